"""Facts of robots that cut no corners, or have a radius: equal to networkx and to brute force."""

from itertools import pairwise, product
from math import hypot, inf, sqrt

import networkx as nx
import numpy as np
import pytest

from irs_gym import (
    budget_to_go,
    distance_to_go,
    highest_feasible_target,
    highest_joint_target,
    joint_distance_to_go,
    joint_shortest_path,
    pareto_front,
    shortest_path,
    straight_line_bound,
    switch_front,
    trade_off,
)
from irs_gym.grid import MOVES, legal_moves, with_clearance
from irs_gym.oracle.shortest_path import descend, optimal_moves

SHAPES = [(1, 1), (1, 7), (2, 2), (3, 5), (6, 6), (9, 4), (10, 12)]


def graph_of(feasible, cell_size=1.0):
    """Moves along the axes, and diagonals whose two cells beside them are feasible as well."""
    graph = nx.Graph()
    cells = {tuple(cell) for cell in np.argwhere(feasible).tolist()}
    graph.add_nodes_from(cells)
    for i, j in cells:
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if {(i + di, j + dj), (i + di, j), (i, j + dj)} <= cells:
                graph.add_edge((i, j), (i + di, j + dj), weight=hypot(di, dj) * cell_size)
    return graph


def random_maps(count):
    rng = np.random.default_rng(7)
    for n in range(count):
        shape = SHAPES[n % len(SHAPES)]
        feasible = rng.random(shape) < rng.uniform(0.4, 1.0)
        start, goal = (tuple(int(k) for k in rng.integers(shape)) for _ in range(2))
        yield feasible, start, goal, float(rng.choice([0.1, 0.5, 3.7]))


def length_of(graph, start, goal):
    if start not in graph or goal not in graph or not nx.has_path(graph, start, goal):
        return inf
    return nx.dijkstra_path_length(graph, start, goal)


# --- corners --------------------------------------------------------------------------------------


def test_a_diagonal_needs_both_cells_beside_it():
    feasible = np.array([[True, False], [True, True]])
    assert shortest_path(feasible, (0, 0), (1, 1), 1.0).distance == sqrt(2)
    path = shortest_path(feasible, (0, 0), (1, 1), 1.0, corner_cutting=False)
    assert path.cells.tolist() == [[0, 0], [1, 0], [1, 1]]
    feasible[1, 0] = False
    assert shortest_path(feasible, (0, 0), (1, 1), 1.0).distance == sqrt(2)
    assert shortest_path(feasible, (0, 0), (1, 1), 1.0, corner_cutting=False) is None


def test_paths_and_distances_without_corner_cutting_equal_networkx():
    reached = 0
    for feasible, start, goal, cell_size in random_maps(200):
        graph = graph_of(feasible, cell_size)
        expected = length_of(graph, start, goal)
        path = shortest_path(feasible, start, goal, cell_size, corner_cutting=False)
        to_go = distance_to_go(feasible, goal, cell_size, corner_cutting=False)
        assert to_go[start] == pytest.approx(expected, abs=1e-9)
        assert (path is None) == (expected == inf)
        if path is not None:
            assert path.distance == pytest.approx(expected, abs=1e-9)
            walked = [tuple(cell) for cell in path.cells.tolist()]
            assert all(graph.has_edge(*move) for move in pairwise(walked))
            legal = legal_moves(feasible, corner_cutting=False)
            assert descend(to_go, start, cell_size, legal).distance == pytest.approx(expected)
            reached += 1
    assert reached > 60


def test_optimal_moves_without_corner_cutting_are_those_that_begin_a_shortest_path():
    for feasible, _, goal, _ in random_maps(60):
        graph = graph_of(feasible)
        to_go = distance_to_go(feasible, goal, 1.0, corner_cutting=False)
        legal = legal_moves(feasible, corner_cutting=False)
        found = optimal_moves(to_go[None], 1.0, legal[None])[0]
        for cell in np.ndindex(feasible.shape):
            for n, move in enumerate(MOVES.tolist()):
                ahead = (cell[0] + move[0], cell[1] + move[1])
                is_move = graph.has_edge(cell, ahead) and np.isfinite(to_go[cell])
                wanted = is_move and abs(hypot(*move) + to_go[ahead] - to_go[cell]) < 1e-6
                assert found[n][cell] == (wanted and to_go[cell] > 0)


