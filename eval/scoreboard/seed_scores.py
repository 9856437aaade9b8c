"""`SeedScores`: how the seeds of one algorithm, or a reference policy, did on one problem; and over
all problems.

All estimates come from records of episodes, as the scoreboard's data keep them, so that anybody can
make them anew.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from agents.registry import ALGORITHMS
from agents.rollout.episode import EpisodeResult, evaluation_env
from eval.estimates import estimate_as_json
from eval.scoreboard.results import Group, Result, default_settings
from eval.scoreboard.score import play_references
from eval.statistics import (
    SCORE,
    Estimate,
    estimate,
    estimate_median,
    interquartile_mean,
    mean,
    optimality_gap,
    share,
)

AGGREGATES = {"mean": mean, "iqm": interquartile_mean, "gap": optimality_gap}
METRICS = ("spl", "soft_spl")
CLOCKS = ("steps_to_optimum", "seconds_to_optimum")

Row = Mapping[str, Any]
"""What one episode did, as `episode_record` tells it; of a run, with its seed and `CLOCKS`."""


@dataclass(frozen=True)
class SeedScores:
    """Estimates over seeds.

    Attributes
    ----------
    name
        Of the policy.
    kind
        ``"learned"``, or ``"reference"``.
    seeds
        Seeds of the runs, or numbers of the episodes of a random policy; one number for a
        deterministic reference.
    left_out
        How many runs of the same kind are left out.
    estimates
        By name: ``success`` and ``at_optimum`` are shares of the seeds; ``spl_mean``, ``spl_iqm``,
        ``spl_gap`` and the same of ``soft_spl`` count a failure's SPL as 0; ``ratio``,
        ``steps_to_optimum`` and ``seconds_to_optimum`` are medians in which a failure is infinite;
        ``refused`` is a mean.
    played
        The episodes of a reference policy; those of runs are kept with the runs.
    """

    name: str
    kind: str
    seeds: tuple[int, ...]
    left_out: int
    estimates: dict[str, Estimate]
    played: tuple[Row, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The standing for JSON, which has no infinity: null stands for it."""
        return {
            **vars(self),
            "seeds": list(self.seeds),
            "estimates": _as_json(self.estimates),
            "played": list(self.played),
        }


def episode_record(episode: EpisodeResult) -> dict[str, Any]:
    """What the estimates need of an episode, for JSON."""
    names = ("is_success", "is_optimal", "ratio", "spl", "soft_spl", "refused")
    return {name: getattr(episode, name) for name in names}


def learned(name: str, rows: Sequence[Row], left_out: int) -> SeedScores:
    """Standing of one group of runs; it has no estimates where all its runs are left out."""
    seeds = tuple(each["seed"] for each in rows)
    return SeedScores(name, "learned", seeds, left_out, _of_runs(rows))


def references(
    result: Result, episodes: int, seed: int
) -> tuple[dict[str, EpisodeResult], list[SeedScores]]:
    """Each reference policy's first episode on the problem of a run, and its standing."""
    env = evaluation_env(result.run.task)
    first = {}
    standings = []

    for name, played in play_references(env, {}, episodes, seed).items():
        rows = tuple(episode_record(each) for each in played)
        first[name] = played[0]
        standings.append(
            SeedScores(
                name.replace("_", " "),
                "reference",
                tuple(range(len(rows))),
                0,
                _of_reference(rows),
                rows,
            )
        )

    return first, standings


