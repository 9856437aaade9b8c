"""Facts of the cost and the distance to go from every cell, against the fronts of each."""

import numpy as np
import pytest

from irs_gym import budget_to_go, build_radio_map, distance_to_go, pareto_front
from irs_gym.oracle.budget_to_go import last_within


def random_costs(seed, shape=(7, 6)):
    """Costs of tenths, many of them 0, and obstacles."""
    rng = np.random.default_rng(seed)
    cost = np.maximum(rng.integers(-3, 8, shape), 0) / 10
    cost[rng.random(shape) < 0.2] = np.inf
    cost[-1, -1] = 0.1
    return cost


def fronts_of(cost, goal, cell_size):
    """The front of every cell from which the goal can be reached, without what it costs itself."""
    fronts = {}
    for cell in map(tuple, np.argwhere(np.isfinite(cost)).tolist()):
        try:
            front = pareto_front(cost, cell, goal, cell_size)
        except ValueError:
            continue
        fronts[cell] = (front.costs - cost[cell], front.distances)
    return fronts


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("most", [0, 0.45, np.inf])
def test_pairs_of_every_cell_are_its_front_up_to_the_budget(seed, most):
    cost = random_costs(seed)
    to_go = budget_to_go(cost, (6, 5), 0.5, most)
    fronts = fronts_of(cost, (6, 5), 0.5)
    for flat in range(cost.size):
        pairs = slice(*to_go.offsets[flat : flat + 2])
        costs, distances = fronts.get(divmod(flat, 6), (np.zeros(0), np.zeros(0)))
        is_met = costs <= most + 1e-9
        # of pairs whose costs differ by rounding alone, the last counts
        is_last = np.diff(to_go.costs[pairs], append=np.inf) > 1e-9
        np.testing.assert_allclose(to_go.costs[pairs][is_last], costs[is_met], rtol=0, atol=1e-11)
        np.testing.assert_allclose(to_go.distances[pairs][is_last], distances[is_met], rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_distances_of_many_robots_are_those_of_their_fronts(seed):
    cost = random_costs(seed)
    to_go = budget_to_go(cost, (6, 5), 0.5, most=2.0)
    fronts = fronts_of(cost, (6, 5), 0.5)
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, cost.size, (20, 50))
    budgets = rng.integers(-3, 21, cells.shape) / 10
    for flat, budget, distance in zip(
        cells.ravel(), budgets.ravel(), to_go.distance(cells, budgets).ravel(), strict=True
    ):
        costs, distances = fronts.get(divmod(int(flat), 6), (np.zeros(0), np.zeros(0)))
        is_met = costs <= budget + 1e-9
        assert distance == pytest.approx(distances[is_met].min(initial=np.inf), rel=1e-12)
    assert to_go.distance(cells, budgets).shape == cells.shape
    assert to_go.distance(3, 0.5) == to_go.distance([3], [0.5])[0] == to_go.distance([3], 0.5)[0]


@pytest.mark.parametrize("seed", range(4))
def test_paths_keep_to_the_budget_and_are_as_long_as_told(seed):
    cost = random_costs(seed)
    to_go = budget_to_go(cost, (6, 5), 0.5, most=2.0)
    for flat in range(cost.size):
        cell = divmod(flat, 6)
        for budget in (0.0, 0.3, 0.6, 2.0):
            path, distance = to_go.path(cell, budget), to_go.distance(flat, budget)
            if path is None:
                assert np.isinf(distance)
                continue
            assert tuple(path.cells[0]) == cell
            assert tuple(path.cells[-1]) == (6, 5)
            assert cost[tuple(path.cells[1:].T)].sum() <= budget + 1e-9
            assert path.distance == distance
            assert 0.5 * np.hypot(*np.diff(path.cells, axis=0).T).sum() == pytest.approx(distance)


