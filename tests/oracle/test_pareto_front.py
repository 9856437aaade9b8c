"""Facts of Pareto fronts of cost and distance, against brute force and other packages."""

from decimal import Decimal, localcontext
from fractions import Fraction
from heapq import heappop, heappush
from math import fsum, hypot, sqrt

import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse import coo_array

from irs_gym import build_radio_map, generate_scene, pareto_front, trade_off
from irs_gym.memory import MemoryLimitError

ROOT2 = Decimal("1.41421356237309504880168872420969807856967187537694807317668")
PAPER = ((0, 20), (39, 20), 0.5)


def cost_of(radio_map, target_db, kind):
    """Violations or deficits, spelled out anew."""
    below = np.maximum(target_db - radio_map.gain_db, 0)
    return np.where(radio_map.free, below > 0 if kind == "violation" else below, np.inf)


def random_costs(seed, shape=(8, 8), greatest=4):
    """Whole costs, many of them 0, and obstacles."""
    rng = np.random.default_rng(seed)
    cost = np.maximum(rng.integers(-2, greatest, shape), 0).astype(float)
    cost[rng.random(shape) < 0.2] = np.inf
    cost[0, 0] = cost[-1, -1] = 1
    return cost


def moves_of(cost):
    """All moves (from, to, length) between free cells, spelled out cell by cell."""
    cells = [tuple(cell) for cell in np.argwhere(np.isfinite(cost)).tolist()]
    free = set(cells)
    steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    return [
        (cell, there, hypot(*step))
        for cell in cells
        for step in steps
        if (there := (cell[0] + step[0], cell[1] + step[1])) in free
    ]


def is_front(front):
    """Whether costs rise, distances fall, and the paths are what they are said to be."""
    assert (np.diff(front.costs) > 0).all()
    assert (np.diff(front.distances) < 0).all()
    return True


def check_paths(front, cost, start, goal, cell_size):
    for n, (total, distance) in enumerate(zip(front.costs, front.distances, strict=True)):
        path = front.path(n)
        steps = np.diff(path.cells, axis=0)
        assert tuple(path.cells[0]) == start
        assert tuple(path.cells[-1]) == goal
        assert (np.abs(steps).max(axis=1, initial=1) == 1).all()
        assert total == fsum(cost[tuple(path.cells.T)])
        assert path.distance == distance
        assert distance == pytest.approx(cell_size * np.hypot(*steps.T).sum(), rel=1e-12)


# --- brute force ----------------------------------------------------------------------------------


def every_path(cost, start, goal):
    """(cost, straight, diagonal) of every path that enters no cell twice, exactly."""
    found = []

    def go_on(cell, visited, total, straight, diagonal):
        if cell == goal:
            found.append((total, straight, diagonal))
            return
        for i in range(cell[0] - 1, cell[0] + 2):
            for j in range(cell[1] - 1, cell[1] + 2):
                there = (i, j)
                if there in visited or not (0 <= i < cost.shape[0] and 0 <= j < cost.shape[1]):
                    continue
                if np.isinf(cost[there]):
                    continue
                is_diagonal = i != cell[0] and j != cell[1]
                go_on(
                    there,
                    visited | {there},
                    total + Fraction(cost[there]),
                    straight + (not is_diagonal),
                    diagonal + is_diagonal,
                )

    if np.isfinite(cost[start]):
        go_on(start, {start}, Fraction(cost[start]), 0, 0)
    return found


