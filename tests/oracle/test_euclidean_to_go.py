"""Facts of the shortest paths of any shape, from any point: against a visibility graph of networkx
and shapely, and against grids that are ever finer.
"""

from itertools import combinations
from math import hypot, inf, sqrt

import networkx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from test_straight_line import cells, is_inside

from irs_gym import (
    build_radio_map,
    distance_to_go,
    euclidean_distance_to_go,
    shortest_path,
    straight_line_bound,
    straight_line_path,
)
from irs_gym.memory import MemoryLimitError
from irs_gym.oracle.sight import Sight

examples = settings(max_examples=60, deadline=None, derandomize=True)


@st.composite
def maps(draw, largest=6):
    """Small maps, half of them with many corners."""
    shape = draw(st.tuples(st.integers(1, largest), st.integers(1, largest)))
    number = shape[0] * shape[1]
    marks = draw(st.lists(st.integers(0, 3), min_size=number, max_size=number))
    least = draw(st.sampled_from([1, 2]))
    return np.array(marks).reshape(shape) >= least


def coordinates(largest):
    """Numbers of cells: on borders, in the middle, and anywhere."""
    return st.one_of(
        st.integers(0, 2 * largest).map(lambda n: n / 2),
        st.floats(0, largest, allow_subnormal=False).map(lambda x: round(x, 4)),
    )


@st.composite
def maps_and_points(draw, number):
    feasible = draw(maps())
    points = [
        (draw(coordinates(feasible.shape[0])), draw(coordinates(feasible.shape[1])))
        for _ in range(number)
    ]
    return feasible, np.array(points)


def is_in_closed_cells(feasible, points, margin=1e-9):
    low = np.argwhere(feasible)
    inside = (points[:, None] >= low - margin) & (points[:, None] <= low + 1 + margin)
    return inside.all(axis=2).any(axis=1)


def by_networkx(feasible, goal, points):
    """Distances over the visibility graph of all corners of all cells: segments that shapely finds
    within the joined squares.
    """
    low = np.argwhere(feasible)
    area = shapely.union_all(shapely.box(*low.T, *(low + 1).T)).buffer(1e-9, join_style="mitre")
    shapely.prepare(area)
    lattice = np.argwhere(np.ones(np.array(feasible.shape) + 1))
    places = np.concatenate([[goal], points, lattice]).astype(float)
    first, second = np.triu_indices(len(places), 1)
    sights = shapely.linestrings(np.stack([places[first], places[second]], axis=1))
    is_seen = shapely.covers(area, sights)
    graph = networkx.Graph()
    graph.add_nodes_from(np.flatnonzero(shapely.covers(area, shapely.points(places))).tolist())
    for a, b in zip(first[is_seen].tolist(), second[is_seen].tolist(), strict=True):
        graph.add_edge(a, b, weight=hypot(*(places[a] - places[b])))
    if 0 not in graph:
        return np.full(len(points), inf)
    lengths = networkx.single_source_dijkstra_path_length(graph, 0)
    return np.array([lengths.get(n + 1, inf) for n in range(len(points))])


@examples
@given(maps_and_points(9))
def test_distances_are_those_of_a_visibility_graph_of_all_corners_from_anywhere(drawn):
    feasible, (goal, *points) = drawn
    to_go = euclidean_distance_to_go(feasible, tuple(goal), 1.0)
    expected = by_networkx(feasible, goal, points)
    assert to_go(points) == pytest.approx(expected, abs=1e-9)
    for point, distance in zip(points, expected, strict=True):
        path = straight_line_path(feasible, tuple(point), tuple(goal), 1.0)
        assert (inf if path is None else path.distance) == pytest.approx(distance, abs=1e-9)


