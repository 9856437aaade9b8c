"""`headroom_of`: what policies of the local track make in a small family, beside the most that any
could.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import process_time
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from agents.policies.replanning import Replanner
from agents.registry import ALGORITHMS
from agents.rollout.alike_scenes import roll_out_alike
from agents.rollout.scene_set import SceneSetResults, most_steps
from agents.runs.pretrained import load_pretrained
from eval.unseen.scores import untrained_explorer
from eval.unseen.small_families import CELL_SIZE, SmallFamily, scene_set
from irs_gym.grid import MOVES, Cell
from irs_gym.oracle.belief_optimum import BeliefOptimum, belief_optimum
from irs_gym.oracle.belief_search import Criterion

REPLANNING = "optimistic replanning"
UNTRAINED = "explorer, untrained"
LEARNED = ("explorer", "explorer_ppo")

PolicyFor = Callable[[tuple[int, int], int], Policy]
"""A policy for maps of a shape (X, Y), seen so many cells around the robot."""


@dataclass(frozen=True, eq=False)
class Headroom:
    """A small family at one radius: the optimum, and the episodes of policies by their titles."""

    family: SmallFamily
    radius: int
    best_spl: BeliefOptimum
    best_distance: BeliefOptimum
    seconds: float  # of one core, that both optima took
    played: Mapping[str, SceneSetResults]

    def spl(self, title: str) -> float:
        """Expected SPL of a policy that was played."""
        return float(self.played[title].spl @ self.family.weights)

    def distance(self, title: str) -> float:
        """Expected metres of a policy that was played; +inf where it does not always arrive."""
        episodes = self.played[title]
        if not episodes.is_success.all():
            return np.inf
        return float(episodes.distance @ self.family.weights)

    @property
    def highest(self) -> float:
        """The highest expected SPL of the policies that were played."""
        return max(self.spl(title) for title in self.played)

    @property
    def is_bound_kept(self) -> bool:
        """Whether no policy that was played makes more than the bound, nor fewer metres."""
        return all(
            self.spl(title) <= self.best_spl.bound + 1e-9
            and self.distance(title) >= self.best_distance.bound - 1e-9
            for title in self.played
        )


def policies() -> dict[str, PolicyFor]:
    """Optimistic replanning, an explorer that has learned nothing, and the pretrained ones, by
    their titles.
    """

    def shaped(explorer: Any) -> PolicyFor:
        return lambda shape, radius: replace(explorer, shape=shape)

    learned = {ALGORITHMS[each].title: load_pretrained(each).policy for each in LEARNED}

    return {
        REPLANNING: Replanner,
        UNTRAINED: shaped(untrained_explorer()),
        **{title: shaped(policy) for title, policy in learned.items()},
    }


def headroom_of(
    family: SmallFamily, radius: int, players: Mapping[str, PolicyFor], max_states: int
) -> Headroom:
    """The optimum of a family by expected SPL and by expected metres, and the policies' episodes.

    See `irs_gym.belief_optimum` for ``max_states``.
    """
    began = process_time()
    best_spl, best_distance = (
        belief_optimum(
            family.feasible,
            family.start,
            family.goal,
            CELL_SIZE,
            radius=radius,
            criterion=criterion,
            weights=family.weights,
            max_states=max_states,
        )
        for criterion in get_args(Criterion)
    )
    seconds = process_time() - began

    pool = scene_set(family)
    played = {
        title: roll_out_alike(
            player(pool.shape, radius), pool, patch_radius=radius, max_steps=most_steps(pool)
        )
        for title, player in players.items()
    }

    return Headroom(family, radius, best_spl, best_distance, seconds, played)


def path_of(episodes: SceneSetResults, scene: int, start: Cell) -> NDArray[np.int64]:
    """The cells ``(D, 2)`` of an episode none of whose moves was refused."""
    actions = np.asarray(episodes.actions)[scene]
    steps = MOVES[actions[actions >= 0]]  # (D - 1, 2)
    return np.cumsum(np.concatenate([[start], steps]), axis=0)
