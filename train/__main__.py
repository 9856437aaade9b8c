"""`python -m train ALGORITHM`: trains an agent and writes a run folder."""

import sys

from agents.checkpoint import RunError
from train.config import DEFAULTS, parse


def main() -> int:
    """Train the algorithm named first; its settings make the rest of the command line. Returns the exit status."""
    algorithm, *arguments = sys.argv[1:] or ["--help"]
    if algorithm not in DEFAULTS:
        print(f"usage: python -m train {{{','.join(DEFAULTS)}}} [--help]")
        return 0 if algorithm in ("-h", "--help") else 2
    config = parse(algorithm, arguments)

    from train.run import check, train  # here, so that help and mistakes need not wait for PyTorch

    try:
        check(config)
    except (OSError, ValueError) as error:
        print(f"python -m train {algorithm}: {error}", file=sys.stderr)
        return 2
    try:
        run, evaluation = train(config)
    except RunError as error:
        print(f"python -m train {algorithm}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # before the first step, or for the second time
        print(f"python -m train {algorithm}: ended at once", file=sys.stderr)
        return 130
    print(f"{run.folder}: {evaluation.summary}")
    return 130 if evaluation.status == "interrupted" else 0


if __name__ == "__main__":
    sys.exit(main())
