"""The oracle: exact shortest paths, distances to go and the highest feasible target of a map."""

from dataclasses import dataclass
from math import floor, sqrt
from typing import Any

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
    as_cell,
    cells_at,
    checked_cell_size,
    checked_map,
    flat_cells,
    legal_moves,
    neighbours,
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
    feasible: NDArray[np.bool_], start: Cell, goal: Cell, cell_size: float
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
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    source = flat_cell(feasible, start, "start")
    target = flat_cell(feasible, goal, "goal")
    if not (feasible[start] and feasible[goal]):
        return None

    # for each cell, the one that a shortest path from the start reaches it from, (X * Y,)
    _, before = dijkstra(_graph(feasible), indices=source, return_predecessors=True)
    if source != target and before[target] < 0:
        return None

    # read off backwards, from the goal
    flat = [target]
    while flat[-1] != source:
        flat.append(int(before[flat[-1]]))

    cells = cells_at(np.array(flat[::-1], dtype=np.int64), feasible.shape)

    return Path(path_length(cells, cell_size), cells)


def distance_to_go(
    feasible: NDArray[np.bool_], goal: Cell, cell_size: float
) -> NDArray[np.float64]:
    """Length in metres of the shortest path from every cell to the goal.

    Returns shape ``(X, Y)``; +inf where the goal cannot be reached. Raises ``ValueError`` as
    `shortest_path` does.

    Examples
    --------
    >>> import numpy as np
    >>> distance_to_go(np.ones((2, 3), dtype=bool), (0, 0), cell_size=0.5).round(3).tolist()
    [[0.0, 0.5, 1.0], [0.5, 0.707, 1.207]]
    """
    feasible = checked_map(feasible, "feasible", "b", GRAPH_BYTES)
    cell_size = checked_cell_size(cell_size)
    goal = as_cell(goal, "goal")
    target = flat_cell(feasible, goal, "goal")
    if not feasible[goal]:
        return np.full(feasible.shape, np.inf)

    # Moves are symmetric, so distances from the goal are distances to it.
    distance = dijkstra(_graph(feasible), indices=target).reshape(feasible.shape)

    return np.asarray(distance * cell_size)


def descend(to_go: NDArray[np.float64], start: Cell, cell_size: float) -> Path:
    """A shortest path read off the map of distances to go, by the steepest way down.

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
        on_map = np.all((ahead >= 0) & (ahead < to_go.shape), axis=1)
        ahead = ahead[on_map]

        # On a shortest path, a move and the way that is left after it are together as long as the
        # way from here; after any other move they are longer.
        length = MOVE_LENGTHS[on_map] * cell_size
        cells.append(ahead[np.argmin(length + to_go[ahead[:, 0], ahead[:, 1]])])

    path = np.stack(cells)

    return Path(path_length(path, cell_size), path)


def detours_of_moves(to_go: NDArray[np.float64], cell_size: float) -> NDArray[np.float64]:
    """How much longer than the shortest a path from each cell becomes with each move.

    Parameters
    ----------
    to_go
        Distances to go in metres, +inf where the goal cannot be reached; shape ``(S, X, Y)``.
    cell_size
        Edge of a cell in metres.

    Returns
    -------
    Metres, shape ``(S, 8, X, Y)``; +inf for moves into and from cells from which the goal cannot be
    reached.
    """
    ahead = neighbours(to_go, np.inf, axis=1)
    length = MOVE_LENGTHS[:, None, None] * cell_size

    return ahead + length - np.where(np.isfinite(to_go), to_go, -np.inf)[:, None]


def optimal_moves(to_go: NDArray[np.float64], cell_size: float) -> NDArray[np.bool_]:
    """Which moves from each cell begin a shortest path; the arguments are those of
    `detours_of_moves`.

    Returns
    -------
    Shape ``(S, 8, X, Y)``; no move where the goal cannot be reached, nor at the goal.
    """
    return (
        detours_of_moves(to_go, cell_size)
        <= np.where(np.isfinite(to_go), to_go, 0.0)[:, None] * _TIE
    )


def highest_feasible_target(gain_db: NDArray[np.float64], start: Cell, goal: Cell) -> float:
    """The highest target in dB at which start and goal are connected, exactly: the widest path's
    bottleneck.

    A path's bottleneck is its lowest gain; the widest path is that of the highest bottleneck. It
    runs in the maximum spanning tree of the free cells (Hu, 1961), a move being as wide as the
    lower of its two cells. Returns -inf where no path exists at any target.

    Parameters
    ----------
    gain_db
        Shape ``(X, Y)``; -inf in obstacles.

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

    # Gains as ranks, 0 for the highest: a move costs the rank of the lower of its two cells. SciPy
    # takes a weight of 0 for no edge, hence the 1.
    levels, rank = np.unique(-gain_db.ravel(), return_inverse=True)  # (K,), (X * Y,)
    rows, second, _ = edges(np.isfinite(gain_db))
    first_rank = np.repeat(rank, np.diff(rows))  # (moves,)
    cost = np.maximum(first_rank, rank[second]) + 1.0

    # The tree that keeps the cheapest moves, those of the highest gains.
    graph = csr_array((cost, second, rows), shape=(gain_db.size,) * 2)
    tree = minimum_spanning_tree(graph, overwrite=True)

    # In a tree there is one path between two cells: walk it back from the goal, and keep the worst
    # rank on the way.
    _, before = breadth_first_order(tree, source, directed=False)
    cell = target
    worst = rank[target]

    while cell != source:
        cell = before[cell]
        if cell < 0:  # another tree of the forest
            return -np.inf
        worst = max(worst, rank[cell])

    return -float(levels[worst])


def largest_component(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest set of free cells that are all connected, shape ``(X, Y)``; the first of several
    as large.
    """
    # obstacles are components of one cell each, and count for nothing
    _, labels = connected_components(_graph(free), directed=False)  # (X * Y,)
    sizes = np.bincount(labels, weights=free.ravel())
    largest: NDArray[np.bool_] = labels == np.argmax(sizes)

    return free & largest.reshape(free.shape)


def infeasible(gain_db: NDArray[np.float64], start: Cell, goal: Cell, target_db: float) -> str:
    """What to say of a target at which start and goal are not connected: it names the highest that
    is feasible.
    """
    highest = highest_feasible_target(gain_db, start, goal)
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


def edges(free: NDArray[np.bool_]) -> tuple[Integers, Integers, Integers]:
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
    legal = legal_moves(free) & free[:, :, None]  # (X, Y, 8)

    # how many moves leave each cell, added up
    rows: Integers = np.zeros(free.size + 1, dtype=index)
    np.cumsum(legal.sum(axis=2).ravel(), out=rows[1:])

    # the legal moves in order, cell after cell, and where each leads
    cells, moves = np.divmod(np.flatnonzero(legal).astype(index), len(MOVES))
    cells += flat_cells(MOVES, free.shape).astype(index)[moves]

    return rows, cells, moves


def _graph(free: NDArray[np.bool_]) -> csr_array:
    """Weighted graph of eq. (17) over the free cells, lengths in cells."""
    rows, cells, moves = edges(free)
    return csr_array((MOVE_LENGTHS[moves], cells, rows), shape=(free.size, free.size))
