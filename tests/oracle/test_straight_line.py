from fractions import Fraction
from itertools import combinations, pairwise
from math import hypot, inf, sqrt

import networkx
import numpy as np
import pytest

from irs_gym import build_radio_map, shortest_path, straight_line_bound, trade_off


def cells(*rows):
    """Feasible map (X, Y) from rows of text, the top one the largest j; '#' is infeasible."""
    return np.array([[mark != "#" for mark in row] for row in reversed(rows)]).T


def is_inside(feasible, first, second):
    """Whether a segment between lattice points (half cells) stays inside the closed feasible cells:
    exact, slow.

    The segment is cut where it meets a border between cells; each piece lies in one cell or on one
    border.
    """
    (x0, y0), (x1, y1) = first, second
    cuts = {Fraction(0), Fraction(1)}
    for low, high in ((x0, x1), (y0, y1)):
        borders = [line for line in range(min(low, high) + 1, max(low, high)) if line % 2 == 0]
        cuts |= {Fraction(border - low, high - low) for border in borders}
    for before, after in pairwise(sorted(cuts)):
        middle = (before + after) / 2
        x, y = x0 + middle * (x1 - x0), y0 + middle * (y1 - y0)
        around = [
            (i, j)
            for i in ({x // 2} if x % 2 else {x // 2 - 1, x // 2})
            for j in ({y // 2} if y % 2 else {y // 2 - 1, y // 2})
        ]
        on_map = [
            cell
            for cell in around
            if 0 <= cell[0] < feasible.shape[0] and 0 <= cell[1] < feasible.shape[1]
        ]
        if not any(feasible[int(i), int(j)] for i, j in on_map):
            return False
    return True


def brute_force_bound(feasible, start, goal):
    """The shortest path in the visibility graph of all corners of all cells, in cells."""
    ends = [(2 * i + 1, 2 * j + 1) for i, j in (start, goal)]
    lattice = [
        (2 * i, 2 * j) for i in range(feasible.shape[0] + 1) for j in range(feasible.shape[1] + 1)
    ]
    graph = networkx.Graph()
    graph.add_nodes_from(ends)
    for first, second in combinations([*dict.fromkeys(ends), *lattice], 2):
        if is_inside(feasible, first, second):
            graph.add_edge(
                first, second, weight=hypot(second[0] - first[0], second[1] - first[1]) / 2
            )
    if not (feasible[start] and feasible[goal] and networkx.has_path(graph, *ends)):
        return inf
    return networkx.dijkstra_path_length(graph, *ends)


@pytest.mark.parametrize("seed", range(40))
def test_bound_equals_brute_force_over_all_corners_of_all_cells(seed):
    rng = np.random.default_rng(seed)
    feasible = rng.random((int(rng.integers(2, 7)), int(rng.integers(2, 7)))) < rng.choice(
        [0.4, 0.6, 0.8]
    )
    start, goal = (0, 0), (feasible.shape[0] - 1, feasible.shape[1] - 1)
    feasible[start] = feasible[goal] = True
    expected = brute_force_bound(feasible, start, goal)
    assert straight_line_bound(feasible, start, goal, 1.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("goal", [(7, 0), (7, 1), (6, 4), (0, 5), (3, 3), (0, 0)])
def test_with_nothing_in_the_way_it_is_the_straight_line(goal):
    bound = straight_line_bound(np.ones((8, 6), bool), (0, 0), goal, 0.25)
    assert bound == pytest.approx(0.25 * hypot(*goal), rel=1e-15)


@pytest.mark.parametrize("density", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("seed", range(4))
def test_it_is_never_above_the_oracle_nor_below_the_straight_line(seed, density):
    feasible = np.random.default_rng(seed).random((40, 40)) < density
    feasible[:2, :2] = feasible[-2:, -2:] = True
    path = shortest_path(feasible, (0, 0), (39, 39), 0.5)
    bound = straight_line_bound(feasible, (0, 0), (39, 39), 0.5)
    if path is None:
        assert bound == inf
    else:
        assert 0.5 * hypot(39, 39) <= bound <= path.distance


def test_it_is_below_the_oracle_on_the_paper_s_map_at_every_step_of_the_target():
    radio_map = build_radio_map("paper")
    curve = trade_off(radio_map.gain_db, (0, 20), (39, 20), 0.5)
    bounds = [
        straight_line_bound(radio_map.feasible(t), (0, 20), (39, 20), 0.5) for t in curve.targets_db
    ]
    assert all(
        19.5 < bound < distance for bound, distance in zip(bounds, curve.distances, strict=True)
    )
    assert bounds == sorted(bounds)


BLOCK = cells(".....", "..#..", ".....")  # one infeasible cell half-way
WALL = cells("..#..", "..#..", ".....")
SLIT = cells("..##..", "..##..", "......")


@pytest.mark.parametrize(
    ("feasible", "start", "goal", "expected"),
    [
        # over the two upper corners of the block: (0.5, 1.5) (2, 2) (3, 2) (4.5, 1.5)
        (BLOCK, (0, 1), (4, 1), 2 * hypot(1.5, 0.5) + 1),
        # a grazing line along the block's side is allowed
        (BLOCK, (0, 0), (4, 0), 4.0),
        # under the wall from the upper row: (0.5, 2.5) (2, 1) (3, 1) (4.5, 2.5)
        (WALL, (0, 2), (4, 2), 2 * hypot(1.5, 1.5) + 1),
        # the border between two infeasible cells is no way through
        (SLIT, (0, 2), (5, 2), 2 * hypot(1.5, 1.5) + 2),
        # cells that touch at a corner only are joined there: straight through
        (cells("#.", ".#"), (0, 0), (1, 1), sqrt(2)),
        # and a path may bend there, as in a room with one door of no width: (0.5, 0.5) (2, 1) (2.5,
        # 2.5)
        (cells("##.", "##.", "..#"), (0, 0), (2, 2), hypot(1.5, 0.5) + hypot(0.5, 1.5)),
        # along the diagonal of a staircase
        (cells("##.", "#.#", ".##"), (0, 0), (2, 2), 2 * sqrt(2)),
        # a corridor around a corner bends once, at the inner corner
        (cells("##.", "##.", "..."), (0, 0), (2, 2), 2 * hypot(1.5, 0.5)),
        # a straight corridor one cell wide
        (cells(".....", "#####", "....."), (0, 2), (4, 2), 4.0),
        (cells(".....", "#####", "....."), (0, 2), (4, 0), inf),
        (cells(".#", "#."), (0, 0), (1, 1), inf),  # both ends infeasible
        (cells("..", ".."), (1, 1), (1, 1), 0.0),
    ],
)
def test_hand_made_corners(feasible, start, goal, expected):
    for turned, ends in (
        (feasible, (start, goal)),
        (feasible.T, (start[::-1], goal[::-1])),
        (feasible[::-1], tuple((feasible.shape[0] - 1 - i, j) for i, j in (start, goal))),
        (feasible, (goal, start)),
    ):
        assert straight_line_bound(turned, *ends, 2.0) == pytest.approx(2 * expected, rel=1e-14)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (
            (249, 1),
            hypot(999, 2),
        ),  # its corner at (250, 1) lies 1/1998 of a cell above the line: missed
        (
            (250, 0),
            (hypot(499, 1) + hypot(1499, 3)) / 2,
        ),  # the same corner of this one is cut off: around it
    ],
)
def test_a_line_that_misses_a_corner_by_next_to_nothing_is_told_from_one_that_cuts_it(
    block, expected
):
    feasible = np.ones((1000, 3), bool)
    feasible[block] = False
    assert straight_line_bound(feasible, (0, 0), (999, 2), 1.0) == pytest.approx(
        expected, rel=1e-15
    )


def test_an_end_off_the_map_is_named():
    with pytest.raises(ValueError, match=r"goal=\(2, 0\) lies off the map"):
        straight_line_bound(np.ones((2, 2), bool), (0, 0), (2, 0), 1.0)
