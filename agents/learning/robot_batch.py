"""`RobotBatch`: robots on their ways through scenes of a pool, with what each of them has seen."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.learning.local_configs import RobotBatchConfig
from agents.policies.belief_map import BeliefMap, padded_margin, windows
from agents.rollout.rules import RULES
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import cells_at, flat_cells
from irs_gym.mdp.dynamics import next_cells, permissions, start_cells

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
_SCENES = 256  # in work at a time


class BatchStep(NamedTuple):
    """Where a step has brought n robots, before those whose episodes are over begin anew."""

    cells: Ints  # (n, 2)
    is_there: Bools  # (n,), at the goal
    is_over: Bools  # (n,), at the goal or out of steps


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What robots see, and which moves they can make, in all cells of the scenes of a pool."""

    margin: NDArray[np.float32]  # (S, X + 2r, Y + 2r), scaled
    is_legal: Bools  # (S, X, Y, 8)
    radius: int  # r

    @classmethod
    def of(cls, pool: SceneSet, radius: int) -> "Surroundings":
        """Of the scenes of a pool, some at a time: what lies between takes more memory."""
        parts = np.array_split(np.arange(len(pool)), -(-len(pool) // _SCENES))
        is_legal = [
            permissions(
                RULES.constraint, pool.free[part], pool.feasible[part], **pool.motion(part)
            )[0]
            for part in parts
        ]

        return cls(padded_margin(pool, slice(None), radius), np.concatenate(is_legal), radius)

    def patches(self, scenes: Ints, cells: Ints) -> NDArray[np.float32]:
        """Those of robots in cells ``(n, 2)`` of scenes ``(n,)``: as `patches_of`."""
        _, i, j = windows(cells, self.radius)
        return np.asarray(self.margin[scenes[:, None, None], i, j])


class RobotBatch:
    """Robots that begin anew, in another scene, as soon as they have arrived or given up.

    Attributes
    ----------
    scenes, cells
        Where each robot is, ``(n,)`` and ``(n, 2)``.
    steps
        How many each has taken since it began, ``(n,)``.
    belief
        What each has seen of its map since it began.
    """

    def __init__(self, config: RobotBatchConfig, pool: SceneSet, rng: np.random.Generator) -> None:
        n = config.robots
        self.config = config
        self._rng = rng
        self.scenes = np.zeros(n, dtype=np.int64)
        self.cells = np.zeros((n, 2), dtype=np.int64)
        self.steps = np.zeros(n, dtype=np.int64)
        self.belief = BeliefMap.nothing(n, pool.shape, config.patch_radius)
        self._surroundings: Surroundings | None = None  # once they are asked for
        self.begin(pool, np.arange(n))

    def known(self, pool: SceneSet, device: str = "cpu") -> tuple[Tensor, Tensor, Tensor]:
        """What the robots know, as `agents.networks.explorer.ExplorerNetwork` takes it: a copy."""
        margin = np.ascontiguousarray(self.belief.maps)  # (n, X, Y)
        goals = flat_cells(pool.goal[self.scenes], pool.shape)  # (n,)

        return (
            torch.from_numpy(margin).to(device),
            torch.from_numpy(goals).to(device),
            torch.from_numpy(pool.irs[self.scenes]).to(device),
        )

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_surroundings": None}  # made anew of the pool

    def _around(self, pool: SceneSet) -> Surroundings:
        if self._surroundings is None:
            self._surroundings = Surroundings.of(pool, self.config.patch_radius)
        return self._surroundings

    def begin(self, pool: SceneSet, robots: Ints) -> None:
        """Send these robots on their way through scenes drawn anew."""
        self.scenes[robots] = self._rng.integers(len(pool), size=len(robots))
        self.cells[robots] = pool.start[self.scenes[robots]]

        is_drawn = self._rng.random(len(robots)) < self.config.random_start
        for robot in robots[is_drawn].tolist():
            scene = self.scenes[robot]
            can_start = start_cells(pool.distance_to_go[scene], tuple(pool.goal[scene].tolist()))
            self.cells[robot] = self._rng.choice(cells_at(can_start, pool.shape))

        self.steps[robots] = 0
        self.belief = self.belief.forget(robots)
        self._look(pool)

    def move(self, pool: SceneSet, moves: Ints, waits: Bools) -> BatchStep:
        """One step of all robots but those that wait, by the rules of the environment.

        Those that have arrived or given up begin anew.
        """
        cells = self._next_cells(pool, moves, ~waits)
        self.cells = cells
        self.steps += ~waits
        self._look(pool)

        is_there = (cells == pool.goal[self.scenes]).all(axis=1)
        is_over = is_there | (self.steps >= self.config.max_steps)
        if is_over.any():
            self.cells = cells.copy()  # the step that is told of keeps its own
            self.begin(pool, np.flatnonzero(is_over))

        return BatchStep(cells, is_there, is_over)

    def _next_cells(self, pool: SceneSet, moves: Ints, is_moving: Bools) -> Ints:
        """Cells ``(n, 2)`` that the moves lead to."""
        i, j = self.cells.T
        can = self._around(pool).is_legal[self.scenes, i, j, moves] & is_moving

        here = flat_cells(self.cells, pool.shape)
        return cells_at(next_cells(here, moves, can, pool.shape), pool.shape)

    def _look(self, pool: SceneSet) -> None:
        patches = self._around(pool).patches(self.scenes, self.cells)
        self.belief = self.belief.look(self.cells, patches)
