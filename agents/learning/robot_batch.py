"""`RobotBatch`: robots on their ways through scenes of a pool, with what each of them has seen."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.learning.local_configs import RobotBatchConfig
from agents.policies.belief_map import UNKNOWN, padded_margin
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
    """What there is around robots in all cells of the scenes of a pool."""

    margin: Tensor  # (S, X + 2r, Y + 2r), scaled
    to_go: Tensor  # (S, X, Y), cells to the scene's own goal
    is_legal: Bools  # (S, X, Y, 8), whether a robot can make a move

    @classmethod
    def of(cls, pool: SceneSet, radius: int, device: str = "cpu") -> "Surroundings":
        """Of the scenes of a pool, some at a time: what lies between takes more memory."""
        parts = np.array_split(np.arange(len(pool)), -(-len(pool) // _SCENES))
        is_legal = [
            permissions(
                RULES.constraint, pool.free[part], pool.feasible[part], **pool.motion(part)
            )[0]
            for part in parts
        ]
        to_go = (pool.distance_to_go / pool.cell_size).astype(np.float32)

        return cls(
            torch.from_numpy(padded_margin(pool, slice(None), radius)).to(device),
            torch.from_numpy(to_go).to(device),
            np.concatenate(is_legal),
        )


class RobotBatch:
    """Robots that begin anew, in another scene, as soon as they have arrived or given up.

    Attributes
    ----------
    scenes, cells
        Where each robot is, ``(n,)`` and ``(n, 2)``.
    steps
        How many each has taken since it began, ``(n,)``.
    margin
        Scaled margins that each has seen of its map since it began, ``(n, X + 2r, Y + 2r)`` with a
        border as wide as it sees, NaN where it has not looked.
    """

    def __init__(
        self,
        config: RobotBatchConfig,
        pool: SceneSet,
        rng: np.random.Generator,
        device: str = "cpu",
    ) -> None:
        n = config.robots
        border = 2 * config.patch_radius
        self.config = config
        self.device = device
        self._rng = rng
        self.scenes = np.zeros(n, dtype=np.int64)
        self.cells = np.zeros((n, 2), dtype=np.int64)
        self.steps = np.zeros(n, dtype=np.int64)
        shape = (n, pool.shape[0] + border, pool.shape[1] + border)
        self.margin = torch.full(shape, float(UNKNOWN), device=device)
        self._surroundings: Surroundings | None = None  # once they are asked for
        self.begin(pool, np.arange(n))

    @property
    def maps(self) -> Tensor:
        """What each has seen of its map, without the border, ``(n, X, Y)``: a view."""
        inner = slice(self.config.patch_radius, -self.config.patch_radius or None)
        return self.margin[:, inner, inner]

    def known(self, pool: SceneSet) -> tuple[Tensor, Tensor]:
        """What the robots know, as `agents.networks.explorer.ExplorerNetwork` takes it: a copy."""
        goals = flat_cells(pool.goal[self.scenes], pool.shape)  # (n,)

        return (
            self.maps.clone(memory_format=torch.contiguous_format),
            torch.from_numpy(goals).to(self.device),
        )

    def truth(self, pool: SceneSet) -> tuple[Tensor, Tensor]:
        """What their maps are really like: which cells are feasible, and how many cells it is from
        each to the goal, both ``(n, X, Y)``.
        """
        around = self._around(pool)
        scenes = torch.from_numpy(self.scenes).to(self.device)
        inner = slice(self.config.patch_radius, -self.config.patch_radius or None)

        return around.margin[scenes, inner, inner] >= 0, around.to_go[scenes]

    def in_view(self) -> Tensor:
        """Which cells lie in the patch that each robot sees now, bool ``(n, X, Y)``."""
        columns, rows = self.maps.shape[1:]
        i, j = torch.from_numpy(self.cells).to(self.device).T[..., None]  # (n, 1) each
        radius = self.config.patch_radius
        is_near_x = (torch.arange(columns, device=self.device) - i).abs() <= radius  # (n, X)
        is_near_y = (torch.arange(rows, device=self.device) - j).abs() <= radius  # (n, Y)

        return torch.logical_and(is_near_x[:, :, None], is_near_y[:, None])

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_surroundings": None}  # made anew of the pool

    def _around(self, pool: SceneSet) -> Surroundings:
        if self._surroundings is None:
            self._surroundings = Surroundings.of(pool, self.config.patch_radius, self.device)
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
        self.margin[torch.from_numpy(robots).to(self.device)] = float(UNKNOWN)
        self._look(pool, robots)

    def move(self, pool: SceneSet, moves: Ints, waits: Bools) -> BatchStep:
        """One step of all robots but those that wait, by the rules of the environment.

        Those that have arrived or given up begin anew.
        """
        cells = self._next_cells(pool, moves, ~waits)
        self.cells = cells
        self.steps += ~waits
        self._look(pool, np.arange(len(cells)))

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

    def _look(self, pool: SceneSet, robots: Ints) -> None:
        """These robots see the patch around them."""
        side = torch.arange(2 * self.config.patch_radius + 1, device=self.device)
        numbers = np.column_stack([robots, self.scenes[robots], self.cells[robots]])  # (m, 4)
        robot, scene, i, j = torch.from_numpy(numbers).to(self.device).T[..., None, None]
        i = i + side[:, None]  # (m, 2r+1, 1)
        j = j + side  # (m, 1, 2r+1)
        self.margin[robot, i, j] = self._around(pool).margin[scene, i, j]