@examples
@given(maps_and_points(4))
def test_distances_are_a_metric_and_no_shorter_than_the_straight_line(drawn):
    feasible, points = drawn
    between = np.array(
        [euclidean_distance_to_go(feasible, tuple(goal), 1.0)(points) for goal in points]
    )
    assert between == pytest.approx(between.T, abs=1e-9)
    for n, point in enumerate(points):
        assert between[n, n] == (0 if is_in_closed_cells(feasible, point[None])[0] else inf)
        assert np.all(between[n] >= np.hypot(*(points - point).T) - 1e-9)
        assert np.all(between <= between[:, [n]] + between[[n]] + 1e-9)


@examples
@given(maps_and_points(5))
def test_a_path_is_as_long_as_its_distance_and_feasible_all_along(drawn):
    feasible, (goal, *points) = drawn
    to_go = euclidean_distance_to_go(feasible, tuple(goal), 1.0)
    for point in points:
        distance = float(to_go(point))
        path = to_go.path(point)
        if distance == inf:
            assert path.shape == (0, 2)
            continue
        assert path[0].tolist() == point.tolist()
        assert path[-1].tolist() == goal.tolist()
        pieces = np.diff(path, axis=0)
        assert np.hypot(*pieces.T).sum() == pytest.approx(distance, abs=1e-9)
        for begin, piece in zip(path, pieces, strict=False):
            along = begin + np.linspace(0, 1, 500)[:, None] * piece
            assert is_in_closed_cells(feasible, along).all()
            left = float(to_go(begin + piece))  # what is left falls by what is gone
            assert to_go(along) == pytest.approx(
                np.linspace(left + hypot(*piece), left, 500), abs=1e-8
            )


