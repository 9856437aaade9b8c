"""`python -m eval ablations`: what each part of the task and of the setting is worth, in steps to
the optimum.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from agents.rollout.episode import evaluation_env
from eval.estimates import finite
from eval.origin import commands_of
from eval.pictures import write_pictures
from eval.scoreboard.ablations import ablations_page
from eval.scoreboard.board import build_board
from eval.scoreboard.return_variance import return_variances
from eval.scoreboard.runs_page import Made, results_below, told
from irs_gym.files import write_file

FIGURES = "figures/ablations"
GAMMAS = (0.95, 0.97, 0.98, 0.99, 0.995, 0.999, 1.0)


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path = Path("docs"),
    trained_by: str | None = None,
) -> int:
    """Write ablations.md, its data and its figures from a sweep over variants on one problem.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth.
    out
        Folder of the page.
    trained_by
        The command that trained the runs, to stand on the page.
    """

    def make() -> Made:
        results, left_out = results_below(folder)
        problems = {each.problem for each in results}
        if len(problems) != 1:
            raise ValueError(
                f"{str(folder)!r} holds runs on {len(problems)} problems: ablations are of one"
            )

        # One episode of each random reference is enough: the page leaves the references out.
        board, pictures = build_board(results, left_out, episodes=1, seed=0)
        board["commands"] = commands_of("ablations", trained_by)
        env: Any = evaluation_env(results[0].run.task).unwrapped
        found = return_variances(env.world, GAMMAS)

        curves = {
            name: picture for name, picture in pictures.items() if name.endswith("-curves.png")
        }
        write_pictures(out / FIGURES, curves)
        board["figures"] = [f"{FIGURES}/{name}" for name in curves]
        board["discounts"] = [{**asdict(each), "ratio": finite(each.ratio)} for each in found]
        data = json.dumps(board, indent=1, allow_nan=False) + "\n"
        write_file(out / "ablations.json", data.encode())
        write_file(out / "ablations.md", ablations_page(board).encode())

        return results, left_out, str(out / "ablations.md")

    return told("ablations", make)
