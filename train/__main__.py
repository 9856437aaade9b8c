"""`python -m train ALGORITHM` trains an agent and writes a run folder; `python -m train sweep FILE`
trains many; `python -m train dataset` and `python -m train scenes` write what there is to learn
from.
"""

import sys
from collections.abc import Sequence
from functools import partial

from agents.runs.interruption import ALL, exit_at_once, interruptible

# All else is imported in functions: a Ctrl-C meanwhile ends in one line, and help need not wait for
# PyTorch.


def main() -> int:
    """Train the algorithm named first; its settings make the rest of the command line. Returns the
    exit status.
    """
    from agents.registry import ALGORITHMS

    name, *arguments = sys.argv[1:] or ["--help"]
    if name == "sweep":
        return _sweep(arguments)
    if name in ("dataset", "scenes"):
        return _datasets(name, arguments)

    if name not in ALGORITHMS:
        print(f"usage: python -m train {{{','.join(ALGORITHMS)},sweep,dataset,scenes}} [--help]")
        return 0 if name in ("-h", "--help") else 2

    return _train(name, arguments)


def _train(algorithm: str, arguments: Sequence[str]) -> int:
    from train.config import parse

    config = parse(algorithm, arguments)
    program = f"python -m train {algorithm}"

    from agents.runs.run_folder import RunError
    from train.run import check, train

    def train_and_tell() -> int:
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
        except OSError as error:  # a full disk, say
            print(f"{program}: {error}", file=sys.stderr)
            return 1

        print(f"{run.folder}: {evaluation.summary}")
        return 128 + evaluation.signal if evaluation.is_interrupted else 0

    return interruptible(program, train_and_tell, ALL)


def _datasets(name: str, arguments: Sequence[str]) -> int:
    import tyro

    from train.datasets import commands

    program = f"python -m train {name}"
    command = getattr(commands, name)
    flat = (tyro.conf.OmitArgPrefixes,)
    run = partial(tyro.cli, command, args=arguments, prog=program, config=flat)

    return interruptible(program, run, ALL)


def _sweep(arguments: Sequence[str]) -> int:
    import tyro

    program = "python -m train sweep"

    try:
        from train.sweep import main as sweep
    except ModuleNotFoundError as error:
        if error.name != "ray":
            raise

        print(f'{program}: Ray is missing: pip install -e ".[train,sweep]"', file=sys.stderr)
        return 2

    return interruptible(program, partial(tyro.cli, sweep, args=arguments, prog=program), ALL)


if __name__ == "__main__":
    exit_at_once("python -m train")
    sys.exit(main())