@pytest.mark.parametrize("seed", range(6))
def test_a_grid_that_is_ever_finer_comes_down_to_what_eight_directions_cost(seed):
    rng = np.random.default_rng(seed)
    feasible = rng.random((7, 6)) < 0.75
    goal = tuple(np.argwhere(feasible)[rng.integers(feasible.sum())])
    centres = np.argwhere(feasible) + 0.5
    exact = euclidean_distance_to_go(feasible, (goal[0] + 0.5, goal[1] + 0.5), 1.0)(centres)
    before = inf
    for parts in (1, 3, 9, 27):
        fine = np.kron(feasible, np.ones((parts, parts), bool))
        end = (parts * goal[0] + parts // 2, parts * goal[1] + parts // 2)
        grid = distance_to_go(fine, end, 1 / parts)[
            tuple(parts * np.argwhere(feasible).T + parts // 2)
        ]
        assert np.array_equal(np.isfinite(grid), np.isfinite(exact))
        is_reached = np.isfinite(exact)
        assert np.all(exact[is_reached] <= grid[is_reached] + 1e-9)
        assert np.all(grid[is_reached] <= before + 1e-9)
        before = grid[is_reached]
    # the octile metric is at most 1.0824 of the straight line; corners are missed by half a part
    octile = sqrt(2) - 1
    assert np.all(before <= exact[is_reached] * hypot(1, octile) + 12 / 27)


@pytest.mark.parametrize("target_db", [-60.0, -61.8, -62.5, -65.0])
def test_on_the_papers_map_it_equals_the_straight_line_bound_of_every_cell(target_db):
    feasible = build_radio_map("paper").feasible(target_db)
    centres = -10 + 0.5 * (np.argwhere(feasible) + 0.5)
    to_go = euclidean_distance_to_go(feasible, (9.75, 0.25), 0.5, origin=(-10, -10))(centres)
    grid = distance_to_go(feasible, (39, 20), 0.5)[feasible]
    assert np.all(to_go <= grid + 1e-12)
    for n in range(0, len(centres), 7):
        cell = tuple(np.argwhere(feasible)[n])
        bound = straight_line_bound(feasible, cell, (39, 20), 0.5)
        assert to_go[n] == pytest.approx(bound, rel=1e-14)


def test_the_papers_own_problem_free_of_the_grid():
    feasible = build_radio_map("paper").feasible(-61.8)
    ends = ((-9.75, 0.25), (9.75, 0.25))
    path = straight_line_path(feasible, *ends, 0.5, origin=(-10.0, -10.0))
    to_go = euclidean_distance_to_go(feasible, ends[1], 0.5, origin=(-10.0, -10.0))
    assert path.distance == pytest.approx(21.742896182122568, rel=1e-14)
    assert to_go(ends[0]) == pytest.approx(path.distance, rel=1e-14)
    assert to_go.path(ends[0]).tolist() == path.points.tolist()
    assert path.distance < shortest_path(feasible, (0, 20), (39, 20), 0.5).distance


@pytest.mark.parametrize("seed", range(5))
def test_sight_is_that_of_exact_fractions(seed):
    rng = np.random.default_rng(seed)
    feasible = rng.random((5, 4)) < rng.choice([0.5, 0.7, 0.9])
    for corner_cutting in (True, False):
        sight = Sight(feasible, corner_cutting)
        places = [(x, y) for x in range(11) for y in range(9)]
        pairs = [pair for pair in combinations(places, 2) if rng.random() < 0.2]
        first, second = np.array(pairs).swapaxes(0, 1) / 2
        seen = sight.between(first, second)
        assert seen.tolist() == sight.between(second, first).tolist()
        expected = [is_inside(feasible, *pair) for pair in pairs]
        if corner_cutting:
            assert seen.tolist() == expected
        else:
            assert not np.any(seen & ~np.array(expected))


def test_without_corner_cutting_a_sight_may_end_where_cells_touch_but_not_pass():
    sight = Sight(cells("#.", ".#"), corner_cutting=False)
    low, corner, high = [[0.0, 0.5]], [[1.0, 1.0]], [[2.0, 1.5]]
    assert sight.between(np.array(low), np.array(corner)).all()
    assert sight.between(np.array(corner), np.array(high)).all()
    assert not sight.between(np.array(low), np.array(high)).any()


WALL = cells("..#..", "..#..", ".....")


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((2.0, 3.0), 2 + 1 + sqrt(5)),  # on the wall: down along its side, under it and up
        ((2.0, 1.0), 1 + sqrt(5)),  # at its lower corner
        ((2.5, 1.0), 0.5 + sqrt(5)),  # under it
        ((2.5, 1.5), inf),  # in it
        ((2.0 + 1e-10, 3.0), 2 + 1 + sqrt(5)),  # no further in it than rounding
        ((2.0 + 1e-6, 3.0), inf),
        ((0.0, 3.0), sqrt(8) + 1 + sqrt(5)),
        ((5.0, 3.0), 1.0),  # the far corner of the map
        ((5.1, 3.0), inf),  # off the map
        ((-1e300, 1e300), inf),
    ],
)
def test_hand_made_points(point, expected):
    to_go = euclidean_distance_to_go(WALL, (4.0, 3.0), 1.0)
    assert to_go(point) == pytest.approx(expected, abs=2e-9)


def test_metres_and_the_lower_left_corner_are_those_of_the_map():
    rng = np.random.default_rng(0)
    feasible = rng.random((8, 5)) < 0.8
    feasible[3, 2] = True
    points = rng.random((50, 2)) * (8, 5)
    in_cells = euclidean_distance_to_go(feasible, (3.2, 2.9), 1.0)
    origin = np.array([-7.0, 3.0])
    to_go = euclidean_distance_to_go(
        feasible, tuple(origin + 0.25 * np.array([3.2, 2.9])), 0.25, origin=(-7.0, 3.0)
    )
    assert to_go(origin + 0.25 * points) == pytest.approx(0.25 * in_cells(points), abs=1e-9)


def test_points_are_answered_in_the_shape_that_they_come_in_and_each_as_if_alone():
    rng = np.random.default_rng(1)
    feasible = rng.random((30, 20)) < 0.8
    feasible[29, 19] = True
    to_go = euclidean_distance_to_go(feasible, (29.5, 19.5), 1.0)
    points = rng.random((4, 25, 2)) * (30, 20)
    together = to_go(points)
    assert together.shape == (4, 25)
    assert together.tolist() == [[float(to_go(point)) for point in row] for row in points]
    assert to_go(np.empty((0, 2))).shape == (0,)


