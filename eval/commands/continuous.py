"""`python -m eval continuous`: what is learned where the robot goes anywhere on the floor, beside
the exact optimum and the best path over the paper's grid.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from agents.registry import drivers
from agents.runs.problem import Problem
from eval.origin import commands_of, origins
from eval.scoreboard.continuous_page import continuous_page
from eval.scoreboard.continuous_scores import Standing, references_of
from eval.scoreboard.results import Group, LeftOut, Result
from eval.scoreboard.runs_page import Made, results_below, told
from eval.scoreboard.seed_scores import group_names
from irs_gym.files import write_file


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path = Path("docs"),
    trained_by: str | None = None,
    episodes: int = 100,
) -> int:
    """Write continuous.md and continuous.json from the runs of a sweep of `IrsNavContinuous-v0`.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth.
    out
        Folder of the page.
    trained_by
        The command that trained the runs, to stand on the page.
    episodes
        Episodes of the random policy.
    """

    def make() -> Made:
        if episodes < 1:
            raise ValueError(f"episodes={episodes} must be 1 or more")

        results, left_out = results_below(folder, algorithms=drivers())
        board = continuous_board(results, left_out, episodes)
        board["commands"] = commands_of("continuous", trained_by)
        data = json.dumps(board, indent=1, allow_nan=False) + "\n"
        out.mkdir(parents=True, exist_ok=True)
        write_file(out / "continuous.json", data.encode())
        write_file(out / "continuous.md", continuous_page(board).encode())

        return results, left_out, str(out / "continuous.md")

    return told("continuous", make)


def continuous_board(
    results: Sequence[Result], left_out: Sequence[LeftOut], episodes: int
) -> dict[str, Any]:
    """What the page says, for JSON."""
    by_problem: dict[Problem, dict[Group, list[Result]]] = {}
    for each in sorted(results, key=lambda one: (one.problem.order, one.seed)):
        by_problem.setdefault(each.problem, {}).setdefault(each.group, []).append(each)

    groups = [group for found in by_problem.values() for group in found]
    names = group_names(sorted(groups, key=lambda each: drivers().index(each.algorithm)))
    problems = []

    for problem, found in by_problem.items():
        references = references_of(next(iter(found.values()))[0], episodes)
        grid = references["grid oracle"].median
        rows = [Standing.of(names[group], runs, grid) for group, runs in found.items()]
        rows.sort(key=lambda each: list(names.values()).index(each.name))
        problems.append(
            {
                "problem": problem.label,
                "optimum": references["oracle"].median,
                "grid_optimum": grid,
                "goal_radius": problem.goal_radius,
                "speed": problem.speed,
                "time_step": problem.time_step,
                "policies": [each.as_json() for each in (*rows, *references.values())],
            }
        )

    return {
        "format_version": 1,
        "runs": len(results),
        "problems": problems,
        "left_out": [{"folder": each.folder, "reason": each.reason} for each in left_out],
        **origins([each.run for each in results]),
    }
