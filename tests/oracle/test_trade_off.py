from decimal import Decimal, localcontext

import networkx
import numpy as np
import pytest

from irs_gym import build_radio_map, highest_feasible_target, trade_off
from irs_gym.oracle import trade_off as trade_off_curve
from irs_gym.oracle.whole_lengths import true_length, whole_lengths

SQRT2 = 2**0.5


def random_map(seed, shape=(9, 8), levels=25):
    """Gains with many ties, and obstacles."""
    rng = np.random.default_rng(seed)
    gain_db = rng.integers(-90, -90 + levels, shape) / 3
    gain_db[rng.random(shape) < 0.2] = -np.inf
    return gain_db


def brute_force_distance(gain_db, start, goal, target_db):
    """Shortest distance in cells by networkx, on a graph spelled out cell by cell."""
    graph = networkx.Graph()
    cells = {
        tuple(cell)
        for cell in np.argwhere(gain_db >= target_db).tolist()
        if gain_db[tuple(cell)] > -np.inf
    }
    graph.add_nodes_from(cells)
    for i, j in cells:
        for step, length in (((1, 0), 1.0), ((0, 1), 1.0), ((1, 1), SQRT2), ((1, -1), SQRT2)):
            neighbour = (i + step[0], j + step[1])
            if neighbour in cells:
                graph.add_edge((i, j), neighbour, weight=length)
    if not (start in cells and goal in cells and networkx.has_path(graph, start, goal)):
        return np.inf
    return networkx.dijkstra_path_length(graph, start, goal)


@pytest.mark.parametrize("seed", range(30))
def test_curve_equals_brute_force_over_every_gain_of_a_map(seed):
    gain_db = random_map(seed)
    start, goal = (0, seed % 8), (8, 7 - seed % 8)
    curve = trade_off(gain_db, start, goal, 0.5)
    values = np.unique(gain_db[np.isfinite(gain_db)])
    between = (values[1:] + values[:-1]) / 2
    for targets in (values, between, values[[0]] - 1, values[[-1]] + 1):
        expected = [0.5 * brute_force_distance(gain_db, start, goal, target) for target in targets]
        np.testing.assert_allclose(curve.distance_at(targets), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_each_breakpoint_is_a_gain_of_the_map_at_which_the_distance_rises(seed):
    gain_db = random_map(seed, shape=(12, 12))
    curve = trade_off(gain_db, (0, 0), (11, 11), 1.0)
    assert np.isin(curve.targets_db, gain_db).all()
    assert (np.diff(curve.targets_db) > 0).all()
    assert (np.diff(np.append(curve.distances, np.inf)) > 1e-3).all()
    assert (
        curve.distance_at(np.nextafter(curve.targets_db, np.inf)).tolist()
        == [*curve.distances[1:], np.inf][: len(curve.distances)]
    )


@pytest.mark.parametrize("phase_bits", [None, 1])
def test_curve_of_the_paper_s_map_is_right_at_every_gain_of_it(phase_bits):
    radio_map = build_radio_map("paper", phase_bits=phase_bits)
    gain_db, start, goal = radio_map.gain_db, (0, 20), (39, 20)
    curve = trade_off(gain_db, start, goal, 0.5)
    values = np.unique(gain_db[radio_map.free])
    values = values[:: max(1, len(values) // 40)]
    expected = [0.5 * brute_force_distance(gain_db, start, goal, target) for target in values]
    np.testing.assert_allclose(curve.distance_at(values), expected, rtol=0, atol=1e-9)
    assert curve.targets_db[-1] == highest_feasible_target(gain_db, start, goal)


def test_it_takes_one_dijkstra_run_a_step_and_counts_them_truly(monkeypatch):
    runs = []
    dijkstra = trade_off_curve.dijkstra
    monkeypatch.setattr(
        trade_off_curve, "dijkstra", lambda *a, **k: runs.append(1) or dijkstra(*a, **k)
    )
    for gain_db in (build_radio_map("paper").gain_db[:, ::-1], random_map(3), random_map(4)):
        runs.clear()
        curve = trade_off(gain_db, (0, 0), (gain_db.shape[0] - 1, gain_db.shape[1] - 1), 0.5)
        assert curve.dijkstra_runs == len(runs) <= len(curve.distances) + 1


def test_a_longer_path_of_the_same_length_with_a_higher_gain_moves_the_breakpoint():
    # two ways around the middle, equally long: the lower at -70 dB, the upper at -60 dB
    gain_db = np.full((5, 3), -50.0)
    gain_db[1:4, 1], gain_db[2, 0], gain_db[2, 2] = -90, -70, -60
    curve = trade_off(gain_db, (0, 1), (4, 1), 1.0)
    assert curve.targets_db.tolist() == [-90, -60]
    np.testing.assert_allclose(curve.distances, [4, 2 + 2 * SQRT2], rtol=0, atol=1e-12)


def test_start_at_the_goal_costs_nothing_up_to_its_own_gain():
    curve = trade_off(np.array([[-60.0, -70.0]]), (0, 0), (0, 0), 1.0)
    assert curve.targets_db.tolist() == [-60]
    assert curve.distances.tolist() == [0]


@pytest.mark.parametrize("wall", [-np.inf, "start", "goal"])
def test_no_path_at_any_target_gives_an_empty_curve(wall):
    gain_db = np.full((5, 4), -60.0)
    if wall == -np.inf:
        gain_db[2] = wall
    else:
        gain_db[{"start": (0, 0), "goal": (4, 3)}[wall]] = -np.inf
    curve = trade_off(gain_db, (0, 0), (4, 3), 1.0)
    assert curve.targets_db.shape == curve.distances.shape == (0,)
    assert curve.distance_at(-100.0) == np.inf


def test_an_end_off_the_map_is_named():
    with pytest.raises(ValueError, match=r"goal=\(9, 0\) lies off the map"):
        trade_off(np.zeros((3, 3)), (0, 0), (9, 0), 1.0)
    with pytest.raises(ValueError, match=r"start=\(0, -1\) lies off the map"):
        trade_off(np.zeros((3, 3)), (0, -1), (2, 0), 1.0)


@pytest.mark.parametrize("cells", [1, 2, 50, 1600, 10**6])
def test_whole_lengths_order_paths_as_their_true_lengths_do(cells):
    q, p = whole_lengths(cells)
    rng = np.random.default_rng(cells)
    diagonal = rng.integers(-cells, cells + 1, 200)
    for b in {int(n) for n in diagonal} | {cells, -cells}:
        with localcontext() as context:
            context.prec = 60
            root = Decimal(2).sqrt()
            for a in {
                round(-b * root) + shift for shift in (-1, 0, 1)
            }:  # the nearest calls there are
                true, whole = a + b * root, a * q + b * p
                assert (true > 0, true < 0) == (whole > 0, whole < 0)
                if a >= 0 and b >= 0:
                    assert true_length(whole, cells) == pytest.approx(float(true), rel=1e-15)
    for a, b in rng.integers(0, cells + 1, (50, 2)).tolist():
        assert true_length(a * q + b * p, cells) == a + b * SQRT2
