"""Facts of the fewest configurations, and of codebooks that cover a task: a best path survives."""

from functools import cache

import numpy as np
import pytest

from irs_gym import (
    Robot,
    build_radio_map,
    codebook_gain_db,
    cover_codebook,
    fewest_configurations,
    focused_codebook,
    joint_shortest_path,
    load_scene,
    shortest_path,
    switch_front,
)

START, GOAL = (0, 10), (19, 10)  # of the paper's scene, in cells of a metre
TARGETS = (-61.8, -61.0, -60.5)


@cache
def table(target_db, bits=None):
    return fewest_configurations("paper", target_db, 1.0, phase_bits=bits)


@cache
def cover(size, target_db):
    return cover_codebook("paper", size, target_db, cell_size=1.0)


@pytest.mark.parametrize("target_db", TARGETS)
def test_the_fewest_configurations_are_the_front_of_all_focused_ones(target_db):
    radio_map = build_radio_map("paper", 1.0)
    found = table(target_db)
    assert np.array_equal(found.cells, np.argwhere(radio_map.free))
    best = shortest_path(radio_map.feasible(target_db), START, GOAL, 1.0)
    assert found.following == best.distance

    gain_db = codebook_gain_db("paper", focused_codebook("paper", found.cells, 1.0), 1.0)
    front = switch_front(gain_db, target_db, START, GOAL, 1.0)
    assert found.front.switches.tolist() == front.switches.tolist()
    assert found.front.distances.tolist() == front.distances.tolist()


def test_the_papers_table_stands():
    found = fewest_configurations("paper", -61.8)
    assert round(found.following, 3) == 23.228
    assert found.front.switches.tolist() == [0, 1, 2, 3]
    assert found.front.distances.round(3).tolist() == [25.642, 24.471, 23.642, 23.228]


def test_a_panel_that_switches_in_place_may_lose_to_one_that_follows_the_robot():
    # no configuration serves both ends of some move of the shortest path
    found = table(-61.4)
    assert found.following == pytest.approx(24.799, abs=1e-3)
    assert found.front.distances.round(3).tolist() == [25.142]


def test_ends_elements_and_phase_bits_are_those_asked_for():
    near = fewest_configurations("paper", -61.8, 1.0, start=(0, 10), goal=(1, 10))
    assert near.front.distances.tolist() == [1.0]
    coarse = table(-60.5, bits=1)
    assert (
        coarse.following
        == shortest_path(
            build_radio_map("paper", 1.0, phase_bits=1).feasible(-60.5), START, GOAL, 1.0
        ).distance
    )
    assert coarse.front.distances[-1] > table(-60.5).front.distances[-1]
    with pytest.raises(ValueError, match=r"with the 320 configurations: the highest joint target"):
        fewest_configurations("paper", -61.0, 1.0, irs_elements=200)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 8, 16])
@pytest.mark.parametrize("target_db", TARGETS)
def test_the_best_path_that_so_few_configurations_have_survives_a_cover(size, target_db):
    codebook = cover(size, target_db)
    assert codebook.size == size
    gain_db = codebook_gain_db("paper", codebook, 1.0)
    front = table(target_db).front
    used = [len(np.unique(path.configurations)) for path in front.paths]

    if min(used) > size:
        assert codebook.design.startswith("cover: greedy")
        return
    metres = min(d for d, few in zip(front.distances, used, strict=True) if few <= size)
    assert switch_front(gain_db, target_db, START, GOAL, 1.0).distances[-1] == metres
    assert f"path of {metres:.3f} m" in codebook.design
    assert codebook.design.startswith("cover: exact") == (metres == front.distances[-1])


@pytest.mark.parametrize("target_db", TARGETS)
def test_with_room_for_the_whole_front_a_cover_is_best_at_any_cost(target_db):
    gain_db = codebook_gain_db("paper", cover(16, target_db), 1.0)
    own = switch_front(gain_db, target_db, START, GOAL, 1.0)
    front = table(target_db).front
    assert own.switches.tolist() == front.switches.tolist()
    assert own.distances.tolist() == front.distances.tolist()
    # from the best of the first configurations
    for cost in (0.0, 0.5, 3.0):
        best = min(
            joint_shortest_path(gain_db, target_db, START, GOAL, 1.0, cost, first).distance
            for first in np.flatnonzero(gain_db[:, *START] >= target_db).tolist()
        )
        assert best == pytest.approx((front.distances + cost * front.switches).min(), abs=1e-9)