def test_nothing_leads_to_a_goal_that_is_not_feasible():
    to_go = euclidean_distance_to_go(WALL, (2.5, 2.0), 1.0)
    assert to_go([[2.5, 2.0], [0.5, 0.5], [2.5, 1.0]]).tolist() == [inf, inf, inf]
    nowhere = euclidean_distance_to_go(np.zeros((3, 2), bool), (1.0, 1.0), 1.0)
    assert nowhere([[1.0, 1.0]]).tolist() == [inf]
    assert nowhere.path([1.0, 1.0]).shape == (0, 2)


def test_two_ends_that_are_the_same_make_a_path_of_one_point():
    path = straight_line_path(WALL, (0.5, 0.5), (0.5, 0.5), 1.0)
    assert (path.distance, path.points.tolist()) == (0.0, [[0.5, 0.5]])
    to_go = euclidean_distance_to_go(WALL, (0.5, 0.5), 1.0)
    assert to_go.path([0.5, 0.5]).tolist() == [[0.5, 0.5]]


def test_a_path_keeps_the_robots_radius_and_passes_no_corner_that_it_may_not_cut():
    feasible = cells("#.", ".#")
    ends = ((0.5, 0.5), (1.5, 1.5))
    assert straight_line_path(feasible, *ends, 1.0).distance == pytest.approx(sqrt(2))
    assert straight_line_path(feasible, *ends, 1.0, corner_cutting=False) is None
    corridor = np.ones((9, 3), bool)
    ends = ((1.5, 1.5), (7.5, 1.5))
    assert straight_line_path(corridor, *ends, 1.0, robot_radius=1.5).distance == 6.0
    assert straight_line_path(corridor, *ends, 1.0, robot_radius=1.6) is None


def test_what_is_held_cannot_be_written_to():
    to_go = euclidean_distance_to_go(WALL, (0.5, 0.5), 1.0)
    for array in (to_go.points, to_go.lengths, to_go.after, to_go.offsets, to_go.candidates):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(
    ("points", "message"),
    [([[0.5, np.nan]], "finite"), ([[inf, 0.5]], "finite"), ([0.5], r"shape \(1,\)")],
)
def test_points_that_are_none_are_refused(points, message):
    to_go = euclidean_distance_to_go(WALL, (0.5, 0.5), 1.0)
    with pytest.raises(ValueError, match=message):
        to_go(points)


def test_an_end_off_the_map_is_named():
    with pytest.raises(ValueError, match=r"goal=\(5\.5, 0\.5\) lies off the map"):
        euclidean_distance_to_go(WALL, (5.5, 0.5), 1.0)
    with pytest.raises(ValueError, match=r"start=\(-1\.0, 0\.5\) lies off the map"):
        straight_line_path(WALL, (-1.0, 0.5), (0.5, 0.5), 1.0)


def test_a_map_with_too_many_corners_is_refused_before_it_is_searched(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "1GiB")
    feasible = np.arange(160_000).reshape(400, 400) % 7 > 0
    with pytest.raises(MemoryLimitError, match=r"lines of sight of \d+ corners and \d+ cells"):
        euclidean_distance_to_go(feasible, (0.5, 1.5), 1.0)


def test_behind_a_wall_the_way_around_either_end_is_the_shorter_one():
    feasible = np.ones((7, 12), bool)
    feasible[3, 2:10] = False  # x from 3 to 4, y from 2 to 10
    behind = np.stack([np.full(401, 4.0), np.linspace(2, 10, 401)], axis=1)
    for y in (4.0, 5.98, 6.02, 6.5, 7.3):  # of the goal: moves the ridge between both through cells
        to_go = euclidean_distance_to_go(feasible, (3.0, y), 1.0)
        around_low = (y - 2) + 1 + (behind[:, 1] - 2)
        around_high = (10 - y) + 1 + (10 - behind[:, 1])
        assert to_go(behind) == pytest.approx(np.minimum(around_low, around_high), abs=1e-12)
