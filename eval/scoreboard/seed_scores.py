"""`SeedScores`: how the seeds of one algorithm, or a reference policy, did on one problem; and over
all problems.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from agents.registry import ALGORITHMS
from agents.rollout.episode import EpisodeResult, evaluation_env
from eval.estimates import estimate_as_json
from eval.scoreboard.results import Group, Result
from eval.scoreboard.score import RANDOM, play_references
from eval.statistics import (
    Estimate,
    estimate,
    interquartile_mean,
    mean,
    median,
    optimality_gap,
    share,
)

AGGREGATES = {"mean": mean, "iqm": interquartile_mean, "gap": optimality_gap}
METRICS: dict[str, Callable[[EpisodeResult], float]] = {
    "spl": lambda episode: episode.spl,
    "soft_spl": lambda episode: episode.soft_spl,
}


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
    """

    name: str
    kind: str
    seeds: tuple[int, ...]
    left_out: int
    estimates: dict[str, Estimate]

    def as_json(self) -> dict[str, Any]:
        """The standing for JSON, which has no infinity: null stands for it."""
        estimates = {name: estimate_as_json(each) for name, each in self.estimates.items()}
        return {**vars(self), "seeds": list(self.seeds), "estimates": estimates}


def learned(name: str, results: Sequence[Result], left_out: int) -> SeedScores:
    """Standing of one group of runs; it has no estimates where all its runs are left out."""
    estimates = _of_episodes([each.episode for each in results]) if results else {}

    for clock in ("steps_to_optimum", "seconds_to_optimum") if results else ():
        estimates[clock] = estimate([getattr(each, clock) for each in results], median)

    return SeedScores(name, "learned", tuple(each.seed for each in results), left_out, estimates)


def references(
    result: Result, episodes: int, seed: int
) -> tuple[dict[str, EpisodeResult], list[SeedScores]]:
    """Each reference policy's first episode on the problem of a run, and its standing."""
    env = evaluation_env(result.run.task)
    first = {}
    standings = []

    for name, played in play_references(env, {}, episodes, seed).items():
        estimates = _of_episodes(played)
        if name not in RANDOM:  # one episode is all that it ever does: no interval
            estimates = {
                key: replace(each, low=None, high=None, note="") for key, each in estimates.items()
            }

        first[name] = played[0]
        standings.append(
            SeedScores(name.replace("_", " "), "reference", tuple(range(len(played))), 0, estimates)
        )

    return first, standings


def overall(name: str, groups: Sequence[Sequence[Result]], problems: int) -> dict[str, Any]:
    """Scores of one algorithm over all problems, for JSON; whole seeds are resampled, with all that
    each one did.

    Where the problems do not have the same seeds, those that all have count.
    """
    by_seed = [{each.seed: each.episode for each in results} for results in groups]

    # only a seed that played every problem can be resampled as a whole
    seeds = sorted(set.intersection(*map(set, by_seed)))
    found: dict[str, Any] = {"name": name, "problems": len(groups), "of": problems, "seeds": seeds}
    runs = [each for results in groups for each in results]
    found["at_optimum"] = {"runs": sum(each.episode.is_optimal for each in runs), "of": len(runs)}

    for score, value in METRICS.items():
        # (seeds, problems)
        table = [[value(episodes[seed]) for episodes in by_seed] for seed in seeds]

        for aggregate, statistic in AGGREGATES.items():
            found[f"{score}_{aggregate}"] = (
                estimate_as_json(estimate(table, statistic)) if seeds else None
            )

    return found


def group_names(groups: Sequence[Group]) -> dict[Group, str]:
    """Names of groups: the algorithm's, and the settings in which one differs from the usual one of
    that algorithm.

    The usual one is that with the fewest differences from all others.
    """
    names = {}

    for algorithm in dict.fromkeys(each.algorithm for each in groups):
        same = [each for each in groups if each.algorithm == algorithm]
        usual = min(same, key=lambda one: sum(len(_differences(one, other)) for other in same))

        for group in same:
            words = [
                f"{name.partition('.')[2]} {value}"
                for name, value in _differences(group, usual).items()
            ]
            names[group] = ", ".join([ALGORITHMS[algorithm].title, *words])

    return names


def _differences(group: Group, other: Group) -> dict[str, Any]:
    """The settings of a group that another one does not share."""
    values = group.values
    others = other.values
    return {
        name: value for name, value in values.items() if name not in others or others[name] != value
    }


def _of_episodes(episodes: Sequence[EpisodeResult]) -> dict[str, Estimate]:
    estimates = {
        "success": share(sum(each.is_success for each in episodes), len(episodes)),
        "at_optimum": share(sum(each.is_optimal for each in episodes), len(episodes)),
        "ratio": estimate([inf if each.ratio is None else each.ratio for each in episodes], median),
        "refused": estimate([each.refused for each in episodes]),
    }
    for score, value in METRICS.items():
        values = np.array([value(each) for each in episodes])
        estimates |= {
            f"{score}_{name}": estimate(values, statistic) for name, statistic in AGGREGATES.items()
        }

    return estimates
