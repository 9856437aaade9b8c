"""`spl_tables` and others: tables of policies over sets of scenes, for the page of unseen scenes.

Sets are rows, as there are many; policies are columns, so many side by side as can be read.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

from eval.estimates import estimate_cell
from eval.markdown import table, text
from eval.unseen.page_sets import PAGE_SETS
from eval.unseen.scene_scores import FAMILY_SETS, IN_THESE, MEAN, RIVALS

Entrant = Mapping[str, Any]
SIDE_BY_SIDE = 5  # policies in a table of scores
DIFFERENCES = 6  # in a table
NOTHING = "–"
MEAN_TITLE = "*eight families, mean*"


@dataclass(frozen=True)
class Column:
    """A column of a table over sets: its title, and its cell for the name of each."""

    title: str
    sets: Mapping[str, Any]  # by the names of those that it knows
    cell: Callable[[str], str]


def spl_tables(entrants: Sequence[Entrant]) -> str:
    """SPL of each policy on each set with its interval, and the mean over families; whom others are
    compared with stand in each table.
    """
    shown = [each for each in entrants if each["family"] is None]
    rivals = [each for each in shown if each["algorithm"] in RIVALS]
    others = [each for each in shown if each not in rivals]
    columns = [
        [_spl_column(each, shown) for each in (*rivals, *part)]
        for part in _parts(others, SIDE_BY_SIDE - len(rivals))
    ]
    return "\n\n".join(map(_over_sets, columns))


def success_table(entrants: Sequence[Entrant]) -> str:
    """Success of each policy on each set, without intervals, so that all stand side by side."""

    def cell(each: Entrant, name: str) -> str:
        found = _found(each, name, "success")
        return NOTHING if found is None else f"{found['value']:.4f}"

    shown = [each for each in entrants if each["family"] is None]
    return _over_sets(
        [Column(_title(each, shown), each["sets"], partial(cell, each)) for each in shown]
    )


def difference_tables(entrants: Sequence[Entrant]) -> str:
    """Differences in SPL of what learns from the untrained explorer and from replanning, and of
    these two, on each set.
    """
    shown = [each for each in entrants if each["family"] is None]
    columns = [
        Column(
            f"{_title(each, shown)}, {title_of(over)}",
            each["sets"],
            partial(_difference, each, over),
        )
        for each in shown
        for over in RIVALS.values()
        if each["seeds"] or (each["algorithm"], over) == ("untrained_explorer", "over_replanning")
    ]
    return "\n\n".join(_over_sets(part) for part in _parts(columns, DIFFERENCES))


def these_scenes_table(entrants: Sequence[Entrant]) -> str:
    """Differences in SPL from the untrained explorer of what learned with several seeds, with
    intervals that hold in these very scenes.
    """
    shown = [each for each in entrants if each["family"] is None]
    over = RIVALS["untrained_explorer"] + IN_THESE
    columns = [
        Column(_title(each, shown), each["sets"], partial(_difference, each, over))
        for each in shown
        if len(each["seeds"]) > 1
    ]
    parts = [_over_sets(part) for part in _parts(columns, DIFFERENCES)]
    return "\n\n".join(parts) or "No policy has several seeds on the page yet."


def clear_table(entrants: Sequence[Entrant], left_out: Sequence[Mapping[str, Any]]) -> str:
    """On which sets a learned policy differs from a rival for certain, and on which that is open.

    Of agents that each a family was left out for, on which of these families.
    """
    rows: list[list[str]] = []

    for each in entrants:
        if each["family"] is None and each["seeds"]:
            sets = {name: _all(each, name) for name in set_names(each)}
            rows += _clear_rows(each["name"], sets)

    for each in left_out:
        means = {over: found["these"] for over, found in each["mean"].items()}
        sets = {**each["families"], "mean": means}
        rows += _clear_rows(f"{each['name']}, the family left out", sets)

    return table(("policy", "difference", "above zero", "below zero", "open"), rows)


def left_out_tables(
    left_out: Sequence[Mapping[str, Any]], entrants: Sequence[Entrant], track: str
) -> str:
    """Of each family, the agents that learned on all kinds but that: their SPL, and how far that is
    above the references.
    """
    shown = [each for each in left_out if each["track"] == track]
    if not shown:
        return "No run of this kind is on the page yet."

    rivals = {each["algorithm"]: each for each in entrants if each["algorithm"] in RIVALS}
    tables = []

    for each in shown:
        overs = [over for over in RIVALS.values() if over in each["mean"]]
        rows = []
        for name in FAMILY_SETS:
            family = name.removeprefix("ood-")
            found = each["families"].get(family, {})
            rows.append(
                [
                    name,
                    len(found.get("seeds", ())) or NOTHING,
                    score_cell(found.get("spl")),
                    *(difference_cell(found.get(over)) for over in overs),
                    *(
                        score_cell(_found(rival, name, "spl"))
                        for rival in rivals.values()
                        if track == "local"
                    ),
                ]
            )

        for title, which in (("mean", "these"), ("mean, for other families too", "others")):
            mean = each["mean"]
            rows.append(
                [
                    f"*{title}*",
                    "",
                    score_cell(mean["spl"][which]),
                    *(difference_cell(mean[over][which]) for over in overs),
                    *(
                        score_cell(_found(rival, MEAN, "spl") if which == "these" else None)
                        for rival in rivals.values()
                        if track == "local"
                    ),
                ]
            )

        header = [
            text(each["name"]),
            "seeds",
            "SPL",
            *map(title_of, overs),
            *(text(rival["name"]) for rival in rivals.values() if track == "local"),
        ]
        tables.append(table(header, rows))

    return "\n\n".join(tables)


def shipped_tables(shipped: Sequence[Mapping[str, Any]], entrants: Sequence[Entrant]) -> str:
    """How each model of ``models/`` was chosen; then its own SPL on each set, with the mean of its
    seeds where there are others.
    """
    if not shipped:
        return "None of the models in `models/` is on this page."

    rows = [
        (
            text(each["name"]),
            each["learned_on"],
            whole_number(each["training_scenes"]),
            f"{each['seed']}, of {each['chosen_among']} runs",
            f"{each['validation_spl']:.4f}",
        )
        for each in shipped
    ]
    chosen = table(("model", "learned on", "training scenes", "seed", "validation SPL"), rows)
    seeds = {(each["name"], each["training_scenes"]): each for each in entrants}
    beside = [each for each in shipped if each["seeds"] > 1]  # a row above is the others

    def cell(each: Mapping[str, Any], name: str) -> str:
        own = each["spl"].get(name)
        if own is None:
            return NOTHING

        mean = _found(seeds[each["name"], each["training_scenes"]], name, "spl")
        assert mean is not None
        return f"{score_cell(own)}<br>(seeds: {mean['value']:.4f})"

    columns = [Column(_title(each, beside), each["spl"], partial(cell, each)) for each in beside]
    scores = [_over_sets(part) for part in _parts(columns, SIDE_BY_SIDE)]

    return "\n\n".join([chosen, *scores])


# --- parts ----------------------------------------------------------------------------------------


def _over_sets(columns: Sequence[Column]) -> str:
    """A row a set, all but the paper's scene, which has a table of its own."""
    known = {name for column in columns for name in column.sets}
    names = [name for name in PAGE_SETS if name in known and name != "paper"]
    if MEAN in known:
        names.insert(names.index(FAMILY_SETS[-1]) + 1, MEAN)

    header = ["set", *(column.title for column in columns)]
    return table(
        header, [[_short(name), *(column.cell(name) for column in columns)] for name in names]
    )


