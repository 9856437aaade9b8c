"""`Standing`: how the seeds of one algorithm, or a reference policy, did where the robot goes
anywhere on the floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from agents.rollout.episode import TOLERANCE, EpisodeResult, evaluation_env, roll_out
from eval.estimates import estimate_as_json, finite
from eval.scoreboard.results import Result
from eval.scoreboard.score import RANDOM, play_references
from eval.statistics import Estimate, estimate, estimate_median, share

FINER = (2, 4)  # parts of a step in which policies are replayed


@dataclass(frozen=True)
class Standing:
    """Figures over seeds.

    Attributes
    ----------
    name
        Of the policy.
    kind
        ``"learned"``, or ``"reference"``.
    seeds
        Seeds of the runs, or numbers of episodes.
    distances
        Metres from the start to the goal's disc; infinite for a failure.
    shorter
        How many are shorter than the best path over the grid, to the same disc.
    estimates
        ``success`` and ``shorter``: shares of the seeds; ``ratio`` to the exact optimum and
        ``seconds``, of training before the first test that was shorter than the grid's path:
        medians in which a failure is infinite; ``spl``: a mean.
    replayed
        Median distances of the same policies in steps of 1/2 and 1/4 of the time; none of a
        reference.
    """

    name: str
    kind: str
    seeds: tuple[int, ...]
    distances: tuple[float, ...]
    shorter: int
    estimates: dict[str, Estimate]
    replayed: tuple[float, ...] = ()

    @classmethod
    def of(cls, name: str, results: Sequence[Result], grid: float) -> "Standing":
        """Of runs on one problem, whose best path over the grid has ``grid`` metres."""
        standing = _of_episodes(
            name,
            "learned",
            [each.seed for each in results],
            [each.episode for each in results],
            grid,
        )
        seconds = [_first_shorter(each, grid) for each in results]

        return replace(
            standing,
            estimates={**standing.estimates, "seconds": estimate_median(seconds)},
            replayed=tuple(
                float(np.median([_replay(each, parts) for each in results])) for parts in FINER
            ),
        )

    @property
    def median(self) -> float:
        """Metres; infinite where half or more fail."""
        return float(np.median(self.distances))

    def as_json(self) -> dict[str, Any]:
        """For JSON, which has no infinity: null stands for it."""
        return {
            **vars(self),
            "seeds": list(self.seeds),
            "distances": [finite(each) for each in self.distances],
            "median": finite(self.median),
            "replayed": [finite(each) for each in self.replayed],
            "estimates": {name: estimate_as_json(each) for name, each in self.estimates.items()},
        }


def references_of(result: Result, episodes: int, seed: int = 0) -> dict[str, Standing]:
    """Of each reference policy on the problem of a run; random ones play so many episodes."""
    played = play_references(evaluation_env(result.run.task), {}, episodes, seed)
    grid = played["grid_oracle"][0].distance
    found = {}

    for name, each in played.items():
        shown = name.replace("_", " ")
        standing = _of_episodes(shown, "reference", range(len(each)), each, grid)
        if name not in RANDOM:  # one episode is all that it ever does: no interval
            estimates = {
                key: replace(value, low=None, high=None, note="")
                for key, value in standing.estimates.items()
            }
            standing = replace(standing, estimates=estimates)
        found[shown] = standing

    return found


def _of_episodes(
    name: str, kind: str, seeds: Sequence[int], episodes: Sequence[EpisodeResult], grid: float
) -> Standing:
    distances = [each.distance if each.is_success else inf for each in episodes]
    shorter = sum(each < grid * (1 - TOLERANCE) for each in distances)
    ratios = [inf if each.ratio is None else each.ratio for each in episodes]
    estimates = {
        "success": share(sum(each.is_success for each in episodes), len(episodes)),
        "shorter": share(shorter, len(episodes)),
        "ratio": estimate_median(ratios),
        "spl": estimate([each.spl for each in episodes], within=(0.0, 1.0)),
    }

    return Standing(name, kind, tuple(seeds), tuple(distances), shorter, estimates)


def _replay(result: Result, parts: int) -> float:
    """Metres of the best policy of a run where each step is cut into so many, at each of which it
    may turn; infinite for a failure.
    """
    task: Any = result.run.task
    env = evaluation_env(replace(task, time_step=task.time_step / parts))
    episode = roll_out(result.run.load_model("best"), env)

    return episode.distance if episode.is_success else inf


def _first_shorter(result: Result, grid: float) -> float:
    """Seconds of training before the first test whose path was shorter than the grid's."""
    curve = result.curve
    least = result.episode.oracle_distance / (grid * (1 - TOLERANCE))  # SPL of such a path
    is_shorter = curve.spl > least

    return float(curve.seconds[is_shorter][0]) if is_shorter.any() else inf
