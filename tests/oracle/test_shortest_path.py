"""Facts of the oracle: equal to networkx on random maps, and to the numbers that the paper prints."""

from functools import cache
from itertools import product
from math import inf, sqrt

import networkx as nx
import numpy as np
import pytest

from irs_gym.grid import Grid
from irs_gym.oracle.shortest_path import (
    descend,
    distance_to_go,
    highest_feasible_target,
    path_length,
    shortest_path,
)
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import load_scene

SHAPES = [(1, 1), (1, 7), (8, 1), (2, 2), (3, 5), (6, 6), (9, 4), (12, 17)]


def graph_of(feasible, cell_size=1.0) -> nx.Graph:
    """The paper's graph, eq. (17): all feasible cells, joined where their centres are at most
    sqrt(2) cells apart.
    """
    cells = nx.Graph()
    cells.add_nodes_from(cell for cell in np.ndindex(feasible.shape) if feasible[cell])
    for i, j in list(cells):
        for di, dj in product((-1, 0, 1), repeat=2):
            if (di, dj) != (0, 0) and (i + di, j + dj) in cells:
                cells.add_edge((i, j), (i + di, j + dj), weight=sqrt(di * di + dj * dj) * cell_size)
    return cells


def random_maps(count):
    """Maps of all shapes, from nearly empty to nearly full, each with two cells."""
    rng = np.random.default_rng(12)
    for n in range(count):
        shape = SHAPES[n % len(SHAPES)]
        feasible = rng.random(shape) < rng.uniform(0.2, 1.0)
        start, goal = (tuple(int(k) for k in rng.integers(shape)) for _ in range(2))
        yield feasible, start, goal, float(rng.choice([0.1, 0.5, 1.0, 3.7]))


def steps(cells):
    return np.abs(np.diff(cells, axis=0))


# --- shortest paths -------------------------------------------------------------------------------


def test_the_shortest_path_equals_networkx_on_random_maps():
    reached = missed = 0
    for feasible, start, goal, cell_size in random_maps(400):
        cells = graph_of(feasible, cell_size)
        path = shortest_path(feasible, start, goal, cell_size)
        if not (feasible[start] and feasible[goal] and nx.has_path(cells, start, goal)):
            assert path is None
            missed += 1
            continue
        assert path.distance == pytest.approx(nx.dijkstra_path_length(cells, start, goal), abs=1e-9)
        assert (tuple(path.cells[0]), tuple(path.cells[-1])) == (start, goal)
        assert (path.cells.dtype, path.cells.shape[1]) == (np.int64, 2)
        assert all(feasible[tuple(cell)] for cell in path.cells)
        assert len(path.cells) == 1 or (steps(path.cells).max(axis=1) == 1).all()
        assert path.distance == pytest.approx(
            np.hypot(*steps(path.cells).T).sum() * cell_size, abs=1e-9
        )
        reached += 1
    assert min(reached, missed) > 100


def test_distances_to_go_equal_networkx_on_random_maps():
    for feasible, _, goal, cell_size in random_maps(200):
        expected = np.full(feasible.shape, inf)
        if feasible[goal]:
            for cell, length in nx.single_source_dijkstra_path_length(
                graph_of(feasible, cell_size), goal
            ).items():
                expected[cell] = length
        to_go = distance_to_go(feasible, goal, cell_size)
        assert to_go.dtype == np.float64
        assert np.array_equal(np.isfinite(to_go), np.isfinite(expected))
        finite = np.isfinite(expected)
        assert np.allclose(to_go[finite], expected[finite], rtol=0, atol=1e-9)


def test_going_down_the_distances_is_a_shortest_path_from_everywhere():
    for feasible, _, goal, cell_size in random_maps(80):
        to_go = distance_to_go(feasible, goal, cell_size)
        for start in np.ndindex(feasible.shape):
            if not np.isfinite(to_go[start]):
                with pytest.raises(ValueError, match=r"the goal cannot be reached from start=\("):
                    descend(to_go, start, cell_size)
                continue
            path = descend(to_go, start, cell_size)
            assert path.distance == pytest.approx(to_go[start], abs=1e-9)
            assert (tuple(path.cells[0]), tuple(path.cells[-1])) == (start, goal)
            assert all(feasible[tuple(cell)] for cell in path.cells)
            assert len(path.cells) == 1 or (steps(path.cells).max(axis=1) == 1).all()


def test_a_path_cuts_corners():
    feasible = np.array([[True, False], [False, True]])
    path = shortest_path(feasible, (0, 0), (1, 1), 0.5)
    assert path.cells.tolist() == [[0, 0], [1, 1]]
    assert path.distance == 0.5 * sqrt(2)


