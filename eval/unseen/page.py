"""`unseen_page`: the page of agents on scenes that they have never seen; and its curve over
training scenes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eval.estimates import estimate_cell
from eval.markdown import code, table, template, template_sections, text
from eval.origin import commands_block, origin_text
from eval.pictures import as_png
from eval.unseen.policy_results import is_point
from eval.unseen.scene_scores import RIVALS

FIGURES = "figures/generalisation"  # beside the page
KINDS = {  # of scenes, by the name of a set
    "test": "the training scenes' kind",
    "ood-clutter": "13 to 24 boxes, more than in any training scene",
    "ood-irs": "no panel, two, or one with fewer or more elements than any training scene's",
    "ood-size": "twice the sides, and as many boxes for the area",
    "ood-rooms": "walls with doors: 4 to 10 rooms, and 4 boxes at most",
    "paper": "the paper's scene at five targets",
}
LARGEST_KIND = "four times the sides, and as many boxes for the area"


def unseen_page(record: Mapping[str, Any], figures: str) -> str:
    """The page of a record (see `eval.commands.generalisation.record_of`); ``figures`` is the
    folder that it links to.
    """
    shown = [
        each
        for each in record["entrants"]
        if not is_point(each["algorithm"], each["training_scenes"])
    ]
    on_map = [each for each in shown if each["track"] == "map"]
    local = [each for each in shown if each["track"] == "local"]
    sets = record["sets"]
    rates = record["throughput"]

    return template("generalisation.md").format(
        commands=commands_block(record["commands"]),
        sets=_sets_rows(sets["map"]),
        hard=record["hard"],
        map_scores=_scores_table(on_map),
        map_elsewhere=_elsewhere_table(on_map, sets["map"]),
        large_scenes=sets["local"]["ood-size"]["scenes"],
        local_scores=_scores_table(local),
        local_elsewhere=_elsewhere_table(local, sets["local"]),
        intervals=_intervals_text(record["over"], "all"),
        differences=_intervals_text(record["over"], "differences"),
        clear=_clear_table(local, sets["local"]),
        shipped=_shipped_table(record),
        pretrained=_pretrained_section(record.get("pretrained")),
        paper=_paper_table([*on_map, *local]),
        curve=_curve_table(record["entrants"]),
        figures=figures,
        scenes=rates["scenes_per_second"],
        maps=rates["maps"],
        steps_64=rates["steps_per_second"]["64"] / 1e6,
        steps_1024=rates["steps_per_second"]["1024"] / 1e6,
        load=rates["load_before"],
        left_out=_left_out_table(record["left_out"]),
        origin=origin_text(record),
    )


def draw_scenes_curve(entrants: Sequence[Mapping[str, Any]]) -> bytes:
    """Test SPL of the planning network over training scenes: the mean and each seed."""
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.add_subplot()

    for subset, colour in (("all", "C0"), ("hard", "C1")):
        _draw_subset(axes, curve_of(entrants), subset, colour)

    axes.set(xscale="log", xlabel="training scenes", ylabel="SPL")
    axes.grid(alpha=0.3)
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


def curve_of(entrants: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The planning networks that differ in the number of training scenes alone."""
    planners = [
        each
        for each in entrants
        if each["algorithm"] == "planner" and "encoding margin" not in each["name"]
    ]
    return sorted(planners, key=lambda each: each["training_scenes"])


# --- tables ---------------------------------------------------------------------------------------


def _sets_rows(sets: Mapping[str, Any]) -> str:
    rows = []

    for name, each in sets.items():
        columns, lines = each["cells"]
        kind = KINDS.get(name, LARGEST_KIND)
        rows.append(
            f"| {name} | {each['scenes']:,} | {columns} x {lines} | {each['hard']} | {kind} |"
        )

    return "\n".join(rows)


def _pretrained_section(found: Mapping[str, Any] | None) -> str:
    """How the models that come with the package do on the set of rooms; nothing where it was not
    asked.
    """
    if found is None:
        return ""

    header = (
        *("policy", "sees", "success", "SPL", "ratio", "exact"),
        *("success, hard", "SPL, hard"),
    )
    rows = [
        (
            text(each["name"]),
            "the map" if each["track"] == "map" else "a patch",
            *(_plain_cell(each["all"][name]) for name in ("success", "spl", "ratio", "exact")),
            *(_plain_cell(each["hard"][name]) for name in ("success", "spl")),
        )
        for each in found["rows"]
    ]

    section = template_sections("rooms.md")["Rooms with doors"].strip()
    return section.format(
        set=found["set"], scenes=found["scenes"], hard=found["hard"], rows=table(header, rows)
    )


