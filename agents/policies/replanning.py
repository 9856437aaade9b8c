"""`Replanner`: optimistic replanning, what D* Lite computes: the reference for agents that see only
a patch.
"""

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.path_plan import OFF_PATH, Moves, plan_paths
from irs_gym.grid import MOVES, flat_cells
from irs_gym.mdp.packing import Packing

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ReplannerState:
    """What n robots know since their reset, and what they are about to do.

    Attributes
    ----------
    floor
        Bool, shape ``(n, X + 2b, Y + 2b)``: cells that were not seen to be obstructed or below the
        target. The unknown is open; the border of b cells around the map is closed.
    border
        b.
    moves
        int8, shape ``(n, X * Y)``: those of their paths, as `agents.policies.path_plan.plan_paths`
        has them.
    cells, goals
        Flat cells ``(n,)``: where they were at the last step, and where they go.
    """

    floor: Bools
    border: int
    moves: Moves
    cells: Ints
    goals: Ints

    @property
    def is_open(self) -> Bools:
        """The floor without its border, ``(n, X, Y)``: a view."""
        inner = slice(self.border, -self.border)
        return self.floor[:, inner, inner]


@dataclass(frozen=True, eq=False)
class Replanner:
    """A policy that takes the first move of a shortest path over all cells that it has not seen to
    be infeasible.

    It reads nothing but observations (dict, flat or map) and their layout: the frame that positions
    are scaled to, and the patch's radius. What it has seen since the start of the episode is its
    state. Where it sees its neighbours, none of its moves is refused; with a radius of 0 it learns
    from a refusal, as it stays where it is. Of moves equally good it takes the first.

    A path is followed until a cell that it needs turns out to be closed. Until then it is what a
    plan made anew would give: as cells only close, distances to go only rise, those along the path
    stay as they are, and so the first of the best moves in its cells is still the first of the
    best.
    """

    shape: tuple[int, int]  # (X, Y)
    radius: int | None  # None where the whole map is seen
    corner_cutting: bool = True

    def predict(
        self,
        observation: Any,
        state: ReplannerState | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, ReplannerState]:
        """Actions for one observation or a batch, and what was seen so far; see
        `agents.policies.policy.Policy`.

        Without ``state``, or where ``episode_start``, it knows nothing but what it sees.
        """
        decoded = Packing.of(observation, self.shape, self.radius).decode(observation)
        views = (decoded.margin >= 0.0).reshape(decoded.cell.size, -1)  # (n, cells in view)
        cells = decoded.cell.ravel()  # (n,)
        goals = decoded.goal.ravel()  # (n,)

        old = self._blank(len(cells)) if state is None else state
        if episode_start is not None and np.any(episode_start):
            old = self._forget(old, np.ravel(episode_start).astype(bool))

        # What turns out to be closed, and whose paths depend on it.
        robots = np.arange(len(cells))
        needs_path = goals != old.goals  # (n,)
        floor = old.floor
        places = self._closed(old, cells, views)
        if len(places):
            floor = floor.copy()
            floor.reshape(-1)[places] = False
            robot, i, j = np.unravel_index(places, floor.shape)
            on_map = (i - self._border) * self.shape[1] + j - self._border
            needs_path[robot[old.moves[robot, on_map] != OFF_PATH]] = True

        # A path holds until then, or until the robot is elsewhere.
        moves = old.moves
        needs_path |= moves[robots, cells] < 0
        if needs_path.any():
            moves = moves.copy()
            inner = slice(self._border, -self._border)
            cost = np.where(floor[needs_path, inner, inner], 1.0, np.inf)
            moves[needs_path] = plan_paths(
                cost, cells[needs_path], goals[needs_path], self.corner_cutting
            )

        new = ReplannerState(floor, self._border, moves, cells, goals)
        return moves[robots, cells].astype(np.int64).reshape(decoded.cell.shape), new

    def _closed(self, old: ReplannerState, cells: Ints, views: Bools) -> Ints:
        """Places in the array of floors that turn out to be closed."""
        origins = self._origins(cells)  # (n,)
        places = origins[:, None] + self._view  # (n, cells in view)
        closed = places[old.floor.take(places) > views]
        if self.radius != 0:
            return closed

        # Without its neighbours in view, it did not see that its move would be refused.
        still = np.flatnonzero(cells == old.cells)
        ahead = origins[still] + self._steps[old.moves[still, cells[still]]]

        return np.concatenate([closed, ahead[old.floor.take(ahead)]])

    def _blank(self, robots: int) -> ReplannerState:
        """What robots know that have seen nothing."""
        floor = np.zeros((robots, *self._frame), dtype=bool)
        inner = slice(self._border, -self._border)
        floor[:, inner, inner] = True
        moves = np.full((robots, prod(self.shape)), OFF_PATH, dtype=np.int8)
        nowhere = np.full(robots, -1)

        return ReplannerState(floor, self._border, moves, nowhere, nowhere)

    def _forget(self, old: ReplannerState, robots: Bools) -> ReplannerState:
        """Nothing known by these robots."""
        blank = self._blank(1)
        floor = old.floor.copy()
        moves = old.moves.copy()
        cells = np.where(robots, blank.cells, old.cells)
        goals = np.where(robots, blank.goals, old.goals)
        floor[robots] = blank.floor
        moves[robots] = blank.moves

        return ReplannerState(floor, self._border, moves, cells, goals)

    # --- places: cells of all floors, each with its border, one behind the other ------------------

    def _origins(self, cells: Ints) -> Ints:
        """The places of robots in flat cells ``(n,)``, or of their floors where those are seen
        whole.
        """
        columns, rows = self._frame
        first = np.arange(len(cells)) * (columns * rows)
        if self.radius is None:
            return first

        return first + cells + cells // self.shape[1] * (2 * self._border) + self._corner

    @cached_property
    def _border(self) -> int:
        """As many cells as are in view: no view, and no move, leads beyond it."""
        return max(self.radius or 0, 1)

    @cached_property
    def _frame(self) -> tuple[int, int]:
        """Cells of a floor along x and y."""
        return self.shape[0] + 2 * self._border, self.shape[1] + 2 * self._border

    @cached_property
    def _corner(self) -> int:
        """The place of the first cell of the map."""
        return self._border * (self._frame[1] + 1)

    @cached_property
    def _steps(self) -> Ints:
        """How many places each move leads on, ``(8,)``."""
        return flat_cells(MOVES, self._frame)

    @cached_property
    def _view(self) -> Ints:
        """From the origin to each place in view."""
        if self.radius is None:
            cells = np.moveaxis(np.indices(self.shape, dtype=np.int64), 0, -1)
            return flat_cells(cells, self._frame).ravel() + self._corner

        side = np.arange(-self.radius, self.radius + 1)
        window = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
        return flat_cells(window, self._frame).ravel()
