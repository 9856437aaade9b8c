"""`Replanner`: optimistic replanning, what D* Lite computes: the reference for agents that see only
a patch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, MOVES, cells_at, legal_moves, neighbours
from irs_gym.mdp.packing import Packing
from irs_gym.oracle.shortest_path import distance_to_go

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ReplannerState:
    """What a robot knows since its reset, and what it is about to do."""

    is_open: Bools  # (X, Y): not seen to be obstructed or below the target; the unknown is open
    goal: int  # flat
    moves: Ints  # (X * Y,): the first move of a shortest path over open cells
    last: int  # flat cell that the robot was in at the last step


@dataclass(frozen=True, eq=False)
class Replanner:
    """A policy that takes the first move of a shortest path over all cells that it has not seen to
    be infeasible.

    It reads nothing but observations (dict, flat or map) and their layout: the frame that positions
    are scaled to, and the patch's radius. What it has seen since the start of the episode is its
    state. Where it sees its neighbours, none of its moves is refused; with a radius of 0 it learns
    from a refusal, as it stays where it is. Of moves equally good it takes the first.
    """

    shape: tuple[int, int]  # (X, Y)
    radius: int | None  # None where the whole map is seen
    corner_cutting: bool = True

    def predict(
        self,
        observation: Any,
        state: Sequence[ReplannerState] | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, tuple[ReplannerState, ...]]:
        """Actions for one observation or a batch, and what was seen so far; see
        `agents.policies.policy.Policy`.

        Without ``state``, or where ``episode_start``, it knows nothing but what it sees.
        """
        decoded = Packing.of(observation, self.shape, self.radius).decode(observation)
        robots = decoded.cell.ravel()  # (n,)
        goals = decoded.goal.ravel()  # (n,)
        feasible = decoded.margin >= 0.0  # (..., 2r+1, 2r+1), or the whole map
        views = feasible.reshape(len(robots), *feasible.shape[-2:])

        olds: Sequence[ReplannerState | None] = [None] * len(robots) if state is None else state
        if episode_start is not None:
            olds = [
                None if begins else old
                for old, begins in zip(olds, np.ravel(episode_start), strict=True)
            ]

        each = zip(olds, robots.tolist(), goals.tolist(), views, strict=True)
        memories = tuple(self._look(old, robot, goal, view) for old, robot, goal, view in each)
        actions = [memory.moves[memory.last] for memory in memories]

        return np.array(actions).reshape(decoded.cell.shape), memories

    def _look(
        self, old: ReplannerState | None, robot: int, goal: int, view: Bools
    ) -> ReplannerState:
        """What the robot knows now, with a new plan where that differs from what it hoped for."""
        is_open = np.ones(self.shape, dtype=bool) if old is None else old.is_open.copy()
        i, j = cells_at(np.array(robot), self.shape).tolist()
        if self.radius is None:
            is_open &= view
        else:
            columns, seen_columns = _overlap(i, self.radius, self.shape[0])
            rows, seen_rows = _overlap(j, self.radius, self.shape[1])
            is_open[columns, rows] &= view[seen_columns, seen_rows]

        # Without its neighbours in view, it did not see that its move would be refused.
        if self.radius == 0 and old is not None and old.last == robot:
            is_open[tuple(np.add((i, j), MOVES[old.moves[robot]]))] = False

        if old is not None and old.goal == goal and (is_open == old.is_open).all():
            return replace(old, last=robot)

        return ReplannerState(is_open, goal, self._plan(is_open, goal), robot)

    def _plan(self, is_open: Bools, goal: int) -> Ints:
        """First moves of the shortest paths over open cells, shape ``(X * Y,)``."""
        i, j = cells_at(np.array(goal), self.shape).tolist()
        to_go = distance_to_go(is_open, (i, j), 1.0, corner_cutting=self.corner_cutting)

        # Of each move from each cell, (X, Y, 8).
        is_legal = legal_moves(is_open, self.corner_cutting)
        length = np.where(is_legal, MOVE_LENGTHS + neighbours(to_go, np.inf), np.inf)

        return np.asarray(length.argmin(axis=-1).ravel())


def _overlap(at: int, radius: int, size: int) -> tuple[slice, slice]:
    """Along one axis, the cells of a map that a patch shows, and where it shows them."""
    first = max(at - radius, 0)
    end = min(at + radius + 1, size)
    return slice(first, end), slice(first - at + radius, end - at + radius)
