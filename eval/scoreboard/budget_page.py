"""`budget_page`: what is learned under hard budgets and bounds on the expected cost, as a page."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from eval.estimates import estimate_cell
from eval.markdown import table, template, text
from eval.origin import commands_block, origin_text


def budget_page(board: Mapping[str, Any]) -> str:
    """The page of what `eval.commands.budget` has found."""
    return template("budget.md").format(
        runs=board["runs"],
        commands=commands_block(board["commands"]),
        expected=expected_table(board["expected"]),
        penalties=penalties_table(board["expected"]),
        hard=hard_table(board["hard"]),
        left_out=left_out_text(board["left_out"]),
        origin=origin_text(board),
    )


def expected_table(found: Sequence[Mapping[str, Any]]) -> str:
    """A row for each bound on the expected cost."""
    if not found:
        return "No run has ended."

    header = (
        *("problem", "seeds", "expected cost", "at most", "seeds within", "mean distance"),
        *("hull", "gap to the hull", "seconds"),
    )
    rows = []

    for each in found:
        estimates = each["estimates"]
        seeds = len(each["seeds"])
        rows.append(
            (
                text(each["problem"]),
                seeds,
                estimate_cell(estimates["cost"], _shown),
                f"{each['bound']:g}",
                f"{round(estimates['within']['value'] * seeds)} of {seeds}",
                estimate_cell(estimates["distance"], _metres),
                f"{each['optimum']:.3f} m",
                estimate_cell(estimates["gap"], _percent),
                f"{median(each['seconds']):.0f}",
            )
        )

    return table(header, rows)


def penalties_table(found: Sequence[Mapping[str, Any]]) -> str:
    """A row for each price of each problem."""
    if not found:
        return "No run has ended."

    header = (
        *("problem", "price, metres a unit", "trainings", "arrived", "within the bound"),
        *("cost", "distance", "hull at the bound"),
    )
    rows = [
        (
            text(each["problem"]),
            f"{penalty['price']:g}",
            penalty["trainings"],
            penalty["arrived"],
            penalty["within"],
            estimate_cell(penalty["cost"], _shown),
            estimate_cell(penalty["distance"], _metres),
            f"{each['optimum']:.3f} m",
        )
        for each in found
        for penalty in each["penalties"]
    ]

    return table(header, rows)


def hard_table(found: Sequence[Mapping[str, Any]]) -> str:
    """A row for each hard budget, a column for each algorithm."""
    if not found:
        return "No run has ended."

    names = list(dict.fromkeys(each["policy"] for each in found))
    cells = {(each["problem"], each["policy"]): _hard_cell(each) for each in found}
    optima = {each["problem"]: each["optimum"] for each in found}
    rows = [
        (text(problem), f"{optimum:.3f} m", *(cells.get((problem, name), "–") for name in names))
        for problem, optimum in optima.items()
    ]

    return table(("problem", "optimum", *map(text, names)), rows)


def _hard_cell(found: Mapping[str, Any]) -> str:
    said = f"{found['exact']} of {len(found['seeds'])}"
    seconds = found["seconds_to_optimum"]

    return said if seconds is None else f"{said}<br><sub>{seconds:.0f} s</sub>"


def _shown(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.3f}"


def _metres(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.3f} m"


def _percent(value: float | None) -> str:
    return "infinite" if value is None else f"{value:z.2%}"


def left_out_text(left_out: Sequence[Mapping[str, Any]]) -> str:
    """What is left out, and why; nothing where all counts."""
    if not left_out:
        return "No run is left out."

    lines = [f"- {text(each['folder'])}: {text(each['reason'])}" for each in left_out]
    return "\n".join(["Left out:", "", *lines])
