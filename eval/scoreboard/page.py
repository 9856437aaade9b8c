"""`scoreboard_page`: the scoreboard as a page; its tables."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from eval.estimates import estimate_cell, interval_below
from eval.markdown import code, table, template, text
from eval.origin import commands_block, origin_text

FIGURES = "figures/scoreboard"  # beside the page
BANDS = "student"  # the rule of the bands in the figures
BANDS_RESAMPLED = (
    "The bands in the figures are older: percentiles of resampled seeds, which hold about 90 % for "
    "ten seeds. They cannot be drawn anew, as the tests of these runs were not kept."
)
CAPTIONS = {
    "curves": "Mean SPL of the tests during training with its 95 % band over seeds, "
    "and when the seeds arrived",
    "paths": "The oracle's path and that of the worst seed of each algorithm",
}
SCORES_HEADER = (
    "policy",
    "seeds",
    "at the optimum",
    "success",
    "ratio",
    "SPL",
    "soft-SPL",
    "refused",
    "steps to the optimum",
    "seconds to the optimum",
)


def scoreboard_page(board: Mapping[str, Any], figures: str) -> str:
    """The page of a scoreboard (see `eval.scoreboard.board`); ``figures`` is the folder that it
    links to.
    """
    problems = [_problem_section(each, figures) for each in board["problems"]]

    return template("scoreboard.md").format(
        runs=len(board["runs"]),
        commands=commands_block(board["commands"]),
        episodes=board["episodes"],
        bands="" if board.get("bands") == BANDS else f" {BANDS_RESAMPLED}",
        glance=_glance_table(board),
        overall=_overall_table(board),
        problems="\n\n".join(problems),
        left_out=_left_out_table(board),
        origin=origin_text(board),
    )


def runs_table(board: Mapping[str, Any]) -> str:
    """All runs, one in a row."""
    header = (
        *("folder", "problem", "policy", "seed", "ended", "metres", "ratio", "SPL", "soft-SPL"),
        *("refused", "steps to the optimum", "seconds to the optimum", "steps", "seconds"),
    )
    rows = [
        (
            code(each["folder"]),
            text(each["problem"]),
            text(each["policy"]),
            each["seed"],
            each["status"].replace("_", " "),
            f"{each['distance']:.3f}",
            _rounded(each["ratio"], 3) if each["is_success"] else "failure",
            _rounded(each["spl"], 3),
            _rounded(each["soft_spl"], 3),
            each["refused"],
            _abbreviated(each["steps_to_optimum"]),
            _rounded(each["seconds_to_optimum"], 0),
            _abbreviated(each["steps"]),
            _rounded(each["seconds"], 0),
        )
        for each in board["runs"]
    ]
    return table(header, rows)


def seed_scores_table(standings: Sequence[Mapping[str, Any]]) -> str:
    """Standings on one problem, one in a row."""
    return table(SCORES_HEADER, [_scores_row(each) for each in standings])


def count_of(standing: Mapping[str, Any], key: str) -> str:
    """How many of a standing's seeds a share stands for: "9 of 10"."""
    seeds = len(standing["seeds"])
    return f"{round(standing['estimates'][key]['value'] * seeds)} of {seeds}"


# --- parts of the page ----------------------------------------------------------------------------


def _glance_table(board: Mapping[str, Any]) -> str:
    """Seeds at the optimum, and the median time, for each problem and algorithm."""
    names = list(board["settings"])
    rows = []

    for problem in board["problems"]:
        found = {row["name"]: row for row in problem["standings"] if row["kind"] == "learned"}
        rows.append((text(problem["label"]), *(_glance_cell(found.get(name)) for name in names)))

    return table(("problem", *map(text, names)), rows)


def _glance_cell(standing: Mapping[str, Any] | None) -> str:
    if standing is None or not standing["estimates"]:
        return "–"

    seconds = standing["estimates"]["seconds_to_optimum"]["value"]
    time = "never" if seconds is None else f"{_rounded(seconds, 0)} s"

    return f"{count_of(standing, 'at_optimum')}, {time}{_missing(standing)}"


