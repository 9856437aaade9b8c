"""`ablations_page`: what each part of the task and of the setting is worth, as a page."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from eval.markdown import table, template, template_sections, text
from eval.origin import commands_block, origin_text
from eval.scoreboard.page import count_of, seed_scores_table
from eval.scoreboard.return_variance import DETOUR, ReturnVariance

DISCOUNTS = "What separates routes that differ by 2 %"  # title of that section of the page


def ablations_page(board: Mapping[str, Any]) -> str:
    """The page of a board over variants on one problem (see `eval.scoreboard.board`), with the
    paths of its learning curves, ``"figures"``, and the scatter of the problem's returns,
    ``"discounts"``.
    """
    (problem,) = board["problems"]
    standings = [each for each in problem["standings"] if each["kind"] == "learned"]
    curves = [f"![Learning curves of the variants]({each})" for each in board["figures"]]

    return template("ablations.md").format(
        problem=text(problem["label"]),
        runs=len(board["runs"]),
        usual=text(standings[0]["name"]),
        commands=commands_block(board["commands"]),
        scores=seed_scores_table(standings),
        worth=_worth_table(standings),
        curves="\n\n".join(curves),
        origin=origin_text(board),
        **_discounts_fields(problem["oracle_distance"], _variances(board["discounts"])),
    )


def discounts_section(oracle_distance: float, found: Sequence[ReturnVariance]) -> str:
    """What the discount does to the problem itself, whoever learns it."""
    section = template_sections("ablations.md")[DISCOUNTS]
    return section.format(**_discounts_fields(oracle_distance, found))


def _discounts_fields(oracle_distance: float, found: Sequence[ReturnVariance]) -> dict[str, Any]:
    return {
        "detour": DETOUR,
        "metres": DETOUR * oracle_distance,
        "discounts": _discounts_table(found),
    }


def _variances(kept: Sequence[Mapping[str, Any]]) -> list[ReturnVariance]:
    """From JSON, where null stands for infinity."""
    return [
        ReturnVariance(**{**each, "ratio": inf if each["ratio"] is None else each["ratio"]})
        for each in kept
    ]


def _worth_table(standings: Sequence[Mapping[str, Any]]) -> str:
    """Each variant's median steps to the optimum in terms of the default's, which stands first."""
    default = standings[0]["estimates"]["steps_to_optimum"]["value"]
    rows = []

    for each in standings:
        found = each["estimates"]
        steps = found["steps_to_optimum"]["value"] if found else None
        if steps is None or default is None:
            times = "never in half of the seeds"
        else:
            times = f"{steps / default:.2f}"

        arrived = count_of(each, "at_optimum") if found else "0 of 0"
        rows.append((text(each["name"]), times, arrived))

    return table(("variant", "times the default's steps", "seeds at the optimum"), rows)


def _discounts_table(found: Sequence[ReturnVariance]) -> str:
    header = (
        "discount",
        "best path over the oracle's",
        "longer from",
        "scatter of the return, metres",
        "returns to average",
    )
    rows = [
        (
            each.gamma,
            f"{each.ratio:.3f}",
            each.longer,
            f"{each.spread:,.2f}",
            f"{each.episodes:,.0f}",
        )
        for each in found
    ]
    return table(header, rows)
