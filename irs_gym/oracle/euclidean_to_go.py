"""`euclidean_distance_to_go`: the shortest distance of any path to one goal, from any point."""

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import checked_cell_size, checked_map, checked_point
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.shortest_path import GRAPH_BYTES
from irs_gym.oracle.sight import Sight, in_cells
from irs_gym.oracle.straight_line import without_repeats
from irs_gym.oracle.visibility_graph import corners_of, is_taut, search

_PAIR_BYTES = 100  # gone over for each corner, and each corner or cell that it could see,
_COLUMN_BYTES = 12  # and for each column that may be between them
_BLOCK = 2**20  # cells and corners that are looked at together
_DIAGONAL = 2**0.5 + 1e-6  # of a cell, beyond all rounding


@dataclass(frozen=True, eq=False)
class EuclideanToGo:
    """Distances to one goal from every point of a map, over its closed feasible cells.

    A shortest path runs straight to the goal, or to a corner of the infeasible area and on from
    there. For each cell are held the corners that it may run to first.

    Attributes
    ----------
    goal, cell_size, origin
        As asked for, in metres.
    sight
        Which points see each other.
    points
        float64, shape ``(V, 2)``, in cells from the lower left corner: the goal, and the corners
        that it can be reached from.
    lengths
        float64, shape ``(V,)``, in cells: their distances to the goal.
    after
        int64, shape ``(V,)``: the point that follows on the way to the goal; -1 for the goal.
    offsets
        int64, shape ``(X * Y + 1,)``: flat cell n has the candidates from ``offsets[n]`` to before
        ``offsets[n + 1]``; none where the goal cannot be reached.
    candidates
        int32, shape ``(K,)``: numbers of ``points``.

    Examples
    --------
    >>> import numpy as np
    >>> feasible = np.ones((3, 3), dtype=bool)
    >>> feasible[1, :2] = False  # a wall with a gap at its upper end
    >>> to_go = euclidean_distance_to_go(feasible, (1.25, 0.5), cell_size=0.5)
    >>> to_go([[0.25, 0.5], [1.0, 0.5], [0.75, 0.5]]).round(3).tolist()  # the last in the wall
    [1.618, 0.25, inf]
    """

    goal: tuple[float, float]
    cell_size: float
    origin: tuple[float, float]
    sight: Sight
    points: NDArray[np.float64]
    lengths: NDArray[np.float64]
    after: NDArray[np.int64]
    offsets: NDArray[np.int64]
    candidates: NDArray[np.int32]

    def __post_init__(self) -> None:
        freeze(self.points, self.lengths, self.after, self.offsets, self.candidates)

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Distances in metres from points (x, y) in metres, ``(..., 2)``: shape ``(...)``.

        inf where a point is not feasible, or the goal cannot be reached.

        Raises
        ------
        ValueError
            Where ``points`` are no finite points.
        """
        position = self._in_cells(points)
        length, _ = self._first(position.reshape(-1, 2))

        return length.reshape(position.shape[:-1]) * self.cell_size

    def path(self, point: ArrayLike) -> NDArray[np.float64]:
        """A shortest path from a point (x, y) to the goal, ``(k, 2)`` in metres; ``(0, 2)`` where
        there is none.

        Raises
        ------
        ValueError
            As for a call.
        """
        _, first = self._first(self._in_cells(point).reshape(1, 2))
        over = [int(first[0])]
        if over[0] < 0:
            return np.empty((0, 2))

        while over[-1] > 0:
            over.append(int(self.after[over[-1]]))

        corners = np.array(self.origin) + self.points[over[:-1]] * self.cell_size
        ends = np.array([point, self.goal], dtype=np.float64)

        return without_repeats(np.concatenate([ends[:1], corners, ends[1:]]))

    def _in_cells(self, points: ArrayLike) -> NDArray[np.float64]:
        position = np.asarray(points, dtype=np.float64)
        if position.shape[-1:] != (2,) or not np.isfinite(position).all():
            raise ValueError(
                f"points of the shape {position.shape} must be finite (x, y) in metres: (..., 2)"
            )

        return in_cells(position, self.cell_size, np.array(self.origin))

    def _first(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Lengths in cells of the ways from points ``(n, 2)``, ``(n,)``, and which point is the
        first that each leads to, -1 where there is no way.
        """
        length = np.full(len(points), inf)
        first = np.full(len(points), -1)
        cell = self.sight.cell_of(points)
        number = np.where(cell >= 0, self.offsets[cell + 1] - self.offsets[cell], 0)
        asked = np.flatnonzero(number)
        number = number[asked]

        # all ways over candidates, inf where there is none: (n, K)
        rank = np.arange(np.max(number, initial=0))
        at = np.minimum(self.offsets[cell[asked], None] + rank, len(self.candidates) - 1)
        over = self.candidates[at]
        apart = self.points[over] - points[asked, None]
        ways = self.lengths[over] + np.hypot(apart[..., 0], apart[..., 1])
        ways[rank >= number[:, None]] = inf

        # the shortest of each point, until it sees the candidate
        row = np.arange(len(asked))
        while row.size:
            best = ways[row].argmin(axis=1)
            way = ways[row, best]
            candidate = over[row, best]
            is_seen = self.sight.between(points[asked[row]], self.points[candidate])
            length[asked[row[is_seen]]] = way[is_seen]
            first[asked[row[is_seen]]] = candidate[is_seen]
            ways[row, best] = inf
            row = row[~is_seen & (way < inf)]

        return length, first


