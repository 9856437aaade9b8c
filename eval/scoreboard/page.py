"""`markdown`: the scoreboard as a page."""

from collections.abc import Mapping, Sequence
from typing import Any

from eval.markdown import code, page, table, text

INTRODUCTION = """# Scoreboard

How {runs} training runs did against the exact optimum, beside the reference policies. Made by

{commands}

Every agent is scored by the greedy policy that its run kept as the best, played anew from the fixed start. Only the
scoring knows the oracle: no agent sees it in training.

| figure | what it is |
|---|---|
| at the optimum, success | seeds whose path is as short as the oracle's (to 1e-9), and seeds that reach the goal |
| ratio | distance over the oracle's: the median over all seeds, in which a failure is infinite |
| SPL, soft-SPL | oracle's distance over the distance, 0 for a failure; soft-SPL has progress in place of success |
| refused | refused moves in the episode, a mean |
| steps, seconds | training before the first test at the optimum: the median over all seeds, never there is infinite |

Seconds are those of the machine that trained, with all else that ran on it: steps compare better.

Below each figure is its 95 % interval: Clopper and Pearson's for shares of seeds, else the percentile bootstrap that
resamples whole seeds {resamples:,} times. † marks figures that are equal in all seeds: resampling then shows no spread,
which is not to say that the next seed would be equal too. Deterministic references have no interval; for the random
ones, {episodes} episodes stand for the seeds."""

OVERALL = """## Over all problems

Mean, interquartile mean (IQM) and optimality gap (the mean shortfall from 1) over seeds and problems. What one seed
did on all problems stays together in the resampling. Where problems do not have the same seeds, those that all have
count."""

CAPTIONS = {
    "curves": "Mean SPL of the tests during training with its 95 % band over seeds, and when the seeds arrived",
    "paths": "The oracle's path and that of the worst seed of each algorithm",
}
HEADS = (
    "policy", "seeds", "at the optimum", "success", "ratio", "SPL", "soft-SPL", "refused", "steps to the optimum",
    "seconds to the optimum",
)  # fmt: skip


def markdown(board: Mapping[str, Any], figures: str) -> str:
    """The page of a scoreboard (see `eval.commands.board.build`); ``figures`` is the folder that it
    links to.
    """
    commands = "\n".join(f"    {each}" for each in board["commands"])
    introduction = INTRODUCTION.format(
        **{**board, "runs": len(board["runs"]), "commands": commands}
    )
    problems = [_problem(each, figures) for each in board["problems"]]

    return page(
        introduction, "## At a glance", _glance(board), OVERALL, _overall(board), *problems, _left_out(board),
        origin(board),
    )  # fmt: skip


def runs_table(board: Mapping[str, Any]) -> str:
    """All runs, one in a row."""
    heads = ("folder", "problem", "policy", "seed", "ended", "metres", "ratio", "SPL", "soft-SPL", "refused",
             "steps to the optimum", "seconds to the optimum", "steps", "seconds")  # fmt: skip
    rows = [
        (code(each["folder"]), text(each["problem"]), text(each["policy"]), each["seed"],
         each["status"].replace("_", " "),
         f"{each['distance']:.3f}", _number(each["ratio"], 3) if each["is_success"] else "failure",
         _number(each["spl"], 3), _number(each["soft_spl"], 3), each["refused"], _count(each["steps_to_optimum"]),
         _number(each["seconds_to_optimum"], 0), _count(each["steps"]), _number(each["seconds"], 0))
        for each in board["runs"]
    ]  # fmt: skip
    return table(heads, rows)


def _glance(board: Mapping[str, Any]) -> str:
    """Seeds at the optimum, and the median time, for each problem and algorithm."""
    names = list(board["settings"])
    rows = []

    for problem in board["problems"]:
        found = {row["name"]: row for row in problem["standings"] if row["kind"] == "learned"}
        rows.append((text(problem["label"]), *(_glimpse(found.get(name)) for name in names)))

    return "Seeds at the optimum, and median time to it.\n\n" + table(
        ("problem", *map(text, names)), rows
    )


def _glimpse(row: Mapping[str, Any] | None) -> str:
    if row is None or not row["estimates"]:
        return "–"

    seconds = row["estimates"]["seconds_to_optimum"]["value"]
    return f"{count_of(row, 'at_optimum')}, {'never' if seconds is None else f'{_number(seconds, 0)} s'}{_missing(row)}"


def _overall(board: Mapping[str, Any]) -> str:
    heads = ("policy", "problems", "seeds", "runs at the optimum", "SPL mean", "SPL IQM", "SPL gap", "soft-SPL mean",
             "soft-SPL IQM", "soft-SPL gap")  # fmt: skip
    keys = [
        f"{score}_{aggregate}"
        for score in ("spl", "soft_spl")
        for aggregate in ("mean", "iqm", "gap")
    ]
    rows = [
        (text(each["name"]), f"{each['problems']} of {each['of']}", len(each["seeds"]),
         f"{each['at_optimum']['runs']} of {each['at_optimum']['of']}", *(_cell(each[key], 3) for key in keys))
        for each in board["overall"]
    ]  # fmt: skip
    return table(heads, rows)


