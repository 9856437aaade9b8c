"""The oracle: exact shortest paths, distances to go and the highest feasible target of a map."""

from dataclasses import dataclass
from math import floor, sqrt
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    dijkstra,
    minimum_spanning_tree,
)

from irs_gym.grid import (
    MOVE_LENGTHS,
    MOVES,
    Cell,
    Motion,
    as_cell,
    cells_at,
    checked_cell_size,
    checked_map,
    checked_motion,
    checked_radius,
    flat_cells,
    legal_moves,
    lowest_ahead,
    neighbours,
    with_clearance,
)
from irs_gym.memory import freeze

# For each cell of a map, at the most: of the graph of its moves and a search in it.
GRAPH_BYTES = 400
Integers = NDArray[np.integer[Any]]

# Relative: lengths are sums of floats, and moves that lose no more than this count as the best.
_TIE = 1e-9


@dataclass(frozen=True, eq=False)
class Path:
    """A path over the grid.

    Attributes
    ----------
    distance
        Its length in metres.
    cells
        int64, shape ``(D, 2)``: its cells (i, j) from start to goal.

    Examples
    --------
    >>> import numpy as np
    >>> path = Path(distance=1.0, cells=np.array([[0, 0], [1, 0], [2, 0]]))
    >>> len(path.cells), path.distance
    (3, 1.0)
    """

    distance: float
    cells: NDArray[np.int64]

    def __post_init__(self) -> None:
        freeze(self.cells)


def path_length(cells: NDArray[np.int64], cell_size: float) -> float:
    """Length in metres of a path of neighbouring cells ``(D, 2)``, counted exactly: (a + b sqrt(2))
    cell_size.
    """
    steps = np.abs(np.diff(cells, axis=0))
    diagonal = int(np.count_nonzero(steps.sum(axis=1) == 2))
    straight = int(np.count_nonzero(steps.sum(axis=1) == 1))

    return (straight + diagonal * sqrt(2.0)) * cell_size


