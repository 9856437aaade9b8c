"""`RobotBatch`: robots on their ways through scenes of a pool, with what each of them has seen."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.learning.local_configs import RobotBatchConfig
from agents.policies.belief_map import BeliefMap, patches_of
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVES

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class FinishedEpisodes(NamedTuple):
    """Where a step has brought n robots."""

    cells: Ints  # (n, 2)
    is_there: Bools  # (n,), at the goal
    is_over: Bools  # (n,), at the goal or out of steps


class RobotBatch:
    """Robots that begin anew, in another scene, as soon as they have arrived or given up.

    Attributes
    ----------
    scenes, cells
        Where each robot is, ``(n,)`` and ``(n, 2)``.
    seen
        What each has seen since it began.
    """

    def __init__(self, terms: RobotBatchConfig, pool: SceneSet, rng: np.random.Generator) -> None:
        n = terms.robots
        self.terms = terms
        self._rng = rng
        self.scenes = np.zeros(n, dtype=np.int64)
        self.cells = np.zeros((n, 2), dtype=np.int64)
        self.steps = np.zeros(n, dtype=np.int64)
        self.seen = BeliefMap.nothing(n, pool.shape, terms.patch_radius)
        self.begin(pool, np.arange(n))

    def known(self, pool: SceneSet) -> tuple[Tensor, Tensor, Tensor]:
        """What the robots know, as `agents.networks.explorer.ExplorerNetwork` takes it: a copy."""
        goals = pool.goal[self.scenes] @ [pool.shape[1], 1]
        margin = torch.from_numpy(np.ascontiguousarray(self.seen.maps))
        return margin, torch.from_numpy(goals), torch.from_numpy(pool.irs[self.scenes])

    def begin(self, pool: SceneSet, robots: Ints) -> None:
        """Send these robots on their way through scenes drawn anew."""
        self.scenes[robots] = self._rng.integers(len(pool), size=len(robots))
        self.cells[robots] = pool.start[self.scenes[robots]]

        for robot in robots[self._rng.random(len(robots)) < self.terms.random_start].tolist():
            to_go = pool.distance_to_go[self.scenes[robot]]
            self.cells[robot] = self._rng.choice(np.argwhere(np.isfinite(to_go) & (to_go > 0)))

        self.steps[robots] = 0
        self.seen = self.seen.forget(robots)
        self._look(pool)

    def move(self, pool: SceneSet, moves: Ints, waits: Bools) -> FinishedEpisodes:
        """One step of all robots but those that wait; refused into cells that are not feasible.

        Those that have arrived or given up begin anew.
        """
        ahead = self.cells + MOVES[moves]
        is_inside = ((ahead >= 0) & (ahead < pool.shape)).all(axis=1)
        inside = np.where(is_inside[:, None], ahead, 0)
        can = is_inside & pool.feasible[self.scenes, inside[:, 0], inside[:, 1]] & ~waits
        places = self.cells = np.where(can[:, None], ahead, self.cells)
        self.steps += ~waits
        self._look(pool)
        is_there = (self.cells == pool.goal[self.scenes]).all(axis=1)
        is_over = is_there | (self.steps >= self.terms.max_steps)
        if is_over.any():
            self.cells = places.copy()
            self.begin(pool, np.flatnonzero(is_over))

        return FinishedEpisodes(places, is_there, is_over)

    def _look(self, pool: SceneSet) -> None:
        self.seen = self.seen.look(
            self.cells, patches_of(pool, self.scenes, self.cells, self.seen.radius)
        )
