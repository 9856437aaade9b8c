"""`markdown`: the page of agents on scenes that they have never seen; and its curve over training
scenes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from eval.markdown import code, page, table, text
from eval.pictures import as_png
from eval.scoreboard.page import origin
from eval.unseen.policy_results import is_point

INTRODUCTION = """# Factories never seen

How agents that learned on generated scenes do on others, scored against the exact optimum of each. Made by

{commands}

| set | scenes | cells | hard | what it is |
|---|---|---|---|---|
{sets}

All sets but the last two are the frozen ones of `IrsNavRandom-v0`, version 0; no agent has learned on a scene of
theirs. *Hard* scenes have a detour (oracle's distance over octile distance) above {hard:g}. Each policy plays one
greedy episode in each scene, of max(400, 5 (X + Y)) steps at most on maps of X x Y cells. *SPL* is success weighted by
path length, *ratio* the mean distance over the oracle's in the successes alone, *exact* the share of scenes whose path
is as short as the oracle's (to 1e-9). Below a figure is its 95 % interval from resampling whole seeds; † marks figures
that are equal in all seeds, which is not to say that the next seed would be equal too. A row with one seed has no
interval."""

MAP = """## Map track

The agent sees the whole radio map. The planning networks have value iteration built in: what they learn is what
each move costs. The value-iteration network is that of Tamar et al. (2016). The U-Net knows nothing of paths."""

LOCAL = """## Local track

The agent sees its position, the gains in the 11 x 11 cells around it and what IRS there is. The optimum with full
knowledge is then a bound that nobody can always reach, so the reference is *optimistic replanning*: Dijkstra over what
the robot has seen, the unknown taken for feasible, which is what D* Lite computes. The column *over replanning* is the
mean difference in SPL on the same scenes, with an interval from resampling seeds and scenes. In the set of large maps
the first {large_scenes} scenes count, as every step costs a plan.

The explorers have a dynamic programme built in, which plans over what they remember: what they learn is how much to
distrust the unknown, and where. The untrained one takes all of it to be about an eighth longer than it is."""

PAPER = """## The paper's scene

It is in no training set. For each target: seeds whose path is as short as the oracle's, and the mean ratio of those
that reached the goal."""

CURVE = """## How many training scenes it takes

The planning network with the mask as its input, by imitation, with the same number of updates."""

GALLERY = """## Where they do well, and where they fail

Seed 0 of each on the test scenes: two with the longest detours among those solved at an SPL above 0.95, then its two
worst."""

THROUGHPUT = """## Throughput

| what | a second |
|---|---|
| scenes generated, with radio map and oracle, one process | {scenes:.0f} |
| steps of the vector environment over {maps:,} maps, 64 robots | {steps_64:.2f} M |
| steps of the vector environment over {maps:,} maps, 1,024 robots | {steps_1024:.2f} M |

Measured at the end of the command above, with a load of {load:.1f} before it: other work on the machine slows it down.
The columns *steps/s* and *seconds* in the tables are of training on one thread, tests included, beside other runs; in
imitation over whole maps a step is a scene, each of which gives a label for every cell."""


def markdown(record: Mapping[str, Any], figures: str) -> str:
    """The page of a record (see `eval.commands.generalisation.record_of`); ``figures`` is the
    folder that it links to.
    """
    shown = [
        each
        for each in record["entrants"]
        if not is_point(each["algorithm"], each["training_scenes"])
    ]
    by_track = {
        track: [each for each in shown if each["track"] == track] for track in ("map", "local")
    }
    local_sets = record["sets"]["local"]
    found = record["throughput"]
    introduction = INTRODUCTION.format(
        commands="\n".join(f"    {each}" for each in record["commands"] if each),
        sets=_sets(record["sets"]["map"]),
        hard=record["hard"],
    )
    steps = {name: rate / 1e6 for name, rate in found["steps_per_second"].items()}

    return page(
        introduction,
        MAP, _scores(by_track["map"]), _elsewhere(by_track["map"], record["sets"]["map"]),
        LOCAL.format(large_scenes=local_sets["ood-size"]["scenes"]), _scores(by_track["local"]),
        _elsewhere(by_track["local"], local_sets),
        PAPER, _paper([*by_track["map"], *by_track["local"]]),
        CURVE, _curve(record["entrants"]), f"![Test SPL over training scenes]({figures}/scenes.png)",
        GALLERY, f"![Successes and failures]({figures}/gallery.png)",
        THROUGHPUT.format(scenes=found["scenes_per_second"], maps=found["maps"], steps_64=steps["64"],
                          steps_1024=steps["1024"], load=found["load_before"]),
        _left_out(record["left_out"]), origin(record),
    )  # fmt: skip


def draw_scenes_curve(entrants: Sequence[Mapping[str, Any]]) -> bytes:
    """Test SPL of the planning network over the number of training scenes: the mean and each seed."""
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.add_subplot()

    for subset, colour in (("all", "C0"), ("hard", "C1")):
        points = [
            (each["training_scenes"], each["sets"]["test"].get(subset))
            for each in curve_of(entrants)
        ]
        points = [(scenes, found) for scenes, found in points if found]
        axes.plot(*zip(*((n, found["spl"]["value"]) for n, found in points), strict=True), "o-", color=colour,
                  label=f"{subset} test scenes") if points else None  # fmt: skip

        for n, found in points:
            axes.plot(
                [n] * len(found["spl_by_seed"]), found["spl_by_seed"], ".", color=colour, alpha=0.4
            )

    axes.set(xscale="log", xlabel="training scenes", ylabel="SPL")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")

    return as_png(figure, dpi=110, in_palette=True)


def curve_of(entrants: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The planning networks that differ in the number of training scenes alone."""
    planners = [
        each
        for each in entrants
        if each["algorithm"] == "planner" and "encoding margin" not in each["name"]
    ]
    return sorted(planners, key=lambda each: each["training_scenes"])


def _sets(sets: Mapping[str, Any]) -> str:
    what = {
        "test": "the training scenes' kind",
        "ood-clutter": "13 to 24 boxes, more than in any training scene",
        "ood-irs": "no panel, two, or one with fewer or more elements than any training scene's",
        "ood-size": "twice the sides, and as many boxes for the area",
        "paper": "the paper's scene at five targets",
    }
    rows = [
        f"| {name} | {each['scenes']:,} | {each['cells'][0]} x {each['cells'][1]} | {each['hard']} "
        f"| {what.get(name, 'four times the sides, and as many boxes for the area')} |"
        for name, each in sets.items()
    ]
    return "\n".join(rows)


def _scores(entrants: Sequence[Mapping[str, Any]]) -> str:
    is_local = any("over_replanning" in each["sets"]["test"]["all"] for each in entrants)
    heads = [
        "policy",
        "training scenes",
        "seeds",
        "success",
        "SPL",
        "ratio",
        "exact",
        "success, hard",
        "SPL, hard",
    ]
    rows = []

    for each in entrants:
        whole = each["sets"]["test"]["all"]
        hard = each["sets"]["test"].get("hard")
        row = [text(each["name"]), _whole(each["training_scenes"]), len(each["seeds"]) or "", _cell(whole["success"]),
               _cell(whole["spl"]), _number(whole["ratio"]), f"{whole['exact']:.3f}",
               *([_cell(hard["success"]), _cell(hard["spl"])] if hard else ["–", "–"])]  # fmt: skip
        row += [_cell(whole.get("over_replanning"), sign="+")] if is_local else []
        row += [_whole(each["steps_per_second"]), _whole(each["seconds"])]
        rows.append(row)

    return table([*heads, *(["over replanning"] if is_local else []), "steps/s", "seconds"], rows)


def _elsewhere(entrants: Sequence[Mapping[str, Any]], sets: Mapping[str, Any]) -> str:
    """Success and SPL on the sets of other kinds."""
    names = [name for name in sets if name not in ("test", "paper")]
    is_local = any("over_replanning" in each["sets"]["test"]["all"] for each in entrants)
    rows = []

    for each in entrants:
        row = [text(each["name"])]
        for name in names:
            found = each["sets"].get(name)
            if found is None:
                row.append("–")
                continue

            whole = found["all"]
            row.append(f"{whole['success']['value']:.3f}, {_cell(whole['spl'])}")
            if is_local:
                row.append(_cell(whole.get("over_replanning"), sign="+"))

        rows.append(row)

    heads = [head for name in names for head in ([name, "over replanning"] if is_local else [name])]

    return "Success and SPL on scenes of other kinds.\n\n" + table(["policy", *heads], rows)


def _paper(entrants: Sequence[Mapping[str, Any]]) -> str:
    targets = next(each["paper"] for each in entrants if each["paper"])
    heads = ["policy", *(f"{each['target_db']:g} dB" for each in targets)]
    rows = [
        [
            text(each["name"]),
            *(f"{at['exact']} of {at['of']}, {_number(at['ratio'])}" for at in each["paper"]),
        ]
        for each in entrants
        if each["paper"]
    ]
    return table(heads, rows)


def _curve(entrants: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (_whole(each["training_scenes"]), len(each["seeds"]), _cell(each["sets"]["test"]["all"]["success"]),
         _cell(each["sets"]["test"]["all"]["spl"]),
         _cell(each["sets"]["test"]["hard"]["spl"]) if "hard" in each["sets"]["test"] else "–")
        for each in curve_of(entrants)
    ]  # fmt: skip
    return table(("training scenes", "seeds", "success", "SPL", "SPL, hard"), rows)


def _left_out(left_out: Sequence[Mapping[str, Any]]) -> str:
    if not left_out:
        return "## Runs left out\n\nNone: every run below the folder is on the page."

    rows = [(code(each["folder"]), text(each["reason"])) for each in left_out]
    return "## Runs left out\n\n" + table(("folder", "why"), rows)


def _cell(found: Mapping[str, Any] | None, sign: str = "") -> str:
    if found is None:
        return "–"

    value = f"{found['value']:{sign}.4f}"
    if found["note"] == "all seeds equal":
        return f"{value} †"
    if found["interval"] is None:
        return value

    low, high = found["interval"]

    return f"{value}<br><sub>{low:{sign}.4f} to {high:{sign}.4f}</sub>"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _whole(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"
