"""`plan_path`: a shortest path over open cells, with all that it depends on."""

from copy import copy
from functools import lru_cache
from math import ceil, floor, inf, prod, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from irs_gym.grid import MOVE_LENGTHS, MOVES, Cell, cells_at, flat_cells, octile_distance
from irs_gym.memory import check_memory, freeze, frozen

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Cells by which paths may be longer than expected, in one search after the other.
_SLACKS = (2.1, 12.0, inf)
_SIDE = 8  # cells: sides of windows are multiples of this, so that there are few kinds
_BYTES = 400  # for each cell of a graph of moves, at the most
_DIAGONAL = sqrt(2.0) - 1.0  # cells: what a diagonal move is longer by than a straight one
_ROUNDING = 1e-6  # cells: more than sums of lengths lose


class PathPlan(NamedTuple):
    """A shortest path, and what is known after the search for it; all cells are flat."""

    cells: Ints  # (D,): from the start to the last before the goal
    moves: Ints  # (D,): the move in each of them
    watched: Ints  # cells that it depends on as well: the goal, and those beside diagonal moves
    bounds: Floats  # (X, Y): in cells, what the distance to go is at the least


def plan_path(
    is_open: Bools,
    start: Cell,
    goal: Cell,
    corner_cutting: bool = True,
    bounds: Floats | None = None,
) -> PathPlan:
    """A shortest path by the first of the best moves in each of its cells.

    A move is worth its length and the distance to go of the cell ahead. Distances are those of
    `irs_gym.oracle.shortest_path.distance_to_go` to the last digit, sums of floats from the goal
    outward, so that of moves equally good the same is the first. They are worked out in those cells
    alone that may lie on a path short enough.

    Parameters
    ----------
    is_open
        Shape ``(X, Y)``. The start need not be open.
    start, goal
        Cells (i, j). From the goal, the path leads out of it and back.
    corner_cutting
        As in `irs_gym.grid.legal_moves`.
    bounds
        Of an earlier plan with the same goal, when no other cells were closed than are now.

    Returns
    -------
    The plan; where no path leads to the goal, its only move is 0, in the start.
    """
    bounds = _octile_to(goal, is_open.shape) if bounds is None else bounds
    expected = float(bounds[start])

    for slack in _SLACKS:
        plan = _search(is_open, start, goal, corner_cutting, bounds, expected + slack)
        if plan is not None:
            return plan

    here = flat_cells(np.array([start]), is_open.shape)
    return PathPlan(here, np.zeros(1, dtype=np.int64), here[:0], bounds)


