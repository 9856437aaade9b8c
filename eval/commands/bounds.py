"""`python -m eval bounds`: what the paper's grid costs, with proof: bounds of the continuous
problem.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from eval.markdown import picture, table, template
from eval.paper.continuous import DRAWN_DB, Continuous, continuous_of_paper, draw_cells
from irs_gym.files import write_file


def main(out: Path = Path("docs"), tolerance: float = 1e-3) -> int:
    """Bound the continuous problem in the paper's scene and write a page with the distances of the
    grid beside it.

    Writes OUT/bounds.md, and OUT/figures/bounds as .png, .svg and .csv. Takes a few seconds.

    Parameters
    ----------
    out
        Folder of the page.
    tolerance
        (upper - lower) / upper, at most.
    """
    try:
        found = continuous_of_paper(tolerance)
        draw_cells(
            next(each for each in found if each.has_irs and each.target_db == DRAWN_DB),
            out / "figures",
        )
        write_file(out / "bounds.md", bounds_page(found, tolerance).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval bounds: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / 'bounds.md'}, and {out / 'figures'}")
    return 0


def bounds_page(found: Sequence[Continuous], tolerance: float) -> str:
    """The page."""
    return template("bounds.md").format(
        tolerance=100 * tolerance,
        rows=_table(found),
        picture=picture(
            "bounds",
            "Cells by what is proved of them, and the path of the upper bound, at "
            f"{DRAWN_DB:g} dB.",
        ),
        widest=max(each.bounds.gap for each in found) * 100,
        slowest=max(each.seconds for each in found),
    )


def _table(found: Sequence[Continuous]) -> str:
    header = (
        "target (dB)",
        "IRS",
        "grid (m)",
        "any angle, same cells (m)",
        "lower (m)",
        "upper (m)",
        "gap (%)",
        "the grid costs (%)",
        "cells",
        "seconds of one core",
    )
    rows = [
        (
            f"{each.target_db:g}",
            "yes" if each.has_irs else "no",
            f"{each.grid:.3f}",
            f"{each.any_angle:.3f}",
            f"{each.bounds.lower:.4f}",
            f"{each.bounds.upper:.4f}",
            f"{100 * each.bounds.gap:.3f}",
            "{:+.2f} to {:+.2f}".format(*(100 * cost for cost in each.cost)),
            f"{len(each.bounds.cells):,}",
            f"{each.seconds:.1f}",
        )
        for each in found
    ]

    return table(header, rows)