def brute_force(cost, start, goal):
    """The front of all paths; those that differ by rounding alone cost the same."""
    with localcontext() as context:
        context.prec = 50
        points = {
            (round(total, 12), straight + diagonal * ROOT2)
            for total, straight, diagonal in every_path(cost, start, goal)
        }
    front = []
    for total, length in sorted(points):
        if not front or length < front[-1][1]:
            front.append((total, length))
    return [(float(total), float(length)) for total, length in front]


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([(1, 4), (2, 4), (3, 3), (4, 3)]).flatmap(
        lambda shape: st.lists(
            st.sampled_from([0.0, 0.0, 0.1, 0.2, 0.3, 0.7, 1.0, 1 / 3, 5.0, np.inf]),
            min_size=shape[0] * shape[1],
            max_size=shape[0] * shape[1],
        ).map(lambda values: np.reshape(values, shape))
    ),
    st.data(),
)
def test_front_equals_brute_force_over_all_paths(cost, data):
    cells = st.tuples(*(st.integers(0, n - 1) for n in cost.shape))
    start, goal = data.draw(cells), data.draw(cells)
    expected = brute_force(cost, start, goal)
    if not expected or np.isinf(cost[goal]):
        with pytest.raises(ValueError, match=r"lies in an obstacle|no path leads"):
            pareto_front(cost, start, goal, 0.25)
        return
    front = pareto_front(cost, start, goal, 0.25)
    np.testing.assert_allclose(front.costs, [total for total, _ in expected], atol=1e-11)
    np.testing.assert_allclose(
        front.distances, [0.25 * length for _, length in expected], rtol=1e-12
    )
    check_paths(front, cost, start, goal, 0.25)


# --- other packages -------------------------------------------------------------------------------


def layered_distances(cost, start, goal, most):
    """Shortest distance in cells for each whole budget, by networkx: a layer for each sum paid."""
    graph = networkx.DiGraph()
    moves = moves_of(cost)
    for paid in range(most + 1):
        for cell, there, length in moves:
            if paid + cost[there] <= most:
                graph.add_edge((cell, paid), (there, paid + int(cost[there])), weight=length)
    source = (start, int(cost[start]))
    graph.add_node(source)
    reached = networkx.single_source_dijkstra_path_length(graph, source)
    best = [reached.get((goal, paid), np.inf) for paid in range(most + 1)]
    return np.minimum.accumulate(best)


@pytest.mark.parametrize("seed", range(12))
def test_front_equals_networkx_on_the_layered_graph(seed):
    cost = random_costs(seed)
    front = pareto_front(cost, (0, 0), (7, 7), 1.0)
    most = int(front.costs[-1]) + 2
    expected = layered_distances(cost, (0, 0), (7, 7), most)
    least = int(front.costs[0])
    assert np.isinf(expected[:least]).all()
    for budget in range(least, most + 1):
        assert front.within(budget).distance == pytest.approx(expected[budget], abs=1e-9)
    assert np.isin(front.costs, np.flatnonzero(expected < np.append(np.inf, expected[:-1]))).all()
    check_paths(front, cost, (0, 0), (7, 7), 1.0)


def expected_optimum(cost, start, goal, budget):
    """Least expected length over randomised policies with a bound on their expected cost.

    The linear programme over occupancies: how often each move is made, with one robot that sets
    out from the start and one that arrives.
    """
    moves = moves_of(cost)
    number = {cell: n for n, cell in enumerate(map(tuple, np.argwhere(np.isfinite(cost)).tolist()))}
    out = np.array([number[cell] for cell, _, _ in moves])
    into = np.array([number[there] for _, there, _ in moves])
    which = np.arange(len(moves))
    flow = coo_array((np.ones(len(moves)), (out, which)), shape=(len(number), len(moves)))
    flow = flow - coo_array((np.ones(len(moves)), (into, which)), shape=flow.shape)
    sources = np.zeros(len(number))
    sources[number[start]] += 1
    sources[number[goal]] -= 1
    solved = linprog(
        [length for _, _, length in moves],
        A_ub=[[cost[there] for _, there, _ in moves]],
        b_ub=[budget - cost[start]],
        A_eq=flow,
        b_eq=sources,
    )
    return solved.fun if solved.status == 0 else np.inf


