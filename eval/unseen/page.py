"""`unseen_page`: the page of agents on scenes that they have never seen; and its curve over
training scenes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eval.markdown import code, table, template, template_sections, text
from eval.origin import commands_block, origin_text
from eval.pictures import as_png
from eval.unseen.page_sets import PAGE_SETS
from eval.unseen.policy_results import is_point
from eval.unseen.scene_scores import key_of
from eval.unseen.set_tables import (
    NOTHING,
    clear_table,
    difference_tables,
    left_out_tables,
    score_cell,
    shipped_tables,
    spl_tables,
    success_table,
    these_scenes_table,
    whole_number,
)

FIGURES = "figures/generalisation"  # beside the page
EARLIER_SETS = ("test", "ood-clutter", "ood-irs", "ood-size")


def unseen_page(record: Mapping[str, Any], figures: str) -> str:
    """The page of a record (see `eval.commands.generalisation.record_of`); ``figures`` is the
    folder that it links to.
    """
    shown = [
        each
        for each in record["entrants"]
        if not each["is_run"]
        or not is_point(each["algorithm"], each["split"], each["training_scenes"])
    ]
    on_map = [each for each in shown if each["track"] == "map"]
    local = [each for each in shown if each["track"] == "local"]
    left_out = record["left_out_families"]
    rates = record["throughput"]
    minutes = {track: seconds / 60 for track, seconds in record["playing"].items()}

    return template("generalisation.md").format(
        commands=commands_block(record["commands"]),
        sets=_sets_table(record["sets"]),
        hard=record["hard"],
        map_agents=_agents_table(on_map),
        map_spl=spl_tables(on_map),
        map_success=success_table(on_map),
        local_agents=_agents_table(local),
        local_spl=spl_tables(local),
        local_success=success_table(local),
        differences=difference_tables(local),
        in_these_scenes=these_scenes_table(local),
        left_out_families=left_out_tables(left_out, local, "local"),
        clear=clear_table(local, left_out),
        shipped=shipped_tables(record["shipped"], record["entrants"]),
        paper=_paper_table([*on_map, *local]),
        curve=_curve_table(curve_of(record)),
        earlier=_earlier_section(record["earlier"]),
        figures=figures,
        scenes=rates["scenes_per_second"],
        maps=rates["maps"],
        steps_64=rates["steps_per_second"]["64"] / 1e6,
        steps_1024=rates["steps_per_second"]["1024"] / 1e6,
        load=rates["load_before"],
        map_minutes=minutes["map"],
        local_minutes=minutes["local"],
        left_out=_left_out_table(record["left_out"]),
        origin=f"{origin_text(record)}{_kept_text(record['entrants'])}",
    )


def draw_scenes_curve(record: Mapping[str, Any]) -> bytes:
    """Test SPL of the planning network over training scenes: the mean and each seed."""
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.add_subplot()

    for subset, colour in (("all", "C0"), ("hard", "C1")):
        _draw_subset(axes, curve_of(record), subset, colour)

    axes.set(xscale="log", xlabel="training scenes", ylabel="SPL")
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:  # a page may have no planner
        axes.legend(fontsize="small")

    return as_png(figure, dpi=110, in_palette=True)


def _draw_subset(
    axes: Axes, planners: Sequence[Mapping[str, Any]], subset: str, colour: str
) -> None:
    """SPL on all test scenes or on the hard ones; where there are none, nothing is drawn."""
    points = [(each["training_scenes"], each["sets"]["test"].get(subset)) for each in planners]
    points = [(scenes, found) for scenes, found in points if found]
    if not points:
        return

    scenes = [n for n, _ in points]
    means = [found["spl"]["value"] for _, found in points]
    axes.plot(scenes, means, "o-", color=colour, label=f"{subset} test scenes")

    for n, found in points:
        seeds = found["spl_by_seed"]
        axes.plot([n] * len(seeds), seeds, ".", color=colour, alpha=0.4)


def curve_of(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The planning networks that differ in the number of usual training scenes alone; those of
    earlier runs where there are no others.
    """

    def found(entrants: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
        planners = [
            each
            for each in entrants
            if each["algorithm"] == "planner"
            and each["learned_on"] == "usual"
            and each["seeds"]
            and "encoding margin" not in each["name"]
        ]
        return sorted(planners, key=lambda each: each["training_scenes"])

    own = found(record["entrants"])
    return own if len(own) > 1 else found(record["earlier"]) or own


# --- tables ---------------------------------------------------------------------------------------


def _sets_table(sets: Mapping[str, Mapping[str, Any]]) -> str:
    """What each set is, and how many of its scenes are played."""
    rows = []

    for name, each in sets["map"].items():
        columns, lines = each["cells"]
        local = sets["local"][name]["scenes"]
        hard = f"{each['hard'] / each['scenes']:.0%}"
        rows.append(
            (
                name,
                f"{each['scenes']:,}",
                f"{local:,}",
                f"{columns}x{lines}",
                hard,
                f"{each['longest']:.0f}",
                PAGE_SETS[name].what,
            )
        )

    header = (
        *("set", "scenes, map track", "local track", "cells", "hard", "longest way (m)"),
        "what it is",
    )
    return table(header, rows)


def _agents_table(entrants: Sequence[Mapping[str, Any]]) -> str:
    """What each policy learned on, what that took, and more of what it did on the test scenes."""
    rows = []

    for each in entrants:
        if each["family"] is not None:
            continue

        whole = each["sets"]["test"]["all"]
        hard = each["sets"]["test"].get("hard")
        rows.append(
            (
                text(each["name"]),
                each["learned_on"] or "",
                whole_number(each["training_scenes"]),
                len(each["seeds"]) or "",
                whole_number(each["steps_per_second"]),
                whole_number(each["seconds"]),
                _ratio_cell(whole["ratio"]),
                f"{whole['exact']:.3f}",
                score_cell(hard["success"] if hard else None),
                score_cell(hard["spl"] if hard else None),
            )
        )

    header = (
        *("policy", "learned on", "training scenes", "seeds", "steps/s", "seconds"),
        *("ratio", "exact", "success, hard", "SPL, hard"),
    )
    return table(header, rows)


def _paper_table(entrants: Sequence[Mapping[str, Any]]) -> str:
    targets = next(each["paper"] for each in entrants if each["paper"])
    header = ["policy", *(f"{each['target_db']:g} dB" for each in targets)]
    rows = [
        [
            text(each["name"]),
            *(f"{at['exact']} of {at['of']}, {_ratio_cell(at['ratio'])}" for at in each["paper"]),
        ]
        for each in entrants
        if each["paper"]
    ]
    return table(header, rows)


def _curve_table(planners: Sequence[Mapping[str, Any]]) -> str:
    rows = []

    for each in planners:
        test = each["sets"]["test"]
        rows.append(
            (
                whole_number(each["training_scenes"]),
                len(each["seeds"]),
                score_cell(test["all"]["success"]),
                score_cell(test["all"]["spl"]),
                score_cell(test["hard"]["spl"] if "hard" in test else None),
            )
        )

    return table(("training scenes", "seeds", "success", "SPL", "SPL, hard"), rows)


def _earlier_section(earlier: Sequence[Mapping[str, Any]]) -> str:
    """What is left of runs whose files are gone; nothing where there are none."""
    shown = [
        each
        for each in earlier
        if not is_point(each["algorithm"], each["split"], each["training_scenes"])
    ]
    if not shown:
        return ""

    rows = []
    for each in shown:
        sets = [each["sets"].get(name, {}).get("all") for name in EARLIER_SETS]
        rows.append(
            (
                text(each["name"]),
                whole_number(each["training_scenes"]),
                len(each["seeds"]),
                *(score_cell(found["spl"]) if found else NOTHING for found in sets),
            )
        )

    section = template_sections("unseen_earlier.md")["Earlier runs"].strip()
    return section.format(rows=table(("policy", "training scenes", "seeds", *EARLIER_SETS), rows))


def _left_out_table(left_out: Sequence[Mapping[str, Any]]) -> str:
    if not left_out:
        return "None: every run below the folder is on the page."

    rows = [(code(each["folder"]), text(each["reason"])) for each in left_out]
    return table(("folder", "why"), rows)


def _kept_text(entrants: Sequence[Mapping[str, Any]]) -> str:
    """Which rows were not played anew, if any, and from which commit they were scored."""
    kept: dict[str, list[str]] = {}
    for each in entrants:
        if "scored_from" in each:
            kept.setdefault(each["scored_from"] or "unknown", []).append(key_of(each))

    return "".join(
        f" Kept as they were, scored from commit {text(commit)}: {text('; '.join(names))}."
        for commit, names in kept.items()
    )


def _ratio_cell(ratio: float | None) -> str:
    return NOTHING if ratio is None else f"{ratio:.4f}"
