"""Facts of generated scenes: always feasible, of the sizes promised, graded by their detour, files
like any other.
"""

import json
from itertools import pairwise

import numpy as np
import pytest

import irs_gym
from eval.unseen.scores import detours
from irs_gym.datasets.generator import (
    CELL_SIZE,
    DIFFICULTIES,
    LEAST_RANGE_DB,
    Difficulty,
    draw_solved_scene,
    generate_scene,
    least_distance,
)
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.oracle.shortest_path import highest_feasible_target, largest_component, shortest_path
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import load_scene
from irs_gym.units import wavelength_m

SAMPLE = [draw_solved_scene(np.random.default_rng(seed)) for seed in range(40)]
SCENES = [each.scene for each in SAMPLE]
PAPER = load_scene("paper")


def test_every_scene_is_feasible_at_its_own_target():
    for each in SAMPLE:
        feasible = each.radio_map.feasible(each.scene.target_db)
        path = shortest_path(feasible, each.start, each.goal, CELL_SIZE)
        assert path.distance == pytest.approx(each.oracle_distance, abs=1e-9)
        assert each.detour >= 1.0 - 1e-9


def test_the_target_lies_between_the_loosest_and_the_highest_feasible_one():
    shares = []
    for each in SAMPLE:
        gain = each.radio_map.gain_db
        loosest = gain[largest_component(each.radio_map.free)].min()
        highest = highest_feasible_target(gain, each.start, each.goal)
        assert highest - loosest >= LEAST_RANGE_DB
        assert loosest - 0.01 <= each.scene.target_db <= highest
        shares.append((each.scene.target_db - loosest) / (highest - loosest))
    assert min(shares) < 0.2
    assert max(shares) > 0.8


def test_start_and_goal_are_centres_of_cells_half_the_room_apart():
    for each in SAMPLE:
        scene, grid = each.scene, each.radio_map.grid
        assert (scene.start, scene.goal) == (grid.centre(each.start), grid.centre(each.goal))
        assert largest_component(each.radio_map.free)[each.start]
        assert np.hypot(*np.subtract(scene.start, scene.goal)) >= least_distance(scene.room)
    assert least_distance(PAPER.room) == 10.0


def test_three_of_five_scenes_are_drawn_until_they_need_a_detour_and_some_of_the_others_need_one_too():
    has_to = np.array([np.random.default_rng(seed).random() < 0.6 for seed in range(len(SAMPLE))])
    has_one = np.array([each.detour > 1.05 for each in SAMPLE])
    assert (has_to.sum(), has_one.sum()) == (24, 31)
    assert has_one[has_to].all()


def test_seven_of_ten_test_scenes_need_a_detour_over_5_percent():
    assert np.mean(detours(build_scene_set("test", 200)) > 1.05) == pytest.approx(0.717, abs=0.03)


def test_every_hard_scene_needs_a_detour_over_20_percent():
    assert (
        min(draw_solved_scene(np.random.default_rng(seed), "hard").detour for seed in range(8))
        > 1.2
    )


def test_easy_scenes_are_easier_than_those_of_the_default():
    easy = [draw_solved_scene(np.random.default_rng(seed), "easy").detour for seed in range(20)]
    assert np.median(easy) < 1.05 < np.median([each.detour for each in SAMPLE])


def test_rooms_boxes_and_panels_are_of_the_sizes_promised():
    for scene in SCENES:
        sides = np.subtract(scene.room.upper, scene.room.lower)
        assert ((sides >= 14) & (sides <= 20) & (sides % 0.5 == 0)).all()
        assert 3 <= len(scene.obstacles) <= 12
        assert all(400 <= panel.elements <= 2400 for panel in scene.irs_panels)
    heights = [box.size[2] for scene in SCENES for box in scene.obstacles]
    assert min(heights) < PAPER.antenna_height < max(heights)  # some do not block line of sight
    assert {scene.phase_bits for scene in SCENES} == {None, 1, 2, 3}
    flush = [box.lower[0] == scene.room.x_min for scene in SCENES for box in scene.obstacles]
    assert any(flush)
    assert not all(flush)