@pytest.mark.parametrize("seed", range(25))
def test_bottleneck_and_trade_off_without_corner_cutting_equal_brute_force_over_every_gain(seed):
    rng = np.random.default_rng(seed)
    gain_db = rng.integers(-90, -65, (8, 7)) / 3
    gain_db[rng.random(gain_db.shape) < 0.15] = -inf
    start = (0, seed % 7)
    goal = (7, 6 - seed % 7)
    levels = np.unique(gain_db[np.isfinite(gain_db)])
    expected = np.array(
        [0.5 * length_of(graph_of(gain_db >= level), start, goal) for level in levels]
    )

    curve = trade_off(gain_db, start, goal, 0.5, corner_cutting=False)
    np.testing.assert_allclose(curve.distance_at(levels), expected, rtol=0, atol=1e-9)
    highest = highest_feasible_target(gain_db, start, goal, corner_cutting=False)
    assert highest == max(levels[np.isfinite(expected)], default=-inf)
    assert np.isin(curve.targets_db, gain_db).all()


def test_a_straight_line_does_not_pass_where_cells_touch_at_a_corner():
    feasible = np.array([[True, False, True], [False, True, True], [True, True, True]])
    assert straight_line_bound(feasible, (0, 0), (2, 2), 1.0) == pytest.approx(2 * sqrt(2))
    assert straight_line_bound(feasible, (0, 0), (2, 2), 1.0, corner_cutting=False) == inf


def test_no_straight_line_bound_is_beyond_the_path_or_below_the_one_that_passes_more():
    longer = 0
    for feasible, start, goal, cell_size in random_maps(150):
        path = shortest_path(feasible, start, goal, cell_size, corner_cutting=False)
        bound = straight_line_bound(feasible, start, goal, cell_size, corner_cutting=False)
        freer = straight_line_bound(feasible, start, goal, cell_size)
        assert freer <= bound * (1 + 1e-9)
        assert bound <= (inf if path is None else path.distance)
        longer += freer < bound - 1e-6 < inf
    assert longer


def test_a_straight_line_around_a_touch_is_as_long_as_one_on_a_map_whose_touches_are_closed():
    """A touch is closed for good by a wall: each cell cut into 5 x 5, those around it blocked."""
    compared = 0
    for feasible, start, goal, _ in random_maps(60):
        bound = straight_line_bound(feasible, start, goal, 1.0, corner_cutting=False)
        if not 0 < bound < inf:
            continue
        fine = np.kron(feasible, np.ones((25, 25), dtype=bool))
        for i, j in product(range(1, feasible.shape[0]), range(1, feasible.shape[1])):
            around = feasible[i - 1 : i + 1, j - 1 : j + 1]
            if around.sum() == 2 and around[0, 0] == around[1, 1]:
                fine[25 * i - 1 : 25 * i + 1, 25 * j - 1 : 25 * j + 1] = False
        ends = [tuple(25 * k + 12 for k in cell) for cell in (start, goal)]
        closed = straight_line_bound(fine, *ends, 1 / 25)
        assert bound <= closed * (1 + 1e-9)
        assert closed == pytest.approx(bound, abs=0.4)
        compared += 1
        if compared == 12:
            break
    assert compared == 12


# --- radius ---------------------------------------------------------------------------------------


def clearance(free, cell_size):
    """Metres from each centre to the nearest closed square that is not free, the border's
    included.
    """
    blocked = np.argwhere(~np.pad(free, 1)) - 1
    metres = np.empty(free.shape)
    for cell in np.ndindex(free.shape):
        apart = np.maximum(np.abs(blocked - cell) - 0.5, 0.0)
        metres[cell] = np.hypot(*apart.T).min() * cell_size
    return metres


def test_a_robot_keeps_its_radius_from_squares_and_walls():
    for free, *_, cell_size in random_maps(60):
        metres = clearance(free, cell_size)
        for radius in (0.1, 0.5, 0.75, 1.2, 2.6):
            expected = free & (metres >= radius * cell_size - 1e-9)
            assert (with_clearance(free, radius * cell_size, cell_size) == expected).all()


