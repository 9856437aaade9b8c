"""`Episode`: one robot on its way over one world, step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell, legal_moves
from irs_gym.mdp.action_values import optimal_q
from irs_gym.mdp.budget import can_pay, choose_budget, cleared, scaled_amount
from irs_gym.mdp.checks import checked_action
from irs_gym.mdp.dynamics import (
    ACTIONS,
    Transition,
    choose_start,
    metres_to_go,
    optimal_moves_within,
    oracle_path,
    paid_at_start,
    refused_reward,
    tables_for,
    transition_table,
)
from irs_gym.mdp.metrics import spl
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.path_history import cells_of
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import Rules, World
from irs_gym.oracle.shortest_path import Path, flat_cell, optimal_moves
from irs_gym.rendering.episode_view import RENDERERS, view_of
from irs_gym.vector.infos import BUDGET_VALUES, KEYS

_COST = Transition._fields.index("cost")


class Episode:
    """What has become of a robot since its reset, over the tables of its world."""

    def __init__(
        self,
        world: World,
        start: Cell,
        goal: Cell,
        keys: Sequence[str] = KEYS,
        budget: float | None = None,
    ) -> None:
        """Begin at the start; a ``ValueError`` says why there can be no such episode (see
        `tables_for`).

        ``keys``: those of the infos. ``budget``: the total cost that the episode may come to, where
        the rules hold one.
        """
        self.world = world
        self.start = start
        self.goal = goal
        self.tables = tables_for(world, start, goal, budget)
        self.observer = build_observer(world, goal)
        self.is_running = True
        known = KEYS if budget is None else (*KEYS, *BUDGET_VALUES)
        self._unwanted = [key for key in known if key not in keys]  # of the infos
        self._cell = world.radio_map.grid.flat(start)
        self._cells = [self._cell]  # flat indices
        self._budget = budget
        self._start_cost = float(paid_at_start(world, self._cell))
        self._left = None if budget is None else _less(budget, self._start_cost)
        self._oracle_distance = self.distance_to_go
        self._distance = 0.0
        self._refused = 0
        self._has_violated = False

    @property
    def oracle(self) -> Path:
        """The shortest path from start to goal that the rules allow."""
        return oracle_path(self.world, self.start, self.goal, self._budget)

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) so far, refused moves left out."""
        return cells_of(np.array(self._cells), self.world.feasible.shape)

    @property
    def distance_to_go(self) -> float:
        """Metres of the shortest way from here to the goal that the rules allow; inf where there is
        none.
        """
        return float(metres_to_go(self.world, self.goal, self._cell, self._left))

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused in this cell, bool ``(8,)``."""
        return self._mask().astype(bool)

    def optimal_actions(self, cell: Any = None) -> NDArray[np.int64]:
        """See `irs_gym.envs.nav.IrsNavEnv.optimal_actions`."""
        i, j = (
            self.world.radio_map.grid.cell_at(self._cell) if cell is None else as_cell(cell, "cell")
        )
        flat = flat_cell(self.world.feasible, (i, j), "cell")
        if self._left is not None:
            return optimal_moves_within(self.world, self.goal, flat, self._left)

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
            budget=self._budget or 0.0,
            budget_left=self._left or 0.0,
            refused=self._refused,
            has_violated=self._has_violated,
            is_running=self.is_running,
        )

    def opening(self) -> tuple[Any, dict[str, Any]]:
        """What a reset returns: the first observation and its info."""
        return self._observe(), self._info(cost=self._start_cost)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; returns what an environment's step does."""
        if not self.is_running:
            raise ResetNeeded(
                "the episode has ended, or none has begun: call reset() before step()"
            )

        entry = self._cell * ACTIONS + checked_action(action)
        outcome: Any = self.tables.transition.item(entry)
        if self._cannot_pay(outcome[_COST]):
            outcome = self._refused_outcome(action)

        next_cell, reward, moved, is_refused, cost, is_terminated, is_at_goal = outcome
        self._cells.append(next_cell)
        self._cell = next_cell
        self._distance += moved
        self._refused += is_refused
        if self._budget is None:
            self._has_violated = self._has_violated or cost > 0
        else:
            reward, is_terminated = self._pay(cost, reward, is_terminated, is_at_goal)

        self.is_running = not is_terminated
        info = self._info(is_refused, cost, is_at_goal and not self._has_violated)

        return self._observe(), reward, is_terminated, False, info

    def _cannot_pay(self, cost: float) -> bool:
        """Whether a step is refused, since the budget cannot pay it."""
        if self._left is None or self.world.rules.on_exhausted != "refuse":
            return False
        return not can_pay(self._left, cost)

    def _refused_outcome(self, action: Any) -> tuple[Any, ...]:
        """The transition of a move that the budget refuses: the robot stays, and pays nothing."""
        cell_size = self.world.radio_map.grid.cell_size
        reward = float(refused_reward(self.world.rules, int(action), cell_size))

        return self._cell, reward, 0.0, True, 0.0, False, False

    def _mask(self) -> NDArray[np.int8]:
        """1 where an action is not refused, ``(8,)``; in memory of its own."""
        mask: NDArray[np.int8] = self.tables.action_mask[self._cell].copy()
        if self._left is not None and self.world.rules.on_exhausted == "refuse":
            entries = self._cell * ACTIONS + np.arange(ACTIONS)
            mask &= can_pay(self._left, self.tables.transition["cost"].take(entries))

        return mask

    def _pay(
        self, cost: float, reward: float, is_terminated: bool, is_at_goal: bool
    ) -> tuple[float, bool]:
        """Take a cost out of the budget; the reward of the move, and whether the episode ends.

        Where the budget is exhausted, it may end, and then it is a failure, at the goal as well.
        """
        rules = self.world.rules
        assert self._left is not None
        self._left = _less(self._left, cost)
        self._has_violated = self._left < 0
        if not self._has_violated or rules.on_exhausted == "continue":
            return reward, is_terminated

        return reward - rules.goal_bonus * is_at_goal, True

    def _observe(self) -> Any:
        observation = self.observer.observe(self._cell)
        if self._left is not None:
            packing = self.observer.packing
            packing.set_budget(observation, scaled_amount(self._left))
            if packing.observation == "masked":
                observation["action_mask"][:] = self._mask()

        return observation

    def render(self, mode: str | None) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path;
        None without a mode.
        """
        return (
            None
            if mode is None
            else RENDERERS[mode](
                view_of(self.world, self.start, self.goal, self._budget), self.path
            )
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
            "action_mask": self._mask(),
            "is_refused": is_refused,
            "cost": cost,
            "is_success": is_success,
            "spl": float(spl(True, self._oracle_distance, self._distance)) if is_success else 0.0,
            "oracle_distance": self._oracle_distance,
        }
        if self._left is not None:
            info["distance_to_go"] = self.distance_to_go
            info["budget_left"] = self._left

        for key in self._unwanted:
            del info[key]

        return info


def _less(left: float, cost: float) -> float:
    """What a cost leaves of a budget."""
    return float(cleared(np.asarray(left - cost)))


def option_names(rules: Rules) -> tuple[str, ...]:
    """Options of `reset` that the rules add to start and goal."""
    return () if rules.budget is None else ("budget",)


def episode_budget(rules: Rules, asked: Any, rng: np.random.Generator) -> float | None:
    """The budget of an episode; None where the rules hold none."""
    if rules.budget is None:
        return None
    return choose_budget(rules.budget, asked, rng)


def begin(
    world: World,
    ends: dict[str, Cell],
    rng: np.random.Generator,
    keys: Sequence[str],
    budget: float | None = None,
) -> Episode:
    """Episode between the ends given as ``start`` and ``goal``; the world's own goal, and a start
    as its task says.
    """
    goal = ends.get("goal", world.goal)
    start = ends.get("start") or choose_start(world, goal, rng, budget)

    return Episode(world, start, goal, keys, budget)


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

    ends = grid.cell_at(snapshot.start), grid.cell_at(snapshot.goal)
    budget = None if world.cost is None else snapshot.budget
    episode = Episode(world, *ends, keys, budget)
    episode._left = None if budget is None else snapshot.budget_left
    episode._cell = snapshot.cell
    episode._cells = [grid.flat(cell) for cell in path] or [snapshot.cell]
    episode._distance = snapshot.distance
    episode._refused = snapshot.refused
    episode._has_violated = snapshot.has_violated
    episode.is_running = snapshot.is_running

    return episode