def _problem(problem: Mapping[str, Any], figures: str) -> str:
    standings = seed_scores_table(problem["standings"])
    pictures = [
        f"![{_caption(name)}]({figures}/{name})\n\n*{_caption(name)}.*"
        for name in problem["figures"]
    ]
    distance = f"The oracle needs {problem['oracle_distance']:.3f} m."
    return "\n\n".join([f"## {text(problem['label'])}", distance, standings, *pictures])


def seed_scores_table(standings: Sequence[Mapping[str, Any]]) -> str:
    """Standings on one problem, one in a row."""
    return table(HEADS, [_row(each) for each in standings])


def _row(standing: Mapping[str, Any]) -> tuple[str, ...]:
    found = standing["estimates"]
    seeds = len(standing["seeds"])
    if not found:
        return text(standing["name"]), f"0{_missing(standing)}", *("–" for _ in HEADS[2:])

    count = (
        f"{seeds}{_missing(standing)}"
        if standing["kind"] == "learned"
        else f"{seeds} played"
        if seeds > 1
        else ""
    )
    cells = [
        _cell(found[key], digits)
        for key, digits in (("ratio", 3), ("spl_mean", 3), ("soft_spl_mean", 3))
    ]
    shares = [_share(standing, key) for key in ("at_optimum", "success")]
    clocks = ["", ""]
    if standing["kind"] == "learned":
        clocks = [_cell(found["steps_to_optimum"], None), _cell(found["seconds_to_optimum"], 0)]

    return text(standing["name"]), count, *shares, *cells, _cell(found["refused"], 1), *clocks


def _share(standing: Mapping[str, Any], key: str) -> str:
    if len(standing["seeds"]) == 1 and standing["kind"] == "reference":
        return "yes" if standing["estimates"][key]["value"] else "no"
    return f"{count_of(standing, key)}{_below(standing['estimates'][key], 2)}"


def count_of(standing: Mapping[str, Any], key: str) -> str:
    """How many of a standing's seeds a share stands for: "9 of 10"."""
    seeds = len(standing["seeds"])
    return f"{round(standing['estimates'][key]['value'] * seeds)} of {seeds}"


def _cell(found: Mapping[str, Any] | None, digits: int | None) -> str:
    if found is None:
        return "–"

    number = _count(found["value"]) if digits is None else _number(found["value"], digits)
    return (
        f"{number} †" if found["note"] == "all seeds equal" else f"{number}{_below(found, digits)}"
    )


def _below(found: Mapping[str, Any], digits: int | None) -> str:
    if found["interval"] is None:
        return ""

    low, high = (
        _count(each) if digits is None else _number(each, digits) for each in found["interval"]
    )
    return f"<br><sub>{low} to {high}</sub>"


def _number(value: float | None, digits: int) -> str:
    """A number with so many digits after the point; one without any has one where it is below ten."""
    if value is None:
        return "∞"
    return f"{value:.{digits or int(0 < value < 9.95)}f}"


def _count(value: float | None) -> str:
    """A number of steps with three digits, in thousands or millions."""
    if value is None:
        return "∞"

    factor, prefix = (1e6, " M") if value >= 999_500 else (1e3, " k")
    return f"{value / factor:.3g}{prefix}"


def _missing(standing: Mapping[str, Any]) -> str:
    return f" ({standing['left_out']} left out)" if standing["left_out"] else ""


def _caption(name: str) -> str:
    return next(said for kind, said in CAPTIONS.items() if name.endswith(f"-{kind}.png"))


def _left_out(board: Mapping[str, Any]) -> str:
    if not board["left_out"]:
        return "## Runs left out\n\nNone: every run below the folder is on the board."

    rows = [(code(each["folder"]), *(text(each[name] or "") for name in ("problem", "policy", "reason")))
            for each in board["left_out"]]  # fmt: skip
    return "## Runs left out\n\n" + table(("folder", "problem", "policy", "why"), rows)


def origin(board: Mapping[str, Any]) -> str:
    """Commits and versions that the runs were trained and scored with."""

    def listed(versions: Mapping[str, str]) -> str:
        return ", ".join(f"{text(name)} {text(version)}" for name, version in versions.items())

    commits: Sequence[str] = [text(each or "unknown") for each in board["trained_from"]]
    trained = "; ".join(listed(each) for each in board["trained_with"])

    return (
        f"## Where it comes from\n\nTrained from commit {', '.join(commits)} with {trained}. "
        f"Scored from commit {board['commit'] or 'unknown'} with {listed(board['versions'])}."
    )
