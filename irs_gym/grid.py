"""The floor's grid of square cells, the eight moves, and `legal_moves`, the only judge of motion.

Cells are ``(i, j)`` with ``i`` along x and ``j`` along y, as in the paper's matrix C; every map is
an array of shape ``(X, Y)`` indexed ``[i, j]``, and its flat cells are numbered ``i * Y + j``.
Points are ``(x, y)`` in metres. Moves run counter-clockwise from +x: E, NE, N, NW, W, SW, S, SE.
"""

from dataclasses import dataclass
from math import atan2, floor, pi, sqrt
from numbers import Real
from operator import index
from typing import Any, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from irs_gym.memory import check_memory

MOVES = np.array(
    [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)], dtype=np.int64
)
MOVE_NAMES = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
MOVE_LENGTHS = np.hypot(MOVES[:, 0], MOVES[:, 1])  # (8,), in cells: 1 or sqrt(2)
for _constant in (MOVES, MOVE_LENGTHS):
    _constant.setflags(write=False)

Cell = tuple[int, int]
_Int = TypeVar("_Int", bound=np.integer[Any])

# metres: of a cell's edge, and of any coordinate
SMALLEST = 1e-9
LARGEST = 1e9

# In cells: a point this near to a border counts as on it, whatever the rounding of its coordinates.
SNAP = 1e-9
_CLEARANCE_BYTES = 120  # for each cell whose clearance is measured


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
        Where ``shape`` is not two positive integers, ``cell_size`` not positive and finite, or
        ``origin`` not two finite numbers.

    Examples
    --------
    >>> grid = Grid.tile((-10.0, -10.0), (10.0, 10.0), 0.5)
    >>> grid.shape, grid.cell_of((-10.0, 0.0)), grid.centre((0, 20))
    ((40, 40), (0, 20), (-9.75, 0.25))
    >>> grid.flat((1, 2)), grid.cell_at(42)
    (42, (1, 2))
    """

    shape: tuple[int, int]
    cell_size: float
    origin: tuple[float, float]

    def __post_init__(self) -> None:
        columns, rows = as_cell(self.shape, "shape", "two positive numbers of cells (X, Y)")
        if columns < 1 or rows < 1:
            raise ValueError(f"shape={self.shape!r} must be two positive numbers of cells (X, Y)")

        object.__setattr__(self, "shape", (columns, rows))
        object.__setattr__(self, "cell_size", checked_cell_size(self.cell_size))
        object.__setattr__(self, "origin", checked_point(self.origin, "origin"))

    @classmethod
    def tile(
        cls, lower: tuple[float, float], upper: tuple[float, float], cell_size: float
    ) -> "Grid":
        """Grid that tiles the rectangle from ``lower`` to ``upper`` (metres) exactly.

        Raises
        ------
        ValueError
            Where ``cell_size`` is not positive and finite, or does not divide both sides; where a
            corner is no point.
        """
        cell_size = checked_cell_size(cell_size)
        lower = checked_point(lower, "lower")
        upper = checked_point(upper, "upper")
        shape = []

        for axis, low, high in zip("xy", lower, upper, strict=True):
            cells = (high - low) / cell_size
            if round(cells) < 1 or abs(cells - round(cells)) > SNAP * max(1.0, cells):
                better = (high - low) / max(1, round(cells))
                raise ValueError(
                    f"cell_size={cell_size} does not divide the room's {high - low:g} m "
                    f"along {axis}: {better:.6g} m would"
                )

            shape.append(round(cells))

        return cls((shape[0], shape[1]), cell_size, lower)

    @property
    def upper(self) -> tuple[float, float]:
        """Upper right corner ``(x, y)`` of the floor in metres."""
        (x, y), (columns, rows) = self.origin, self.shape
        return x + columns * self.cell_size, y + rows * self.cell_size

    def centres(self) -> NDArray[np.float64]:
        """Cell centres in metres, shape ``(X, Y, 2)`` (eq. 10 of the paper, counted from 0)."""
        self.check_memory(32)
        x, y = (
            low + (np.arange(n) + 0.5) * self.cell_size
            for low, n in zip(self.origin, self.shape, strict=True)
        )
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    def centre(self, cell: Cell) -> tuple[float, float]:
        """Centre ``(x, y)`` of one cell in metres."""
        return (
            self.origin[0] + (cell[0] + 0.5) * self.cell_size,
            self.origin[1] + (cell[1] + 0.5) * self.cell_size,
        )

    def cell_of(self, point: tuple[float, float]) -> Cell:
        """Cell of a point in metres.

        A point on the border of two cells belongs to the upper one; the floor's outer border
        belongs to the last cell inside.

        Raises
        ------
        ValueError
            Where the point lies outside the floor, or is not two numbers.
        """
        point = _two_numbers(point, "point")
        cell = []

        for value, low, n in zip(point, self.origin, self.shape, strict=True):
            position = (value - low) / self.cell_size
            if not -SNAP <= position <= n + SNAP:
                raise ValueError(
                    f"the point {point} m lies outside the floor "
                    f"from {self.origin} to {self.upper} m"
                )

            nearest = round(position)
            at = nearest if abs(position - nearest) < SNAP else floor(position)
            cell.append(min(at, n - 1))  # the outer border has no cell beyond it

        return cell[0], cell[1]

    def has(self, cell: Cell) -> bool:
        """Whether the cell lies on the grid."""
        return 0 <= cell[0] < self.shape[0] and 0 <= cell[1] < self.shape[1]

    def flat(self, cell: Cell) -> int:
        """Number of a cell (i, j) among the flat cells."""
        return cell[0] * self.shape[1] + cell[1]

    def cell_at(self, flat: int) -> Cell:
        """The cell (i, j) of that number: undoes `flat`."""
        return divmod(flat, self.shape[1])

    def check_memory(self, each: float, what: str = "the map") -> None:
        """Refuse work on the map that takes so many bytes for each cell; see
        `irs_gym.memory.check_memory`.
        """
        columns, rows = self.shape
        asked = f"cell_size={self.cell_size}: {what} of {columns} x {rows} cells"
        check_memory(asked, each * columns * rows)


def as_cell(value: Any, name: str, wanted: str = "a cell (i, j) of two integers") -> Cell:
    """Two integers; a ``ValueError`` names the field otherwise. Neither bools nor floats are
    integers.
    """
    try:
        i, j = value
        if not isinstance(i, bool | np.bool_) and not isinstance(j, bool | np.bool_):
            return index(i), index(j)
    except (TypeError, ValueError):
        pass

    raise ValueError(f"{name}={value!r} must be {wanted}")


def checked_cell_size(cell_size: Any) -> float:
    """Edge of a cell in metres; a ``ValueError`` says what is wrong with one that no map can
    have.
    """
    is_number = isinstance(cell_size, Real) and not isinstance(cell_size, bool)
    if not is_number or not 0 < cell_size < np.inf:
        raise ValueError(f"cell_size={cell_size!r} must be a positive number of metres")
    if not SMALLEST <= cell_size <= LARGEST:
        raise ValueError(f"cell_size={cell_size!r} must lie from {SMALLEST} to {LARGEST} m")

    return float(cell_size)


def checked_point(point: Any, name: str) -> tuple[float, float]:
    """A point (x, y) in metres; a ``ValueError`` names the field otherwise."""
    x, y = _two_numbers(point, name)
    if not (abs(x) <= LARGEST and abs(y) <= LARGEST):
        raise ValueError(
            f"{name}={point!r} must be two finite numbers of metres, none beyond {LARGEST}"
        )

    return x, y


def _two_numbers(point: Any, name: str) -> tuple[float, float]:
    try:
        x, y = point
        if not any(isinstance(each, bool) or not isinstance(each, Real) for each in (x, y)):
            return float(x), float(y)
    except (OverflowError, TypeError, ValueError):
        pass

    raise ValueError(f"{name}={point!r} must be two finite numbers of metres, along x and y")


def checked_map(values: Any, name: str, kinds: str, each: float = 0) -> NDArray[Any]:
    """An array ``(X, Y)`` of the kinds of values that are named by NumPy's letters.

    A ``ValueError`` names the field where it is none; where work on it would take too much memory,
    at so many bytes for each cell; and where it holds NaN or +inf.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"{name} is no array: {error}") from None

    if array.dtype.kind not in kinds:
        wanted = "bools" if kinds == "b" else "real numbers of dB"
        raise ValueError(f"{name} holds values of the type {array.dtype}, not {wanted}")

    if array.ndim != 2 or not array.size:
        raise ValueError(f"{name} has the shape {array.shape}, but a map has two axes (X, Y)")

    check_memory(
        f"{name}: work on a map of {array.shape[0]} x {array.shape[1]} cells", each * array.size
    )
    if kinds == "b":
        return array

    array = array.astype(np.float64, copy=False)
    if not np.all(array < np.inf):
        raise ValueError(
            f"{name} holds NaN or +inf: each cell must be a number of dB, or -inf where blocked"
        )

    return array