@pytest.mark.parametrize("seed", range(8))
def test_hull_is_the_optimum_over_all_randomised_policies(seed):
    cost = random_costs(seed, greatest=6) / 3
    front = pareto_front(cost, (0, 0), (7, 7), 1.0)
    low, high = front.costs[[0, -1]]
    for budget in (low, low + 0.1, (low + high) / 2, high, high + 1):
        assert front.expected_distance(budget) == pytest.approx(
            expected_optimum(cost, (0, 0), (7, 7), budget), abs=1e-7
        )
    if low > 0.2:
        assert front.expected_distance(low - 0.1) == np.inf
        assert expected_optimum(cost, (0, 0), (7, 7), low - 0.1) == np.inf


def test_hull_of_the_paper_s_scene_is_the_optimum_over_all_randomised_policies():
    cost = cost_of(build_radio_map("paper"), -60.0, "violation")
    front = pareto_front(cost, *PAPER)
    assert front.expected_distance(13) == pytest.approx(23.607, abs=5e-4)
    assert 0.5 * expected_optimum(cost, *PAPER[:2], 13) == pytest.approx(
        float(front.expected_distance(13)), abs=1e-7
    )


def by_heap(cost, start, goal):
    """BOA*'s order and test with a heap, and lengths and costs as sums of floats: no bounds, no
    buckets, no whole numbers.
    """
    ahead = {}
    for cell, there, length in moves_of(cost):
        ahead.setdefault(cell, []).append((there, length))
    waiting = [(0.0, cost[start], start)]
    least = {}
    points = []
    while waiting:
        length, total, cell = heappop(waiting)
        if total >= least.get(cell, np.inf):
            continue
        least[cell] = total
        if cell == goal:
            points.append((total, length))
            continue
        for there, further in ahead[cell]:
            if total + cost[there] < least.get(there, np.inf):
                heappush(waiting, (length + further, total + cost[there], there))
    return points[::-1]


def merged(points):
    """Of points that are equally long but for rounding, the cheapest."""
    kept = []
    for total, length in points:
        if not kept or length < kept[-1][1] - 1e-9:
            kept.append((total, length))
    return np.array(kept)


