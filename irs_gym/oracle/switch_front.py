"""`switch_front`: the shortest path over the number of switches, every point of it exact."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from irs_gym.grid import Cell, checked_cell_size
from irs_gym.memory import freeze
from irs_gym.oracle.joint import (
    Graph,
    JointPath,
    checked_end,
    checked_gains,
    checked_target,
    feasible_pairs,
    joint_infeasible,
    least_to_go,
    pairs_graph,
    path_of_pairs,
)
from irs_gym.oracle.shortest_path import Integers
from irs_gym.oracle.whole_lengths import whole_lengths


@dataclass(frozen=True, eq=False)
class SwitchFront:
    """Least metres over the number of switches: a step function, falling with the switches.

    Attributes
    ----------
    switches
        int64, shape ``(P,)``, rising: the numbers of switches that make the path shorter. The first
        is the fewest with which the goal can be reached.
    distances
        float64, shape ``(P,)``, falling, in metres: the shortest path with so many switches, which
        cost nothing here. The last is the shortest with any number.
    paths
        P paths, one for each point.

    Examples
    --------
    >>> front = SwitchFront(np.array([0, 2]), np.array([3.0, 2.5]), paths=())
    >>> front.distance_with(1), front.distance_with(5)
    (3.0, 2.5)
    """

    switches: NDArray[np.int64]
    distances: NDArray[np.float64]
    paths: tuple[JointPath, ...]

    def __post_init__(self) -> None:
        freeze(self.switches, self.distances)

    def distance_with(self, switches: int) -> float:
        """Least metres with at most so many switches; +inf where the goal takes more."""
        step = int(np.searchsorted(self.switches, switches, side="right"))
        return float(self.distances[step - 1]) if step else np.inf


def switch_front(
    gain_db: NDArray[np.float64], target_db: float, start: Cell, goal: Cell, cell_size: float
) -> SwitchFront:
    """Every point of (switches, metres): the shortest path with 0, 1, 2 ... switches, as long as
    one more makes it shorter. The first configuration is free.

    Layer after layer: from the best way to each cell with s switches, under whichever
    configuration, Dijkstra's algorithm finds the ways with s + 1. Pairs of a configuration and a
    cell that a layer does not improve, or from which even the shortest way under all configurations
    together is too long, are left out. Lengths are whole numbers, see
    `irs_gym.oracle.whole_lengths.whole_lengths`, so that comparisons are exact.

    Parameters
    ----------
    gain_db
        Gains of K configurations in dB, shape ``(K, X, Y)``; -inf in obstacles.
    target_db
        The lowest gain that the robot may have.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.

    Raises
    ------
    ValueError
        Where there is no path with any number of switches (the message names the highest target at
        which there is one), or an argument is out of its range.

    Examples
    --------
    >>> gain_db = np.full((3, 5, 2), -70.0)  # K = 3
    >>> gain_db[0, :3, 0] = gain_db[1, 2:, 0] = -60.0  # two that share the straight way
    >>> gain_db[2, [0, 1, 2, 3, 4], [0, 1, 1, 1, 0]] = -60.0  # and one for a way around
    >>> front = switch_front(gain_db, -62.0, (0, 0), (4, 0), cell_size=1.0)
    >>> front.switches.tolist(), front.distances.round(3).tolist()
    ([0, 1], [4.828, 4.0])
    """
    gain_db = checked_gains(gain_db)
    target_db = checked_target(target_db)
    cell_size = checked_cell_size(cell_size)
    source = checked_end(gain_db, start, "start")
    sink = checked_end(gain_db, goal, "goal")

    pairs = feasible_pairs(gain_db, target_db)
    lengths = whole_lengths(int(np.count_nonzero(pairs)))
    graph = pairs_graph(pairs, *lengths)
    to_go = least_to_go(pairs, *lengths, sink)  # (X * Y,)

    layers: list[NDArray[np.float64]] = []  # each (K, X * Y): least length to every pair
    points: list[JointPath] = []
    shortest = np.inf
    begin = np.where(np.arange(pairs[0].size) == source, 0.0, np.inf)  # (X * Y,), of length 0

    while True:
        # Pairs that a switch improves, and that a shorter way to the goal may lead through.
        best = layers[-1] if layers else np.full(graph.pair_of.shape, np.inf)
        is_seed = (graph.pair_of >= 0) & (begin < best) & (begin + to_go < shortest)
        if not is_seed.any():
            break

        layers.append(np.minimum(best, _spread(graph, is_seed, begin, shortest)))
        begin = layers[-1].min(axis=0)
        if begin[sink] < shortest:
            shortest = begin[sink]
            states = _walk_back(graph, layers, sink)
            points.append(path_of_pairs(states, pairs.shape, cell_size, 0.0))

    if not points:
        raise ValueError(joint_infeasible(gain_db, start, goal, target_db))

    return SwitchFront(
        np.array([path.switches for path in points], dtype=np.int64),
        np.array([path.distance for path in points]),
        tuple(points),
    )


def _spread(
    graph: Graph, is_seed: NDArray[np.bool_], begin: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """Least lengths, up to the limit, of ways without a switch from the seeds, which begin at the
    lengths ``(X * Y,)`` of their cells; shape ``(K, X * Y)``.
    """
    weights = graph.weights
    nodes = len(graph.states)
    seeds = graph.pair_of[is_seed]
    offsets = np.broadcast_to(begin, is_seed.shape)[is_seed]

    # A source of its own, after all nodes, leads to the seeds. SciPy may take a weight of 0 for no
    # edge, hence the 1.
    rows = np.append(weights.indptr, weights.indptr[-1] + len(seeds))
    extended = csr_array(
        (np.append(weights.data, offsets + 1), np.append(weights.indices, seeds), rows),
        shape=(nodes + 1, nodes + 1),
    )
    length = np.full(is_seed.shape, np.inf)
    length.flat[graph.states] = dijkstra(extended, indices=nodes, limit=limit + 1)[:nodes] - 1

    return length


def _walk_back(graph: Graph, layers: list[NDArray[np.float64]], sink: int) -> Integers:
    """The pairs ``(D,)`` of K * X * Y on a shortest way to the sink with the fewest switches, read
    off the layers from its end: whole numbers, so that lengths are compared exactly.
    """
    cells = graph.pair_of.shape[1]
    weights = graph.weights
    layer = len(layers) - 1
    state = int(np.argmin(layers[layer][:, sink])) * cells + sink
    way = [state]

    while True:
        length = layers[layer].flat[state]
        if layer and layers[layer - 1].flat[state] == length:  # it takes no switch more
            layer -= 1
            continue

        node = graph.pair_of.flat[state]
        links = slice(weights.indptr[node], weights.indptr[node + 1])
        near = graph.states[weights.indices[links]]
        is_before = layers[layer].flat[near] + weights.data[links] == length
        if is_before.any():
            state = int(near[np.argmax(is_before)])
        elif layer:
            layer -= 1
            state = int(np.argmin(layers[layer][:, state % cells])) * cells + state % cells
        else:
            return np.array(way[::-1])

        way.append(state)
