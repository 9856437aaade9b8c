"""`straight_line_path`: the shortest path that is free of the grid's eight directions."""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import (
    Cell,
    as_cell,
    checked_cell_size,
    checked_map,
    checked_point,
    with_clearance,
)
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.shortest_path import shortest_path
from irs_gym.oracle.sight import Sight, cells_around, in_cells
from irs_gym.oracle.visibility_graph import corners_of, search

_CELL_BYTES = 2000  # for each cell: the grid's graph, and the corners
_SIGHT_BYTES = 100  # gone over for each pair of corners


@dataclass(frozen=True, eq=False)
class Polyline:
    """A path of straight pieces.

    Attributes
    ----------
    distance
        Its length in metres.
    points
        float64, shape ``(k, 2)``: its points (x, y) in metres from start to goal; one where both
        are the same.

    Examples
    --------
    >>> Polyline(distance=5.0, points=np.array([[0.0, 0.0], [3.0, 4.0]])).points.tolist()
    [[0.0, 0.0], [3.0, 4.0]]
    """

    distance: float
    points: NDArray[np.float64]

    def __post_init__(self) -> None:
        freeze(self.points)


def straight_line_path(
    feasible: NDArray[np.bool_],
    start: tuple[float, float],
    goal: tuple[float, float],
    cell_size: float,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
) -> Polyline | None:
    """Shortest path of any shape between two points, inside the feasible cells.

    Cells are closed squares: the path may run along their borders, and pass between two that touch
    at a corner only, as the paper's moves do. Such a path bends at corners of the infeasible area
    only, so it is the shortest one in the visibility graph of those corners. From many points to
    one goal: `irs_gym.euclidean_distance_to_go`.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    start, goal
        Points (x, y) in metres.
    cell_size
        Edge of a cell in metres.
    origin
        The map's lower left corner (x, y) in metres.
    corner_cutting
        Whether the path may pass between two cells that touch at a corner only.
    robot_radius
        Keeps the robot to fewer cells, as in `irs_gym.oracle.shortest_path.shortest_path`.

    Returns
    -------
    The path, or None where the goal cannot be reached, or an end is not feasible.

    Raises
    ------
    ValueError
        As `irs_gym.oracle.shortest_path.shortest_path`, where an end lies off the map, and where
        the map has more corners than can be searched.

    Examples
    --------
    >>> import numpy as np
    >>> feasible = np.ones((3, 3), dtype=bool)
    >>> feasible[1, :2] = False  # a wall with a gap at its upper end
    >>> path = straight_line_path(feasible, (0.25, 0.5), (1.25, 0.5), cell_size=0.5)
    >>> path.points.tolist()
    [[0.25, 0.5], [0.5, 1.0], [1.0, 1.0], [1.25, 0.5]]
    >>> round(path.distance, 3)
    1.618
    """
    feasible = checked_map(feasible, "feasible", "b", _CELL_BYTES)
    cell_size = checked_cell_size(cell_size)
    lower_left = np.array(checked_point(origin, "origin"))
    ends = np.array([checked_point(start, "start"), checked_point(goal, "goal")])  # (2, 2)
    points = in_cells(ends, cell_size, lower_left)
    for name, end, point in zip(("start", "goal"), ends.tolist(), points, strict=True):
        if np.any((point < 0) | (point > feasible.shape)):
            raise ValueError(f"{name}={tuple(end)} lies off the map")

    feasible = with_clearance(feasible, robot_radius, cell_size)
    length, corners = _shortest(feasible, points, corner_cutting)
    if length == inf:
        return None

    return Polyline(
        length * cell_size,
        without_repeats(np.concatenate([ends[:1], lower_left + corners * cell_size, ends[1:]])),
    )


def straight_line_bound(
    feasible: NDArray[np.bool_],
    start: Cell,
    goal: Cell,
    cell_size: float,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
) -> float:
    """Length in metres of the shortest path of any shape, from centre to centre, inside the
    feasible cells.

    Cells are closed squares: the path may run along their borders, and pass between two that touch
    at a corner only, as the paper's moves do. It is never longer than the oracle's, and the
    straight line where nothing is in the way. The path itself: `straight_line_path`.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.
    corner_cutting
        Whether the path may pass between two cells that touch at a corner only.
    robot_radius
        Keeps the robot to fewer cells, as in `irs_gym.oracle.shortest_path.shortest_path`.

    Returns
    -------
    +inf where the goal cannot be reached.

    Raises
    ------
    ValueError
        As `irs_gym.oracle.shortest_path.shortest_path`, and where the map has more corners than can
        be searched.

    Examples
    --------
    >>> import numpy as np
    >>> feasible = np.ones((5, 3), dtype=bool)
    >>> round(straight_line_bound(feasible, (0, 0), (4, 1), cell_size=0.5), 3)  # hypot(4, 1) cells
    2.062
    >>> round(shortest_path(feasible, (0, 0), (4, 1), cell_size=0.5).distance, 3)
    2.207
    """
    feasible = checked_map(feasible, "feasible", "b", _CELL_BYTES)
    cell_size = checked_cell_size(cell_size)
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    feasible = with_clearance(feasible, robot_radius, cell_size)
    path = shortest_path(feasible, start, goal, 1.0, corner_cutting=corner_cutting)
    if path is None:
        return inf

    bound, _ = _shortest(feasible, np.array([start, goal]) + 0.5, corner_cutting, path.distance)

    return min(bound, path.distance) * cell_size  # equal lengths may be rounded differently


def without_repeats(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points ``(n, 2)`` but for those that equal the one before."""
    is_new = np.append(True, np.any(np.diff(points, axis=0) != 0, axis=1))

    return np.asarray(points[is_new])


def _shortest(
    feasible: NDArray[np.bool_],
    ends: NDArray[np.float64],
    corner_cutting: bool,
    longest: float | None = None,
) -> tuple[float, NDArray[np.int64]]:
    """Length in cells of the shortest path between two points ``(2, 2)``, inf where there is none,
    and the corners that it bends at ``(n, 2)``.

    ``longest`` is the length of a path; None: that over the grid is looked up.
    """
    if longest is None:
        longest = _grid_length(feasible, ends, corner_cutting)
    if longest == inf:
        return inf, np.empty((0, 2), dtype=np.int64)

    corners, slopes = corners_of(feasible, corner_cutting)
    check_memory(
        f"feasible: lines of sight between {len(corners)} corners",
        0,
        _SIGHT_BYTES * len(corners) ** 2,
    )
    points = np.concatenate([ends, corners])
    reached, before = search(
        Sight(feasible, corner_cutting), points, np.append([0, 0], slopes), 1, longest=longest
    )

    # read off backwards, from the goal
    over = [int(before[1])]
    while over[-1] > 0:
        over.append(int(before[over[-1]]))

    return float(reached[1]), corners[np.array(over[-2::-1], dtype=np.int64) - 2]


def _grid_length(
    feasible: NDArray[np.bool_], ends: NDArray[np.float64], corner_cutting: bool
) -> float:
    """Length in cells of a path between two points ``(2, 2)`` over centres of cells; inf where
    there is none.
    """
    padded = np.pad(feasible, 1)
    starts, goals = (
        np.unique(around[padded[tuple(around.T + 1)]], axis=0) for around in cells_around(ends)
    )
    lengths = [inf]
    for start in starts.tolist():
        for goal in goals.tolist():
            path = shortest_path(feasible, start, goal, 1.0, corner_cutting=corner_cutting)
            if path is not None:
                outside = np.hypot(*(ends - np.array([start, goal]) - 0.5).T).sum()
                lengths.append(path.distance + float(outside))

    return min(lengths)