def test_access_point_and_panel_are_mounted_on_two_walls_and_stand_behind_no_box():
    walls = set()
    for scene in SCENES:
        (point,), (panel,), room = scene.access_points, scene.irs_panels, scene.room
        place = dict(zip("xy", point.position, strict=False))
        on = {
            wall
            for wall in ("x_min", "x_max", "y_min", "y_max")
            if place[wall[0]] == getattr(room, wall)
        }
        assert len(on | {panel.wall}) == 2
        walls |= on
        half = (
            panel.rows
            * panel.elements_per_subsurface[1]
            * panel.pitch_wavelengths
            * wavelength_m(2.0)
            / 2
        )
        assert half <= panel.position[2] <= room.height - half
        for box in scene.obstacles:
            for x, y, bottom in (point.position, (*panel.position[:2], panel.position[2] - half)):
                is_in = box.lower[0] <= x <= box.upper[0] and box.lower[1] <= y <= box.upper[1]
                assert not is_in or bottom > box.size[2]
    assert len(walls) == 4


def test_the_radio_is_that_of_the_papers_scene():
    for scene in SCENES:
        for name in ("carrier_ghz", "rician_factor_db", "path_loss", "antenna_height"):
            assert getattr(scene, name) == getattr(PAPER, name)


def test_the_map_that_a_scene_is_drawn_with_is_its_own():
    for each in SAMPLE[:6]:
        assert np.array_equal(build_radio_map(each.scene).gain_db, each.radio_map.gain_db)


def test_a_scene_survives_the_round_trip_through_a_file(tmp_path):
    for scene in SCENES:
        scene.save(tmp_path / "scene.json")
        assert load_scene(tmp_path / "scene.json") == scene


def test_files_read_well():
    def numbers(part):
        if isinstance(part, dict | list):
            for each in part.values() if isinstance(part, dict) else part:
                yield from numbers(each)
        elif isinstance(part, float):
            yield part

    for scene in SCENES:
        assert all(
            len(str(value).split(".")[1]) <= 3
            for value in numbers(json.loads(scene.model_dump_json()))
        )


def test_equal_seeds_give_equal_scenes_and_others_do_not():
    assert generate_scene(np.random.default_rng(5)) == SCENES[5]
    assert all(one != other for one, other in pairwise(SCENES))
    rng = np.random.default_rng(5)
    assert generate_scene(rng) != generate_scene(rng)
    assert irs_gym.generate_scene is generate_scene


@pytest.mark.parametrize("panels", ["none", "two", "small", "large"])
def test_other_panels_can_be_drawn(panels):
    scene = generate_scene(np.random.default_rng(1), Difficulty(panels=(panels,), detour_share=0.0))
    elements = [panel.elements for panel in scene.irs_panels]
    assert len(elements) == {"none": 0, "two": 2}.get(panels, 1)
    assert len({panel.wall for panel in scene.irs_panels}) == len(elements)
    if panels == "small":
        assert 20 <= elements[0] <= 200
    if panels == "large":
        assert 4000 <= elements[0] <= 8000


def test_a_difficulty_sets_the_numbers_of_boxes_and_the_size_of_the_room():
    level = Difficulty(sides=(8.0, 9.0), boxes=(1, 2), detour_share=0.0)
    for seed in range(4):
        scene = generate_scene(np.random.default_rng(seed), level)
        assert len(scene.obstacles) in (1, 2)
        assert set(np.subtract(scene.room.upper, scene.room.lower)) <= {8.0, 8.5, 9.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sides": (20.0, 14.0)}, "sides="),
        ({"boxes": (5, 4)}, "boxes="),
        ({"panels": ("three",)}, "panels="),
        ({"panels": ()}, "panels="),
        ({"detour": 0.9}, "detour=0.9"),
        ({"detour_share": 1.5}, "detour_share=1.5"),
    ],
)
def test_bad_difficulties_are_refused_by_field(change, message):
    with pytest.raises(ValueError, match=message):
        Difficulty(**change)


def test_an_unknown_difficulty_is_answered_with_all():
    with pytest.raises(
        ValueError, match=r"difficulty='medium' must be one of \('easy', 'default', 'hard'\)"
    ):
        generate_scene(np.random.default_rng(0), "medium")
    assert tuple(DIFFICULTIES) == ("easy", "default", "hard")
