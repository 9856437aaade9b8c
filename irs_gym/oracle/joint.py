"""The joint oracle: exact optima of path and configurations together, by Dijkstra's algorithm over
(configuration, cell).
"""

from bisect import bisect_left
from dataclasses import dataclass
from math import floor, isnan
from numbers import Real
from operator import index
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra

from irs_gym.grid import (
    LARGEST,
    MOVE_LENGTHS,
    MOVES,
    Cell,
    Motion,
    as_cell,
    cells_at,
    checked_cell_size,
    checked_motion,
    flat_cells,
    legal_moves,
    lowest_ahead,
)
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.shortest_path import Integers, flat_cell, for_radius, path_length

_PAIR_BYTES = 500  # for each feasible pair of a configuration and a cell, at the most
_MAP_BYTES = 30  # for any pair
_FIRST_LIMIT = 1.1  # times the shortest way: where the first search looks
_SWITCH = len(MOVES)  # the link after those of the moves: to the hub of the cell, or from it


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path over the grid, and the configuration that the panel holds all along it.

    Attributes
    ----------
    distance
        Its cost in metres: its length, and the cost of each switch.
    switches
        How often the panel goes over to another configuration.
    cells
        int64, shape ``(D, 2)``: its cells (i, j) from start to goal. Where the panel switches, in
        place, the cell stands twice in a row.
    configurations
        int64, shape ``(D,)``: the configuration at each of them, before and after a switch.

    Examples
    --------
    >>> path = JointPath(1.5, 1, np.array([[0, 0], [1, 0], [1, 0], [2, 0]]), np.array([3, 3, 7, 7]))
    >>> path.switch_cells.tolist()
    [[1, 0]]
    """

    distance: float
    switches: int
    cells: NDArray[np.int64]
    configurations: NDArray[np.int64]

    def __post_init__(self) -> None:
        freeze(self.cells, self.configurations)

    @property
    def switch_cells(self) -> NDArray[np.int64]:
        """Where the panel switches, shape ``(switches, 2)``."""
        is_switch: NDArray[np.bool_] = np.diff(self.configurations) != 0  # (D - 1,)
        return self.cells[1:][is_switch]


def joint_shortest_path(
    gain_db: NDArray[np.float64],
    target_db: float,
    start: Cell,
    goal: Cell,
    cell_size: float,
    switch_cost: float = 0.0,
    first: int | None = None,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> JointPath:
    """The best path and configurations together: least metres plus ``switch_cost`` metres a switch.

    The robot moves between cells that meet the target under the present configuration. A switch
    happens in place, into any configuration that meets the target there. Of equally good ones, a
    path of fewest switches.

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
    switch_cost
        Metres that a switch costs: robot speed x reconfiguration time.
    first
        The configuration at the start. None: the one of the highest gain there, the first of equal
        ones.
    corner_cutting, robot_radius, passable
        As in `irs_gym.shortest_path`, under the present configuration; the radius keeps the robot
        away from obstacles, where no configuration has a gain.

    Raises
    ------
    ValueError
        Where there is no such path (the message names the highest target at which there is one),
        or an argument is out of its range.

    Examples
    --------
    >>> gain_db = np.array([[[-60.0], [-60.0], [-70.0]], [[-65.0], [-60.0], [-60.0]]])  # K = 2
    >>> path = joint_shortest_path(gain_db, -62.0, (0, 0), (2, 0), cell_size=0.5, switch_cost=0.3)
    >>> path.distance, path.switches, path.configurations.tolist()
    (1.3, 1, [0, 0, 1, 1])
    """
    gain_db = checked_gains(gain_db)
    target_db = checked_target(target_db)
    cell_size = checked_cell_size(cell_size)
    switch_cost = checked_switch_cost(switch_cost)
    motion = checked_motion(corner_cutting, passable, gain_db.shape[1:])
    gain_db = for_radius(gain_db, robot_radius, cell_size)
    source = checked_end(gain_db, start, "start")
    sink = checked_end(gain_db, goal, "goal")
    gains_here = gain_db.reshape(len(gain_db), -1)[:, source]  # (K,)
    first = int(np.argmax(gains_here)) if first is None else _checked_first(first, len(gain_db))

    pairs = feasible_pairs(gain_db, target_db)
    weights = _weights(pairs.shape, switch_cost / cell_size)
    straight, diagonal, half_switch = weights
    # of the shortest way through each cell, switches uncounted
    through = least_to_go(pairs, straight, diagonal, source, **motion)
    through = through + least_to_go(pairs, straight, diagonal, sink, **motion)  # (X * Y,)

    if not (pairs[first, *divmod(source, pairs.shape[2])] and np.isfinite(through[source])):
        raise ValueError(joint_infeasible(gain_db, start, goal, target_db, first, **motion))

    if not corner_cutting:  # a diagonal asks for cells beside it, whether they are kept or not
        motion = {"passable": legal_moves(pairs, **motion)}  # (K, X, Y, 8)

    # Most searches end within a little more than the shortest way, and then leave out all cells
    # farther off. What they find is the best if it is no longer than that.
    limit = through[source] * _FIRST_LIMIT + 2 * half_switch
    while True:
        kept = pairs & (through <= limit).reshape(pairs.shape[1:])
        states, length = _search(kept, weights, first, source, sink, **motion)
        if length <= limit:
            return path_of_pairs(states, pairs.shape, cell_size, switch_cost)
        limit = length


def _search(
    pairs: NDArray[np.bool_],
    weights: tuple[float, float, float],
    first: int,
    source: int,
    sink: int,
    **motion: Unpack[Motion],
) -> tuple[Integers, float]:
    """The pairs on the best way from the source under the first configuration to the sink, and its
    length: +inf where there is none.
    """
    graph = pairs_graph(pairs, *weights, **motion)
    ends = graph.pair_of[:, sink]

    # For each pair the next one on the way to the goal: weights are the same both ways.
    to_go, after, _ = dijkstra(
        graph.weights, indices=ends[ends >= 0], min_only=True, return_predecessors=True
    )
    nodes = [int(graph.pair_of[first, source])]
    length = float(to_go[nodes[0]])
    while after[nodes[-1]] >= 0:
        nodes.append(int(after[nodes[-1]]))

    return graph.states_at(np.array(nodes)), length


def joint_distance_to_go(
    gain_db: NDArray[np.float64],
    target_db: float,
    goal: Cell,
    cell_size: float,
    switch_cost: float = 0.0,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """What is left to the goal from every cell under every configuration, at the best: metres plus
    ``switch_cost`` metres a switch.

    The arguments are those of `joint_shortest_path`. Returns shape ``(K, X, Y)``; +inf where the
    goal cannot be reached, or the configuration is below the target in the cell.

    Examples
    --------
    >>> gain_db = np.array([[[-60.0], [-60.0], [-70.0]], [[-65.0], [-60.0], [-60.0]]])  # K = 2
    >>> to_go = joint_distance_to_go(gain_db, -62.0, (2, 0), cell_size=0.5, switch_cost=0.3)
    >>> to_go.round(9).tolist()
    [[[1.3], [0.8], [inf]], [[inf], [0.5], [0.0]]]
    """
    gain_db = checked_gains(gain_db)
    target_db = checked_target(target_db)
    cell_size = checked_cell_size(cell_size)
    switch_cost = checked_switch_cost(switch_cost)
    motion = checked_motion(corner_cutting, passable, gain_db.shape[1:])
    gain_db = for_radius(gain_db, robot_radius, cell_size)
    sink = checked_end(gain_db, goal, "goal")

    pairs = feasible_pairs(gain_db, target_db)
    straight, diagonal, half_switch = _weights(pairs.shape, switch_cost / cell_size)
    graph = pairs_graph(pairs, straight, diagonal, half_switch, **motion)
    to_go = np.full(pairs.shape, np.inf)
    ends = graph.pair_of[:, sink]
    ends = ends[ends >= 0]
    if not len(ends):
        return to_go

    distance = dijkstra(graph.weights, indices=ends, min_only=True)[: len(graph.states)]
    to_go.flat[graph.states] = distance / straight * cell_size

    return to_go


def highest_joint_target(
    gain_db: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    *,
    cell_size: float | None = None,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    passable: NDArray[np.bool_] | None = None,
) -> float:
    """The highest target in dB at which some path leads from start to goal, whatever it costs and
    whatever the first configuration, exactly; -inf where none does at any.

    A move can be made under the configuration that has the highest gain on the lower of its two
    cells (without corner cutting, on the lowest of a diagonal's four), as the panel may switch
    before and after it: that gain is the move's width, and the target the bottleneck of the widest
    path.

    Parameters
    ----------
    gain_db
        Shape ``(K, X, Y)``; -inf in obstacles.
    cell_size
        Edge of a cell in metres, which a ``robot_radius`` needs.
    corner_cutting, robot_radius, passable
        As in `irs_gym.shortest_path`, under the present configuration; the radius keeps the robot
        away from obstacles, where no configuration has a gain.

    Examples
    --------
    >>> gain_db = np.array([[[-60.0], [-61.0], [-70.0]], [[-65.0], [-60.0], [-63.0]]])  # K = 2
    >>> highest_joint_target(gain_db, (0, 0), (2, 0))
    -63.0
    """
    gain_db = checked_gains(gain_db)
    motion = checked_motion(corner_cutting, passable, gain_db.shape[1:])
    gain_db = for_radius(gain_db, robot_radius, cell_size)
    source = checked_end(gain_db, start, "start")
    sink = checked_end(gain_db, goal, "goal")
    best = gain_db.max(axis=0).ravel()  # (X * Y,)
    if source == sink:
        return float(best[source])

    width = np.full((*gain_db.shape[1:], len(MOVES)), -np.inf)  # (X, Y, 8)
    for gains in gain_db:
        ahead = lowest_ahead(gains, -np.inf, corner_cutting)
        np.maximum(width, np.minimum(gains[..., None], ahead), out=width)
    if motion["passable"] is not None:
        width[~motion["passable"]] = -np.inf

    moves = np.flatnonzero(np.isfinite(width))
    width = width.ravel()[moves]  # (moves,)
    cells, move = np.divmod(moves, len(MOVES))
    second = cells + flat_cells(MOVES, gain_db.shape[1:])[move]

    def reaches(target_db: float) -> bool:
        kept = width >= target_db
        graph = csr_array((kept[kept], (cells[kept], second[kept])), shape=(len(best),) * 2)
        return sink in breadth_first_order(graph, source, return_predecessors=False)

    # Bisection: the goal is reached up to some width, and at none above.
    widths = np.unique(width)  # rising
    lost = bisect_left(widths, True, key=lambda target_db: not reaches(target_db))

    return float(widths[lost - 1]) if lost else -np.inf


def joint_infeasible(
    gain_db: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    target_db: float,
    first: int | None = None,
    **motion: Unpack[Motion],
) -> str:
    """What to say of a target at which no joint path leads from start to goal: it names the highest
    at which one does.
    """
    highest = highest_joint_target(gain_db, start, goal, **motion)
    asked = ""
    if first is not None:
        highest = min(highest, float(gain_db[first, start[0], start[1]]))
        asked = f" from configuration {first}"

    # rounded down, so that the number is feasible when typed in
    advice = (
        "no target is"
        if highest == -np.inf
        else f"the highest joint target is {floor(highest * 1e4) / 1e4} dB"
    )
    return (
        f"target_db={target_db} is infeasible from {tuple(start)} to {tuple(goal)} with the "
        f"{len(gain_db)} configurations{asked}: {advice}"
    )


# --- the graph of configurations and cells --------------------------------------------------------


class Graph(NamedTuple):
    """Feasible pairs of a configuration and a cell as nodes, and after them a hub for each cell
    where the panel can switch.
    """

    weights: csr_array  # (nodes, nodes), symmetric
    states: Integers  # (pairs,): which of the K * X * Y pairs each node is
    pair_of: Integers  # (K, X * Y): the node of each pair, -1 where it is infeasible

    def states_at(self, nodes: Integers) -> Integers:
        """The pairs among some nodes, hubs left out."""
        return self.states[nodes[nodes < len(self.states)]]


def feasible_pairs(gain_db: NDArray[np.float64], target_db: float) -> NDArray[np.bool_]:
    """Where each configuration meets the target, shape ``(K, X, Y)``, when there is memory for a
    search in it.
    """
    pairs: NDArray[np.bool_] = np.isfinite(gain_db) & (gain_db >= target_db)
    count = int(np.count_nonzero(pairs))
    check_memory(
        f"gain_db: a search over {count:,} pairs of a configuration and a cell",
        _PAIR_BYTES * count + _MAP_BYTES * pairs.size,
    )
    return pairs


def pairs_graph(
    pairs: NDArray[np.bool_],
    straight: float,
    diagonal: float,
    half_switch: float | None = None,
    **motion: Unpack[Motion],
) -> Graph:
    """Graph of all moves, of those weights, and of all switches: over the hub of the cell, so that
    they take 2 K links and not K squared. No switches where their weight is None.
    """
    configurations = len(pairs)
    flat = pairs.reshape(configurations, -1)  # (K, X * Y)
    states = np.flatnonzero(flat)
    pair_of = np.full(flat.shape, -1, dtype=np.int32)
    pair_of.flat[states] = np.arange(len(states), dtype=np.int32)

    # hubs where two configurations or more meet the target
    can_switch = np.zeros(flat.shape[1], dtype=bool)
    if half_switch is not None:
        can_switch = np.count_nonzero(flat, axis=0) > 1
    hubs = np.flatnonzero(can_switch)
    hub_of = np.full(flat.shape[1], -1, dtype=np.int32)
    hub_of[hubs] = len(states) + np.arange(len(hubs), dtype=np.int32)

    # each pair's links: its legal moves, then its hub, and where they lead
    links = np.empty((len(states), _SWITCH + 1), dtype=bool)
    links[:, :_SWITCH] = legal_moves(pairs, **motion)[pairs]
    links[:, _SWITCH] = np.tile(can_switch, configurations)[states]
    second = np.empty(links.shape, dtype=np.int32)
    for move, step in enumerate(flat_cells(MOVES, pairs.shape[1:])):
        # off the map, where no link is, any cell will do
        second[:, move] = pair_of.take(states + step, mode="clip")
    second[:, _SWITCH] = np.tile(hub_of, configurations)[states]
    length = np.where(MOVE_LENGTHS == 1, straight, diagonal)  # (8,)
    weights = np.broadcast_to(np.append(length, half_switch or 0), links.shape)  # (pairs, 9)

    # and each hub's: all pairs of its cell
    at_hubs = flat[:, hubs].T  # (hubs, K)
    back = pair_of[:, hubs].T[at_hubs]

    # the links there are, as compressed sparse rows
    counts = np.append(np.count_nonzero(links, axis=1), np.count_nonzero(at_hubs, axis=1))
    index_type = np.int32 if counts.sum() < 2**31 else np.int64
    rows = np.append(0, np.cumsum(counts)).astype(index_type)
    columns = np.append(second[links], back).astype(index_type, copy=False)
    weights = np.append(weights[links], np.full(len(back), half_switch or 0))

    graph = csr_array((weights, columns, rows), shape=(len(rows) - 1,) * 2)
    return Graph(graph, states, pair_of)


def least_to_go(
    pairs: NDArray[np.bool_],
    straight: float,
    diagonal: float,
    sink: int,
    **motion: Unpack[Motion],
) -> NDArray[np.float64]:
    """Lengths of the shortest ways to a cell with as many switches as it takes, shape ``(X * Y,)``:
    over every move that some configuration allows.
    """
    allowed = (legal_moves(pairs, **motion) & pairs[..., None]).any(axis=0)  # (X, Y, 8)
    first, move = np.divmod(np.flatnonzero(allowed), len(MOVES))
    second = first + flat_cells(MOVES, pairs.shape[1:])[move]
    weights = np.where(MOVE_LENGTHS == 1, straight, diagonal)[move]
    graph = csr_array((weights, (first, second)), shape=(pairs[0].size,) * 2)

    return np.asarray(dijkstra(graph, indices=sink))


def _weights(shape: tuple[int, ...], switch_cells: float) -> tuple[float, float, float]:
    """Whole numbers that stand for the lengths 1 and sqrt(2) of the moves and for half a switch, of
    ``switch_cells`` cells.

    In units of 1/q of a cell, for p/q a convergent of sqrt(2), which is nearer to it than 1/q**2:
    sums of whole numbers are exact in float64 up to 2**53, so that equally long ways are equal here
    too. q is the largest for which a path as long as sixteen times both sides of the map stays
    below that. Half a switch costs one unit more than its share: of equal ways, that of fewest
    switches is the shortest. That adds less than 1e-9 of a cell on maps of a million cells.
    """
    most = 2.0**53 / (16 * (shape[1] + shape[2]))
    q = 1
    p = 1

    # p/q = 1/1, 3/2, 7/5, 17/12 ...
    while q + p <= most:
        q, p = q + p, 2 * q + p

    return float(q), float(p), round(switch_cells * q / 2) + 1.0


def path_of_pairs(
    states: Integers, shape: tuple[int, ...], cell_size: float, switch_cost: float
) -> JointPath:
    """The path through some of the K * X * Y pairs, its distance counted exactly: (a + b sqrt(2))
    cell_size + switches switch_cost.
    """
    configurations, flat = np.divmod(states.astype(np.int64), shape[1] * shape[2])
    cells = cells_at(flat, (shape[1], shape[2]))
    switches = int(np.count_nonzero(np.diff(configurations)))
    distance = path_length(cells, cell_size) + switches * switch_cost

    return JointPath(distance, switches, cells, configurations)


# --- arguments ------------------------------------------------------------------------------------


def checked_gains(gain_db: Any) -> NDArray[np.float64]:
    """Gains ``(K, X, Y)`` in dB; a ``ValueError`` says what is wrong with them."""
    try:
        gains = np.asarray(gain_db)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"gain_db is no array: {error}") from None

    if gains.dtype.kind not in "iuf":
        raise ValueError(f"gain_db holds values of the type {gains.dtype}, not real numbers of dB")
    if gains.ndim != 3 or not gains.size:
        raise ValueError(
            f"gain_db has the shape {gains.shape}, but gains of one configuration or more have "
            "three axes (K, X, Y)"
        )

    check_memory(
        f"gain_db: work on {gains.shape[0]} maps of {gains.shape[1]} x {gains.shape[2]} cells",
        _MAP_BYTES * gains.size,
    )
    gains = gains.astype(np.float64, copy=False)
    if not np.all(gains < np.inf):
        raise ValueError(
            "gain_db holds NaN or +inf: each cell must be a number of dB, or -inf where blocked"
        )

    return gains


def checked_target(target_db: Any) -> float:
    """A target in dB; a ``ValueError`` where it is no number."""
    is_number = isinstance(target_db, Real) and not isinstance(target_db, bool)
    try:
        if is_number and not isnan(target_db):
            return float(target_db)
    except OverflowError:  # an integer of hundreds of digits
        pass

    raise ValueError(f"target_db={target_db!r} must be a number of dB")


def checked_switch_cost(switch_cost: Any) -> float:
    """Metres of a switch; a ``ValueError`` where they are no number from 0 on."""
    is_number = isinstance(switch_cost, Real) and not isinstance(switch_cost, bool)
    if not is_number or not 0 <= switch_cost <= LARGEST:
        raise ValueError(
            f"switch_cost={switch_cost!r} must be a number of metres from 0 to {LARGEST}"
        )
    return float(switch_cost)


def checked_end(gain_db: NDArray[np.float64], cell: Any, name: str) -> int:
    """Flat cell of an end of the path; a ``ValueError`` names it where it is no cell of the map."""
    return flat_cell(gain_db[0], as_cell(cell, name), name)


def _checked_first(first: Any, configurations: int) -> int:
    try:
        if not isinstance(first, bool | np.bool_) and 0 <= index(first) < configurations:
            return index(first)
    except TypeError:
        pass

    raise ValueError(
        f"first={first!r} must be the number of one of {configurations} configurations, from 0"
    )