def _plain_cell(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _intervals_text(over: str, of: str) -> str:
    """What intervals are over, in words: all, or those of differences."""
    section = template_sections("unseen_intervals.md")[f"{of}, over {over}"]
    return section.partition("\n")[2].strip()


def _shipped_table(record: Mapping[str, Any]) -> str:
    """The models that come with the package beside the means of their seeds, on each set."""
    if not record["shipped"]:
        return "None of the models in `models/` is one of the seeds above."

    entrants = {(each["name"], each["training_scenes"]): each for each in record["entrants"]}
    names = [name for name in KINDS if any(name in each["spl"] for each in record["shipped"])]
    names = [name for name in names if name != "paper"]
    rows = []

    for each in record["shipped"]:
        entrant = entrants[each["name"], each["training_scenes"]]
        row = [
            text(each["name"]),
            _whole_number(each["training_scenes"]),
            f"{each['seed']}, of {each['chosen_among']} runs",
            f"{each['validation_spl']:.4f}",
        ]
        for name in names:
            if name not in each["spl"]:
                row.append("–")
                continue

            mean = entrant["sets"][name]["all"]["spl"]["value"]
            row.append(f"{_score_cell(each['spl'][name])}<br>(seeds: {mean:.4f})")

        rows.append(row)

    header = ("policy", "training scenes", "seed", "validation SPL", *names)
    return table(header, rows)


def _clear_table(entrants: Sequence[Mapping[str, Any]], sets: Mapping[str, Any]) -> str:
    """On which sets a learned policy differs from a rival, and on which that is open."""
    rivals = _rivals(entrants)
    rows = []

    for each in entrants:
        for rival in rivals if each["seeds"] else ():
            found: dict[str, list[str]] = {"above": [], "below": [], "open": []}

            for name in sets:
                if name != "paper" and name in each["sets"]:
                    interval = each["sets"][name]["all"][rival]["interval"]
                    found[_side(interval)].append(name)

            cells = (", ".join(names) or "–" for names in found.values())
            rows.append((text(each["name"]), rival.replace("_", " "), *cells))

    return table(("policy", "difference", "above zero", "below zero", "open"), rows)


def _side(interval: Sequence[float] | None) -> str:
    """Where an interval of a difference lies."""
    if interval is None or interval[0] <= 0.0 <= interval[1]:
        return "open"

    return "above" if interval[0] > 0.0 else "below"


def _rivals(entrants: Sequence[Mapping[str, Any]]) -> list[str]:
    """Whom they are compared with: ``"over_replanning"`` and so on."""
    return [
        name
        for name in RIVALS.values()
        if any(name in each["sets"]["test"]["all"] for each in entrants)
    ]


def _rival_titles(rivals: Sequence[str]) -> list[str]:
    return [name.replace("_", " ") for name in rivals]


def _scores_table(entrants: Sequence[Mapping[str, Any]]) -> str:
    """Scores on the test scenes, and what training took."""
    rivals = _rivals(entrants)
    header = [
        *("policy", "training scenes", "seeds", "success", "SPL", "ratio", "exact"),
        *("success, hard", "SPL, hard"),
        *_rival_titles(rivals),
        *("steps/s", "seconds"),
    ]
    rows = []

    for each in entrants:
        whole = each["sets"]["test"]["all"]
        hard = each["sets"]["test"].get("hard")
        row = [
            text(each["name"]),
            _whole_number(each["training_scenes"]),
            len(each["seeds"]) or "",
            _score_cell(whole["success"]),
            _score_cell(whole["spl"]),
            _ratio_cell(whole["ratio"]),
            f"{whole['exact']:.3f}",
            _score_cell(hard["success"] if hard else None),
            _score_cell(hard["spl"] if hard else None),
        ]
        row += [_difference_cell(whole.get(name)) for name in rivals]
        row += [_whole_number(each["steps_per_second"]), _whole_number(each["seconds"])]
        rows.append(row)

    return table(header, rows)


def _elsewhere_table(entrants: Sequence[Mapping[str, Any]], sets: Mapping[str, Any]) -> str:
    """Success and SPL on the sets of other kinds."""
    names = [name for name in sets if name not in ("test", "paper")]
    rivals = _rivals(entrants)
    rows = []

    for each in entrants:
        row = [text(each["name"])]

        for name in names:
            found = each["sets"].get(name)
            if found is None:  # it cannot play maps of this size
                row += ["–"] * (1 + len(rivals))
                continue

            whole = found["all"]
            row.append(f"{whole['success']['value']:.3f}, {_score_cell(whole['spl'])}")
            row += [_difference_cell(whole.get(rival)) for rival in rivals]

        rows.append(row)

    header = ["policy"]
    for name in names:
        header += [name, *_rival_titles(rivals)]

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


def _curve_table(entrants: Sequence[Mapping[str, Any]]) -> str:
    rows = []

    for each in curve_of(entrants):
        test = each["sets"]["test"]
        rows.append(
            (
                _whole_number(each["training_scenes"]),
                len(each["seeds"]),
                _score_cell(test["all"]["success"]),
                _score_cell(test["all"]["spl"]),
                _score_cell(test["hard"]["spl"] if "hard" in test else None),
            )
        )

    return table(("training scenes", "seeds", "success", "SPL", "SPL, hard"), rows)


def _left_out_table(left_out: Sequence[Mapping[str, Any]]) -> str:
    if not left_out:
        return "None: every run below the folder is on the page."

    rows = [(code(each["folder"]), text(each["reason"])) for each in left_out]
    return table(("folder", "why"), rows)


# --- cells ----------------------------------------------------------------------------------------


def _score_cell(found: Mapping[str, Any] | None) -> str:
    return estimate_cell(found, "{:.4f}".format)


def _difference_cell(found: Mapping[str, Any] | None) -> str:
    """With the sign, also where it is plus."""
    return estimate_cell(found, "{:+.4f}".format)


def _ratio_cell(ratio: float | None) -> str:
    return "–" if ratio is None else f"{ratio:.4f}"


def _whole_number(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"