def test_a_wall_has_to_be_walked_around():
    feasible = np.ones((5, 5), dtype=bool)
    feasible[2, :4] = False
    assert shortest_path(feasible, (0, 0), (4, 0), 1.0).distance == pytest.approx(4 * sqrt(2) + 4)
    feasible[2, 4] = False
    assert shortest_path(feasible, (0, 0), (4, 0), 1.0) is None
    assert np.isinf(distance_to_go(feasible, (4, 0), 1.0)[:3]).all()


def test_where_start_and_goal_are_one_the_path_is_a_cell():
    path = shortest_path(np.ones((3, 3), dtype=bool), (1, 2), (1, 2), 0.5)
    assert path.cells.tolist() == [[1, 2]]
    assert path.distance == 0.0


def test_an_end_that_is_not_feasible_has_no_path():
    feasible = np.array([[True, True, False]])
    assert shortest_path(feasible, (0, 0), (0, 2), 1.0) is None
    assert shortest_path(feasible, (0, 2), (0, 0), 1.0) is None
    assert shortest_path(feasible, (0, 2), (0, 2), 1.0) is None
    assert np.isinf(distance_to_go(feasible, (0, 2), 1.0)).all()


def test_path_lengths_are_counted_not_summed():
    cells = np.array([[0, 0], *[[n, n] for n in range(1, 11)], *[[n, 10] for n in range(11, 21)]])
    assert path_length(cells, 0.1) == (10 + 10 * sqrt(2)) * 0.1
    assert path_length(cells[:1], 0.1) == 0.0


@pytest.mark.parametrize("cell", [(-1, 0), (0, -1), (2, 0), (0, 3)])
def test_an_end_off_the_map_is_refused(cell):
    feasible, inside = np.ones((2, 3), dtype=bool), (0, 0)
    for call, name in [
        (lambda: shortest_path(feasible, cell, inside, 1.0), "start"),
        (lambda: shortest_path(feasible, inside, cell, 1.0), "goal"),
        (lambda: distance_to_go(feasible, cell, 1.0), "goal"),
        (lambda: descend(np.zeros((2, 3)), cell, 1.0), "start"),
        (lambda: highest_feasible_target(np.zeros((2, 3)), cell, inside), "start"),
        (lambda: highest_feasible_target(np.zeros((2, 3)), inside, cell), "goal"),
    ]:
        with pytest.raises(ValueError, match=rf"{name}=\(.*\) lies off the map of \(2, 3\) cells"):
            call()


# --- the highest feasible target ------------------------------------------------------------------


def highest_target_by_sweep(gain_db, start, goal) -> float:
    for level in sorted(set(gain_db[np.isfinite(gain_db)].tolist()), reverse=True):
        cells = graph_of(gain_db >= level)
        if start in cells and goal in cells and nx.has_path(cells, start, goal):
            return level
    return -inf


def random_gains(count, has_ties):
    rng = np.random.default_rng(13)
    for n in range(count):
        shape = SHAPES[n % len(SHAPES)]
        gain_db = rng.normal(-61, 2, shape)
        gain_db = gain_db.round() if has_ties else gain_db
        gain_db[rng.random(shape) < rng.uniform(0, 0.7)] = -inf
        start, goal = (tuple(int(k) for k in rng.integers(shape)) for _ in range(2))
        yield gain_db, start, goal


@pytest.mark.parametrize("has_ties", [False, True])
def test_the_highest_feasible_target_equals_a_sweep_over_all_gains(has_ties):
    found = set()
    for gain_db, start, goal in random_gains(160, has_ties):
        expected = highest_target_by_sweep(gain_db, start, goal)
        assert highest_feasible_target(gain_db, start, goal) == expected
        found.add(expected)
    assert -inf in found
    assert len(found) > 5


def test_a_map_is_connected_at_exactly_that_target_and_not_above():
    for gain_db, start, goal in random_gains(100, has_ties=False):
        target = highest_feasible_target(gain_db, start, goal)
        above = gain_db >= np.nextafter(target, inf)
        assert shortest_path(above, start, goal, 1.0) is None
        if target > -inf:
            assert shortest_path(gain_db >= target, start, goal, 1.0) is not None


def test_the_highest_target_of_a_single_cell_is_its_gain():
    assert highest_feasible_target(np.array([[-3.0, -inf]]), (0, 0), (0, 0)) == -3.0
    assert highest_feasible_target(np.array([[-3.0, -inf]]), (0, 1), (0, 1)) == -inf
    assert highest_feasible_target(np.array([[0.0]]), (0, 0), (0, 0)) == 0.0


