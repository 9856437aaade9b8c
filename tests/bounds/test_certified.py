"""Facts of the certified bounds: they hold against plain sampling and random paths, and say what
they cannot tell.
"""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from irs_gym import Scene, build_radio_map, certified_bounds, load_scene, straight_line_bound
from irs_gym.memory import MemoryLimitError
from irs_gym.radio.irs import Hardware
from irs_gym.radio.radio_map import serve

PAPER = load_scene("paper")
START = (-9.725, 0.275)  # centres of cells of 0.05 m beside those of the paper's start and goal
GOAL = (9.725, 0.275)
CASES = [(target_db, None) for target_db in (-64.0, -62.5, -62.0, -61.8, -61.2, -60.0)]
CASES += [(-64.0, 0), (-62.5, 0)]

each_case = pytest.mark.parametrize(("target_db", "irs_elements"), CASES)


@cache
def bounds_at(target_db, irs_elements):
    return certified_bounds(PAPER, target_db, start=START, goal=GOAL, irs_elements=irs_elements)


@cache
def sampled_map(irs_elements):
    return build_radio_map(PAPER, 0.05, irs_elements)


def points_along(path, count):
    """So many points of a polyline, evenly by length, and its corners."""
    pieces = np.hypot(*np.diff(path, axis=0).T)
    at = np.append(0, np.cumsum(pieces))
    where = np.sort(np.append(np.linspace(0, at[-1], count), at))
    return np.stack([np.interp(where, at, path[:, axis]) for axis in (0, 1)], axis=1)


def is_feasible(points, target_db, irs_elements):
    """Whether the radio model itself gives all points the target, and none lies in an obstacle."""
    scene = PAPER.with_irs_elements(irs_elements)
    positions = np.column_stack([points, np.full(len(points), scene.antenna_height)])
    gains, _, _ = serve(scene, Hardware(), positions, needs_shifts=False)
    is_inside = np.all(np.abs(points) <= 10 + 1e-9)
    return bool(is_inside and np.all(10 * np.log10(gains) >= target_db)) and not bool(
        scene.floor.is_covered(points).any()
    )


@each_case
def test_the_bracket_is_within_a_thousandth_and_its_path_has_the_upper_length(
    target_db, irs_elements
):
    bounds = bounds_at(target_db, irs_elements)
    length = np.hypot(*np.diff(bounds.path, axis=0).T).sum()
    assert 0 < bounds.lower <= bounds.upper
    assert bounds.gap <= 1e-3
    assert length <= bounds.upper == pytest.approx(length, rel=2e-9)
    assert np.array_equal(bounds.path[[0, -1]], [START, GOAL])


@each_case
def test_the_path_is_feasible_at_ten_thousand_points_of_the_radio_model(target_db, irs_elements):
    points = points_along(bounds_at(target_db, irs_elements).path, 10_000)
    assert is_feasible(points, target_db, irs_elements)


@each_case
def test_plain_sampling_on_a_fine_grid_overlaps_the_bracket(target_db, irs_elements):
    radio_map = sampled_map(irs_elements)
    ends = [radio_map.grid.cell_of(point) for point in (START, GOAL)]
    # a cell and the eight around it: all of them, or any
    lowest = minimum_filter(radio_map.gain_db, 3, mode="nearest")
    highest = np.where(
        radio_map.free, maximum_filter(radio_map.gain_db, 3, mode="nearest"), -np.inf
    )
    pessimistic = straight_line_bound(lowest >= target_db, *ends, 0.05)
    optimistic = straight_line_bound(highest >= target_db, *ends, 0.05)

    bounds = bounds_at(target_db, irs_elements)
    assert optimistic <= bounds.upper
    assert bounds.lower <= pessimistic


@each_case
def test_no_feasible_path_of_many_at_random_is_shorter_than_the_lower_bound(
    target_db, irs_elements
):
    bounds = bounds_at(target_db, irs_elements)
    rng = np.random.default_rng(0)
    shorter = 0

    for _ in range(300):
        # the best path with its corners moved and more of them, or one at random
        if rng.random() < 0.8:
            path = points_along(bounds.path, int(rng.integers(2, 9)))
            path[1:-1] += rng.normal(0, 10 ** rng.uniform(-4, 0), path[1:-1].shape)
        else:
            path = np.array([START, *rng.uniform(-10, 10, (int(rng.integers(0, 3)), 2)), GOAL])
        length = np.hypot(*np.diff(path, axis=0).T).sum()
        if length < bounds.lower:
            shorter += 1
            assert not is_feasible(points_along(path, 4000), target_db, irs_elements)

    assert shorter or bounds.lower == pytest.approx(np.hypot(19.45, 0), rel=1e-6)


def test_a_path_that_may_go_straight_has_the_length_of_the_line():
    bounds = certified_bounds(PAPER, -90.0, start=(-9.0, -9.0), goal=(9.0, -8.0))
    assert bounds.path.tolist() == [[-9.0, -9.0], [9.0, -8.0]]
    assert bounds.lower == pytest.approx(np.hypot(18, 1), rel=1e-8)


def test_around_an_obstacle_it_touches_the_corners():
    bounds = certified_bounds(PAPER, -90.0, start=(-2.0, -1.0), goal=(2.0, -1.0))
    assert bounds.upper == pytest.approx(6.0, rel=1e-8)
    assert bounds.path.round(6).tolist() == [[-2, -1], [-2, -2], [2, -2], [2, -1]]