def _overall_table(board: Mapping[str, Any]) -> str:
    header = (
        *("policy", "problems", "seeds", "runs at the optimum"),
        *("SPL mean", "SPL IQM", "SPL gap", "soft-SPL mean", "soft-SPL IQM", "soft-SPL gap"),
    )
    keys = [
        f"{score}_{aggregate}"
        for score in ("spl", "soft_spl")
        for aggregate in ("mean", "iqm", "gap")
    ]
    rows = [
        (
            text(each["name"]),
            f"{each['problems']} of {each['of']}",
            len(each["seeds"]),
            f"{each['at_optimum']['runs']} of {each['at_optimum']['of']}",
            *(estimate_cell(each[key], _digits(3)) for key in keys),
        )
        for each in board["overall"]
    ]
    return table(header, rows)


def _problem_section(problem: Mapping[str, Any], figures: str) -> str:
    pictures = []

    for name in problem["figures"]:
        caption = next(words for kind, words in CAPTIONS.items() if name.endswith(f"-{kind}.png"))
        pictures.append(f"![{caption}]({figures}/{name})\n\n*{caption}.*")

    return "\n\n".join(
        [
            f"## {text(problem['label'])}",
            f"The oracle needs {problem['oracle_distance']:.3f} m.",
            seed_scores_table(problem["standings"]),
            *pictures,
        ]
    )


def _left_out_table(board: Mapping[str, Any]) -> str:
    if not board["left_out"]:
        return "None: every run below the folder is on the board."

    rows = [
        (
            code(each["folder"]),
            *(text(each[name] or "") for name in ("problem", "policy", "reason")),
        )
        for each in board["left_out"]
    ]
    return table(("folder", "problem", "policy", "why"), rows)


# --- rows and cells -------------------------------------------------------------------------------


def _scores_row(standing: Mapping[str, Any]) -> tuple[str, ...]:
    found = standing["estimates"]
    if not found:  # all its runs are left out
        missing = f"0{_missing(standing)}"
        return text(standing["name"]), missing, *("–" for _ in SCORES_HEADER[2:])

    return (
        text(standing["name"]),
        _seeds_cell(standing),
        _share_cell(standing, "at_optimum"),
        _share_cell(standing, "success"),
        estimate_cell(found["ratio"], _digits(3)),
        estimate_cell(found["spl_mean"], _digits(3)),
        estimate_cell(found["soft_spl_mean"], _digits(3)),
        estimate_cell(found["refused"], _digits(1)),
        *_time_cells(standing),
    )


def _seeds_cell(standing: Mapping[str, Any]) -> str:
    """Seeds of runs, or episodes of a random reference; nothing for other references."""
    seeds = len(standing["seeds"])
    if standing["kind"] == "learned":
        return f"{seeds}{_missing(standing)}"

    return f"{seeds} played" if seeds > 1 else ""


def _share_cell(standing: Mapping[str, Any], key: str) -> str:
    share = standing["estimates"][key]
    if len(standing["seeds"]) == 1 and standing["kind"] == "reference":
        return "yes" if share["value"] else "no"

    return f"{count_of(standing, key)}{interval_below(share, _digits(2))}"


def _time_cells(standing: Mapping[str, Any]) -> tuple[str, str]:
    """Steps and seconds to the optimum; a reference was not trained."""
    if standing["kind"] != "learned":
        return "", ""

    found = standing["estimates"]
    return (
        estimate_cell(found["steps_to_optimum"], _abbreviated),
        estimate_cell(found["seconds_to_optimum"], _digits(0)),
    )


def _digits(digits: int) -> Callable[[float | None], str]:
    """How `_rounded` writes numbers with so many digits."""
    return partial(_rounded, digits=digits)


def _rounded(value: float | None, digits: int) -> str:
    """A number with so many digits after the point; in place of none, one where it is below ten."""
    if value is None:
        return "∞"
    return f"{value:.{digits or int(0 < value < 9.95)}f}"


def _abbreviated(value: float | None) -> str:
    """A number of steps with three digits, in thousands or millions."""
    if value is None:
        return "∞"

    # from 999,500 on, three digits round up to the million
    factor, prefix = (1e6, " M") if value >= 999_500 else (1e3, " k")
    return f"{value / factor:.3g}{prefix}"


def _missing(standing: Mapping[str, Any]) -> str:
    return f" ({standing['left_out']} left out)" if standing["left_out"] else ""
