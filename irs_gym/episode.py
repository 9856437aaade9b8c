"""`Episode`: one robot on its way over one world, step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.dynamics import ACTIONS, choose_start, tables_for
from irs_gym.grid import Cell
from irs_gym.infos import KEYS
from irs_gym.interface import RENDERERS, checked_action, view_of
from irs_gym.metrics import spl
from irs_gym.observation import build_observer
from irs_gym.oracle import Path, descend
from irs_gym.task import World
from irs_gym.trail import cells_of


class Episode:
    """What has become of a robot since its reset, over the tables of its world."""

    def __init__(self, world: World, start: Cell, goal: Cell, keys: Sequence[str] = KEYS) -> None:
        """Begin at the start; a ``ValueError`` says why there can be no such episode (see `tables_for`).

        ``keys``: those of the infos.
        """
        self.world, self.start, self.goal = world, start, goal
        self.tables = tables_for(world, start, goal)
        self.observer = build_observer(world, goal)
        self.is_running = True
        self._keys = keys
        self._cell = int(np.ravel_multi_index(start, world.radio_map.grid.shape))
        self._cells = [self._cell]  # flat indices
        self._oracle_distance = float(self.tables.distance_to_go[start])
        self._distance = 0.0
        self._refused = 0
        self._has_violated = False

    @property
    def oracle(self) -> Path:
        """The shortest feasible path from start to goal."""
        return descend(self.tables.distance_to_go, self.start, self.world.radio_map.grid.cell_size)

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) so far, refused moves left out."""
        return cells_of(np.array(self._cells), self.world.feasible.shape)

    @property
    def distance_to_go(self) -> float:
        """Metres of the shortest feasible path from here to the goal; inf where there is none."""
        return float(self.tables.distance_to_go.flat[self._cell])

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused in this cell, bool ``(8,)``."""
        return np.asarray(self.tables.action_mask[self._cell], dtype=bool)

    def opening(self) -> tuple[Any, dict[str, Any]]:
        """What a reset returns: the first observation and its info."""
        return self.observer.observe(self._cell), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; returns what an environment's step does."""
        if not self.is_running:
            raise ResetNeeded("the episode has ended, or none has begun: call reset() before step()")
        entry = self._cell * ACTIONS + checked_action(action)
        outcome: Any = self.tables.transition.item(entry)
        next_cell, reward, moved, is_refused, cost, is_terminated, is_at_goal = outcome
        self._cells.append(next_cell)
        self._cell = next_cell
        self._distance += moved
        self._refused += is_refused
        self._has_violated = self._has_violated or cost > 0
        self.is_running = not is_terminated
        info = self._info(is_refused, cost, is_at_goal and not self._has_violated)
        return self.observer.observe(next_cell), reward, is_terminated, False, info

    def render(self, mode: str | None) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path; None without a mode."""
        return None if mode is None else RENDERERS[mode](view_of(self.world, self.start, self.goal), self.path)

    def _info(self, is_refused: bool = False, cost: float = 0.0, is_success: bool = False) -> dict[str, Any]:
        distance_to_go, gain_db, margin_db = self.tables.cell.item(self._cell)
        info = {
            "distance": self._distance,
            "refused": self._refused,
            "distance_to_go": distance_to_go,
            "gain_db": gain_db,
            "margin_db": margin_db,
            "action_mask": self.tables.action_mask[self._cell].copy(),
            "is_refused": is_refused,
            "cost": cost,
            "is_success": is_success,
            "spl": float(spl(True, self._oracle_distance, self._distance)) if is_success else 0.0,
            "oracle_distance": self._oracle_distance,
        }
        return {key: info[key] for key in self._keys}


def begin(world: World, ends: dict[str, Cell], rng: np.random.Generator, keys: Sequence[str]) -> Episode:
    """Episode between the ends given as ``start`` and ``goal``; the world's own goal, and a start as its task says."""
    goal = ends.get("goal", world.goal)
    return Episode(world, ends.get("start") or choose_start(world, goal, rng), goal, keys)