def test_a_target_is_that_of_the_worst_cell_on_the_best_way():
    gain_db = np.array([[-1.0, -9.0, -1.0], [-2.0, -inf, -3.0], [-2.0, -4.0, -3.0]])
    # past the corner: (0, 0), (1, 0), (2, 1), (1, 2), (0, 2)
    assert highest_feasible_target(gain_db, (0, 0), (0, 2)) == -4.0


# --- the numbers of the paper ---------------------------------------------------------------------

GRID = load_scene("paper").grid(0.5)
START, GOAL = GRID.cell_of((-10.0, 0.0)), GRID.cell_of((10.0, 0.0))


@cache
def gains(irs_elements=1200, phase_bits=None, quantiser="nearest"):
    return build_radio_map("paper", 0.5, irs_elements, phase_bits, quantiser).gain_db


def metres(target_db, *setting) -> float:
    path = shortest_path(gains(*setting) >= target_db, START, GOAL, GRID.cell_size)
    return path.distance if path else inf


@pytest.mark.parametrize(
    ("setting", "target_db"),
    [
        ((0,), -62.084),
        ((1200,), -59.511),
        ((1200, 3, "nearest"), -59.572),
        ((1200, 2, "nearest"), -59.744),
        ((1200, 1, "nearest"), -60.409),
        ((1200, 2, "as_printed"), -59.941),
        ((1200, 1, "as_printed"), -61.363),
    ],
)
def test_the_papers_scene_is_feasible_up_to(setting, target_db):
    highest = highest_feasible_target(gains(*setting), START, GOAL)
    assert highest == pytest.approx(target_db, abs=5e-4)
    assert metres(highest, *setting) < inf == metres(np.nextafter(highest, 0), *setting)


def test_continuous_phases_gain_2_57_db_over_no_irs():
    without, continuous = (highest_feasible_target(gains(m), START, GOAL) for m in (0, 1200))
    assert continuous - without == pytest.approx(2.57, abs=5e-3)


@pytest.mark.parametrize(
    ("target_db", "distance"),
    [
        (-63.0, 21.571),
        (-61.93, 21.571),
        (-61.8, 23.228),
        (-61.55, 24.056),
        (-61.17, 25.642),
        (-59.9, 26.228),
    ],
)
def test_the_shortest_distance_with_continuous_phases_at(target_db, distance):
    assert metres(target_db) == pytest.approx(distance, abs=5e-4)
    by_networkx = nx.dijkstra_path_length(graph_of(gains() >= target_db, 0.5), START, GOAL)
    assert metres(target_db) == pytest.approx(by_networkx, abs=1e-9)


def test_without_irs_the_robot_travels_up_to_18_87_percent_farther():
    farther = [metres(t, 0) / metres(t) - 1 for t in np.linspace(-63.5, -62.5, 11)]
    assert 100 * max(farther) == pytest.approx(18.87, abs=5e-3)
    assert metres(-63.0, 0) == pytest.approx(25.642, abs=5e-4)


def test_with_one_bit_it_travels_10_39_percent_farther_at_minus_61_8_db():
    one_bit = metres(-61.8, 1200, 1)
    assert one_bit == pytest.approx(25.642, abs=5e-4)
    for setting in [(1200,), (1200, 2), (1200, 3)]:
        assert 100 * (one_bit / metres(-61.8, *setting) - 1) == pytest.approx(10.39, abs=5e-3)


def test_one_bit_needs_at_most_600_more_elements_at_minus_61_8_db():
    def fewest(distance, bits) -> int:
        return next(m for m in range(200, 2401, 200) if metres(-61.8, m, bits) <= distance + 1e-9)

    distances = {metres(-61.8, m) for m in range(200, 2401, 200)}
    assert len(distances) == 4
    for bits in (None, 2, 3):
        assert max(fewest(d, 1) - fewest(d, bits) for d in distances) == 600


def test_more_elements_never_lengthen_the_path():
    for bits in (None, 1, 2, 3):
        distances = [metres(-61.8, m, bits) for m in range(0, 2401, 200)]
        assert distances == sorted(distances, reverse=True)


def test_the_oracle_takes_the_cells_of_any_grid():
    grid = Grid.tile((-10.0, -10.0), (10.0, 10.0), 0.25)
    gain_db = build_radio_map(cell_size=0.25).gain_db
    start, goal = grid.cell_of((-10.0, 0.0)), grid.cell_of((10.0, 0.0))
    path = shortest_path(gain_db >= -61.8, start, goal, 0.25)
    expected = nx.dijkstra_path_length(graph_of(gain_db >= -61.8, 0.25), start, goal)
    assert path.distance == pytest.approx(expected, abs=1e-9)
