"""The floor's grid of square cells, the eight moves, and `legal_moves`, the only judge of motion.

Cells are ``(i, j)`` with ``i`` along x and ``j`` along y, as in the paper's matrix C; every map is an array
of shape ``(X, Y)`` indexed ``[i, j]``. Points are ``(x, y)`` in metres. Moves run counter-clockwise from +x:
E, NE, N, NW, W, SW, S, SE.
"""

from dataclasses import dataclass
from math import floor, isfinite, sqrt
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOVES = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)], dtype=np.int64)
MOVE_NAMES = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
MOVE_LENGTHS = np.hypot(MOVES[:, 0], MOVES[:, 1])  # (8,), in cells: 1 or sqrt(2)
for _constant in (MOVES, MOVE_LENGTHS):
    _constant.setflags(write=False)

Cell = tuple[int, int]

_SNAP = 1e-9  # in cells: a point this near to a border counts as on it, whatever the rounding of its coordinates


@dataclass(frozen=True)
class Grid:
    """Square cells that tile a rectangular floor.

    Attributes
    ----------
    shape
        Number of cells ``(X, Y)`` along x and y.
    cell_size
        Edge of a cell in metres (the paper's Delta).
    origin
        Lower left corner ``(x, y)`` of the floor in metres.

    Raises
    ------
    ValueError
        Where ``cell_size`` is not positive and finite, or ``origin`` is not two finite numbers.
    """

    shape: tuple[int, int]
    cell_size: float
    origin: tuple[float, float]

    def __post_init__(self) -> None:
        _check_cell_size(self.cell_size)
        if np.shape(self.origin) != (2,) or not np.isfinite(self.origin).all():
            raise ValueError(f"origin={self.origin} must be two finite numbers of metres")

    @classmethod
    def tile(cls, lower: tuple[float, float], upper: tuple[float, float], cell_size: float) -> "Grid":
        """Grid that tiles the rectangle from ``lower`` to ``upper`` (metres) exactly.

        Raises
        ------
        ValueError
            Where ``cell_size`` is not positive and finite, or does not divide both sides.
        """
        _check_cell_size(cell_size)
        shape = []
        for axis, low, high in zip("xy", lower, upper, strict=True):
            cells = (high - low) / cell_size
            if round(cells) < 1 or abs(cells - round(cells)) > _SNAP * max(1.0, cells):
                raise ValueError(
                    f"cell_size={cell_size} does not divide the room's {high - low:g} m along {axis}: "
                    f"{(high - low) / max(1, round(cells)):.6g} m would"
                )
            shape.append(round(cells))
        return cls((shape[0], shape[1]), float(cell_size), (float(lower[0]), float(lower[1])))

    @property
    def upper(self) -> tuple[float, float]:
        """Upper right corner ``(x, y)`` of the floor in metres."""
        (x, y), (columns, rows) = self.origin, self.shape
        return x + columns * self.cell_size, y + rows * self.cell_size

    def centres(self) -> NDArray[np.float64]:
        """Cell centres in metres, shape ``(X, Y, 2)`` (eq. 10 of the paper, counted from 0)."""
        x, y = (low + (np.arange(n) + 0.5) * self.cell_size for low, n in zip(self.origin, self.shape, strict=True))
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    def centre(self, cell: Cell) -> tuple[float, float]:
        """Centre ``(x, y)`` of one cell in metres."""
        return (
            self.origin[0] + (cell[0] + 0.5) * self.cell_size,
            self.origin[1] + (cell[1] + 0.5) * self.cell_size,
        )

    def cell_of(self, point: tuple[float, float]) -> Cell:
        """Cell of a point in metres.

        A point on the border of two cells belongs to the upper one; the floor's outer border belongs to the
        last cell inside.

        Raises
        ------
        ValueError
            Where the point lies outside the floor.
        """
        cell = []
        for value, low, n in zip(point, self.origin, self.shape, strict=True):
            position = (value - low) / self.cell_size
            if not -_SNAP <= position <= n + _SNAP:
                raise ValueError(
                    f"the point {tuple(point)} m lies outside the floor from {self.origin} to {self.upper} m"
                )
            nearest = round(position)
            index = nearest if abs(position - nearest) < _SNAP else floor(position)
            cell.append(min(index, n - 1))
        return cell[0], cell[1]

    def has(self, cell: Cell) -> bool:
        """Whether the cell lies on the grid."""
        return 0 <= cell[0] < self.shape[0] and 0 <= cell[1] < self.shape[1]


def _check_cell_size(cell_size: float) -> None:
    if not (isinstance(cell_size, Real) and isfinite(cell_size) and cell_size > 0):
        raise ValueError(f"cell_size={cell_size!r} must be a positive number of metres")


def legal_moves(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the eight moves lead from each cell to a free cell of the map.

    A move is legal where its destination is on the map and free; diagonal moves may cut corners, as in the
    paper's eq. (15c), which only tests the two cell centres.

    Parameters
    ----------
    free
        Shape ``(X, Y)``: the cells that may be entered.

    Returns
    -------
    Shape ``(X, Y, 8)``, the last axis in the order of `MOVES`.
    """
    columns, rows = free.shape
    padded = np.zeros((columns + 2, rows + 2), dtype=bool)
    padded[1:-1, 1:-1] = free
    return np.stack([padded[1 + di : columns + 1 + di, 1 + dj : rows + 1 + dj] for di, dj in MOVES], axis=-1)


def octile_distance(offsets: ArrayLike) -> NDArray[np.float64]:
    """Length in cells of the shortest eight-direction path over an obstacle-free grid.

    ``offsets`` has shape ``(..., 2)``: cells between the two ends along x and y. Returns shape ``(...)``.
    """
    apart = np.abs(np.asarray(offsets, dtype=np.float64))
    return np.asarray(apart.max(axis=-1) + (sqrt(2.0) - 1.0) * apart.min(axis=-1))
