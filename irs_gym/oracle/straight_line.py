"""`straight_line_bound`: how short a path could be that is free of the grid's eight directions."""

from math import inf
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell, checked_cell_size, checked_map
from irs_gym.memory import check_memory
from irs_gym.oracle.shortest_path import shortest_path

_CELL_BYTES = 2000  # for each cell: a square, joined with the others
_SIGHT_BYTES = 100  # gone over for each pair of corners

# (n, 2), in half cells from the map's lower left corner, so that all are whole numbers
Points = NDArray[np.int64]


def straight_line_bound(
    feasible: NDArray[np.bool_], start: Cell, goal: Cell, cell_size: float
) -> float:
    """Length in metres of the shortest path of any shape, from centre to centre, inside the
    feasible cells.

    Cells are closed squares: the path may run along their borders, and pass between two that touch
    at a corner only, as the paper's moves do. It is never longer than the oracle's, and the
    straight line where nothing is in the way. Such a path bends at corners of the infeasible area
    only, so it is the shortest one in the visibility graph of those corners.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.

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
    path = shortest_path(feasible, start, goal, 1.0)
    if path is None:
        return inf

    corners, slopes = _corners(feasible)
    check_memory(
        f"feasible: lines of sight between {len(corners)} corners",
        0,
        _SIGHT_BYTES * len(corners) ** 2,
    )
    # Cell (i, j) is the square from (2i, 2j) to (2i + 2, 2j + 2) half cells: the ends are centres.
    points = np.concatenate([2 * np.array([start, goal]) + 1, corners])
    bound = _search(points, np.append([0, 0], slopes), _area(feasible), 2 * path.distance) / 2

    return min(bound, path.distance) * cell_size  # equal lengths may be rounded differently


def _corners(feasible: NDArray[np.bool_]) -> tuple[Points, NDArray[np.int64]]:
    """Points where a shortest path may bend, ``(n, 2)``, and the sign of the slopes dy/dx that it
    may have there.

    Of the four cells around such a point, the infeasible ones lie on one diagonal: one of them at a
    reflex corner, two where feasible cells touch at a corner only. A taut path neither enters them
    nor could be pulled straight, so its pieces run in the quadrants of the other diagonal, both on
    their way in and out.
    """
    # around the corner (i, j) of cells, with infeasible ones outside of the map: (X + 1, Y + 1)
    blocked = np.pad(~feasible, 1, constant_values=True)
    south_west = blocked[:-1, :-1]
    south_east = blocked[1:, :-1]
    north_west = blocked[:-1, 1:]
    north_east = blocked[1:, 1:]

    # Infeasible cells on one diagonal alone: the path bends around them, along the other one.
    rising = south_west | north_east
    falling = south_east | north_west
    slope = np.where(falling, 1, -1) * (rising != falling)

    return 2 * np.argwhere(slope), slope[slope != 0]


def _area(feasible: NDArray[np.bool_]) -> Any:
    """The feasible cells as one polygon, grown by so little that it takes in its border and no new
    line of sight.

    A segment between whole points passes a whole point that it misses at 1/length or more, far
    beyond this growth.
    """
    low = 2 * np.argwhere(feasible)
    area = shapely.coverage_union_all(shapely.box(*low.T, *(low + 2).T)).buffer(
        1e-7, join_style="mitre"
    )
    shapely.prepare(area)

    return area


def _search(points: Points, slopes: NDArray[np.int64], area: Any, longest: float) -> float:
    """Length of the shortest way from the first point to the second along lines of sight, by the A*
    algorithm.

    Lines of sight are tested only where they may lie on a taut path no longer than ``longest``.
    """
    to_goal = np.hypot(*(points - points[1]).T)  # (n,): never longer than the way to go
    reached = np.where(np.arange(len(points)) == 0, 0.0, inf)
    is_open = np.ones(len(points), dtype=bool)

    # the open point whose way from the start, and straight on to the goal, is the shortest
    while (here := int(np.argmin(np.where(is_open, reached + to_goal, inf)))) != 1:
        is_open[here] = False

        # which points could be next
        apart = points - points[here]  # (n, 2)
        length = reached[here] + np.hypot(*apart.T)
        slope = np.sign(apart[:, 0] * apart[:, 1])
        is_taut = (slope * slopes >= 0) & (slope * slopes[here] >= 0)
        is_short = (length < reached) & (length + to_goal <= longest * (1 + 1e-12))
        ahead = np.flatnonzero(is_open & is_taut & is_short)

        # and which of them can be seen from here
        sights = shapely.linestrings(
            np.stack([np.broadcast_to(points[here], (len(ahead), 2)), points[ahead]], axis=1)
        )
        ahead = ahead[shapely.contains_properly(area, sights)]
        reached[ahead] = length[ahead]

    return float(reached[1])
