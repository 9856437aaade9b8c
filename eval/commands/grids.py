"""`python -m eval grids`: the oracle against the published lengths of the MovingAI benchmarks, on a
page.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional, arg

from agents.runs import provenance
from eval.benchmark.published_lengths import (
    DIGITS,
    SOLVERS,
    Comparison,
    Timing,
    compare_lengths,
    longest,
    time_solvers,
)
from eval.markdown import code, table, template
from irs_gym.files import write_file
from irs_gym.radio.readers.movingai import map_of

_MOST_LISTED = 20  # tasks that differ


def main(
    folder: Annotated[Positional[Path], arg(metavar="FOLDER")],
    out: Path = Path("docs"),
    timing: bool = True,
) -> int:
    """Compare the oracle, without corner cutting, with every length that the scenario files of a
    folder print, and write OUT/grids.md; fails where one differs by more than its rounding.

    Parameters
    ----------
    folder
        Of scenario files (*.scen) and their maps (*.map), however deep.
    out
        Folder of the page.
    timing
        Time networkx and scikit-image as well, on the longest task of each file.
    """
    try:
        files = sorted(folder.rglob("*.scen")) if folder.is_dir() else []
        if not files:
            raise FileNotFoundError(f"folder={str(folder)!r} holds no scenario file (*.scen)")

        comparisons = [_compared(file, folder) for file in files]
        timings = {
            file.name: time_solvers(map_of(file, each.scenarios, folder), longest(each))
            for file, each in zip(files, comparisons, strict=True)
            if timing
        }
    except (OSError, ValueError) as error:
        print(f"python -m eval grids: {error}", file=sys.stderr)
        return 2

    out.mkdir(parents=True, exist_ok=True)
    write_file(out / "grids.md", grids_page(comparisons, timings).encode())
    print(f"written: {out / 'grids.md'}")

    return 0 if all(each.is_equal.all() for each in comparisons) else 1


def _compared(file: Path, folder: Path) -> Comparison:
    """One file, with a line for the terminal."""
    found = compare_lengths(file, folder)
    print(
        f"{found.name}: {np.count_nonzero(found.is_equal)} of {len(found.lengths)} lengths agree, "
        f"the worst differs by {found.differences.max():.3g} cells; {found.seconds:.1f} s"
    )
    return found


def grids_page(comparisons: Sequence[Comparison], timings: Mapping[str, Sequence[Timing]]) -> str:
    """The page."""
    equal = sum(int(np.count_nonzero(each.is_equal)) for each in comparisons)
    units = max(float((each.differences / each.units).max()) for each in comparisons)

    return template("grids.md").format(
        equal=equal,
        tasks=sum(len(each.lengths) for each in comparisons),
        files=len(comparisons),
        worst=max(float(each.differences.max()) for each in comparisons),
        units=units,
        digits=DIGITS,
        rows=lengths_table(comparisons),
        differing=differing_section(comparisons),
        timings=timings_section(timings) if timings else "",
        processor=provenance.processor(),
        versions=", ".join(f"{name} {number}" for name, number in provenance.versions().items()),
        commit=provenance.commit() or "unknown",
    )


def lengths_table(comparisons: Sequence[Comparison]) -> str:
    """A row a file."""
    header = (
        "scenario file",
        "free cells",
        "lengths",
        "agree",
        "worst difference, cells",
        "in the sixth digit",
        "seconds of one core",
    )
    return table(
        header,
        [
            (
                code(each.name),
                f"{each.cells:,}",
                f"{len(each.lengths):,}",
                f"{np.count_nonzero(each.is_equal):,}",
                f"{each.differences.max():.2g}",
                f"{(each.differences / each.units).max():.3f}",
                f"{each.seconds:.1f}",
            )
            for each in comparisons
        ],
    )


def differing_section(comparisons: Sequence[Comparison]) -> str:
    """The first tasks whose lengths do not agree; empty where all do."""
    rows = [
        (
            code(each.name),
            each.scenarios[n].start,
            each.scenarios[n].goal,
            code(each.scenarios[n].printed),
            f"{each.lengths[n]:.8g}",
        )
        for each in comparisons
        for n in np.flatnonzero(~each.is_equal).tolist()
    ]
    if not rows:
        return ""

    header = ("scenario file", "start (i, j)", "goal (i, j)", "printed", "found")
    more = f"\n\nand {len(rows) - _MOST_LISTED} more." if len(rows) > _MOST_LISTED else ""

    return f"## Lengths that differ\n\n{table(header, rows[:_MOST_LISTED])}{more}\n"


def timings_section(timings: Mapping[str, Sequence[Timing]]) -> str:
    """Seconds of each solver, by file."""
    rows = [
        (
            code(name),
            *("not installed" if each.seconds is None else f"{each.seconds:.3g}" for each in its),
            ", ".join(sorted({f"{each.length:.6g}" for each in its if each.length is not None})),
        )
        for name, its in timings.items()
    ]
    header = ("scenario file", *(name for name, *_ in SOLVERS), "lengths, cells")
    words = template("grids_time.md")

    return words.format(rows=table(header, rows))
