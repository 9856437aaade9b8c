"""`Observer`: what an agent sees of a world, for one goal; and `Packing`, its layout."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from math import prod
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.mdp.dynamics import ACTIONS, action_mask
from irs_gym.mdp.task import Observation, World

MARGIN_SCALE_DB = 5.0  # a margin of this many dB over the target is seen as 1
_MOST_CELLS = 2**24  # whole numbers up to this one are float32 as well
_LARGEST_TABLE = 2**27  # bytes: observations of larger worlds are computed as they are asked for

Rows = NDArray[np.float32]
Parts = tuple[Rows, ...]  # of rows: one for each array of an observation


@dataclass(frozen=True)
class Packing:
    """How observations are packed in rows of float32.

    In the order of their keys, as `gymnasium.spaces.flatten` packs a Dict: ``gain_patch`` (2r+1,
    2r+1), ``irs`` (3 + N), ``position`` (4). Masked, the action mask (8) follows. As a map, a row
    holds the image (4, X, Y); as a cell, its flat index. Raises ``ValueError`` for more cells than
    float32 can number.
    """

    observation: Observation
    side: int  # of the patch, 2r+1
    settings: int  # 3 + N
    shape: tuple[int, int]  # of the map, (X, Y)

    def __post_init__(self) -> None:
        if self.observation == "cell" and prod(self.shape) > _MOST_CELLS:
            raise ValueError(
                f"observation='cell' can tell {_MOST_CELLS} cells apart, and {self.shape} are more"
            )

    @cached_property
    def patch_end(self) -> int:
        """Column of a row behind the patch."""
        return self.side**2

    @cached_property
    def irs_end(self) -> int:
        """Column of a row behind what it tells of the IRS."""
        return self.side**2 + self.settings

    @cached_property
    def flat_end(self) -> int:
        """Column of a row behind what a flat observation holds."""
        return self.irs_end + 4

    @cached_property
    def width(self) -> int:
        """Columns of a row, D."""
        others = {"map": 4 * prod(self.shape), "masked": self.flat_end + ACTIONS, "cell": 1}
        return others.get(self.observation, self.flat_end)

    @property
    def space(self) -> spaces.Space[Any]:
        """Of one observation; a new one each time, as a space holds the randomness of its samples."""
        shapes = {"gain_patch": (self.side, self.side), "irs": (self.settings,), "position": (4,)}
        if self.observation == "dict":
            return spaces.Dict({name: _box(shape) for name, shape in shapes.items()})

        if self.observation == "masked":
            mask = spaces.Box(0, 1, (ACTIONS,), dtype=np.int8)
            return spaces.Dict({"action_mask": mask, "observation": _box((self.flat_end,))})

        if self.observation == "cell":
            return spaces.Discrete(prod(self.shape))

        return _box((self.width,) if self.observation == "flat" else (4, *self.shape))

    @cached_property
    def columns(self) -> tuple[slice, ...]:
        """Columns of a row that are an array of their own in an observation."""
        inner = {"dict": (self.patch_end, self.irs_end), "masked": (self.flat_end,)}
        edges = [0, *inner.get(self.observation, ()), self.width]
        return tuple(slice(*each) for each in pairwise(edges))

    def empty(self, count: int) -> Parts:
        """Memory for the parts of that many rows. Each part is in one piece, as not every library
        of arrays takes a view with gaps.
        """
        widths = [each.stop - each.start for each in self.columns]
        return tuple(np.empty((count, width), dtype=np.float32) for width in widths)

    def split(self, rows: Rows) -> Parts:
        """Parts of rows ``(..., D)``, as views of them."""
        return tuple(rows[..., each] for each in self.columns)

    def unpack(self, parts: Parts) -> Any:
        """Observations of the parts of rows, with the leading axes kept: views of them, but for
        masks and cells.
        """
        first = parts[0]
        leading = first.shape[:-1]
        if self.observation == "masked":
            return {"action_mask": parts[1].astype(np.int8), "observation": first}
        if self.observation == "cell":
            return first[..., 0].astype(np.int64) if leading else int(first[0])
        if self.observation == "map":
            return first.reshape(*leading, 4, *self.shape)
        if self.observation == "dict":
            patch = first.reshape(*leading, self.side, self.side)
            return {"gain_patch": patch, "irs": parts[1], "position": parts[2]}

        return first


def _box(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, shape, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Observer:
    """Observations of the cells of one world for one goal.

    Attributes
    ----------
    rows
        Packed rows ``(n, D)`` of flat cells ``(n,)``, written to the second argument.
    """

    world: World
    goal: Cell
    packing: Packing
    rows: Callable[[NDArray[np.int64], Rows], Rows]
    table: Rows | None  # (X * Y, D), where it is small enough to keep
    _seen: Callable[[int], Any] = field(
        init=False, repr=False
    )  # unpacked views of the table's rows

    def __post_init__(self) -> None:
        # Robots are in the same cells again and again, and to copy parts is faster than to take a
        # copy apart.
        def seen(cell: int) -> Any:
            return self.packing.unpack(self.packing.split(self.table[cell]))  # type: ignore[index]

        object.__setattr__(self, "_seen", lru_cache(maxsize=4096)(seen))

    def __reduce__(self) -> Any:
        return build_observer, (self.world, self.goal)

    def observe(self, cell: int) -> Any:
        """Observation of one flat cell, in memory of its own."""
        if self.packing.observation == "cell":
            return cell

        if self.table is None:
            rows = self.rows(np.array([cell]), np.empty((1, self.packing.width), dtype=np.float32))
            return self.packing.unpack(self.packing.split(rows[0]))

        observation = self._seen(cell).copy()
        if isinstance(observation, dict):
            for name in observation:
                observation[name] = observation[name].copy()

        return observation


@lru_cache(maxsize=8)
def build_observer(world: World, goal: Cell) -> Observer:
    """Observer of a world for one goal; kept, so the same goal costs nothing again."""
    task = world.task
    shape = world.radio_map.grid.shape
    packing = Packing(task.observation, 2 * task.patch_radius + 1, world.irs.shape[-1], shape)
    rows = _ROWS.get(task.observation, _packed_rows)(world, goal, packing)
    cells = world.feasible.size
    table = None
    # A world whose distances were known beforehand is one of many: it is entered once, and few of
    # its cells are seen.
    if (
        world.to_go is None
        and task.observation != "map"
        and cells * packing.width * 4 <= _LARGEST_TABLE
    ):
        table = rows(np.arange(cells), np.empty((cells, packing.width), dtype=np.float32))
        table.setflags(write=False)

    return Observer(world, goal, packing, rows, table)


def scaled_margin(
    gain_db: NDArray[np.float64], target_db: float | NDArray[np.float64]
) -> NDArray[np.float32]:
    """Margin over the target in `MARGIN_SCALE_DB`, clipped to [-1, 1]; -1 in obstacles. Shape of
    the gain.
    """
    return np.clip((gain_db - target_db) / MARGIN_SCALE_DB, -1.0, 1.0).astype(np.float32)


def own_positions(cells: NDArray[np.int64], shape: tuple[int, int]) -> Rows:
    """x and y of cells ``(..., 2)``, scaled to a room of that shape, ``(..., 2)``."""
    return (2.0 * (cells + 0.5) / shape - 1.0).astype(np.float32)


def vectors_to_goal(offsets: NDArray[np.int64], shape: tuple[int, int]) -> Rows:
    """Vectors to the goal over the room's size, ``(..., 2)``, of cells that far from it."""
    return (-offsets / shape).astype(np.float32)