def flat_cells(cells: NDArray[_Int], shape: tuple[int, int]) -> NDArray[_Int]:
    """Numbers of cells (i, j) on a map of that shape; or how far apart, for differences of cells.

    ``cells`` has the shape ``(..., 2)``, the result ``(...)``. One cell: `Grid.flat`.

    Examples
    --------
    >>> flat_cells(np.array([[0, 0], [1, 2]]), (3, 5))
    array([0, 7])
    """
    return np.asarray(cells[..., 0] * shape[1] + cells[..., 1])


def cells_at(flat: NDArray[_Int], shape: tuple[int, int]) -> NDArray[_Int]:
    """Cells (i, j) of those numbers ``(...)``, shape ``(..., 2)``: undoes `flat_cells`.

    Examples
    --------
    >>> cells_at(np.array([0, 7]), (3, 5))
    array([[0, 0],
           [1, 2]])
    """
    cells = np.empty((*flat.shape, 2), dtype=flat.dtype)
    np.divmod(flat, shape[1], out=(cells[..., 0], cells[..., 1]))  # a third of the time of a stack

    return cells


def neighbours(values: NDArray[Any], fill: Any, axis: int = -1) -> NDArray[Any]:
    """What each move leads to: the values of the eight cells around each cell.

    Parameters
    ----------
    values
        Shape ``(..., X, Y)``: one map, or many.
    fill
        The value off the map.
    axis
        Where the axis of the moves goes, in the order of `MOVES`.

    Returns
    -------
    Shape ``(..., X, Y, 8)`` with the axis in its usual place, at the end.

    Examples
    --------
    >>> neighbours(np.array([[1, 2, 3]]), 0)[0, 1]
    array([0, 0, 3, 0, 0, 0, 1, 0])
    """
    *maps, columns, rows = values.shape
    padded = np.full((*maps, columns + 2, rows + 2), fill, dtype=values.dtype)
    padded[..., 1:-1, 1:-1] = values

    return np.stack(
        [
            padded[..., 1 + di : columns + 1 + di, 1 + dj : rows + 1 + dj]
            for di, dj in MOVES.tolist()
        ],
        axis=axis,
    )


