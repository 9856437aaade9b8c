"""`Observer`: what an agent sees of a world, for one goal."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from irs_gym.grid import Cell
from irs_gym.mdp.dynamics import action_mask
from irs_gym.mdp.packing import (
    GOAL,
    MARGIN,
    OBSTACLE,
    ROBOT,
    Ints,
    Packing,
    Rows,
    own_positions,
    scaled_margin,
    vectors_to_goal,
)
from irs_gym.mdp.task import Observation, World

_LARGEST_TABLE = 2**27  # bytes: observations of larger worlds are computed as they are asked for

RowWriter = Callable[[Ints, Rows], Rows]
"""Writes packed rows of flat cells ``(n,)`` into the rows ``(n, D)`` given, and returns these."""


@dataclass(frozen=True, eq=False)
class Observer:
    """Observations of the cells of one world for one goal.

    Examples
    --------
    >>> from irs_gym.mdp.task import Task, build_world
    >>> world = build_world(Task(observation="flat"))
    >>> observer = build_observer(world, world.goal)
    >>> observation = observer.observe(0)
    >>> observation.shape == observer.packing.space.shape
    True
    >>> int(observer.packing.decode(observation).cell)
    0
    """

    world: World
    goal: Cell
    packing: Packing
    rows: RowWriter
    table: Rows | None  # (X * Y, D), where it is small enough to keep
    _unpacked: Callable[[int], Any] = field(init=False, repr=False)
    """Of a flat cell, views of its row of the table."""

    def __post_init__(self) -> None:
        # Robots are in the same cells again and again, and to copy parts is faster than to take a
        # copy apart.
        def unpacked(cell: int) -> Any:
            return self.packing.unpack(self.packing.split(self.table[cell]))  # type: ignore[index]

        object.__setattr__(self, "_unpacked", lru_cache(maxsize=4096)(unpacked))

    def __reduce__(self) -> Any:
        return build_observer, (self.world, self.goal)

    def observe(self, cell: int) -> Any:
        """Observation of one flat cell, in memory of its own; see `Packing.set_budget` for what is
        left of a budget.
        """
        if self.packing.observation == "cell":
            return cell

        if self.table is None:
            rows = self.rows(np.array([cell]), np.empty((1, self.packing.width), dtype=np.float32))
            return self.packing.unpack(self.packing.split(rows[0]))

        observation = self._unpacked(cell).copy()
        if isinstance(observation, dict):
            for name in observation:
                observation[name] = observation[name].copy()

        return observation


@lru_cache(maxsize=8)
def build_observer(world: World, goal: Cell) -> Observer:
    """Observer of a world for one goal; kept, so the same goal costs nothing again."""
    task = world.task
    shape = world.radio_map.grid.shape
    side = 2 * task.patch_radius + 1
    has_budget = world.cost is not None
    packing = Packing(task.observation, side, world.irs.shape[-1], shape, has_budget)
    rows = _WRITERS.get(task.observation, _flat_rows)(world, goal, packing)
    cells = world.feasible.size

    # A world whose distances were known beforehand is one of many: it is entered once, and few of
    # its cells are seen.
    is_one_of_many = world.to_go is not None
    table = None
    if (
        not is_one_of_many
        and task.observation != "map"
        and cells * packing.width * 4 <= _LARGEST_TABLE
    ):
        table = rows(np.arange(cells), np.empty((cells, packing.width), dtype=np.float32))
        table.setflags(write=False)

    return Observer(world, goal, packing, rows, table)


def _flat_rows(world: World, goal: Cell, packing: Packing) -> RowWriter:
    """Patch, IRS and position, and the action mask behind them where it is asked for."""
    side = packing.side
    # What lies off the map is blocked, as an obstacle is.
    margin = scaled_margin(world.radio_map.gain_db, world.target_db)  # (X, Y)
    padded = np.pad(margin, side // 2, constant_values=-1.0)  # (X + 2r, Y + 2r)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))  # (X, Y, side, side)

    cells = np.indices(packing.shape).transpose(1, 2, 0).reshape(-1, 2)  # (X * Y, 2)
    own = own_positions(cells, packing.shape)  # (X * Y, 2)
    to_goal = vectors_to_goal(cells - np.array(goal), packing.shape)  # (X * Y, 2)
    mask = action_mask(world) if packing.observation == "masked" else None  # (X * Y, 8)

    def rows(at: Ints, out: Rows) -> Rows:
        i, j = cells[at].T
        packing.encode(
            packing.split(out),
            patch=windows[i, j].reshape(len(at), side**2),
            irs=world.irs[i, j],
            own=own[at],
            to_goal=to_goal[at],
            action_mask=None if mask is None else mask[at],
        )

        return out

    return rows


def _map_rows(world: World, goal: Cell, packing: Packing) -> RowWriter:
    """Image channels (4, X, Y): scaled margin, obstacle, robot, goal; the last three are 0 or 1.
    Under a budget there is a fifth, which stays 0 here.
    """
    # All but the robot stays the same.
    still = np.zeros((packing.channels, *packing.shape), dtype=np.float32)
    still[MARGIN] = scaled_margin(world.radio_map.gain_db, world.target_db)
    still[OBSTACLE] = ~world.radio_map.free
    still[GOAL][goal] = 1.0
    still_row = still.ravel()  # (D,)

    def rows(at: Ints, out: Rows) -> Rows:
        out[:] = still_row
        out[np.arange(len(at)), ROBOT * world.feasible.size + at] = 1.0
        return out

    return rows


def _cell_rows(world: World, goal: Cell, packing: Packing) -> RowWriter:
    """The cell itself."""

    def rows(at: Ints, out: Rows) -> Rows:
        out[:, 0] = at
        return out

    return rows


_WRITERS: dict[Observation, Callable[[World, Cell, Packing], RowWriter]] = {
    "map": _map_rows,
    "cell": _cell_rows,
}