def _packed_rows(
    world: World, goal: Cell, packing: Packing
) -> Callable[[NDArray[np.int64], Rows], Rows]:
    side = packing.side
    shape = packing.shape
    padded = np.pad(
        scaled_margin(world.radio_map.gain_db, world.target_db), side // 2, constant_values=-1.0
    )
    windows = np.lib.stride_tricks.sliding_window_view(
        padded, (side, side)
    )  # (X, Y, side, side), a view
    cells = np.indices(shape).transpose(1, 2, 0).reshape(-1, 2)
    own = own_positions(cells, shape)
    to_goal = vectors_to_goal(cells - np.array(goal), shape)
    irs = world.irs
    columns = shape[1]
    patch_end = packing.patch_end
    irs_end = packing.irs_end
    mask = action_mask(world) if packing.observation == "masked" else None

    def rows(at: NDArray[np.int64], out: Rows) -> Rows:
        i, j = np.divmod(at, columns)
        out[:, :patch_end] = windows[i, j].reshape(len(at), patch_end)
        out[:, patch_end:irs_end] = irs[i, j]
        out[:, irs_end : irs_end + 2] = own[at]
        out[:, irs_end + 2 : irs_end + 4] = to_goal[at]
        if mask is not None:
            out[:, irs_end + 4 :] = mask[at]

        return out

    return rows


def _map_rows(
    world: World, goal: Cell, packing: Packing
) -> Callable[[NDArray[np.int64], Rows], Rows]:
    """Image channels (4, X, Y): scaled margin, obstacle, robot, goal; the last three are 0 or 1."""
    shape = packing.shape
    cells = prod(packing.shape)
    still = np.zeros((4, *shape), dtype=np.float32)
    still[0], still[1] = (
        scaled_margin(world.radio_map.gain_db, world.target_db),
        ~world.radio_map.free,
    )
    still[3][goal] = 1.0
    still_row = still.ravel()

    def rows(at: NDArray[np.int64], out: Rows) -> Rows:
        out[:] = still_row
        out[np.arange(len(at)), 2 * cells + at] = 1.0
        return out

    return rows


def _cell_rows(
    world: World, goal: Cell, packing: Packing
) -> Callable[[NDArray[np.int64], Rows], Rows]:
    """The cell itself."""

    def rows(at: NDArray[np.int64], out: Rows) -> Rows:
        out[:, 0] = at
        return out

    return rows


_ROWS: dict[
    Observation, Callable[[World, Cell, Packing], Callable[[NDArray[np.int64], Rows], Rows]]
] = {
    "map": _map_rows,
    "cell": _cell_rows,
}