def _search(
    is_open: Bools, start: Cell, goal: Cell, corner_cutting: bool, bounds: Floats, longest: float
) -> PathPlan | None:
    """A plan whose path is no longer; None where there is none."""
    window = _window(start, goal, longest, is_open.shape)
    across, along = window
    shape = (across.stop - across.start, along.stop - along.start)
    first = (start[0] - across.start) * shape[1] + start[1] - along.start
    last = (goal[0] - across.start) * shape[1] + goal[1] - along.start
    if not is_open[goal]:
        return None

    # No path that is short enough leads through other cells than these.
    least = bounds[window]  # as all that follows, of the window's cells
    from_start = _octile_to(start, is_open.shape)[window]
    is_near = from_start + least <= longest + _ROUNDING

    # Moves into closed cells are none, nor are those past them without corner cutting.
    graph = move_graph(shape)
    lengths = graph.edges.data.copy()  # (8 * cells,)
    lengths[graph.into.take(np.flatnonzero(~(is_open[window] & is_near)), axis=0)] = inf
    if not corner_cutting:
        lengths[graph.past.take(np.flatnonzero(~is_open[window]), axis=0)] = inf

    # Moves are symmetric, so that distances from the goal are those to it.
    edges = copy(graph.edges)
    edges.data = lengths
    to_go = dijkstra(edges, indices=[last], min_only=True, limit=longest)  # (cells,)

    # The first of the best moves, in all cells that were reached and at the end in the start.
    asked = np.append(np.flatnonzero(to_go < inf), first)  # (K,)
    worth = lengths.reshape(-1, 8)[asked] + to_go[edges.indices.reshape(-1, 8)[asked]]  # (K, 8)
    best = worth.argmin(axis=1)  # (K,)
    length = worth[-1, best[-1]]
    if length > longest or length == inf:
        return None

    taken = np.zeros(is_near.size, dtype=np.int64)
    taken[asked] = 8 * asked + best
    path = np.array(_follow(taken, edges.indices, first, last))  # (D,), edges
    moves = path % 8
    cells = _on_map(path // 8, window, is_open.shape)
    watched = np.array([goal[0] * is_open.shape[1] + goal[1]])
    if not corner_cutting:
        is_diagonal = moves % 2 == 1
        steps = flat_cells(MOVES, is_open.shape)
        beside = [steps[(moves[is_diagonal] + turn) % 8] for turn in (-1, 1)]
        watched = np.concatenate([watched, *(cells[is_diagonal] + each for each in beside)])

    # Whatever leaves these cells is longer than that, less the way to them.
    bounds = bounds.copy()
    known = np.minimum(to_go.reshape(shape), longest - from_start)
    bounds[window] = np.maximum(least, known)

    return PathPlan(cells, moves, watched, bounds)


def _follow(taken: Ints, ahead: Ints, first: int, last: int) -> list[int]:
    """The path that begins in a cell and ends before another, as edges; one is taken in each
    cell.
    """
    # one by one, Python's own numbers are faster than NumPy's
    edge_of = taken.data
    cell_of = ahead.data
    path = [edge_of[first]]
    while (cell := cell_of[path[-1]]) != last:
        path.append(edge_of[cell])

    return path


def _window(start: Cell, goal: Cell, longest: float, shape: tuple[int, int]) -> tuple[slice, slice]:
    """The part of a map that no path between two cells leaves, if it is no longer."""
    along_x = abs(goal[0] - start[0])
    along_y = abs(goal[1] - start[1])
    return (
        _span(start[0], goal[0], along_y, longest, shape[0]),
        _span(start[1], goal[1], along_x, longest, shape[1]),
    )


def _span(at: int, to: int, across: int, longest: float, size: int) -> slice:
    """The cells along one axis that such paths come to, where both ends are so far apart across.

    A path that goes v cells along the axis, on its way out and back taken together, is as long as
    the octile distance of v and of the cells across at the least.
    """
    if longest == inf:
        return slice(0, size)

    most = longest - _DIAGONAL * across
    if most < across:  # v, where more moves lead across than along
        most = (longest - across) / _DIAGONAL

    beyond = (most - abs(to - at)) / 2.0
    first = max(floor(min(at, to) - beyond), 0)
    cells = min(ceil(max(at, to) + beyond) + 1, size) - first
    cells = min(-(-cells // _SIDE) * _SIDE, size)
    first = min(first, size - cells)

    return slice(first, first + cells)


def _on_map(cells: Ints, window: tuple[slice, slice], shape: tuple[int, int]) -> Ints:
    """Flat cells of a window as those of the map."""
    across, along = window
    column, row = np.divmod(cells, along.stop - along.start)
    return np.asarray((column + across.start) * shape[1] + row + along.start)


def _octile_to(cell: Cell, shape: tuple[int, int]) -> Floats:
    """Octile distance of each cell of a map to one of them, ``(X, Y)``: a view."""
    first = (shape[0] - 1 - cell[0], shape[1] - 1 - cell[1])
    return _octile_table(shape)[first[0] : first[0] + shape[0], first[1] : first[1] + shape[1]]


@lru_cache(maxsize=8)
def _octile_table(shape: tuple[int, int]) -> Floats:
    """Octile distances by how far cells are apart, from one end of a map to the other."""
    apart = np.indices((2 * shape[0] - 1, 2 * shape[1] - 1)) - np.reshape(shape, (2, 1, 1)) + 1
    return frozen(octile_distance(np.moveaxis(apart, 0, -1)))


class MoveGraph(NamedTuple):
    """All moves over a map of X * Y open cells: edge 8 n + m is move m out of cell n.

    A move off the map is infinitely long, and leads back to where it begins.
    """

    edges: csr_array  # (X * Y, X * Y), lengths in cells
    into: Ints  # (X * Y, 8): edges into each cell
    past: Ints  # (X * Y, 8): diagonal edges that pass beside each cell


@lru_cache(maxsize=128)
def move_graph(shape: tuple[int, int]) -> MoveGraph:
    """The graph of a map of that shape."""
    check_memory(f"a map of {shape} cells: the graph of its moves", float(_BYTES * prod(shape)))
    cells = np.arange(prod(shape))[:, None]  # (X * Y, 1)
    moves = np.arange(8)
    out = 8 * cells + moves  # (X * Y, 8)

    there = cells_at(cells, shape) + MOVES  # (X * Y, 8, 2)
    is_on_map = ((there >= 0) & (there < shape)).all(axis=-1)  # (X * Y, 8)
    ahead = np.where(is_on_map, flat_cells(there, shape), cells)
    lengths = np.where(is_on_map, MOVE_LENGTHS, inf)

    # From each cell ahead, the move back; and from those ahead of straight moves, the diagonals
    # that pass. In place of those from off the map, the move that leads there.
    into = np.where(is_on_map, 8 * ahead + (moves + 4) % 8, out)
    straight = slice(0, 8, 2)
    past = [
        np.where(is_on_map, 8 * ahead + (moves + turn) % 8, out)[:, straight] for turn in (3, 5)
    ]

    index = np.dtype(np.int32 if out.size < 2**31 else np.int64)
    rows = np.arange(0, out.size + 1, 8, dtype=index)
    arrays = (lengths.ravel(), ahead.ravel().astype(index), rows)
    graph = MoveGraph(csr_array(arrays, shape=(cells.size,) * 2), into, np.concatenate(past, 1))
    freeze(*arrays, graph.into, graph.past)

    return graph
