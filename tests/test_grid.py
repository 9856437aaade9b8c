"""Facts of the grid: where cells lie, which cell holds a point, which moves are legal."""

from fractions import Fraction
from math import nan, sqrt

import networkx as nx
import numpy as np
import pytest

from irs_gym.grid import (
    MOVE_LENGTHS,
    MOVE_NAMES,
    MOVES,
    Grid,
    cells_at,
    flat_cells,
    legal_moves,
    neighbours,
    octile_distance,
)

PAPER = Grid.tile((-10.0, -10.0), (10.0, 10.0), 0.5)
SIZES = ["1/10", "1/5", "1/4", "1/3", "2/5", "1/2", "2/3", "1", "5/2"]


def tiled(size: str, low: str = "-10", high: str = "10") -> tuple[Grid, Fraction, Fraction]:
    grid = Grid.tile((float(low), float(low)), (float(high), float(high)), float(Fraction(size)))
    return grid, Fraction(low), Fraction(size)


def test_the_papers_floor_has_40_by_40_cells_with_centres_from_minus_9_75_to_9_75():
    expected = [-9.75 + 0.5 * n for n in range(40)]
    assert PAPER.shape == (40, 40)
    assert PAPER.centres()[:, 7, 0].tolist() == PAPER.centres()[7, :, 1].tolist() == expected
    assert PAPER.upper == (10.0, 10.0)


def test_i_runs_along_x_and_j_along_y():
    grid = Grid.tile((0.0, 0.0), (3.0, 2.0), 1.0)
    assert grid.shape == (3, 2)
    assert grid.centres()[2, 0].tolist() == [2.5, 0.5] == list(grid.centre((2, 0)))
    assert grid.cell_of((2.5, 0.5)) == (2, 0)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("low", "high"), [("-10", "10"), ("0.1", "20.1"), ("-1000.3", "-980.3")])
def test_every_centre_lies_in_its_own_cell(size, low, high):
    grid, *_ = tiled(size, low, high)
    centres = grid.centres()
    for n in range(grid.shape[0]):
        assert grid.cell_of(tuple(centres[n, -1 - n])) == (n, grid.shape[1] - 1 - n)
        assert grid.centre((n, 0)) == tuple(centres[n, 0])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("low", "high"), [("-10", "10"), ("0.1", "20.1"), ("-1000.3", "-980.3")])
def test_a_border_belongs_to_the_upper_cell_and_the_outer_border_to_the_last(size, low, high):
    grid, corner, edge = tiled(size, low, high)
    for n in range(grid.shape[0] + 1):
        border = float(corner + n * edge)  # the nearest double, on whichever side it falls
        assert grid.cell_of((border, border)) == (min(n, grid.shape[0] - 1),) * 2


def test_the_papers_start_and_goal_are_the_cells_above_the_middle_line():
    assert PAPER.cell_of((-10.0, 0.0)) == (0, 20)
    assert PAPER.cell_of((10.0, 0.0)) == (39, 20)
    assert PAPER.centre((0, 20)) == (-9.75, 0.25)
    assert PAPER.centre((39, 20)) == (9.75, 0.25)


@pytest.mark.parametrize(
    "point", [(10.001, 0.0), (-10.001, 0.0), (0.0, 11.0), (0.0, -11.0), (nan, 0.0)]
)
def test_a_point_outside_has_no_cell(point):
    with pytest.raises(
        ValueError, match=r"the point .* lies outside the floor from \(-10.0, -10.0\)"
    ):
        PAPER.cell_of(point)


@pytest.mark.parametrize("size", SIZES)
def test_sizes_that_divide_the_floor_tile_it_exactly(size):
    grid, _, edge = tiled(size)
    assert grid.shape == (20 / edge, 20 / edge)


@pytest.mark.parametrize("size", [0.3, 0.7, 3.0, 19.0, 30.0, 50.0])
def test_a_size_that_does_not_divide_the_floor_is_refused_with_one_that_does(size):
    with pytest.raises(
        ValueError, match=rf"cell_size={size} does not divide the room's 20 m along x: .* m would"
    ) as e:
        Grid.tile((-10.0, -10.0), (10.0, 10.0), size)
    better = float(str(e.value).rsplit(": ")[1].removesuffix(" m would"))
    assert 20 / better == pytest.approx(round(20 / better), rel=1e-5)


def test_both_sides_must_be_divided():
    with pytest.raises(ValueError, match="does not divide the room's 7 m along y"):
        Grid.tile((0.0, 0.0), (10.0, 7.0), 2.0)


@pytest.mark.parametrize("size", [0, 0.0, -0.5, nan, float("inf"), "0.5", None, 1j])
def test_a_cell_size_that_is_no_positive_number_is_refused(size):
    with pytest.raises(ValueError, match=r"cell_size=.* must be a positive number of metres"):
        Grid.tile((-10.0, -10.0), (10.0, 10.0), size)
    with pytest.raises(ValueError, match=r"cell_size=.* must be a positive number of metres"):
        Grid((2, 2), size, (0.0, 0.0))