def overall(name: str, groups: Sequence[Sequence[Row]], problems: int) -> dict[str, Any]:
    """Scores of one algorithm over all problems, for JSON; a seed is one draw, with all that it
    did.

    Where the problems do not have the same seeds, those that all have count.
    """
    by_seed = [{each["seed"]: each for each in rows} for rows in groups]

    # only a seed that played every problem counts as a whole
    seeds = sorted(set.intersection(*map(set, by_seed)))
    found: dict[str, Any] = {"name": name, "problems": len(groups), "of": problems, "seeds": seeds}
    runs = [each for rows in groups for each in rows]
    found["at_optimum"] = {"runs": sum(each["is_optimal"] for each in runs), "of": len(runs)}

    for score in METRICS:
        # (seeds, problems)
        table = [[rows[seed][score] for rows in by_seed] for seed in seeds]

        for aggregate, statistic in AGGREGATES.items():
            found[f"{score}_{aggregate}"] = (
                estimate_as_json(estimate(table, statistic, SCORE)) if seeds else None
            )

    return found


def estimated_anew(board: Mapping[str, Any]) -> dict[str, Any]:
    """A scoreboard, as JSON holds it, with all estimates from the episodes that it keeps."""
    by_name: dict[str, dict[str, list[Row]]] = {}
    for run in board["runs"]:
        by_name.setdefault(run["policy"], {}).setdefault(run["problem"], []).append(run)

    problems = []
    for problem in board["problems"]:
        standings = []

        for each in problem["standings"]:
            if each["kind"] == "learned":
                rows = by_name.get(each["name"], {}).get(problem["label"], [])
                found = _of_runs(rows)
            else:
                found = _of_reference(each["played"])

            standings.append({**each, "estimates": _as_json(found)})

        problems.append({**problem, "standings": standings})

    return {
        **board,
        "problems": problems,
        "overall": [
            overall(name, list(groups.values()), len(problems)) for name, groups in by_name.items()
        ],
    }


def group_names(groups: Sequence[Group]) -> dict[Group, str]:
    """Names of groups: the algorithm's, and the settings in which one differs from the usual one of
    that algorithm.

    The usual one is that with the fewest differences from all others, and of equals from the
    defaults.
    """
    names = {}

    for algorithm in dict.fromkeys(each.algorithm for each in groups):
        same = [each for each in groups if each.algorithm == algorithm]
        usual = min(
            same,
            key=lambda one: (
                sum(len(_differences(one.values, other.values)) for other in same),
                len(_differences(one.values, {**one.values, **default_settings(algorithm)})),
            ),
        )

        for group in same:
            words = [
                f"{name.partition('.')[2]} {value}"
                for name, value in _differences(group.values, usual.values).items()
            ]
            names[group] = ", ".join([ALGORITHMS[algorithm].title, *words])

    return names


def _differences(values: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """The settings that others do not share."""
    return {
        name: value for name, value in values.items() if name not in others or others[name] != value
    }


def _of_runs(rows: Sequence[Row]) -> dict[str, Estimate]:
    if not rows:
        return {}

    clocks = {
        name: estimate_median([inf if each[name] is None else each[name] for each in rows])
        for name in CLOCKS
    }
    return {**_of_episodes(rows), **clocks}


def _of_reference(rows: Sequence[Row]) -> dict[str, Estimate]:
    estimates = _of_episodes(rows)
    if len(rows) > 1:
        return estimates

    # one episode is all that it ever does: no interval
    return {key: replace(each, low=None, high=None, note="") for key, each in estimates.items()}


def _of_episodes(rows: Sequence[Row]) -> dict[str, Estimate]:
    ratios = [inf if each["ratio"] is None else each["ratio"] for each in rows]
    estimates = {
        "success": share(sum(each["is_success"] for each in rows), len(rows)),
        "at_optimum": share(sum(each["is_optimal"] for each in rows), len(rows)),
        "ratio": estimate_median(ratios),
        "refused": estimate([each["refused"] for each in rows], within=(0.0, inf)),
    }
    for score in METRICS:
        values = [each[score] for each in rows]
        estimates |= {
            f"{score}_{name}": estimate(values, statistic, SCORE)
            for name, statistic in AGGREGATES.items()
        }

    return estimates


def _as_json(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: estimate_as_json(each) for name, each in estimates.items()}