class Motion(TypedDict, total=False):
    """What `legal_moves` asks of a move besides a free cell, as keyword arguments."""

    corner_cutting: bool
    passable: NDArray[np.bool_] | None


def legal_moves(
    free: NDArray[np.bool_],
    corner_cutting: bool = True,
    passable: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Which of the eight moves lead from each cell to a free cell of the map.

    Parameters
    ----------
    free
        Shape ``(..., X, Y)``: the cells that may be entered.
    corner_cutting
        Whether a diagonal move asks for its destination alone, as in the paper's eq. (15c), which
        only tests the two cell centres. Otherwise both cells beside it must be free as well.
    passable
        Shape ``(..., X, Y, 8)``: moves that the robot's body can make. None: all of them.

    Returns
    -------
    Shape ``(..., X, Y, 8)``, the last axis in the order of `MOVES`.

    Examples
    --------
    >>> free = np.array([[True, False], [True, True]])
    >>> [MOVE_NAMES[n] for n in np.flatnonzero(legal_moves(free)[0, 0])]
    ['E', 'NE']
    >>> [MOVE_NAMES[n] for n in np.flatnonzero(legal_moves(free, corner_cutting=False)[0, 0])]
    ['E']
    """
    legal = lowest_ahead(free, False, corner_cutting)
    return legal if passable is None else legal & passable


def lowest_ahead(values: NDArray[Any], off_map: Any, corner_cutting: bool = True) -> NDArray[Any]:
    """The lowest value that each move meets: that of its destination and, without corner cutting,
    those of the two cells beside a diagonal.

    ``values`` has the shape ``(..., X, Y)``, the result ``(..., X, Y, 8)``.
    """
    lowest = neighbours(values, off_map)
    if not corner_cutting:
        # a diagonal has its odd number between those of the two moves along the axes
        straight = lowest[..., 0::2]  # (..., X, Y, 4)
        beside = np.minimum(straight, np.roll(straight, -1, axis=-1))
        lowest[..., 1::2] = np.minimum(lowest[..., 1::2], beside)

    return lowest


def with_clearance(
    free: NDArray[np.bool_], robot_radius: float, cell_size: float
) -> NDArray[np.bool_]:
    """The free cells whose centre is at least ``robot_radius`` metres from all that is not free:
    closed squares, and what lies beyond the map.

    ``free`` and the result are of the shape ``(X, Y)``.

    Examples
    --------
    >>> free = np.ones((4, 3), dtype=bool)
    >>> with_clearance(free, 0.5, cell_size=0.5).astype(int).tolist()  # 0.25 m from the walls
    [[0, 0, 0], [0, 1, 0], [0, 1, 0], [0, 0, 0]]
    """
    robot_radius = checked_radius(robot_radius)
    if not robot_radius:
        return free

    check_memory(f"robot_radius={robot_radius}: clearance", float(_CLEARANCE_BYTES * free.size))
    # Points half a cell apart: centres have odd numbers. The point of a closed square that is the
    # nearest to a centre is among them. Each belongs to the squares from `low` to `high`.
    blocked = np.pad(~free, 1, constant_values=True)  # (X + 2, Y + 2)
    columns, rows = (np.arange(2 * n + 1) for n in free.shape)
    is_clear = np.ones((len(columns), len(rows)), dtype=bool)

    for i in ((columns + 1) // 2, columns // 2 + 1):
        for j in ((rows + 1) // 2, rows // 2 + 1):
            is_clear &= ~blocked[np.ix_(i, j)]

    metres = distance_transform_edt(is_clear)[1::2, 1::2] * (cell_size / 2)  # (X, Y)

    return np.asarray(free & (metres >= robot_radius * (1 - SNAP)))


def checked_radius(robot_radius: Any) -> float:
    """The radius of a robot in metres; a ``ValueError`` where it is none from 0."""
    is_number = isinstance(robot_radius, Real) and not isinstance(robot_radius, bool)
    if not is_number or not 0 <= robot_radius <= LARGEST:
        raise ValueError(
            f"robot_radius={robot_radius!r} must be a number of metres from 0 to {LARGEST}"
        )

    return float(robot_radius)


def checked_motion(
    corner_cutting: Any, passable: Any, shape: tuple[int, ...], name: str = "passable"
) -> Motion:
    """Arguments for `legal_moves` on a map of that shape ``(X, Y)``; a ``ValueError`` names the one
    at fault.

    Moves must be passable there and back, since paths are searched from either end.
    """
    if not isinstance(corner_cutting, bool | np.bool_):
        raise ValueError(f"corner_cutting={corner_cutting!r} must be True or False")
    if passable is None:
        return {"corner_cutting": bool(corner_cutting), "passable": None}

    moves = np.asarray(passable)
    if moves.dtype != bool or moves.shape != (*shape, len(MOVES)):
        raise ValueError(
            f"{name} has the shape {moves.shape} and the type {moves.dtype}, "
            f"but a bool for each cell and move is needed: {(*shape, len(MOVES))}"
        )

    on_map = neighbours(np.ones(shape, dtype=bool), False)  # (X, Y, 8)
    for move in range(len(MOVES) // 2):
        back = neighbours(moves[..., move + 4], False)[..., move]  # (X, Y)
        if ((moves[..., move] != back) & on_map[..., move]).any():
            raise ValueError(
                f"{name} holds a move {MOVE_NAMES[move]} that cannot be made both there and back"
            )

    return {"corner_cutting": bool(corner_cutting), "passable": moves}


def nearest_move(x: float, y: float) -> int:
    """Number of the move whose direction is nearest to (x, y), of any length.

    Examples
    --------
    >>> [MOVE_NAMES[nearest_move(x, y)] for x, y in ((1.0, 0.1), (0.5, 0.6), (-2, 0), (0.1, -1))]
    ['E', 'NE', 'W', 'S']
    """
    return round(atan2(y, x) / (pi / 4)) % len(MOVES)


def octile_distance(offsets: ArrayLike) -> NDArray[np.float64]:
    """Length in cells of the shortest eight-direction path over an obstacle-free grid.

    ``offsets`` has shape ``(..., 2)``: cells between the two ends along x and y. Returns shape
    ``(...)``.
    """
    apart = np.abs(np.asarray(offsets, dtype=np.float64))
    return np.asarray(apart.max(axis=-1) + (sqrt(2.0) - 1.0) * apart.min(axis=-1))