def test_around_slanted_obstacles_it_keeps_out_of_them_and_touches_a_corner():
    corner = (0.3, 4.1)
    triangle = {"polygon": [(-3.0, -5.0), (4.0, -5.0), corner], "height": 1.3}
    scene = Scene.from_data({**PAPER.to_data(), "format_version": 2, "obstacles": [triangle]})
    bounds = certified_bounds(scene, -90.0, start=(-9.0, 0.0), goal=(9.0, 1.0))
    exact = np.hypot(9.3, 4.1) + np.hypot(8.7, 3.1)
    assert bounds.lower <= exact <= bounds.upper
    assert bounds.gap <= 1e-3
    assert not scene.floor.is_covered(points_along(bounds.path, 10_000)).any()


def test_a_finer_tolerance_narrows_the_bracket_within_the_wider_one():
    wide = certified_bounds(PAPER, -62.0, 1e-2)
    narrow = certified_bounds(PAPER, -62.0, 1e-4)
    assert wide.lower <= narrow.lower <= narrow.upper <= wide.upper
    assert narrow.gap <= 1e-4
    assert len(narrow.cells) > len(wide.cells)


def test_cells_tile_what_no_obstacle_takes_and_the_path_runs_through_feasible_ones():
    bounds = certified_bounds(PAPER, -61.8, 1e-2)
    sides = bounds.cells[:, 2:] - bounds.cells[:, :2]
    assert np.prod(sides, axis=1).sum() == pytest.approx(400 - 5 * 16)

    sure = bounds.cells[bounds.states == 1]
    points = points_along(bounds.path, 2000)[:, None]
    is_in = np.all((points >= sure[:, :2] - 1e-9) & (points <= sure[:, 2:] + 1e-9), axis=2)
    assert is_in.any(axis=1).all()


def test_elements_phases_and_array_model_are_those_that_are_asked_for():
    lengths = {
        name: certified_bounds(PAPER, -62.0, **arguments)
        for name, arguments in {
            "continuous": {},
            "coherent": {"array_model": "coherent"},
            "3 bits": {"phase_bits": 3},
            "fewer elements": {"irs_elements": 200},
        }.items()
    }
    assert lengths["coherent"].lower <= lengths["continuous"].upper
    assert lengths["continuous"].lower <= lengths["3 bits"].upper
    assert lengths["continuous"].upper < lengths["fewer elements"].lower


def test_no_path_at_the_target_is_an_error_that_names_one_at_which_there_is():
    ends = {"start": (0.0, 9.5), "goal": (1.0, -9.9)}
    with pytest.raises(ValueError, match=r"no path .* one is known up to -\d+\.\d+ dB") as error:
        certified_bounds(PAPER, -57.9, **ends)
    highest = float(str(error.value).split("up to ")[1].split(" dB")[0])
    assert certified_bounds(PAPER, highest - 0.5, 1e-2, **ends).path.size


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tolerance": 0.0}, "tolerance=0.0 must be"),
        ({"tolerance": float("nan")}, "tolerance=nan must be"),
        ({"tolerance": True}, "tolerance=True must be"),
        ({"tolerance": 1.5}, "tolerance=1.5 must be"),
        ({"target_db": float("inf")}, "target_db=inf must be"),
        ({"target_db": -50.0}, "start=.* has a gain of -59"),
        ({"target_db": -58.0, "start": (0.0, 9.0)}, "goal=.* has a gain of -59"),
        ({"start": (0.0, 0.0)}, "start=.* lies inside an obstacle"),
        ({"goal": (5.0, -5.0)}, "goal=.* lies inside an obstacle"),
        ({"goal": (11.0, 0.0)}, "goal=.* lies outside the room"),
        ({"goal": (float("nan"), 0.0)}, "goal=.* must be two finite numbers"),
        ({"start": (10.0, 0.0)}, "goal=.* must differ from start"),
        ({"array_model": "spherical"}, "array_model='spherical' has no bounds"),
        ({"phase_bits": 1, "quantiser": "as_printed"}, "quantiser='as_printed' has no bounds"),
        ({"cell_size": -1.0}, "cell_size=-1.0"),
        ({"most_cells": 0}, "most_cells=0 must be"),
        ({"most_cells": 2.5}, "most_cells=2.5 must be"),
        ({"irs_elements": 7}, "irs_elements=7"),
    ],
)
def test_arguments_out_of_their_range_are_told(arguments, message):
    with pytest.raises(ValueError, match=message):
        certified_bounds(PAPER, **arguments)


def test_scenes_without_bounds_are_told():
    with pytest.raises(ValueError, match="room: bounds are known for rectangles"):
        certified_bounds("ward")
    walls = {**PAPER.to_data(), "format_version": 2, "path_loss": {"wall_loss_db": 3.0}}
    with pytest.raises(ValueError, match="path_loss: bounds are not known"):
        certified_bounds(Scene.from_data(walls))


def test_cells_beyond_the_memory_limit_are_refused(monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "1MiB")
    with pytest.raises(MemoryLimitError, match="cells"):
        certified_bounds(PAPER, -61.8)
