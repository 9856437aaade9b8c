"""`results_below`: the results of all runs below a folder; `told`: the end of a command that makes
a page of them.
"""

import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from rich.progress import track

from eval.scoreboard.results import LeftOut, Result, find_runs, read_results, tell_left_out

Made = tuple[Sequence[object], Sequence[LeftOut], str]
"""The runs of a page and those left out, and the names of the files written."""


def results_below(
    folder: Path, model: str = "best", algorithms: Collection[str] = ()
) -> tuple[list[Result], list[LeftOut]]:
    """Results of the complete runs below a folder, of some algorithms or of all; and what is left
    out.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder.
    ValueError
        Where it holds no such run; the message says what is left out.
    """
    found, left_out = read_results(track(find_runs(folder), "reading runs", transient=True), model)
    results = [each for each in found if not algorithms or each.config.algorithm in algorithms]
    if not results:
        of = f" of {', '.join(algorithms)}" if algorithms else ""
        reasons = "".join(f"\n  {each.folder}: {each.reason}" for each in left_out)
        raise ValueError(f"no complete run{of} lies below {str(folder)!r}{reasons}")

    return results, left_out


def told(command: str, make: Callable[[], Made]) -> int:
    """Make a page and say what it is made of, or why it cannot be; returns the exit status."""
    try:
        runs, left_out, written = make()
    except (OSError, ValueError) as error:
        print(f"python -m eval {command}: {error}", file=sys.stderr)
        return 2

    tell_left_out(left_out)
    print(f"{len(runs)} runs, {len(left_out)} left out; written: {written}")

    return 0