@pytest.mark.parametrize("origin", [(0.0,), (0.0, 1.0, 2.0), (0.0, nan), (float("inf"), 0.0)])
def test_an_origin_is_two_finite_numbers(origin):
    with pytest.raises(ValueError, match=r"origin=.* must be two finite numbers"):
        Grid((2, 2), 0.5, origin)


def test_the_grid_has_the_cells_from_zero_to_its_shape():
    grid = Grid((3, 2), 1.0, (0.0, 0.0))
    assert [(i, j) for i in range(-2, 6) for j in range(-2, 6) if grid.has((i, j))] == list(
        np.ndindex(3, 2)
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (6, 1), (4, 7)])
def test_flat_cells_number_a_map_row_by_row(shape):
    grid = Grid(shape, 1.0, (0.0, 0.0))
    cells = np.array(list(np.ndindex(shape)))
    numbers = np.arange(shape[0] * shape[1])
    np.testing.assert_array_equal(flat_cells(cells, shape), numbers)
    np.testing.assert_array_equal(cells_at(numbers, shape), cells)
    np.testing.assert_array_equal(cells_at(numbers.reshape(shape), shape), cells.reshape(*shape, 2))
    assert [grid.flat(tuple(cell)) for cell in cells.tolist()] == numbers.tolist()
    assert [list(grid.cell_at(number)) for number in numbers.tolist()] == cells.tolist()
    assert np.arange(numbers.size).reshape(shape)[grid.cell_at(grid.flat((0, 0)))] == 0


# --- moves ----------------------------------------------------------------------------------------


def test_moves_run_counter_clockwise_from_east():
    angles = np.degrees(np.arctan2(MOVES[:, 1], MOVES[:, 0])) % 360
    assert angles.tolist() == [0, 45, 90, 135, 180, 225, 270, 315]
    assert MOVE_NAMES == ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
    assert MOVE_LENGTHS.tolist() == pytest.approx([1, sqrt(2)] * 4, rel=1e-15)


def test_nobody_can_change_the_moves():
    with pytest.raises(ValueError, match="read-only"):
        MOVES[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        MOVE_LENGTHS[0] = 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (6, 1), (2, 3), (7, 9)])
def test_a_move_is_legal_where_its_end_is_on_the_map_and_free(shape):
    free = np.random.default_rng(5).random(shape) < 0.6
    legal = legal_moves(free)
    assert legal.shape == (*shape, 8)
    assert legal.dtype == bool
    for i, j in np.ndindex(shape):
        for n, (di, dj) in enumerate(MOVES):
            on_map = 0 <= i + di < shape[0] and 0 <= j + dj < shape[1]
            assert legal[i, j, n] == (on_map and free[i + di, j + dj])


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (3, 2, 4), (2, 3, 4, 5)])
def test_neighbours_are_the_values_that_moves_lead_to(shape):
    values = np.random.default_rng(3).normal(size=shape)
    found = neighbours(values, np.inf)
    assert found.shape == (*shape, 8)
    np.testing.assert_array_equal(np.moveaxis(found, -1, 0), neighbours(values, np.inf, axis=0))
    for *maps, i, j in np.ndindex(shape):
        for n, (di, dj) in enumerate(MOVES):
            on_map = 0 <= i + di < shape[-2] and 0 <= j + dj < shape[-1]
            assert found[*maps, i, j, n] == (values[*maps, i + di, j + dj] if on_map else np.inf)


def test_diagonal_moves_may_cut_corners():
    free = np.array([[True, False], [False, True]])
    assert np.flatnonzero(legal_moves(free)[0, 0]).tolist() == [MOVE_NAMES.index("NE")]
    assert np.flatnonzero(legal_moves(free)[1, 1]).tolist() == [MOVE_NAMES.index("SW")]


def test_octile_distance_is_the_shortest_path_over_an_empty_floor():
    floor = nx.Graph()
    for i, j in np.ndindex(9, 6):
        for di, dj in [(1, 0), (0, 1), (1, 1), (1, -1)]:
            if i + di < 9 and 0 <= j + dj < 6:
                floor.add_edge((i, j), (i + di, j + dj), weight=sqrt(di * di + dj * dj))
    for start in [(0, 0), (4, 3), (8, 1)]:
        lengths = nx.single_source_dijkstra_path_length(floor, start)
        apart = np.array(list(lengths)) - start
        assert octile_distance(apart) == pytest.approx(list(lengths.values()), abs=1e-12)


def test_octile_distance_keeps_the_shape_and_forgets_the_sign():
    assert octile_distance(np.zeros((4, 5, 2))).shape == (4, 5)
    assert octile_distance((-3, 4)) == octile_distance((4, -3)) == pytest.approx(1 + 3 * sqrt(2))
