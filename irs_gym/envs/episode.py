"""`Episode`: one robot on its way over one world, step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell, legal_moves
from irs_gym.mdp.action_values import optimal_q
from irs_gym.mdp.checks import checked_action
from irs_gym.mdp.dynamics import ACTIONS, Transition, choose_start, tables_for, transition_table
from irs_gym.mdp.metrics import spl
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.path_history import cells_of
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World
from irs_gym.oracle.shortest_path import Path, descend, flat_cell, optimal_moves
from irs_gym.rendering.episode_view import RENDERERS, view_of
from irs_gym.vector.infos import KEYS


class Episode:
    """What has become of a robot since its reset, over the tables of its world."""

    def __init__(self, world: World, start: Cell, goal: Cell, keys: Sequence[str] = KEYS) -> None:
        """Begin at the start; a ``ValueError`` says why there can be no such episode (see
        `tables_for`).

        ``keys``: those of the infos.
        """
        self.world = world
        self.start = start
        self.goal = goal
        self.tables = tables_for(world, start, goal)
        self.observer = build_observer(world, goal)
        self.is_running = True
        self._unwanted = [key for key in KEYS if key not in keys]  # of the infos
        self._cell = world.radio_map.grid.flat(start)
        self._cells = [self._cell]  # flat indices
        self._oracle_distance = float(self.tables.distance_to_go[start])
        self._distance = 0.0
        self._refused = 0
        self._has_violated = False

    @property
    def oracle(self) -> Path:
        """The shortest feasible path from start to goal."""
        return descend(
            self.tables.distance_to_go,
            self.start,
            self.world.radio_map.grid.cell_size,
            self._keeps_target(),
        )

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

    def optimal_actions(self, cell: Any = None) -> NDArray[np.int64]:
        """See `irs_gym.envs.nav.IrsNavEnv.optimal_actions`."""
        i, j = (
            self.world.radio_map.grid.cell_at(self._cell) if cell is None else as_cell(cell, "cell")
        )
        flat_cell(self.world.feasible, (i, j), "cell")
        is_optimal = optimal_moves(
            self.tables.distance_to_go[None],
            self.world.radio_map.grid.cell_size,
            self._keeps_target()[None],
        )

        return np.flatnonzero(is_optimal[0, :, i, j])

    def transition_table(self) -> Transition:
        """See `irs_gym.envs.nav.IrsNavEnv.transition_table`."""
        return transition_table(self.world, self.goal)

    def optimal_q(self, gamma: float) -> NDArray[np.float64]:
        """See `irs_gym.envs.nav.IrsNavEnv.optimal_q`."""
        return optimal_q(self.transition_table(), gamma)

    def snapshot(self, scene: int = 0) -> Snapshot:
        """Where the episode stands, in the scene of that number."""
        return Snapshot(
            rules=self.world.fingerprint,
            scene=scene,
            start=flat_cell(self.world.feasible, self.start, "start"),
            goal=flat_cell(self.world.feasible, self.goal, "goal"),
            cell=self._cell,
            distance=self._distance,
            refused=self._refused,
            has_violated=self._has_violated,
            is_running=self.is_running,
        )

    def opening(self) -> tuple[Any, dict[str, Any]]:
        """What a reset returns: the first observation and its info."""
        return self.observer.observe(self._cell), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; returns what an environment's step does."""
        if not self.is_running:
            raise ResetNeeded(
                "the episode has ended, or none has begun: call reset() before step()"
            )

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
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path;
        None without a mode.
        """
        return (
            None
            if mode is None
            else RENDERERS[mode](view_of(self.world, self.start, self.goal), self.path)
        )

    def _keeps_target(self) -> NDArray[np.bool_]:
        """Which moves the oracle may make, ``(X, Y, 8)``."""
        return legal_moves(self.world.feasible, **self.world.motion)

    def _info(
        self, is_refused: bool = False, cost: float = 0.0, is_success: bool = False
    ) -> dict[str, Any]:
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
        for key in self._unwanted:
            del info[key]

        return info


def begin(
    world: World, ends: dict[str, Cell], rng: np.random.Generator, keys: Sequence[str]
) -> Episode:
    """Episode between the ends given as ``start`` and ``goal``; the world's own goal, and a start
    as its task says.
    """
    goal = ends.get("goal", world.goal)
    return Episode(world, ends.get("start") or choose_start(world, goal, rng), goal, keys)


def resume(
    world: World, snapshot: Snapshot, keys: Sequence[str], path: Sequence[Cell] = ()
) -> Episode:
    """The episode of a snapshot, with its path so far where that is known.

    Raises ``ValueError`` for a snapshot of another map or other rules.
    """
    if snapshot.rules != world.fingerprint:
        raise ValueError(
            "state is of another task: its map or its rules differ from those of this environment"
        )

    grid = world.radio_map.grid
    if not (snapshot.cell < world.feasible.size and world.radio_map.free.flat[snapshot.cell]):
        raise ValueError("state tells a cell that a robot cannot be in")

    episode = Episode(world, grid.cell_at(snapshot.start), grid.cell_at(snapshot.goal), keys)
    episode._cell = snapshot.cell
    episode._cells = [grid.flat(cell) for cell in path] or [snapshot.cell]
    episode._distance = snapshot.distance
    episode._refused = snapshot.refused
    episode._has_violated = snapshot.has_violated
    episode.is_running = snapshot.is_running

    return episode
