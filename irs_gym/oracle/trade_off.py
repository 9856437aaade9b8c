"""`trade_off`: the shortest distance between two cells over the target, every step of it exact."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra

from irs_gym.grid import MOVE_LENGTHS, Cell, as_cell, checked_cell_size, checked_map
from irs_gym.memory import freeze
from irs_gym.oracle.shortest_path import GRAPH_BYTES, Integers, edges, flat_cell
from irs_gym.oracle.whole_lengths import MOST_CELLS, true_length, whole_lengths


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Shortest distance over the target: a step function, rising with the target.

    Attributes
    ----------
    targets_db
        float64, shape ``(S,)``, rising: the highest target at which each distance can still be had.
        The last one is the highest feasible target; there is none where start and goal are never
        connected.
    distances
        float64, shape ``(S,)``, rising, in metres: the shortest distance for targets above the one
        before, up to and with the one at its place.
    dijkstra_runs
        Runs of Dijkstra's algorithm that it took: one a step, and a last one that finds no path.

    Examples
    --------
    >>> import numpy as np
    >>> steps = TradeOff(np.array([-64.0, -60.0]), np.array([1.0, 1.5]), dijkstra_runs=3)
    >>> steps.distance_at([-65.0, -60.0, -59.0]).tolist()
    [1.0, 1.5, inf]
    """

    targets_db: NDArray[np.float64]
    distances: NDArray[np.float64]
    dijkstra_runs: int

    def __post_init__(self) -> None:
        freeze(self.targets_db, self.distances)

    def distance_at(self, target_db: ArrayLike) -> NDArray[np.float64]:
        """Shortest distance in metres at any targets, same shape; +inf above the highest feasible
        one.

        Raises ``ValueError`` where a target is no number.
        """
        targets_db = np.asarray(target_db)
        if targets_db.dtype.kind not in "iuf" or np.isnan(targets_db).any():
            raise ValueError(f"target_db={target_db!r} must be numbers of dB")

        step = np.searchsorted(self.targets_db, targets_db.astype(np.float64), side="left")

        return np.asarray(np.append(self.distances, np.inf)[step])


def trade_off(gain_db: NDArray[np.float64], start: Cell, goal: Cell, cell_size: float) -> TradeOff:
    """The whole trade-off between the target and the shortest distance (the paper's Fig. 5),
    exactly.

    All shortest paths at one target make a directed graph, read off the distances to the goal. The
    distance stays the same up to the bottleneck of the widest path in it, which a bisection over
    its gains finds; the next higher target needs a new run of Dijkstra's algorithm. So there is one
    run a step, where trying every gain of the map takes as many as there are cells.

    Parameters
    ----------
    gain_db
        Shape ``(X, Y)`` in dB; -inf in obstacles.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.

    Raises
    ------
    ValueError
        Where ``gain_db`` is no map of numbers without NaN and +inf or one of too many cells for
        exact sums, an end no cell of it, or ``cell_size`` not positive.

    Examples
    --------
    >>> import numpy as np
    >>> gain_db = np.array([[-60.0, -70.0, -60.0], [-62.0, -64.0, -61.0]])
    >>> steps = trade_off(gain_db, (0, 0), (0, 2), cell_size=0.5)
    >>> steps.targets_db.tolist()  # straight on over -70 dB, around it over -64 dB
    [-70.0, -64.0]
    >>> steps.distances.round(3).tolist()
    [1.0, 1.414]
    """
    gain_db = checked_map(gain_db, "gain_db", "iuf", GRAPH_BYTES)
    if gain_db.size > MOST_CELLS:
        raise ValueError(
            f"gain_db has {gain_db.size} cells, and lengths are exact on maps up to {MOST_CELLS}"
        )

    cell_size = checked_cell_size(cell_size)
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    source = flat_cell(gain_db, start, "start")
    sink = flat_cell(gain_db, goal, "goal")
    gain = gain_db.ravel()  # (X * Y,)

    targets_db: list[float] = []
    distances: list[float] = []
    above = -np.inf  # targets up to and with this one are settled
    runs = 0

    while min(gain[source], gain[sink]) > above:
        # the distance for targets that are a little higher
        to_go, graph = _distances_to_go(gain_db > above, sink)
        runs += 1
        if np.isinf(to_go[source]):
            break

        # It stays the same as long as one of all the shortest paths is feasible: up to the
        # bottleneck of the widest of them.
        above = _bottleneck(_shortest_paths(graph, to_go), gain, source, sink)
        targets_db.append(above)
        distances.append(true_length(to_go[source], gain.size) * cell_size)

    return TradeOff(np.array(targets_db), np.array(distances), runs)


# --- all shortest paths ---------------------------------------------------------------------------


def _distances_to_go(free: NDArray[np.bool_], sink: int) -> tuple[NDArray[np.float64], csr_array]:
    """Whole lengths of the shortest paths to the goal, shape ``(X * Y,)``, and the graph of all
    moves.
    """
    rows, cells, moves = edges(free)
    lengths = np.where(MOVE_LENGTHS == 1, *whole_lengths(free.size)).astype(np.float64)
    graph = csr_array((lengths[moves], cells, rows), shape=(free.size, free.size))

    return dijkstra(graph, indices=sink), graph


# --- the widest of all shortest paths -------------------------------------------------------------


def _shortest_paths(graph: csr_array, to_go: NDArray[np.float64]) -> tuple[Integers, Integers]:
    """The moves (from, to) that lie on a shortest path to the goal."""
    first = np.repeat(np.arange(len(to_go)), np.diff(graph.indptr))  # (moves,)

    # A move is on one if it takes off the way to go exactly its own length: whole numbers, so that
    # the comparison is exact.
    with np.errstate(invalid="ignore"):  # inf - inf where the goal cannot be reached
        is_shortest = to_go[first] - to_go[graph.indices] == graph.data

    return first[is_shortest], graph.indices[is_shortest]


def _bottleneck(
    moves: tuple[Integers, Integers], gain: NDArray[np.float64], source: int, sink: int
) -> float:
    """The highest gain that some path along ``moves`` keeps from source to sink."""
    first, second = moves
    width = np.minimum(gain[first], gain[second])  # (moves,): the highest target that allows each

    def reached(target_db: float) -> Integers:
        kept = width >= target_db
        graph = csr_array((kept[kept], (first[kept], second[kept])), shape=(gain.size,) * 2)
        return np.asarray(breadth_first_order(graph, source, return_predecessors=False))

    # The bottleneck is the gain of some cell on the way, and neither end has a lower one.
    values = np.unique(gain[reached(-np.inf)])  # rising
    values = values[values <= min(gain[source], gain[sink])]

    # Bisection: the goal is reached up to some gain, and at none above.
    lost = bisect_left(values, True, key=lambda target_db: sink not in reached(target_db))

    return float(values[lost - 1])
