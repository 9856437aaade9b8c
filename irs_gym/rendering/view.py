"""`View`: all of an episode that does not change from frame to frame."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import Cell, Grid
from irs_gym.rendering.primitives import Floats

Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class View:
    """All of an episode that does not change from frame to frame.

    Attributes
    ----------
    gain_db
        Shape ``(X, Y)``, ``[i, j]``: channel gain of each cell in dB, -inf in obstacles.
    target_db
        Least gain in dB that the robot must keep.
    grid
        The cells' place on the floor.
    access_points, irs_panels
        Points ``(x, y)`` in metres, none to many; a panel is drawn along the nearest wall, or
        along its own.
    start, goal
        Cells ``(i, j)``. These, and those of paths, may be fractions: points between the centres of
        cells.
    oracle_cells
        Shape ``(D, 2)``: the cells of the shortest path, possibly none.
    size
        Longest side of the picture in px, 320 or more.
    free
        Bool, shape ``(X, Y)``: cells that a robot can enter; by default those of a finite gain.
    outlines
        Closed lines ``(n, 2)`` in metres: what stands in a room as it is, whatever cells it takes.
    panel_angles
        Of each panel's wall against the x axis in degrees; None for the nearest wall. Empty: all.
    oracle_switches
        Shape ``(n, 2)``: cells where the panel switches on the oracle's path; None where no panel
        is switched.
    label
        More about the map, in words.
    goal_radius
        Of the goal in cells, where it is a disc; 0 for a cell.
    is_square
        Whether the picture has white at its sides that makes it as high as wide: of rooms of all
        sizes, pictures are then of one.

    Raises
    ------
    ValueError
        Where a field has the wrong shape, a cell is off the grid, or a number cannot be drawn.
    """

    gain_db: Floats
    target_db: float
    grid: Grid
    access_points: tuple[Point, ...]
    irs_panels: tuple[Point, ...]
    start: Cell | Point
    goal: Cell | Point
    oracle_cells: NDArray[Any]
    size: int = 512
    free: NDArray[np.bool_] | None = None
    outlines: tuple[Floats, ...] = ()
    panel_angles: tuple[float | None, ...] = ()
    oracle_switches: NDArray[np.integer[Any]] | None = None
    label: str = ""
    goal_radius: float = 0.0
    is_square: bool = False

    def __post_init__(self) -> None:
        if self.gain_db.shape != self.grid.shape:
            raise ValueError(
                f"gain_db has shape {self.gain_db.shape}, but the grid {self.grid.shape}"
            )
        if self.free is not None and self.free.shape != self.grid.shape:
            raise ValueError(f"free has shape {self.free.shape}, but the grid {self.grid.shape}")
        if not np.isfinite(self.gain_db).any() or not np.all(self.gain_db < np.inf):
            raise ValueError(
                "gain_db must hold a finite gain in at least one cell, and neither NaN nor +inf"
            )
        if not np.isfinite(self.target_db):
            raise ValueError(f"target_db={self.target_db} must be a finite number of dB")
        if self.size < 320:
            raise ValueError(
                f"size={self.size} px is too small for a readable picture: it must be 320 or more"
            )

        for name, cells in (
            ("start", [self.start]),
            ("goal", [self.goal]),
            ("oracle_cells", self.oracle_cells),
        ):
            if len(cells):
                self.checked_path(cells, name)

    @property
    def has_fractions(self) -> bool:
        """Whether places are fractions of cells, as the start is."""
        return isinstance(self.start[0], float)

    def checked_path(self, path: ArrayLike, name: str) -> NDArray[Any]:
        """Places ``(T, 2)``: cells as `checked_cells`, or float64 fractions of them on the grid."""
        if not self.has_fractions:
            return checked_cells(self.grid, path, name)

        array = np.asarray(path, dtype=np.float64)
        is_path = array.ndim == 2 and array.shape[1:] == (2,)
        checked_cells(self.grid, nearest_cells(self.grid, array) if is_path else array, name)

        return array

    @cached_property
    def is_obstacle(self) -> NDArray[np.bool_]:
        """Cells that no robot can enter, shape ``(X, Y)``."""
        return np.isneginf(self.gain_db) if self.free is None else ~self.free

    @cached_property
    def is_below(self) -> NDArray[np.bool_]:
        """Free cells whose gain is below the target, shape ``(X, Y)``."""
        return (self.gain_db < self.target_db) & ~self.is_obstacle


def checked_cells(grid: Grid, cells: ArrayLike, name: str) -> NDArray[np.int64]:
    """Cells as an int64 array ``(T, 2)``; a ValueError where they are not cells of the grid, or
    none.
    """
    array = np.asarray(cells)
    if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0 or array.dtype.kind not in "iu":
        raise ValueError(
            f"{name} must be integers of shape (T, 2) with T >= 1, not {array.dtype} {array.shape}"
        )

    outside = ((array < 0) | (array >= grid.shape)).any(axis=1)  # (T,)
    if outside.any():
        raise ValueError(
            f"{name} holds {tuple(array[outside][0].tolist())}, "
            f"which is off the grid of {grid.shape}"
        )

    return array.astype(np.int64)


def nearest_cells(grid: Grid, path: NDArray[Any]) -> NDArray[np.int64]:
    """Cells ``(T, 2)`` that fractions of them lie in; on the outer border, the last one inside."""
    if path.dtype.kind != "f":
        return path

    on_border = np.minimum(np.floor(path + 0.5), np.subtract(grid.shape, 1))
    inside = (path >= -0.5) & (path <= np.subtract(grid.shape, 0.5))

    return np.where(inside, on_border, -1).astype(np.int64)
