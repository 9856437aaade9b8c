"""`trade_off`: the shortest distance between two cells over the target, every step of it exact."""

from bisect import bisect_left
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra

from irs_gym.grid import (
    MOVE_LENGTHS,
    Cell,
    Motion,
    as_cell,
    checked_cell_size,
    checked_map,
    checked_motion,
)
from irs_gym.memory import freeze
from irs_gym.oracle.shortest_path import (
    GRAPH_BYTES,
    Integers,
    edges,
    flat_cell,
    for_radius,
    widths,
)
from irs_gym.oracle.whole_lengths import MOST_CELLS, true_length, whole_lengths


class Moves(NamedTuple):
    """Moves over flat cells."""

    first: Integers  # (moves,), the cells that they leave
    second: Integers  # (moves,), those that they enter
    width: NDArray[np.float64]  # (moves,), the highest target in dB that allows each


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


def trade_off(
    gain_db: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    cell_size: float,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> TradeOff:
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
    corner_cutting, robot_radius, passable
        As in `irs_gym.oracle.shortest_path.shortest_path`; the radius keeps the robot away from
        obstacles.

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
    motion = checked_motion(corner_cutting, passable, gain_db.shape)
    gain_db = for_radius(gain_db, robot_radius, cell_size)
    gain = gain_db.ravel()  # (X * Y,)

    targets_db: list[float] = []
    distances: list[float] = []
    above = -np.inf  # targets up to and with this one are settled
    runs = 0

    while min(gain[source], gain[sink]) > above:
        # the distance for targets that are a little higher
        to_go, graph, width = _distances_to_go(gain_db, above, sink, motion)
        runs += 1
        if np.isinf(to_go[source]):
            break

        # It stays the same as long as one of all the shortest paths is feasible: up to the
        # bottleneck of the widest of them.
        above = _bottleneck(_shortest_paths(graph, to_go, width), gain, source, sink)
        targets_db.append(above)
        distances.append(true_length(to_go[source], gain.size) * cell_size)

    return TradeOff(np.array(targets_db), np.array(distances), runs)


# --- all shortest paths ---------------------------------------------------------------------------


def _distances_to_go(
    gain_db: NDArray[np.float64], above: float, sink: int, motion: Motion
) -> tuple[NDArray[np.float64], csr_array, NDArray[np.float64]]:
    """Over cells above a gain: whole lengths of the shortest paths to the goal, shape ``(X * Y,)``,
    the graph of all moves, and the highest target that allows each, ``(moves,)``.
    """
    rows, cells, moves = edges(gain_db > above, **motion)
    lengths = np.where(MOVE_LENGTHS == 1, *whole_lengths(gain_db.size)).astype(np.float64)
    graph = csr_array((lengths[moves], cells, rows), shape=(gain_db.size, gain_db.size))

    return dijkstra(graph, indices=sink), graph, widths(gain_db, rows, moves, **motion)


# --- the widest of all shortest paths -------------------------------------------------------------


def _shortest_paths(
    graph: csr_array, to_go: NDArray[np.float64], width: NDArray[np.float64]
) -> Moves:
    """The moves that lie on a shortest path to the goal, of all those of the graph."""
    first = np.repeat(np.arange(len(to_go)), np.diff(graph.indptr))  # (moves,)

    # A move is on one if it takes off the way to go exactly its own length: whole numbers, so that
    # the comparison is exact.
    with np.errstate(invalid="ignore"):  # inf - inf where the goal cannot be reached
        is_shortest = to_go[first] - to_go[graph.indices] == graph.data

    return Moves(first[is_shortest], graph.indices[is_shortest], width[is_shortest])


def _bottleneck(moves: Moves, gain: NDArray[np.float64], source: int, sink: int) -> float:
    """The highest gain that some path along ``moves`` keeps from source to sink."""

    def reached(target_db: float) -> Integers:
        kept = moves.width >= target_db
        graph = csr_array(
            (kept[kept], (moves.first[kept], moves.second[kept])), shape=(gain.size,) * 2
        )
        return np.asarray(breadth_first_order(graph, source, return_predecessors=False))

    # The bottleneck is the width of some move on the way, and neither end has a lower gain.
    is_near = np.zeros(gain.size, dtype=bool)
    is_near[reached(-np.inf)] = True
    ends = min(gain[source], gain[sink])
    values = np.unique(np.append(moves.width[is_near[moves.first]], ends))  # rising
    values = values[values <= ends]

    # Bisection: the goal is reached up to some gain, and at none above.
    lost = bisect_left(values, True, key=lambda target_db: sink not in reached(target_db))

    return float(values[lost - 1])