def euclidean_distance_to_go(
    feasible: NDArray[np.bool_],
    goal: tuple[float, float],
    cell_size: float,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
) -> EuclideanToGo:
    """The shortest distance to a goal from any point, inside the feasible cells: closed squares,
    which are joined where they touch at a corner.

    The distance is that of `straight_line_path`, for as many points as are asked for: the corners
    are searched once, from the goal, and so are those that each cell may need.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    goal
        Point (x, y) in metres.
    cell_size
        Edge of a cell in metres.
    origin
        The map's lower left corner (x, y) in metres.

    Returns
    -------
    Called with points ``(n, 2)`` in metres, it gives distances ``(n,)`` in metres.

    Raises
    ------
    ValueError
        Where ``feasible`` is no map of bools, ``goal`` no point of it, ``cell_size`` not positive,
        or the map has more corners than can be searched.

    Examples
    --------
    >>> import numpy as np
    >>> to_go = euclidean_distance_to_go(np.ones((4, 2), dtype=bool), (0.0, 0.0), cell_size=1.0)
    >>> to_go([[4.0, 0.0], [3.0, 1.5]]).round(3).tolist()
    [4.0, 3.354]
    >>> to_go.path([3.0, 1.5]).tolist()
    [[3.0, 1.5], [0.0, 0.0]]
    """
    feasible = checked_map(feasible, "feasible", "b", GRAPH_BYTES)
    cell_size = checked_cell_size(cell_size)
    goal = checked_point(goal, "goal")
    origin = checked_point(origin, "origin")
    end = in_cells(np.array(goal), cell_size, np.array(origin))
    if np.any((end < 0) | (end > feasible.shape)):
        raise ValueError(f"goal={goal} lies off the map")

    corners, slopes = corners_of(feasible)
    cells = np.argwhere(feasible)
    check_memory(
        f"feasible: lines of sight of {len(corners)} corners and {len(cells)} cells",
        0,
        float(_PAIR_BYTES + _COLUMN_BYTES * max(feasible.shape))
        * len(corners)
        * (len(corners) + len(cells)),
    )

    # from the goal to the corners, and to the centres of all cells
    sight = Sight(feasible)
    points = np.concatenate([end[None], corners, cells + 0.5])
    bends = np.concatenate([[0], slopes, np.zeros(len(cells), dtype=np.int64)])
    if sight.cell_of(end[None])[0] >= 0:
        lengths, after = search(sight, points, bends, leaves=len(cells))
    else:
        lengths = np.full(len(points), inf)
        after = np.full(len(points), -1)

    # those that the goal can be reached from, numbered anew
    reached = np.flatnonzero(np.isfinite(lengths[: len(corners) + 1]))
    number = np.zeros(len(points), dtype=np.int64)
    number[reached] = np.arange(len(reached))
    after = np.where(after[reached] >= 0, number[after[reached]], -1)

    to_go = np.full(feasible.shape, inf)
    to_go[tuple(cells.T)] = lengths[len(corners) + 1 :]
    offsets, candidates = _candidates(to_go, points[reached], bends[reached], lengths[reached])

    return EuclideanToGo(
        goal=goal,
        cell_size=cell_size,
        origin=origin,
        sight=sight,
        points=points[reached],
        lengths=lengths[reached],
        after=after,
        offsets=offsets,
        candidates=candidates,
    )


def _candidates(
    to_go: NDArray[np.float64],
    points: NDArray[np.float64],
    bends: NDArray[np.int64],
    lengths: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Which of the points a shortest path may lead to first from anywhere in a cell, as the
    ``offsets`` and ``candidates`` of an `EuclideanToGo`.

    Neither the distance to go nor that over a point that is seen changes by more between a cell's
    centre and a point of it than half of its diagonal: where they are equal at the point, they
    differ at the centre by no more than a diagonal. And a cell lies in one quadrant of each corner.

    Parameters
    ----------
    to_go
        Shape ``(X, Y)``: distances to go from the centres, in cells; inf where there is no way.
    points, bends, lengths
        Of the points that may come first, ``(V, 2)``, ``(V,)`` and ``(V,)``.
    """
    cells = np.argwhere(np.isfinite(to_go))
    number = np.zeros(to_go.shape, dtype=np.int64)
    candidates = [np.empty(0, dtype=np.int32)]

    for block in np.array_split(cells, len(cells) * len(points) // _BLOCK + 1):
        apart = points - (block[:, None] + 0.5)  # (B, V, 2)
        way = lengths + np.hypot(apart[..., 0], apart[..., 1])
        may_be = np.abs(way - to_go[tuple(block.T)][:, None]) <= _DIAGONAL
        cell, candidate = np.nonzero(may_be & is_taut(apart, bends))
        number[tuple(block.T)] = np.bincount(cell, minlength=len(block))
        candidates.append(candidate.astype(np.int32))

    return np.append(0, np.cumsum(number)), np.concatenate(candidates)