def test_all_functions_take_a_radius_as_a_map_with_fewer_cells():
    rng = np.random.default_rng(4)
    gain_db = rng.normal(-60.0, 3.0, (14, 12))
    gain_db[4:6, 3:8] = -inf
    for radius in (0.3, 0.6):
        is_clear = with_clearance(np.isfinite(gain_db), radius, 0.5)
        fewer = np.where(is_clear, gain_db, -inf)
        ends = ((2, 2), (10, 9))
        options = {"robot_radius": radius, "corner_cutting": False}
        other = {"corner_cutting": False}
        assert (
            trade_off(gain_db, *ends, 0.5, **options).distances
            == trade_off(fewer, *ends, 0.5, **other).distances
        ).all()
        assert highest_feasible_target(
            gain_db, *ends, cell_size=0.5, **options
        ) == highest_feasible_target(fewer, *ends, **other)
        free = np.isfinite(gain_db)
        for work in (shortest_path, straight_line_bound):
            mine, same = work(free, *ends, 0.5, **options), work(is_clear, *ends, 0.5, **other)
            assert getattr(mine, "distance", mine) == getattr(same, "distance", same)
        mine = distance_to_go(free, ends[1], 0.5, **options)
        assert (mine == distance_to_go(is_clear, ends[1], 0.5, **other)).all()


# --- a body's moves, and refusals -----------------------------------------------------------------


def test_moves_that_a_body_cannot_make_are_made_by_nobody():
    feasible = np.ones((3, 1), dtype=bool)
    passable = np.ones((3, 1, 8), dtype=bool)
    passable[0, 0, 0] = passable[1, 0, 4] = False  # neither east from the first cell nor back
    assert shortest_path(feasible, (0, 0), (2, 0), 1.0, passable=passable) is None
    assert distance_to_go(feasible, (2, 0), 1.0, passable=passable)[0, 0] == inf
    gain_db = np.where(feasible, -60.0, -inf)
    assert highest_feasible_target(gain_db, (0, 0), (2, 0), passable=passable) == -inf
    assert len(trade_off(gain_db, (0, 0), (2, 0), 1.0, passable=passable).distances) == 0


FLOOR = np.ones((3, 2), dtype=bool)
ONE_WAY = np.ones((3, 2, 8), dtype=bool)
ONE_WAY[0, 0, 0] = False


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"corner_cutting": "no"}, "corner_cutting='no' must be True or False"),
        ({"corner_cutting": 1}, "corner_cutting=1 must be"),
        ({"robot_radius": -0.1}, "robot_radius=-0.1 must be a number of metres from 0"),
        ({"robot_radius": float("nan")}, "robot_radius=nan must be"),
        ({"robot_radius": inf}, "robot_radius=inf must be"),
        ({"robot_radius": True}, "robot_radius=True must be"),
        ({"passable": FLOOR}, r"passable has the shape \(3, 2\).* needed: \(3, 2, 8\)"),
        ({"passable": np.ones((3, 2, 8))}, "the type float64, but a bool"),
        ({"passable": ONE_WAY}, "a move E that cannot be made both there and back"),
    ],
)
def test_bad_motion_is_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        shortest_path(FLOOR, (0, 0), (2, 1), 1.0, **options)
    with pytest.raises(ValueError, match=message):
        trade_off(np.where(FLOOR, -60.0, -inf), (0, 0), (2, 1), 1.0, **options)


def test_a_radius_without_a_cell_size_is_refused():
    with pytest.raises(ValueError, match=r"robot_radius=0.3 needs a cell_size"):
        highest_feasible_target(np.full((3, 3), -60.0), (0, 0), (2, 2), robot_radius=0.3)


# --- fronts and configurations --------------------------------------------------------------------


def paths_by_brute_force(cost, start, goal):
    """The undominated pairs of cost and length over all simple paths."""
    graph = graph_of(np.isfinite(cost))
    found = set()
    for path in nx.all_simple_paths(graph, start, goal):
        length = sum(graph.edges[move]["weight"] for move in pairwise(path))
        found.add((float(sum(cost[cell] for cell in path)), round(length, 9)))
    return sorted(
        (cost, length)
        for cost, length in found
        if not any(c <= cost and d <= length and (c, d) != (cost, length) for c, d in found)
    )


