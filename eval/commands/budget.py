"""`python -m eval budget`: what is learned under hard budgets and under bounds on the expected
cost, beside the exact optimum.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Annotated, Any

from tyro.conf import Positional, arg

from agents.registry import ALGORITHMS, specialists
from eval.estimates import finite
from eval.origin import commands_of, origins
from eval.scoreboard.budget_page import budget_page
from eval.scoreboard.expected_cost import Expected
from eval.scoreboard.results import Group, LeftOut, Result
from eval.scoreboard.runs_page import Made, results_below, told
from eval.scoreboard.seed_scores import group_names
from irs_gym.files import write_file


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path = Path("docs"),
    trained_by: str | None = None,
) -> int:
    """Write budget.md and budget.json from the runs of a sweep over budgets.

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
        board = budget_board(results, left_out)
        board["commands"] = commands_of("budget", trained_by)
        data = json.dumps(board, indent=1, allow_nan=False) + "\n"
        out.mkdir(parents=True, exist_ok=True)
        write_file(out / "budget.json", data.encode())
        write_file(out / "budget.md", budget_page(board).encode())

        return results, left_out, str(out / "budget.md")

    return told("budget", make)


def budget_board(results: Sequence[Result], left_out: Sequence[LeftOut]) -> dict[str, Any]:
    """What the page says, for JSON."""
    by_group: dict[Group, list[Result]] = {}
    for each in sorted(results, key=lambda one: (one.problem.order, one.seed)):
        by_group.setdefault(each.group, []).append(each)

    mixed = [found for group, found in by_group.items() if ALGORITHMS[group.algorithm].mixes]
    hard = {
        group: found for group, found in by_group.items() if not ALGORITHMS[group.algorithm].mixes
    }
    ordered = sorted(hard, key=lambda each: specialists().index(each.algorithm))

    # each problem has settings of its own, so that only what differs within one is told
    names: dict[Group, str] = {}
    for problem in dict.fromkeys(each.problem for each in ordered):
        names |= group_names([each for each in ordered if each.problem == problem])

    return {
        "format_version": 1,
        "runs": len(results),
        "expected": [Expected.of(found).as_json() for found in mixed],
        "hard": [_hard_record(hard[group], names[group]) for group in ordered],
        "left_out": [{"folder": each.folder, "reason": each.reason} for each in left_out],
        **origins([each.run for each in results]),
    }


def _hard_record(results: Sequence[Result], name: str) -> dict[str, Any]:
    seconds = median([each.seconds_to_optimum for each in results])
    return {
        "problem": results[0].problem.label,
        "policy": name,
        "optimum": results[0].episode.oracle_distance,
        "seeds": [each.seed for each in results],
        "exact": sum(each.episode.is_optimal for each in results),
        "seconds_to_optimum": finite(seconds),
    }
