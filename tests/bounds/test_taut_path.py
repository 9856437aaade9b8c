"""Facts of the shortest path inside polygons, against all lines of sight and the cells' own bound."""

from itertools import combinations

import networkx
import numpy as np
import pytest
import shapely

from irs_gym import straight_line_bound
from irs_gym.bounds.taut_path import shortest_in

GROWN = 1e-9


def brute_force(area, start, goal):
    """Shortest way over all corners of an area that see each other."""
    points = np.unique(np.vstack([start, goal, shapely.get_coordinates(area)]), axis=0)
    grown = shapely.buffer(area, 1e-9, join_style="mitre")
    graph = networkx.Graph()
    for first, second in combinations(map(tuple, points.tolist()), 2):
        if shapely.covers(grown, shapely.linestrings([first, second])):
            graph.add_edge(first, second, weight=float(np.hypot(*np.subtract(first, second))))
    ends = (tuple(start.tolist()), tuple(goal.tolist()))
    if not all(end in graph for end in ends) or not networkx.has_path(graph, *ends):
        return np.inf
    return networkx.dijkstra_path_length(graph, *ends)


@pytest.mark.parametrize("seed", range(30))
def test_it_is_the_shortest_way_over_all_corners_that_see_each_other(seed):
    rng = np.random.default_rng(seed)
    area = shapely.box(0, 0, 10, 10)
    for _ in range(int(rng.integers(1, 9))):
        corners = rng.uniform(0.5, 9.5, 2) + rng.uniform(-3, 3, (int(rng.integers(3, 6)), 2))
        area = area - shapely.convex_hull(shapely.multipoints(corners))
    start, goal = np.array([0.0, 0.0]), np.array([10.0, 9.0])
    if not shapely.covers(area, shapely.points([start, goal])).all():
        return

    path = shortest_in(area, start, goal, GROWN)
    assert path.length == pytest.approx(brute_force(area, start, goal), rel=1e-7)


@pytest.mark.parametrize("seed", range(30))
def test_over_cells_it_is_their_straight_line_bound(seed):
    rng = np.random.default_rng(seed)
    feasible = rng.random((12, 9)) < rng.choice([0.6, 0.75, 0.9])
    feasible[0, 0] = feasible[-1, -1] = True
    i, j = np.nonzero(feasible)
    area = shapely.union_all(shapely.box(i, j, i + 1, j + 1))

    path = shortest_in(area, np.array([0.5, 0.5]), np.array([11.5, 8.5]), GROWN)
    expected = straight_line_bound(feasible, (0, 0), (11, 8), 1.0)
    assert path.length == pytest.approx(expected, rel=1e-7)


def test_cells_of_many_sizes_about_a_disc_lead_around_it():
    """Staircases of a disc, cut ever finer: the path is the tangents and the arc."""
    cells = np.array([[x, y, x + 1, y + 1] for x in range(-4, 4) for y in range(-4, 4)], float)
    for _ in range(6):
        far = np.abs(np.stack([cells[:, :2], cells[:, 2:]])).max(axis=0)
        is_cut = np.hypot(*np.where(cells[:, :2] * cells[:, 2:] < 0, 0, np.minimum(
            np.abs(cells[:, :2]), np.abs(cells[:, 2:])
        )).T) < 2  # fmt: skip
        is_cut &= np.hypot(*far.T) > 2
        x0, y0, x1, y1 = cells[is_cut].T
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        quarters = [(x0, y0, x, y), (x, y0, x1, y), (x0, y, x, y1), (x, y, x1, y1)]
        cells = np.vstack([cells[~is_cut], *(np.stack(each, axis=1) for each in quarters)])

    nearest = np.maximum(np.maximum(cells[:, :2], -cells[:, 2:]), 0)
    outside = cells[np.hypot(*nearest.T) >= 2]
    area = shapely.union_all(shapely.box(*outside.T))
    path = shortest_in(area, np.array([-4.0, 0.0]), np.array([4.0, 0.0]), GROWN)
    exact = 2 * np.sqrt(16 - 4) + 2 * (np.pi - 2 * np.arccos(0.5))
    assert exact < path.length < exact + 0.1


def test_without_a_way_it_is_infinite_and_has_no_points():
    area = shapely.union_all(shapely.box([0, 3], [0, 0], [2, 5], [2, 2]))
    path = shortest_in(area, np.array([1.0, 1.0]), np.array([4.0, 1.0]), GROWN)
    assert path.length == np.inf
    assert path.points.shape == (0, 2)
