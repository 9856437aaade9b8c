"""`shortest_lengths`: the lengths of the shortest paths of many tasks on one map."""

from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from irs_gym.grid import (
    checked_cell_size,
    checked_map,
    checked_motion,
    flat_cells,
    octile_distance,
    with_clearance,
)
from irs_gym.oracle.shortest_path import GRAPH_BYTES, Integers, graph_of

# How far a search goes at first, in octile distances, and how much further where that was too
# little.
_FIRST = 1.3
_FURTHER = 1.3


def shortest_lengths(
    feasible: NDArray[np.bool_],
    starts: ArrayLike,
    goals: ArrayLike,
    cell_size: float,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """Length in metres of the shortest path of each of n tasks: one graph, and one search for each
    distinct start, or goal where there are fewer.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    starts, goals
        Cells (i, j), shape ``(n, 2)`` each.
    cell_size
        Edge of a cell in metres.
    corner_cutting, robot_radius, passable
        As in `irs_gym.shortest_path`.

    Returns
    -------
    Shape ``(n,)``; +inf where a goal cannot be reached.

    Raises
    ------
    ValueError
        As `irs_gym.shortest_path`, and where the cells are not n starts and n goals.

    Examples
    --------
    >>> feasible = np.ones((3, 3), dtype=bool)
    >>> shortest_lengths(feasible, [(0, 0), (0, 0)], [(2, 0), (2, 2)], cell_size=0.5).round(3)
    array([1.   , 1.414])
    """
    feasible = checked_map(feasible, "feasible", "b", GRAPH_BYTES)
    cell_size = checked_cell_size(cell_size)
    motion = checked_motion(corner_cutting, passable, feasible.shape)
    first = _cells(starts, "starts", feasible.shape)
    second = _cells(goals, "goals", feasible.shape)
    if len(first) != len(second):
        raise ValueError(f"there are {len(first)} starts and {len(second)} goals")

    # moves are symmetric, so either end may be the one that is searched from
    if len(np.unique(first, axis=0)) > len(np.unique(second, axis=0)):
        first, second = second, first

    feasible = with_clearance(feasible, robot_radius, cell_size)
    graph = graph_of(feasible, **motion)
    source = flat_cells(first, feasible.shape)  # (n,)
    target = flat_cells(second, feasible.shape)  # (n,)
    _, piece = connected_components(graph, directed=False)  # (X * Y,)
    is_joined = (piece[source] == piece[target]) & feasible.ravel()[source]
    octile = octile_distance(second - first)  # (n,)

    lengths = np.full(len(source), inf)
    for cell in np.unique(source[is_joined]):
        tasks = np.flatnonzero(is_joined & (source == cell))
        search = _from_both_ends if len(tasks) == 1 else _from_one_end
        lengths[tasks] = search(graph, int(cell), target[tasks], _FIRST * octile[tasks].max())

    return lengths * cell_size


def _from_one_end(
    graph: csr_array, source: int, targets: Integers, limit: float
) -> NDArray[np.float64]:
    """Lengths in cells to those that can be reached, ``(m,)``, by a search that goes up to
    ``limit``, and beyond if it has to.
    """
    while True:
        found = dijkstra(graph, indices=source, limit=limit)[targets]
        if np.isfinite(found).all():
            return np.asarray(found)

        limit = _FURTHER * limit + 1


def _from_both_ends(
    graph: csr_array, source: int, targets: Integers, limit: float
) -> NDArray[np.float64]:
    """The same for one target, by two searches that meet: half as far, they go over half as many
    cells.
    """
    while True:
        # A path no longer than the limit has a cell near to its middle, half a move away at most,
        # that both searches reach.
        ends = np.array([source, targets[0]])
        found = dijkstra(graph, indices=ends, limit=limit / 2 + 1).sum(axis=0).min()
        if found <= limit:
            return np.array([found])

        limit = _FURTHER * limit + 1


def _cells(cells: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Cells ``(n, 2)`` on a map; a ``ValueError`` names the first that is none."""
    array = np.asarray(cells)
    if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "iu":
        raise ValueError(
            f"{name} has the shape {array.shape}, but cells (i, j) are (n, 2) integers"
        )

    is_off = ((array < 0) | (array >= shape)).any(axis=1)
    if is_off.any():
        n = int(np.argmax(is_off))
        raise ValueError(
            f"{name}[{n}]={tuple(array[n].tolist())} lies off the map of {shape} cells"
        )

    return array.astype(np.int64)
