"""`Observer`: what an agent sees of a world, for one goal: spaces, layout and values."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.task import World

MARGIN_SCALE_DB = 5.0  # a margin of this many dB over the target is seen as 1
_LARGEST_TABLE = 2**27  # bytes: observations of larger worlds are computed as they are asked for

Rows = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Observer:
    """Observations of the cells of one world for one goal.

    Rows are packed float32 vectors. In the order of their keys, as `gymnasium.spaces.flatten` packs a Dict:
    ``gain_patch`` (2r+1, 2r+1), ``irs`` (3 + N), ``position`` (4). As a map, a row holds the image (4, X, Y).

    Attributes
    ----------
    space
        Of one observation.
    rows
        Rows ``(n, D)`` of flat cells ``(n,)``, written to the second argument.
    unpack
        Observations of rows ``(..., D)``: views of them, with the leading axes kept.
    """

    world: World
    goal: Cell
    space: spaces.Space[Any]
    width: int
    rows: Callable[[NDArray[np.int64], Rows], Rows]
    unpack: Callable[[Rows], Any]
    table: Rows | None  # (X * Y, D), where it is small enough to keep
    _seen: Callable[[int], Any] = field(init=False, repr=False)  # unpacked views of the table's rows

    def __post_init__(self) -> None:
        # Robots are in the same cells again and again, and to copy parts is faster than to take a copy apart.
        seen = lru_cache(maxsize=4096)(lambda cell: self.unpack(self.table[cell]))  # type: ignore[index]
        object.__setattr__(self, "_seen", seen)

    def __reduce__(self) -> Any:
        return build_observer, (self.world, self.goal)

    def observe(self, cell: int) -> Any:
        """Observation of one flat cell, in memory of its own."""
        if self.table is None:
            return self.unpack(self.rows(np.array([cell]), np.empty((1, self.width), dtype=np.float32))[0])
        observation = self._seen(cell).copy()
        if isinstance(observation, dict):
            for name in observation:
                observation[name] = observation[name].copy()
        return observation


@lru_cache(maxsize=8)
def build_observer(world: World, goal: Cell) -> Observer:
    """Observer of a world for one goal; kept, so the same goal costs nothing again."""
    if world.task.observation == "map":
        return _map_observer(world, goal)
    return _packed_observer(world, goal)


def scaled_margin(world: World) -> NDArray[np.float32]:
    """Margin over the target in `MARGIN_SCALE_DB`, clipped to [-1, 1]; -1 in obstacles. Shape ``(X, Y)``."""
    margin = (world.radio_map.gain_db - world.target_db) / MARGIN_SCALE_DB
    return np.clip(margin, -1.0, 1.0).astype(np.float32)


def positions(world: World, goal: Cell) -> NDArray[np.float32]:
    """Own x and y, and the vector to the goal, each over the room's size, shape ``(X * Y, 4)``."""
    shape = world.radio_map.grid.shape
    cells = np.indices(shape).transpose(1, 2, 0).reshape(-1, 2)
    own = 2.0 * (cells + 0.5) / shape - 1.0
    return np.concatenate([own, (np.array(goal) - cells) / shape], axis=1).astype(np.float32)


def _packed_observer(world: World, goal: Cell) -> Observer:
    radius = world.task.patch_radius
    side, settings = 2 * radius + 1, world.irs.shape[-1]
    padded = np.pad(scaled_margin(world), radius, constant_values=-1.0)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))  # (X, Y, side, side), a view
    irs, position, columns = world.irs.reshape(-1, settings), positions(world, goal), world.irs.shape[1]
    patch_end, irs_end, width = side**2, side**2 + settings, side**2 + settings + 4

    def rows(cells: NDArray[np.int64], out: Rows) -> Rows:
        out[:, :patch_end] = windows[cells // columns, cells % columns].reshape(len(cells), patch_end)
        out[:, patch_end:irs_end] = irs[cells]
        out[:, irs_end:] = position[cells]
        return out

    def unpack(row: Rows) -> dict[str, Rows]:
        return {
            "gain_patch": row[..., :patch_end].reshape(*row.shape[:-1], side, side),
            "irs": row[..., patch_end:irs_end],
            "position": row[..., irs_end:],
        }

    as_is: Callable[[Rows], Any] = lambda row: row  # noqa: E731
    is_flat = world.task.observation == "flat"
    shapes = {"flat": (width,)} if is_flat else {"gain_patch": (side, side), "irs": (settings,), "position": (4,)}
    boxes: dict[str, spaces.Space[Any]] = {
        name: spaces.Box(-1.0, 1.0, shape, dtype=np.float32) for name, shape in shapes.items()
    }
    space = boxes["flat"] if is_flat else spaces.Dict(boxes)
    return _keep(world, goal, space, width, rows, as_is if is_flat else unpack)


def _map_observer(world: World, goal: Cell) -> Observer:
    """Image channels (4, X, Y): scaled margin, obstacle, robot, goal; the last three are 0 or 1."""
    shape = world.radio_map.grid.shape
    cells = shape[0] * shape[1]
    still = np.zeros((4, *shape), dtype=np.float32)
    still[0], still[1], still[3][goal] = scaled_margin(world), ~world.radio_map.free, 1.0
    still_row = still.ravel()

    def rows(at: NDArray[np.int64], out: Rows) -> Rows:
        out[:] = still_row
        out[np.arange(len(at)), 2 * cells + at] = 1.0
        return out

    def unpack(row: Rows) -> Rows:
        return row.reshape(*row.shape[:-1], 4, *shape)

    space = spaces.Box(-1.0, 1.0, (4, *shape), dtype=np.float32)
    return Observer(world, goal, space, 4 * cells, rows, unpack, table=None)


def _keep(
    world: World,
    goal: Cell,
    space: spaces.Space[Any],
    width: int,
    rows: Callable[[NDArray[np.int64], Rows], Rows],
    unpack: Callable[[Rows], Any],
) -> Observer:
    table, cells = None, world.feasible.size
    if cells * width * 4 <= _LARGEST_TABLE:
        table = rows(np.arange(cells), np.empty((cells, width), dtype=np.float32))
        table.setflags(write=False)
    return Observer(world, goal, space, width, rows, unpack, table)
