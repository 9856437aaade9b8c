"""`continuous_page`: what is learned where the robot goes anywhere on the floor, as a page."""

from collections.abc import Mapping
from typing import Any

from agents.networks.place_extractor import WAVES
from eval.estimates import estimate_cell
from eval.markdown import table, template, text
from eval.origin import commands_block, origin_text
from eval.scoreboard.budget_page import left_out_text
from eval.scoreboard.continuous_scores import FINER


def continuous_page(board: Mapping[str, Any]) -> str:
    """The page of what `eval.commands.continuous` has found."""
    return template("continuous.md").format(
        runs=board["runs"],
        waves=WAVES,
        commands=commands_block(board["commands"]),
        problems="\n\n".join(map(problem_section, board["problems"])),
        left_out=left_out_text(board["left_out"]),
        origin=origin_text(board),
    )


def problem_section(found: Mapping[str, Any]) -> str:
    """A row for each policy on one problem, under its optima."""
    finer = " and ".join(f"{found['time_step'] / parts:g}" for parts in FINER)
    header = (
        *("policy", "seeds", "success", "shorter than the grid's", "median distance"),
        *(f"replayed in steps of {finer} s", "median ratio to the optimum", "SPL", "seconds"),
    )
    rows = [_row(each) for each in found["policies"]]
    saving = 1 - found["optimum"] / found["grid_optimum"]

    return "\n\n".join(
        [
            f"## {text(found['problem'])}",
            f"Optimum {found['optimum']:.3f} m, best path over the grid "
            f"{found['grid_optimum']:.3f} m: {saving:.1%} could be saved. Both end at the goal's "
            f"disc of {found['goal_radius']:g} m. A step takes {found['time_step']:g} s: at full "
            f"speed {found['speed'] * found['time_step']:g} m.",
            table(header, rows),
        ]
    )


def _row(each: Mapping[str, Any]) -> tuple[Any, ...]:
    estimates = each["estimates"]
    number = len(each["seeds"])
    successes = round(estimates["success"]["value"] * number)
    is_learned = each["kind"] == "learned"

    return (
        text(each["name"]) if is_learned else f"*{text(each['name'])}*",
        number if is_learned else "",
        _share(successes, number, estimates["success"], is_learned),
        _share(each["shorter"], number, estimates["shorter"], is_learned),
        _metres(each["median"]),
        ", ".join(map(_metres, each["replayed"])),
        estimate_cell(estimates["ratio"], lambda value: "–" if value is None else f"{value:.4f}"),
        estimate_cell(estimates["spl"], "{:.3f}".format),
        estimate_cell(
            estimates.get("seconds"), lambda value: "none" if value is None else f"{value:.0f}"
        ),
    )


def _metres(distance: float | None) -> str:
    return "–" if distance is None else f"{distance:.3f} m"


def _share(count: int, number: int, found: Mapping[str, Any], is_learned: bool) -> str:
    """So many of so many, with the interval of the share where seeds were drawn."""
    said = f"{count} of {number}"
    return (
        estimate_cell(found, lambda value: said if value == found["value"] else f"{value:.0%}")
        if is_learned
        else said
    )