@pytest.mark.parametrize("seed", range(12))
def test_fronts_without_corner_cutting_equal_brute_force(seed):
    rng = np.random.default_rng(seed)
    cost = rng.integers(0, 4, (4, 3)).astype(float)
    cost[rng.random(cost.shape) < 0.2] = inf
    cost[0, 0] = cost[3, 2] = 1.0
    expected = paths_by_brute_force(cost, (0, 0), (3, 2))
    if not expected:
        with pytest.raises(ValueError, match="no path leads"):
            pareto_front(cost, (0, 0), (3, 2), 1.0, corner_cutting=False)
        return

    front = pareto_front(cost, (0, 0), (3, 2), 1.0, corner_cutting=False)
    found = zip(front.costs, front.distances, strict=True)
    np.testing.assert_allclose(list(found), expected, atol=1e-9)
    to_go = budget_to_go(cost, (3, 2), 1.0, most=100, corner_cutting=False)
    for paid, length in expected:
        assert to_go.distance(0, paid - 1.0) == pytest.approx(length)


def joint_graph(gain_db, target_db, switch_cost):
    """Moves under each configuration, and switches in place."""
    graph = nx.Graph()
    for k, gains in enumerate(gain_db):
        for first, second, data in graph_of(gains >= target_db).edges(data=True):
            graph.add_edge((k, first), (k, second), **data)
        graph.add_nodes_from((k, tuple(c)) for c in np.argwhere(gains >= target_db).tolist())
    for k, cell in list(graph):
        for other in range(k):
            if (other, cell) in graph:
                graph.add_edge((k, cell), (other, cell), weight=switch_cost)
    return graph


@pytest.mark.parametrize("seed", range(15))
def test_the_joint_oracle_without_corner_cutting_equals_networkx(seed):
    rng = np.random.default_rng(seed)
    gain_db = rng.integers(-70, -60, (3, 6, 5)).astype(float)
    gain_db[:, rng.random((6, 5)) < 0.15] = -inf
    start, goal = (0, 0), (5, 4)
    options = {"corner_cutting": False}
    levels = np.unique(gain_db[np.isfinite(gain_db)])
    joined = []
    for level in levels:
        graph = joint_graph(gain_db, level, 0.3)
        to_go = joint_distance_to_go(gain_db, level, goal, 1.0, 0.3, **options)
        ends = [(k, goal) for k in range(3) if (k, goal) in graph]
        lengths = nx.multi_source_dijkstra_path_length(graph, ends) if ends else {}
        for k, cell in graph:
            assert to_go[k][cell] == pytest.approx(lengths.get((k, cell), inf), abs=1e-6)
        starts = [k for k in range(3) if (k, start) in lengths]
        if starts:
            joined.append(level)
            path = joint_shortest_path(gain_db, level, start, goal, 1.0, 0.3, starts[0], **options)
            assert path.distance == pytest.approx(lengths[starts[0], start], abs=1e-6)
            front = switch_front(gain_db, level, start, goal, 1.0, **options)
            free = joint_shortest_path(gain_db, level, start, goal, 1.0, 0.0, starts[0], **options)
            assert front.distances[-1] == pytest.approx(free.distance)
    assert highest_joint_target(gain_db, start, goal, **options) == max(joined, default=-inf)


def test_the_joint_oracle_takes_a_radius_as_a_map_with_fewer_cells():
    gain_db = np.full((2, 9, 7), -60.0)
    gain_db[:, 4, :3] = -inf
    ends, options = ((1, 1), (7, 1)), {"robot_radius": 0.6}
    near = joint_shortest_path(gain_db, -65.0, *ends, 1.0)
    far = joint_shortest_path(gain_db, -65.0, *ends, 1.0, **options)
    assert near.distance < far.distance
    fewer = np.where(with_clearance(np.isfinite(gain_db[0]), 0.6, 1.0), gain_db, -inf)
    assert far.distance == joint_shortest_path(fewer, -65.0, *ends, 1.0).distance
    assert far.distance == switch_front(gain_db, -65.0, *ends, 1.0, **options).distances[-1]
    assert highest_joint_target(gain_db, (0, 0), ends[1], cell_size=1.0, **options) == -inf