def test_the_greedy_part_serves_the_most_of_what_is_served_least():
    target_db = -60.5
    codebook = cover(8, target_db)
    candidates = focused_codebook("paper", table(target_db).cells, 1.0)
    covers = codebook_gain_db("paper", candidates, 1.0) >= target_db
    own = codebook_gain_db("paper", codebook, 1.0) >= target_db
    (path,) = table(target_db).front.paths
    fixed = len(np.unique(path.configurations))
    for n in range(fixed, 8):
        times = np.count_nonzero(own[:n], axis=0)
        least = times == times[covers.any(axis=0)].min()
        assert (
            np.count_nonzero(own[n] & least) == np.count_nonzero(covers & least, axis=(1, 2)).max()
        )


ROBOTS = [
    {"corner_cutting": False},
    {"robot_radius": 0.9},
    {"collision": "body", "robot_radius": 0.6, "corner_cutting": False},
]


@pytest.mark.parametrize("asked", ROBOTS, ids=str)
def test_a_robot_has_its_own_front_and_its_own_cover(asked):
    target_db, ends = -60.5, ((2, 10), (17, 10))
    arguments = {"cell_size": 1.0, "start": ends[0], "goal": ends[1], **asked}
    found = fewest_configurations("paper", target_db, **arguments)
    fit = Robot(**asked).fit(build_radio_map("paper", 1.0), load_scene("paper"))
    free = fit.radio_map.free
    assert np.array_equal(found.cells, np.argwhere(free))
    feasible = fit.radio_map.feasible(target_db)
    assert found.following == shortest_path(feasible, *ends, 1.0, **fit.motion).distance

    def front_of(codebook):
        gain_db = np.where(free, codebook_gain_db("paper", codebook, 1.0), -np.inf)
        return switch_front(gain_db, target_db, *ends, 1.0, **fit.motion)

    front = front_of(focused_codebook("paper", found.cells, 1.0))
    assert found.front.distances.tolist() == front.distances.tolist()
    assert found.front.switches.tolist() == front.switches.tolist()
    own = front_of(cover_codebook("paper", 16, target_db, **arguments))
    assert own.distances.tolist() == front.distances.tolist()
    assert own.switches.tolist() == front.switches.tolist()


def test_an_end_where_the_robot_cannot_be_is_refused_by_name():
    for work in (
        fewest_configurations,
        lambda *args, **kwargs: cover_codebook("paper", 4, -61.0, **kwargs),
    ):
        with pytest.raises(ValueError, match=r"start=\(0, 10\) .*robot_radius=0.6 m"):
            work("paper", -61.0, cell_size=1.0, robot_radius=0.6)
        with pytest.raises(ValueError, match="collision='bodies' must be one of"):
            work("paper", -61.0, cell_size=1.0, collision="bodies")


def test_no_configuration_of_a_cover_is_chosen_twice():
    shifts = cover(16, -61.0).phase_shifts
    assert len(np.unique(shifts, axis=0)) == 16


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, -61.0), "size=0 must be a positive number"),
        ((1.5, -61.0), "size=1.5 must be a positive number"),
        ((321, -61.0), "size=321 is more than the 320 free cells"),
        ((4, float("nan")), "target_db=nan must be a number of dB"),
        ((4, -50.0), r"target_db=-50.0 is infeasible from \(0, 10\) to \(19, 10\)"),
    ],
)
def test_arguments_that_are_none_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        cover_codebook(load_scene("paper"), *arguments, cell_size=1.0)


def test_an_end_that_is_no_cell_is_refused():
    with pytest.raises(ValueError, match=r"start=\(99, 0\) lies off the map"):
        fewest_configurations("paper", -61.0, 1.0, start=(99, 0))