def shortest_path(
    feasible: NDArray[np.bool_],
    start: Cell,
    goal: Cell,
    cell_size: float,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> Path | None:
    """Shortest path over feasible cells: problem (15) of the paper, by Dijkstra's algorithm.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.
    corner_cutting
        Whether a diagonal move may pass an infeasible cell beside it, as in the paper.
    robot_radius
        Metres that the centre of a cell must be away from all infeasible cells and the map's edge.
        Where only some of them are obstacles, take a map of `RadioMap.for_robot` instead.
    passable
        Bool, shape ``(X, Y, 8)``: the moves that the robot's body can make; None: all.

    Returns
    -------
    The path, or None where the goal cannot be reached.

    Raises
    ------
    ValueError
        Where ``feasible`` is no map of bools, an end no cell of it, or ``cell_size`` not positive.

    Examples
    --------
    >>> import numpy as np
    >>> feasible = np.ones((3, 3), dtype=bool)
    >>> feasible[1, :2] = False  # a wall with a gap at its upper end
    >>> path = shortest_path(feasible, (0, 0), (2, 0), cell_size=0.5)
    >>> path.cells.tolist()
    [[0, 0], [0, 1], [1, 2], [2, 1], [2, 0]]
    >>> round(path.distance, 3)
    2.414
    """
    feasible = checked_map(feasible, "feasible", "b", GRAPH_BYTES)
    cell_size = checked_cell_size(cell_size)
    motion = checked_motion(corner_cutting, passable, feasible.shape)
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    source = flat_cell(feasible, start, "start")
    target = flat_cell(feasible, goal, "goal")
    feasible = with_clearance(feasible, robot_radius, cell_size)
    if not (feasible[start] and feasible[goal]):
        return None

    # for each cell, the one that a shortest path from the start reaches it from, (X * Y,)
    graph = graph_of(feasible, **motion)
    _, before = dijkstra(graph, indices=source, return_predecessors=True)
    if source != target and before[target] < 0:
        return None

    # read off backwards, from the goal
    flat = [target]
    while flat[-1] != source:
        flat.append(int(before[flat[-1]]))

    cells = cells_at(np.array(flat[::-1], dtype=np.int64), feasible.shape)

    return Path(path_length(cells, cell_size), cells)


def distance_to_go(
    feasible: NDArray[np.bool_],
    goal: Cell,
    cell_size: float,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """Length in metres of the shortest path from every cell to the goal.

    The arguments are those of `shortest_path`. Returns shape ``(X, Y)``; +inf where the goal cannot
    be reached. Raises ``ValueError`` as `shortest_path` does.

    Examples
    --------
    >>> import numpy as np
    >>> distance_to_go(np.ones((2, 3), dtype=bool), (0, 0), cell_size=0.5).round(3).tolist()
    [[0.0, 0.5, 1.0], [0.5, 0.707, 1.207]]
    """
    feasible = checked_map(feasible, "feasible", "b", GRAPH_BYTES)
    cell_size = checked_cell_size(cell_size)
    motion = checked_motion(corner_cutting, passable, feasible.shape)
    goal = as_cell(goal, "goal")
    target = flat_cell(feasible, goal, "goal")
    feasible = with_clearance(feasible, robot_radius, cell_size)
    if not feasible[goal]:
        return np.full(feasible.shape, np.inf)

    # Moves are symmetric, so distances from the goal are distances to it.
    distance = dijkstra(graph_of(feasible, **motion), indices=target).reshape(feasible.shape)

    return np.asarray(distance * cell_size)


def descend(
    to_go: NDArray[np.float64],
    start: Cell,
    cell_size: float,
    legal: NDArray[np.bool_] | None = None,
) -> Path:
    """A shortest path read off the map of distances to go, by the steepest way down.

    ``legal`` ``(X, Y, 8)``: the moves that are allowed, where those between two cells that lead to
    the goal are not all.

    Raises
    ------
    ValueError
        Where the goal cannot be reached from ``start``.
    """
    flat_cell(to_go, start, "start")
    if not np.isfinite(to_go[start]):
        raise ValueError(f"the goal cannot be reached from start={tuple(start)}")

    cells = [np.array(start)]
    while to_go[tuple(cells[-1])] > 0:
        ahead = cells[-1] + MOVES  # (8, 2)
        is_open = np.all((ahead >= 0) & (ahead < to_go.shape), axis=1)
        if legal is not None:
            is_open &= legal[tuple(cells[-1])]
        ahead = ahead[is_open]

        # On a shortest path, a move and the way that is left after it are together as long as the
        # way from here; after any other move they are longer.
        length = MOVE_LENGTHS[is_open] * cell_size
        cells.append(ahead[np.argmin(length + to_go[ahead[:, 0], ahead[:, 1]])])

    path = np.stack(cells)

    return Path(path_length(path, cell_size), path)


def detours_of_moves(
    to_go: NDArray[np.float64], cell_size: float, legal: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """How much longer than the shortest a path from each cell becomes with each move.

    Parameters
    ----------
    to_go
        Distances to go in metres, +inf where the goal cannot be reached; shape ``(S, X, Y)``.
    cell_size
        Edge of a cell in metres.
    legal
        Moves that are allowed, shape ``(S, X, Y, 8)``, where those between two cells that lead to
        the goal are not all.

    Returns
    -------
    Metres, shape ``(S, 8, X, Y)``; +inf for moves into and from cells from which the goal cannot be
    reached, and for those that are not allowed.
    """
    ahead = neighbours(to_go, np.inf, axis=1)
    if legal is not None:
        ahead = np.where(np.moveaxis(legal, -1, 1), ahead, np.inf)

    length = MOVE_LENGTHS[:, None, None] * cell_size

    return ahead + length - np.where(np.isfinite(to_go), to_go, -np.inf)[:, None]


def optimal_moves(
    to_go: NDArray[np.float64], cell_size: float, legal: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Which moves from each cell begin a shortest path; the arguments are those of
    `detours_of_moves`.

    Returns
    -------
    Shape ``(S, 8, X, Y)``; no move where the goal cannot be reached, nor at the goal.
    """
    return (
        detours_of_moves(to_go, cell_size, legal)
        <= np.where(np.isfinite(to_go), to_go, 0.0)[:, None] * _TIE
    )


def highest_feasible_target(
    gain_db: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    *,
    cell_size: float | None = None,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> float:
    """The highest target in dB at which start and goal are connected, exactly: the widest path's
    bottleneck.

    A path's bottleneck is its lowest gain; the widest path is that of the highest bottleneck. It
    runs in the maximum spanning tree of the free cells (Hu, 1961), a move being as wide as the
    lower of its two cells (without corner cutting, a diagonal as the lowest of the four). Returns
    -inf where no path exists at any target.

    Parameters
    ----------
    gain_db
        Shape ``(X, Y)``; -inf in obstacles.
    cell_size
        Edge of a cell in metres, which a ``robot_radius`` needs.
    corner_cutting, robot_radius, passable
        As in `shortest_path`; the radius keeps the robot away from obstacles.

    Raises
    ------
    ValueError
        Where ``gain_db`` is no map of numbers without NaN and +inf, or an end no cell of it.

    Examples
    --------
    >>> import numpy as np
    >>> gain_db = np.array([[-60.0, -70.0, -60.0], [-62.0, -64.0, -61.0]])
    >>> highest_feasible_target(gain_db, (0, 0), (0, 2))  # over the second row
    -64.0
    """
    gain_db = checked_map(gain_db, "gain_db", "iuf", GRAPH_BYTES)
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    source = flat_cell(gain_db, start, "start")
    target = flat_cell(gain_db, goal, "goal")
    motion = checked_motion(corner_cutting, passable, gain_db.shape)
    gain_db = for_radius(gain_db, robot_radius, cell_size)

    # Gains as ranks, 0 for the highest: a move costs the rank of the lowest that it meets. SciPy
    # takes a weight of 0 for no edge, hence the 1.
    levels, rank = np.unique(-gain_db.ravel(), return_inverse=True)  # (K,), (X * Y,)
    rows, second, moves = edges(np.isfinite(gain_db), **motion)
    by_cell = rank.reshape(gain_db.shape)
    cost = 1.0 - widths(-by_cell, rows, moves, **motion)

    # The tree that keeps the cheapest moves, those of the highest gains.
    graph = csr_array((cost, second, rows), shape=(gain_db.size,) * 2)
    tree = minimum_spanning_tree(graph, overwrite=True)

    # In a tree there is one path between two cells: walk it back from the goal, and keep the worst
    # rank on the way.
    _, before = breadth_first_order(tree, source, directed=False)
    cell = target
    worst = rank[target]

    while cell != source:
        last = cell
        cell = before[cell]
        if cell < 0:  # another tree of the forest
            return -np.inf
        worst = max(worst, rank[cell])
        if not corner_cutting:  # of a move along an axis, the cells beside it are its own
            i, j = divmod(last, gain_db.shape[1])
            k, m = divmod(cell, gain_db.shape[1])
            worst = max(worst, by_cell[i, m], by_cell[k, j])

    return -float(levels[worst])


def largest_component(free: NDArray[np.bool_], **motion: Unpack[Motion]) -> NDArray[np.bool_]:
    """The largest set of free cells that are all connected, shape ``(X, Y)``; the first of several
    as large.
    """
    # obstacles are components of one cell each, and count for nothing
    _, labels = connected_components(graph_of(free, **motion), directed=False)  # (X * Y,)
    sizes = np.bincount(labels, weights=free.ravel())
    largest: NDArray[np.bool_] = labels == np.argmax(sizes)

    return free & largest.reshape(free.shape)


def infeasible(
    gain_db: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    target_db: float,
    **motion: Unpack[Motion],
) -> str:
    """What to say of a target at which start and goal are not connected: it names the highest that
    is feasible.
    """
    highest = highest_feasible_target(gain_db, start, goal, **motion)
    # rounded down, so that the number is feasible when typed in
    advice = (
        "no target is"
        if highest == -np.inf
        else f"the highest feasible target is {floor(highest * 1e4) / 1e4} dB"
    )
    return f"target_db={target_db} is infeasible from {start} to {goal}: {advice}"


def flat_cell(array: NDArray[np.generic], cell: Cell, name: str) -> int:
    """Flat index of a cell; a ``ValueError`` that names it where it lies off the map."""
    if not (0 <= cell[0] < array.shape[0] and 0 <= cell[1] < array.shape[1]):
        raise ValueError(f"{name}={tuple(cell)} lies off the map of {array.shape} cells")

    return int(flat_cells(np.array(cell), array.shape[:2]))


def for_radius(
    gain_db: NDArray[np.float64], robot_radius: float, cell_size: float | None
) -> NDArray[np.float64]:
    """The gains ``(..., X, Y)``, of one map or of several configurations, with -inf wherever a
    robot of that radius cannot be; see `irs_gym.grid.with_clearance`.
    """
    if not checked_radius(robot_radius):
        return gain_db
    if cell_size is None:
        raise ValueError(f"robot_radius={robot_radius} needs a cell_size in metres")

    maps = np.isfinite(gain_db).reshape(-1, *gain_db.shape[-2:])  # (K, X, Y)
    free = np.asarray(maps.any(axis=0))
    is_clear = with_clearance(free, robot_radius, checked_cell_size(cell_size))

    return np.where(is_clear, gain_db, -np.inf)


def edges(free: NDArray[np.bool_], **motion: Unpack[Motion]) -> tuple[Integers, Integers, Integers]:
    """All legal moves between free cells, as compressed sparse rows over flat cells.

    Returns
    -------
    rows
        Shape ``(X * Y + 1,)``: the moves out of cell n are those from ``rows[n]`` to before
        ``rows[n + 1]``.
    cells
        The cell that each move leads to.
    moves
        Its number in `irs_gym.grid.MOVES`.
    """
    # half the memory for all but giant maps
    index = np.dtype(np.int32 if free.size * len(MOVES) < 2**31 else np.int64)
    legal = legal_moves(free, **motion) & free[:, :, None]  # (X, Y, 8)

    # how many moves leave each cell, added up
    rows: Integers = np.zeros(free.size + 1, dtype=index)
    np.cumsum(legal.sum(axis=2).ravel(), out=rows[1:])

    # the legal moves in order, cell after cell, and where each leads
    cells, moves = np.divmod(np.flatnonzero(legal).astype(index), len(MOVES))
    cells += flat_cells(MOVES, free.shape).astype(index)[moves]

    return rows, cells, moves


def widths(
    values: NDArray[Any], rows: Integers, moves: Integers, **motion: Unpack[Motion]
) -> NDArray[Any]:
    """The lowest of the values ``(X, Y)`` that each of the `edges` meets, where it begins, where it
    ends and, without corner cutting, beside it; shape ``(moves,)``.
    """
    first = np.repeat(np.arange(values.size, dtype=rows.dtype), np.diff(rows))  # (moves,)
    corner_cutting = motion.get("corner_cutting", True)
    ahead = lowest_ahead(values, values.min(), corner_cutting).reshape(-1, len(MOVES))
    return np.asarray(np.minimum(values.ravel()[first], ahead[first, moves]))


def graph_of(free: NDArray[np.bool_], **motion: Unpack[Motion]) -> csr_array:
    """Weighted graph of eq. (17) over the free cells, lengths in cells."""
    rows, cells, moves = edges(free, **motion)
    return csr_array((MOVE_LENGTHS[moves], cells, rows), shape=(free.size, free.size))
