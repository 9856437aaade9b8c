"""`python -m eval board`: all runs below a folder on one scoreboard, with the references and every
run left out.
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from eval.origin import commands_of
from eval.pictures import write_pictures
from eval.scoreboard.board import build_board
from eval.scoreboard.page import FIGURES, scoreboard_page
from eval.scoreboard.report import html
from eval.scoreboard.runs_page import Made, results_below, told
from irs_gym.files import write_file


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path | None = None,
    model: Literal["best", "last"] = "best",
    episodes: int = 100,
    seed: int = 0,
    trained_by: str | None = None,
) -> int:
    """Put all runs below a folder on one scoreboard, beside the reference policies.

    Writes report.html, one page that holds everything, and into OUT board.json, scoreboard.md and
    its figures.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth; report.html is written there.
    out
        Folder of the other files; by default the same.
    model
        Whether the best or the last state of each agent is scored.
    episodes
        Episodes of each random policy.
    seed
        Seed of the random policies.
    trained_by
        The command that trained the runs, to stand on the page.
    """
    place = out or folder

    def make() -> Made:
        if episodes < 1:
            raise ValueError(f"episodes={episodes} must be 1 or more")

        results, left_out = results_below(folder, model)
        board, pictures = build_board(results, left_out, episodes, seed)
        board["commands"] = commands_of("board", trained_by)
        write(board, pictures, folder, place)

        return results, left_out, f"{folder / 'report.html'}, {place / 'scoreboard.md'}"

    return told("board", make)


def write(board: dict[str, Any], pictures: dict[str, bytes], folder: Path, out: Path) -> None:
    """Write the report into the folder of the runs, all else into ``out``."""
    write_pictures(out / FIGURES, pictures)
    write_file(out / "board.json", (json.dumps(board, indent=1, allow_nan=False) + "\n").encode())
    write_file(out / "scoreboard.md", scoreboard_page(board, FIGURES).encode())
    write_file(folder / "report.html", html(board, pictures).encode())
