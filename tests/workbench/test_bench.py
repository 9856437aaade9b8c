"""Facts of the bench: what is drawn is what the library computes, whatever was done before; what
cannot be done leaves all as it was.
"""

import numpy as np
import pytest

from irs_gym import (
    build_radio_map,
    highest_feasible_target,
    load_scene,
    shortest_path,
    trade_off,
)
from irs_gym.workbench.bench import SNAP, Bench, elements_range
from irs_gym.workbench.drawing import CELL_SIZE, draw
from irs_gym.workbench.handle import Handle, place_of

PAPER = load_scene("paper")


def assert_true(bench: Bench) -> None:
    """What is drawn is what the public functions give for the scene that is shown."""
    scene = bench.scene if bench.is_irs_on else bench.scene.with_irs_elements(0)
    radio_map = build_radio_map(scene, CELL_SIZE)
    grid = radio_map.grid
    ends = grid.cell_of(scene.start), grid.cell_of(scene.goal)
    feasible = radio_map.feasible(scene.target_db)
    path = shortest_path(feasible, *ends, CELL_SIZE)
    steps = trade_off(radio_map.gain_db, *ends, CELL_SIZE)
    drawn = bench.drawing

    assert drawn.scene == bench.shown_scene == scene
    np.testing.assert_array_equal(drawn.radio_map.gain_db, radio_map.gain_db)
    np.testing.assert_array_equal(drawn.feasible, feasible)
    assert (drawn.path and drawn.path.distance) == (path and path.distance)
    np.testing.assert_array_equal(drawn.trade_off.targets_db, steps.targets_db)
    np.testing.assert_array_equal(drawn.trade_off.distances, steps.distances)
    assert drawn.highest_target_db == highest_feasible_target(radio_map.gain_db, *ends)


def test_what_is_drawn_is_true_after_any_acts():
    rng = np.random.default_rng(0)
    bench = Bench.of(PAPER)
    parts = [Handle("start"), Handle("goal"), Handle("access_points"), Handle("irs_panels")]
    parts += [Handle("obstacles", n) for n in range(5)]
    refused = 0

    for _ in range(24):
        kind = rng.integers(5)
        if kind == 0:
            bench = bench.with_target(float(rng.uniform(-66, -58)))
        elif kind == 1:
            bench = bench.with_elements(200 * int(rng.integers(0, 12)))
        elif kind == 2:
            bench = bench.with_phase_bits([None, 1, 2][rng.integers(3)])
        else:
            at = place_of(bench.scene, parts[rng.integers(len(parts))])
            to = tuple((np.array(at) + rng.uniform(-4, 4, 2)).tolist())
            bench = bench.taken(at).dragged(to).dropped()
        refused += bench.refusal is not None
        assert_true(bench)

    assert 0 < refused < 12


def test_parts_move_by_whole_steps_from_where_they_were():
    bench = Bench.of(PAPER).taken((0.3, 0.2))
    for x in (0.31, 0.6, 0.9, 1.31):
        bench = bench.dragged((x, 0.2))
    assert bench.held == Handle("obstacles", 2)
    assert bench.scene.obstacles[2].center == (4 * SNAP, 0.0)


def test_a_hand_that_stays_within_a_step_draws_nothing_anew():
    bench = Bench.of(PAPER).taken((0.3, 0.2)).dragged((0.6, 0.2))
    assert bench.dragged((0.61, 0.21)) is bench


def test_a_refused_move_leaves_the_last_good_state_drawn_and_says_why():
    good = Bench.of(PAPER).taken((-10.0, 0.0)).dragged((-9.0, 0.0))
    bad = good.dragged((0.0, 0.0))
    assert bad.why("part") == "start=(0.0, 0.0) lies inside an obstacle"
    assert bad.refused_by == (10.0, 0.0)
    assert bad.drawing is good.drawing
    dropped = bad.dropped()
    assert (dropped.scene, dropped.why("part")) == (good.scene, bad.why("part"))
    assert dropped.refused_by is None
    assert bad.dragged((-8.0, 0.0)).refusal is None


@pytest.mark.parametrize("target_db", [np.nan, np.inf, -np.inf])
def test_a_target_that_is_no_number_is_refused_at_its_field(target_db):
    bench = Bench.of(PAPER).with_target(target_db)
    assert "target_db" in bench.why("target_db")
    assert not bench.why("part")
    assert bench.scene == PAPER


def test_a_number_of_elements_that_fills_no_row_is_refused_at_its_field():
    bench = Bench.of(PAPER).with_elements(250)
    assert "irs_elements=250 does not fill whole rows" in bench.why("irs_elements")
    assert bench.scene == PAPER


def test_panels_without_elements_come_back():
    bench = Bench.of(PAPER).with_elements(0)
    assert bench.shown_scene.irs_panels == ()
    assert not bench.drawing.trade_off.targets_db.size or bench.drawing.highest_target_db < -60
    back = bench.with_elements(1200)
    assert back.scene == PAPER
    np.testing.assert_array_equal(
        back.drawing.radio_map.gain_db, Bench.of(PAPER).drawing.radio_map.gain_db
    )


def test_every_stop_of_the_elements_slider_fits():
    for name in ("paper", "workshop", "ward", "warehouse"):
        scene = load_scene(name)
        now, most, step = elements_range(scene)
        assert (now % step, most % step) == (0, 0)
        for elements in (step, now, most):
            assert scene.with_irs_elements(elements).irs_panels[0].elements == elements


def test_twins_are_held_and_what_is_removed_is_not():
    bench = Bench.of(PAPER).taken((0.0, 0.0)).dropped().duplicated()
    assert bench.held == Handle("obstacles", 5)
    assert_true(bench)
    assert bench.removed().held is None
    assert bench.removed().scene == PAPER


def test_the_last_access_point_is_not_removed_and_that_is_said():
    bench = Bench.of(PAPER).taken((0.0, 10.0)).dropped().removed()
    assert "access_points" in bench.why("part")
    assert bench.scene == PAPER


def test_a_floor_too_large_to_follow_a_hand_is_refused_before_any_work():
    room = PAPER.room.model_copy(update={"x_max": 1e6 - 10, "y_max": 1e6 - 10})
    with pytest.raises(ValueError, match=r"room: \d+ x \d+ cells of 0.5 m are more than the 40000"):
        draw(PAPER.model_copy(update={"room": room}))


def test_cells_that_do_not_tile_the_room_are_told():
    room = PAPER.room.model_copy(update={"x_max": 10.2})
    with pytest.raises(ValueError, match=r"cell_size=0\.5"):
        draw(PAPER.model_copy(update={"room": room}))