@pytest.mark.parametrize(
    ("target_db", "phase_bits", "counts"),
    [(-60.0, None, (30, 20)), (-60.0, 1, None), (-58.5, 2, None)],
)
def test_front_of_deficits_equals_a_search_with_floats_but_for_points_of_rounding(
    target_db, phase_bits, counts
):
    cost = cost_of(build_radio_map("paper", phase_bits=phase_bits), target_db, "deficit")
    front = pareto_front(cost, *PAPER)
    points = by_heap(cost, *PAPER[:2])
    expected = merged(points)
    assert is_front(front)
    np.testing.assert_allclose(front.costs, expected[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(front.distances, 0.5 * expected[:, 1], rtol=0, atol=1e-9)
    # the sums of floats of equally long paths differ, and make points that are none
    assert counts in (None, (len(points), len(front.costs)))


@pytest.mark.parametrize("seed", range(4))
def test_fronts_of_generated_scenes_equal_a_search_with_floats(seed):
    scene = generate_scene(np.random.default_rng(seed), "hard")
    radio_map = build_radio_map(scene)
    start, goal = (radio_map.grid.cell_of(end) for end in (scene.start, scene.goal))
    target_db = float(np.quantile(radio_map.gain_db[radio_map.free], 0.5))
    for kind in ("violation", "deficit"):
        cost = cost_of(radio_map, target_db, kind)
        front = pareto_front(cost, start, goal, 0.5)
        expected = merged(by_heap(cost, start, goal))
        np.testing.assert_allclose(front.costs, expected[:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(front.distances, 0.5 * expected[:, 1], rtol=0, atol=1e-9)
        check_paths(front, cost, start, goal, 0.5)


# --- known figures --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("phase_bits", "target_db", "expected"),
    [
        (None, -61.8, [(0, 23.228), (1, 22.399), (2, 21.571)]),
        (None, -60.0, [(0, 25.642), (26, 21.571)]),
        (1, -61.8, [(0, 25.642), (14, 21.571)]),
    ],
)
def test_fronts_of_violations_in_the_paper_s_scene(phase_bits, target_db, expected):
    cost = cost_of(build_radio_map("paper", phase_bits=phase_bits), target_db, "violation")
    front = pareto_front(cost, *PAPER)
    assert front.costs.tolist() == [total for total, _ in expected]
    assert front.distances.round(3).tolist() == [distance for _, distance in expected]
    check_paths(front, cost, *PAPER)


def test_between_its_corners_the_paper_s_front_is_that_of_the_corner_before():
    front = pareto_front(cost_of(build_radio_map("paper"), -60.0, "violation"), *PAPER)
    assert front.within(13).distance == front.within(0).distance == front.distances[0]
    assert front.within(26).distance == front.within(np.inf).distance == front.distances[1]


# --- targets --------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["violation", "deficit"])
def test_a_higher_target_makes_no_budget_go_further(seed, kind):
    rng = np.random.default_rng(seed)
    gain_db = rng.integers(-90, -65, (9, 8)) / 3
    budgets = np.arange(0, 30, 0.5)
    before = np.zeros(len(budgets))
    for target_db in np.arange(-30, -21, 0.5):
        below = np.maximum(target_db - gain_db, 0)
        front = pareto_front(below > 0 if kind == "violation" else below, (0, 0), (8, 7), 1.0)
        now = np.array(
            [front.within(b).distance if b >= front.costs[0] else np.inf for b in budgets]
        )
        assert (now >= before).all()
        before = now
    assert np.isinf(before[0])


@pytest.mark.parametrize("seed", range(6))
def test_with_no_budget_the_front_is_the_trade_off(seed):
    rng = np.random.default_rng(seed)
    gain_db = rng.integers(-90, -65, (9, 8)) / 3
    gain_db[rng.random(gain_db.shape) < 0.1] = -np.inf
    gain_db[0, 0] = gain_db[8, 7] = -20
    steps = trade_off(gain_db, (0, 0), (8, 7), 0.5)
    for target_db in np.unique(gain_db[np.isfinite(gain_db)]):
        cost = np.where(np.isfinite(gain_db), np.maximum(target_db - gain_db, 0), np.inf)
        for each in (cost, np.where(cost < np.inf, cost > 0, np.inf)):
            front = pareto_front(each, (0, 0), (8, 7), 0.5)
            distance = front.within(0).distance if front.costs[0] == 0 else np.inf
            assert distance == steps.distance_at(target_db)


# --- sums -----------------------------------------------------------------------------------------


def test_the_order_in_which_costs_are_added_makes_no_point():
    # Above, 0.1 + 0.2 + 0.3 on a way that is longer; below, 0.3 + 0.2 + 0.1: floats differ.
    assert 0.3 + 0.2 + 0.1 < 0.1 + 0.2 + 0.3
    cost = np.full((5, 4), np.inf)
    cost[0, 1] = cost[4, 1] = 0.0
    cost[1:4, 0] = 0.1, 0.2, 0.3
    cost[1:4, 2] = 0.3, np.inf, 0.1
    cost[2, 3] = 0.2
    for each in (cost, cost[::-1]):
        front = pareto_front(each, (0, 1), (4, 1), 1.0)
        assert front.distances.tolist() == [2 + 2 * sqrt(2)]
        assert front.costs.tolist() == [fsum([0.1, 0.2, 0.3])]
    assert len(by_heap(cost[::-1], (0, 1), (4, 1))) + len(by_heap(cost, (0, 1), (4, 1))) == 3


def test_costs_of_any_size_make_the_same_front():
    cost = cost_of(build_radio_map("paper"), -60.0, "deficit")
    front = pareto_front(cost, *PAPER)
    for factor in (2.0**-900, 1e-30, 1e60):
        scaled = pareto_front(cost * factor, *PAPER)
        assert scaled.distances.tolist() == front.distances.tolist()
        np.testing.assert_allclose(scaled.costs, front.costs * factor, rtol=1e-12)


def test_the_start_is_paid_for_and_a_robot_at_the_goal_pays_nothing_else():
    front = pareto_front([[3, 1]], (0, 0), (0, 0), 1.0)
    assert (front.costs.tolist(), front.distances.tolist()) == ([3], [0])
    assert front.path(0).cells.tolist() == [[0, 0]]
    assert pareto_front([[3, 1]], (0, 0), (0, 1), 1.0).costs.tolist() == [4]


# --- what is refused ------------------------------------------------------------------------------

FRONT = pareto_front(np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), (0, 0), (0, 2), 1.0)


def test_a_path_is_counted_as_in_a_list():
    assert FRONT.costs.tolist() == [1, 2]
    assert FRONT.path(-1).cells.tolist() == FRONT.path(1).cells.tolist() == [[0, 0], [0, 1], [0, 2]]
    with pytest.raises(IndexError):
        FRONT.path(2)


def test_a_budget_within_rounding_of_a_cost_meets_it():
    assert FRONT.within(2 * (1 - 1e-14)).distance == 2
    assert FRONT.within(2 * (1 - 1e-9)).distance > 2


def test_a_budget_that_no_path_meets_is_told_the_least_cost():
    with pytest.raises(ValueError, match=r"budget=0.5 is met by no path: the least cost is 1.0"):
        FRONT.within(0.5)


@pytest.mark.parametrize("budget", [-1, -1e-9, float("nan"), "2", None, True, [1.0]], ids=repr)
def test_a_budget_is_a_number_of_0_or_more(budget):
    with pytest.raises(ValueError, match=r"budget=.* must be a number, 0 or more"):
        FRONT.within(budget)


@pytest.mark.parametrize("budget", [-1, [1.0, float("nan")], ["much"], None], ids=repr)
def test_budgets_in_expectation_are_numbers_of_0_or_more(budget):
    with pytest.raises(ValueError, match=r"budget=.* must be numbers, 0 or more"):
        FRONT.expected_distance(budget)


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        ([[0.0, -1.0]], "cost holds NaN or negative numbers"),
        ([[0.0, np.nan]], "cost holds NaN or negative numbers"),
        ([[0.0, 1e200]], "cost holds finite numbers beyond"),
        ([["a", "b"]], "cost holds values of the type"),
        ([[1j, 0]], "cost holds values of the type"),
        ([[0.0], [0.0, 1.0]], "cost is no array"),
        ([0.0, 1.0], "cost has the shape"),
        (np.zeros((0, 3)), "cost has the shape"),
        ([[np.inf, 0.0]], r"start=\(0, 0\) lies in an obstacle"),
        ([[0.0, np.inf]], r"goal=\(0, 1\) lies in an obstacle"),
        ([[0.0]], r"goal=\(0, 1\) lies off the map"),
    ],
)
def test_a_map_that_can_be_none_is_refused(cost, message):
    with pytest.raises(ValueError, match=message):
        pareto_front(cost, (0, 0), (0, 1), 1.0)


def test_ends_that_are_not_connected_are_named():
    with pytest.raises(ValueError, match=r"no path leads from start=\(0, 0\) to goal=\(0, 2\)"):
        pareto_front([[0.0, np.inf, 0.0]], (0, 0), (0, 2), 1.0)


def test_a_map_beyond_the_memory_limit_is_refused_before_work(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "10KiB")
    with pytest.raises(MemoryLimitError, match="cost: work on a map of 40 x 40 cells"):
        pareto_front(np.zeros((40, 40)), (0, 0), (39, 39), 1.0)


def test_arrays_of_a_front_are_read_only():
    for array in (FRONT.costs, FRONT.distances, FRONT.cells, FRONT.ends, FRONT.hull().costs):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