def test_with_all_that_it_may_cost_the_distance_is_the_shortest_and_with_nothing_that_over_free_cells():
    radio_map = build_radio_map("paper")
    below = radio_map.gain_db < -60
    cost = np.where(radio_map.free, below, np.inf)
    to_go = budget_to_go(cost, (39, 20), 0.5, most=np.inf)
    cells = np.arange(cost.size)
    np.testing.assert_allclose(
        to_go.distance(cells, np.inf),
        distance_to_go(radio_map.free, (39, 20), 0.5).ravel(),
        rtol=1e-12,
    )
    over_free = distance_to_go(radio_map.free & ~below, (39, 20), 0.5).ravel()
    is_free = (radio_map.free & ~below).ravel()
    np.testing.assert_allclose(to_go.distance(cells, 0)[is_free], over_free[is_free], rtol=1e-12)


def test_known_distances_from_the_paper_s_start():
    radio_map = build_radio_map("paper")
    cost = np.where(radio_map.free, radio_map.gain_db < -60, np.inf)
    to_go = budget_to_go(cost, (39, 20), 0.5, most=26)
    assert to_go.distance([20] * 4, [0, 13, 25, 26]).round(3).tolist() == [25.642] * 3 + [21.571]


def test_a_robot_pays_for_the_goal_and_not_for_where_it_stands():
    to_go = budget_to_go([[5.0, 2.0]], (0, 1), 1.0, most=9)
    assert to_go.distance([0, 0, 1], [1.9, 2, 0]).tolist() == [np.inf, 1, 0]


def test_a_budget_less_rounding_of_sums_is_met():
    to_go = budget_to_go([[0.0, 0.1, 0.2, 0.3]], (0, 3), 1.0, most=0.6)
    assert 0.1 + 0.2 + 0.3 > 0.6
    left = 0.6 - 0.2 - 0.1
    assert left < 0.3
    assert to_go.distance([0, 2], [0.6, left]).tolist() == [3, 1]
    assert to_go.distance(0, 0.6 - 1e-6) == np.inf


def test_maps_behind_each_other_are_looked_up_as_one():
    costs = [random_costs(seed) for seed in range(3)]
    to_go = [budget_to_go(cost, (6, 5), 1.0, most=1) for cost in costs]
    starts = np.cumsum([0] + [len(each.costs) for each in to_go])
    offsets = np.concatenate(
        [each.offsets[:-1] + at for each, at in zip(to_go, starts, strict=False)] + [starts[-1:]]
    )
    pairs = last_within(
        offsets, np.concatenate([each.costs for each in to_go]), np.arange(126), 0.5
    )
    distances = np.append(np.concatenate([each.distances for each in to_go]), np.inf)[pairs]
    expected = [each.distance(np.arange(42), 0.5) for each in to_go]
    assert distances.tolist() == np.concatenate(expected).tolist()


@pytest.mark.parametrize("most", [-1, float("nan"), "2", None, True], ids=repr)
def test_the_greatest_budget_is_a_number_of_0_or_more(most):
    with pytest.raises(ValueError, match=r"most=.* must be a number, 0 or more"):
        budget_to_go([[0.0, 1.0]], (0, 1), 1.0, most)


@pytest.mark.parametrize(
    ("cost", "goal", "message"),
    [
        ([[0.0, -1.0]], (0, 0), "cost holds NaN or negative numbers"),
        ([[0.0, np.inf]], (0, 1), r"goal=\(0, 1\) lies in an obstacle"),
        ([[0.0, 1.0]], (1, 0), r"goal=\(1, 0\) lies off the map"),
    ],
)
def test_a_map_that_can_be_none_is_refused(cost, goal, message):
    with pytest.raises(ValueError, match=message):
        budget_to_go(cost, goal, 1.0, most=1)


def test_arrays_are_read_only():
    to_go = budget_to_go([[0.0, 1.0]], (0, 1), 1.0, most=1)
    for array in (to_go.offsets, to_go.costs, to_go.distances, to_go.after):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
