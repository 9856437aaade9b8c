"""`python -m eval intervals`: every interval in the documents anew, from the results that are kept
beside them.
"""

import json
import sys
from pathlib import Path
from typing import Any

from eval.coverage import LAWS, SCENES, Coverage, coverages
from eval.markdown import table, template
from eval.scoreboard.ablations import ablations_page
from eval.scoreboard.budget_page import budget_page
from eval.scoreboard.expected_cost import estimated_anew as expected_anew
from eval.scoreboard.page import FIGURES as SCOREBOARD_FIGURES
from eval.scoreboard.page import scoreboard_page
from eval.scoreboard.seed_scores import estimated_anew as board_anew
from eval.unseen.page import FIGURES as UNSEEN_FIGURES
from eval.unseen.page import unseen_page
from eval.unseen.record import DATA_BYTES, SCORES
from eval.unseen.record import estimated_anew as unseen_anew
from eval.unseen.scene_scores import SceneScores
from irs_gym.files import read_file, write_file


def main(out: Path = Path("docs")) -> int:
    """Write intervals.md, and every page whose results are kept with intervals made anew.

    These are scoreboard.md from board.json, ablations.md from ablations.json, budget.md from
    budget.json, and generalisation.md from generalisation.json and generalisation.npz; what is not
    there is left out. No run is needed.

    Parameters
    ----------
    out
        Folder of the pages and of the results.
    """
    try:
        written = [
            name
            for name, make in {
                "board.json": _board,
                "ablations.json": _ablations,
                "budget.json": _budget,
                "generalisation.json": _generalisation,
            }.items()
            if (out / name).exists() and make(out / name, out) is None
        ]
        write_file(out / "intervals.md", intervals_page(coverages()).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval intervals: {error}", file=sys.stderr)
        return 2

    print(f"made anew from {', '.join(written) or 'nothing'}; written: {out / 'intervals.md'}")

    return 0


def _board(path: Path, out: Path) -> None:
    record = board_anew(_read(path))
    _write(record, path)
    write_file(out / "scoreboard.md", scoreboard_page(record, SCOREBOARD_FIGURES).encode())


def _ablations(path: Path, out: Path) -> None:
    record = board_anew(_read(path))
    _write(record, path)
    write_file(out / "ablations.md", ablations_page(record).encode())


def _budget(path: Path, out: Path) -> None:
    record = _read(path)
    record["expected"] = [expected_anew(each) for each in record["expected"]]
    _write(record, path)
    write_file(out / "budget.md", budget_page(record).encode())


def _generalisation(path: Path, out: Path) -> None:
    record = unseen_anew(_read(path), SceneScores.read(out / SCORES))
    _write(record, path)
    write_file(out / "generalisation.md", unseen_page(record, UNSEEN_FIGURES).encode())


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(read_file(path, DATA_BYTES))
    return found


def _write(record: dict[str, Any], path: Path) -> None:
    write_file(path, (json.dumps(record, indent=1, allow_nan=False) + "\n").encode())


# --- the page of intervals ------------------------------------------------------------------------


def intervals_page(found: list[Coverage]) -> str:
    """How often intervals hold, as a page."""
    return template("intervals.md").format(
        scenes=SCENES,
        seeds=_coverage_table([each for each in found if each.spread is None]),
        both=_coverage_table([each for each in found if each.spread is not None]),
    )


def _coverage_table(found: list[Coverage]) -> str:
    """A row for each number of seeds, law and spread."""
    is_crossed = any(each.spread for each in found)
    header = (
        *("seeds", "law"),
        *(("spread of seeds", "of scenes", "of the rest") if is_crossed else ()),
        *("interval holds", "percentile bootstrap holds"),
    )
    rows = [
        (
            each.seeds,
            each.law,
            *(f"{part:g}" for part in each.spread or ()),
            f"{each.held:.1%}",
            f"{each.resampled:.1%}",
        )
        for each in sorted(found, key=lambda one: (one.seeds, LAWS.index(one.law)))
    ]
    return table(header, rows)