def _spl_column(entrant: Entrant, entrants: Sequence[Entrant]) -> Column:
    return Column(
        _title(entrant, entrants),
        entrant["sets"],
        lambda name: score_cell(_found(entrant, name, "spl")),
    )


def _title(entrant: Mapping[str, Any], entrants: Sequence[Mapping[str, Any]]) -> str:
    """Its name, with its training scenes where another has the same."""
    name = text(entrant["name"])
    is_double = sum(each["name"] == entrant["name"] for each in entrants) > 1
    return f"{name}, {entrant['training_scenes']:,} scenes" if is_double else name


def _clear_rows(name: str, sets: Mapping[str, Mapping[str, Any]]) -> Iterator[list[str]]:
    for over in RIVALS.values():
        found: dict[str, list[str]] = {"above": [], "below": [], "open": []}
        for each, figures in sets.items():
            if over in figures:
                found[side_of(figures[over]["interval"])].append(_short(each))

        if any(found.values()):
            yield [
                text(name),
                title_of(over),
                *(", ".join(where) or NOTHING for where in found.values()),
            ]


def side_of(interval: Sequence[float] | None) -> str:
    """Where an interval of a difference lies."""
    if interval is None or interval[0] <= 0.0 <= interval[1]:
        return "open"

    return "above" if interval[0] > 0.0 else "below"


def _short(name: str) -> str:
    return MEAN_TITLE if name == MEAN else name


def set_names(entrant: Entrant) -> list[str]:
    """The sets that it has played, the paper's scene aside, with the mean over families."""
    names = [name for name in (*PAGE_SETS, MEAN) if name in entrant["sets"]]
    return [name for name in names if name != "paper"]


def title_of(over: str) -> str:
    """Of a difference, in words."""
    return over.replace("_", " ")


def _found(entrant: Entrant, name: str, figure: str) -> Mapping[str, Any] | None:
    found: Mapping[str, Any] | None = _all(entrant, name).get(figure)
    return found


def _all(entrant: Entrant, name: str) -> Mapping[str, Any]:
    """Figures over all scenes of a set; none of one that it has not played."""
    found: Mapping[str, Any] = entrant["sets"].get(name, {}).get("all", {})
    return found


def _difference(entrant: Entrant, over: str, name: str) -> str:
    return difference_cell(_found(entrant, name, over))


def _parts(items: Sequence[Any], most: int) -> list[Sequence[Any]]:
    """Of equal lengths, as near as can be, none longer."""
    count = -(-len(items) // most)
    ends = [round(n * len(items) / count) for n in range(count + 1)] if count else [0]
    return [items[begin:end] for begin, end in pairwise(ends)]


# --- cells ----------------------------------------------------------------------------------------


def score_cell(found: Mapping[str, Any] | None) -> str:
    """A score and its interval."""
    return estimate_cell(found, "{:.4f}".format)


def difference_cell(found: Mapping[str, Any] | None) -> str:
    """With the sign, also where it is plus; bold where it is clear of zero."""
    shown = estimate_cell(found, "{:+.4f}".format)
    if found is None or side_of(found["interval"]) == "open":
        return shown

    figure, *below = shown.split("<br>")
    return "<br>".join([f"**{figure}**", *below])


def whole_number(value: float | None) -> str:
    """Nothing for None."""
    return "" if value is None else f"{value:,.0f}"
