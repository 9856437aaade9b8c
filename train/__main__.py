"""`python -m train ALGORITHM` trains an agent and writes a run folder; `python -m train sweep FILE` trains many."""

import sys
from collections.abc import Sequence

import tyro

from agents.algorithms import ALGORITHMS, GENERALISTS, Algorithm, Generalist
from agents.checkpoint import RunError
from train.config import parse


def main() -> int:
    """Train the algorithm named first; its settings make the rest of the command line. Returns the exit status."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name == "sweep":
        return _sweep(arguments)
    if name not in (*ALGORITHMS, *GENERALISTS):
        print(f"usage: python -m train {{{','.join([*ALGORITHMS, *GENERALISTS])},sweep}} [--help]")
        return 0 if name in ("-h", "--help") else 2
    return _train(name, arguments)


def _train(algorithm: Algorithm | Generalist, arguments: Sequence[str]) -> int:
    config, program = parse(algorithm, arguments), f"python -m train {algorithm}"

    from train.run import check, train  # here, so that help and mistakes need not wait for PyTorch

    try:
        check(config)
    except (OSError, ValueError) as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 2
    try:
        run, evaluation = train(config)
    except RunError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # before the first step, or for the second time
        print(f"{program}: ended at once", file=sys.stderr)
        return 130
    print(f"{run.folder}: {evaluation.summary}")
    return 130 if evaluation.status == "interrupted" else 0


def _sweep(arguments: Sequence[str]) -> int:
    try:
        from train.sweep import main as sweep
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise
        print('python -m train sweep: Ray is missing: pip install -e ".[train,sweep]"', file=sys.stderr)
        return 2
    return tyro.cli(sweep, args=arguments, prog="python -m train sweep")


if __name__ == "__main__":
    sys.exit(main())
