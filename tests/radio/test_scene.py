"""Facts of scenes: the paper's preset, files that survive the round trip, and mistakes that are
named.
"""

import json
import math
import os

import numpy as np
import pytest

from irs_gym import build_radio_map, highest_feasible_target, shortest_path
from irs_gym.radio.geometry import Boxes, is_in_footprint
from irs_gym.radio.scene import IrsPanel, Obstacle, Scene, load_scene, scene_names

PAPER = load_scene("paper")


def written(tmp_path, change=None, text=None):
    """A scene file with the paper's scene, changed."""
    data = json.loads(PAPER.model_dump_json())
    if change:
        change(data)
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(data) if text is None else text)
    return path


def put(*keys):
    """A change that sets the value at the end of ``keys``: names and list places, then the value."""
    *way, last, value = keys

    def change(data):
        for key in way:
            data = data[key]
        data[last] = value

    return change


def leave_out(*keys):
    *way, last = keys

    def change(data):
        for key in way:
            data = data[key]
        del data[last]

    return change


# --- the preset -----------------------------------------------------------------------------------


def test_the_preset_is_the_papers_factory():
    assert [(box.center, box.size) for box in PAPER.obstacles] == [
        (centre, (4, 4, 1.3)) for centre in [(-5, -5), (5, -5), (0, 0), (-3, 4), (3, 4)]
    ]
    assert (PAPER.room.lower, PAPER.room.upper, PAPER.room.height) == ((-10, -10), (10, 10), 5)
    assert [point.position for point in PAPER.access_points] == [(0, 10, 2)]
    assert [panel.position for panel in PAPER.irs_panels] == [(0, -10, 2)]
    assert (PAPER.start, PAPER.goal, PAPER.antenna_height) == ((-10, 0), (10, 0), 1)
    assert (PAPER.carrier_ghz, PAPER.rician_factor_db) == (2, 3)
    los, nlos = PAPER.path_loss.line_of_sight, PAPER.path_loss.non_line_of_sight
    assert (los.intercept_db, los.distance_slope_db, los.frequency_slope_db) == (31.84, 21.5, 19)
    assert (nlos.intercept_db, nlos.distance_slope_db, nlos.frequency_slope_db) == (32.4, 23, 20)


def test_the_papers_panel_has_10_columns_of_sub_surfaces_of_20_elements():
    (panel,) = PAPER.irs_panels
    assert (panel.columns, panel.elements, panel.subsurfaces) == (10, 1200, 60)
    assert panel.elements_per_row == 200
    assert panel.along_wall.tolist() == [1, 0, 0]


def test_a_panel_on_a_side_wall_runs_along_y():
    panel = PAPER.irs_panels[0].model_copy(update={"wall": "x_max"})
    assert panel.along_wall.tolist() == [0, 1, 0]


@pytest.mark.parametrize(("elements", "rows"), [(200, 1), (1200, 6), (np.int64(2000), 10)])
def test_elements_fill_rows_of_sub_surfaces(elements, rows):
    (panel,) = PAPER.with_irs_elements(elements).irs_panels
    assert (panel.rows, panel.columns, panel.elements) == (rows, 10, elements)


def test_zero_elements_remove_the_panels_and_none_keeps_them():
    assert PAPER.with_irs_elements(0).irs_panels == ()
    assert PAPER.with_irs_elements(0).with_irs_elements(0).irs_panels == ()
    assert PAPER.with_irs_elements(None) == PAPER


@pytest.mark.parametrize("elements", [1, 100, 199, 1300, -1, -200])
def test_elements_that_do_not_fill_whole_rows_are_refused(elements):
    message = (
        rf"irs_elements={elements} does not fill whole rows .* takes 200, so .* or .* would fit"
    )
    with pytest.raises(ValueError, match=message):
        PAPER.with_irs_elements(elements)


def test_the_refusal_names_the_numbers_of_elements_that_fit():
    with pytest.raises(ValueError, match="so 1200 or 1400 would fit"):
        PAPER.with_irs_elements(1300)


@pytest.mark.parametrize("elements", [1200.0, "1200", True, math.nan, [1200]])
def test_elements_are_counted_in_whole_numbers(elements):
    with pytest.raises(ValueError, match=r"irs_elements=.* must be a whole number of elements"):
        PAPER.with_irs_elements(elements)


def test_elements_need_a_panel():
    with pytest.raises(
        ValueError, match="irs_elements=200 needs an IRS panel, and scene 'paper' lists none"
    ):
        PAPER.with_irs_elements(0).with_irs_elements(200)


# --- values ---------------------------------------------------------------------------------------


def test_scenes_hash_and_compare_by_value():
    again = load_scene("paper")
    assert again is not PAPER
    assert again == PAPER
    assert hash(again) == hash(PAPER)
    other = PAPER.model_copy(update={"antenna_height": 1.5})
    assert other != PAPER
    assert len({PAPER, again, other}) == 2


def test_nobody_can_change_a_scene():
    for part, field in [(PAPER, "name"), (PAPER.room, "height"), (PAPER.obstacles[0], "size")]:
        with pytest.raises(ValueError, match="frozen"):
            setattr(part, field, None)


def test_boxes_stand_on_the_floor():
    assert PAPER.boxes.lower[3].tolist() == [-5, 2, 0]
    assert PAPER.boxes.upper[3].tolist() == [-1, 6, 1.3]


def test_a_room_without_obstacles_has_no_boxes():
    assert PAPER.model_copy(update={"obstacles": ()}).boxes.lower.shape == (0, 3)


@pytest.mark.parametrize(("size", "wall"), [(0.1, 1.4), (0.1, 1.9), (1.1, 8.1), (2.3, 10.1)])
def test_a_box_flush_with_a_wall_is_inside_whatever_the_rounding(size, wall):
    centre = round(wall - size / 2, 3)
    change = {
        "room": {"x_min": -wall, "x_max": wall, "y_min": -wall, "y_max": wall, "height": 3},
        "obstacles": [{"center": [sign * centre] * 2, "size": [size, size, 3]} for sign in (1, -1)],
        "access_points": [{"position": [0, 0, 2]}],
        "irs_panels": [],
        "start": [0, 0],
        "goal": [0.5, 0],
    }
    scene = Scene.model_validate({**PAPER.model_dump(), **change})
    assert len(scene.obstacles) == 2


# --- files ----------------------------------------------------------------------------------------


def test_a_saved_scene_loads_as_it_was(tmp_path):
    PAPER.save(tmp_path / "mine.json")
    assert load_scene(tmp_path / "mine.json") == PAPER == load_scene(str(tmp_path / "mine.json"))


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_of_the_package_loads_and_carries_its_name(name, tmp_path):
    scene = load_scene(name)
    assert scene.name == name
    assert scene.format_version == (2 if name.startswith("war") else 1)
    scene.save(tmp_path / "copy.json")
    assert load_scene(tmp_path / "copy.json") == scene


def test_saving_leaves_nothing_beside_the_file_and_the_usual_permissions(tmp_path):
    PAPER.save(tmp_path / "mine.json")
    (tmp_path / "plain").touch()
    assert sorted(os.listdir(tmp_path)) == ["mine.json", "plain"]
    assert (tmp_path / "mine.json").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("step", ["replace", "write"])
def test_a_save_that_fails_leaves_the_old_file(step, tmp_path, monkeypatch):
    path = tmp_path / "mine.json"
    PAPER.save(path)
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError("no space left")

    target = (os, "replace") if step == "replace" else (Scene, "model_dump_json")
    monkeypatch.setattr(*target, fail)
    with pytest.raises(OSError, match="no space left"):
        PAPER.model_copy(update={"name": "new"}).save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["mine.json"]


def test_no_such_scene_is_said_with_the_names_that_exist():
    with pytest.raises(
        FileNotFoundError, match=r"scene='hangar' is neither a file nor one of .*'paper'"
    ):
        load_scene("hangar")


def test_a_folder_is_no_scene(tmp_path):
    with pytest.raises(FileNotFoundError, match="neither a file nor one of the scenes"):
        load_scene(tmp_path)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_scene_file_cut_short_is_refused(part, tmp_path):
    text = PAPER.model_dump_json()
    path = written(tmp_path, text=text[: int(len(text) * part)])
    with pytest.raises(ValueError, match=r"scene '.*scene\.json': Invalid JSON: EOF"):
        load_scene(path)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"PK\x03\x04", b"\x00" * 50, b"room: 3"])
def test_a_file_that_is_no_json_is_refused(content, tmp_path):
    (tmp_path / "scene.json").write_bytes(content)
    with pytest.raises(ValueError, match=r"scene '.*scene\.json': Invalid JSON"):
        load_scene(tmp_path / "scene.json")


@pytest.mark.parametrize("text", ["[]", "3", "null", '"paper"'])
def test_json_that_is_no_object_is_refused(text, tmp_path):
    with pytest.raises(ValueError, match="should be an object"):
        load_scene(written(tmp_path, text=text))


# --- mistakes in a scene --------------------------------------------------------------------------

MISTAKES = [
    (put("start", [0, 0]), r"start=\(0.0, 0.0\) lies inside an obstacle"),
    (put("goal", [3, 4]), r"goal=\(3.0, 4.0\) lies inside an obstacle"),
    (put("goal", [10.5, 0]), r"goal=\(10.5, 0.0\) lies outside the room"),
    (put("start", [0, -11]), r"start=\(0.0, -11.0\) lies outside the room"),
    (put("goal", [-10, 0]), r"goal=.* must differ from start"),
    (
        put("access_points", 0, "position", [0, 10.1, 2]),
        r"access_points\[0\].position=.* outside the room",
    ),
    (
        put("access_points", 0, "position", [0, 10, 5.1]),
        r"access_points\[0\].position=.* outside the room",
    ),
    (
        put("access_points", 0, "position", [0, 10, -0.1]),
        r"access_points\[0\].position=.* outside the room",
    ),
    (put("access_points", []), r"access_points: .* at least 1 item"),
    (
        put("irs_panels", 0, "position", [0, -9.5, 2]),
        r"irs_panels\[0\].position=.* must lie on its wall, y = -10.0",
    ),
    (
        put("irs_panels", 0, "wall", "x_max"),
        r"irs_panels\[0\].position=.* must lie on its wall, x = 10.0",
    ),
    (
        put("irs_panels", 0, "position", [0, -10, 6]),
        r"irs_panels\[0\].position=.* must lie on its wall",
    ),
    (put("irs_panels", 0, "wall", "north"), r"irs_panels\[0\].wall: .* 'y_max' \(got 'north'\)"),
    (
        put("access_points", 0, "position", [0, -10, 2]),
        r"irs_panels\[0\].position=.* coincides with an access point",
    ),
    (
        put("irs_panels", 0, "rows", 0),
        r"irs_panels\[0\].rows: .* greater than or equal to 1 \(got 0\)",
    ),
    (put("irs_panels", 0, "columns", 2.5), r"irs_panels\[0\].columns: .* integer \(got 2.5\)"),
    (put("irs_panels", 0, "columns", True), r"irs_panels\[0\].columns: .* integer \(got True\)"),
    (
        put("irs_panels", 0, "pitch_wavelengths", 0),
        r"irs_panels\[0\].pitch_wavelengths: .* greater than 0",
    ),
    (
        put("irs_panels", 0, "elements_per_subsurface", [1, 0]),
        r"elements_per_subsurface\[1\]: .* \(got 0\)",
    ),
    (
        put("irs_panels", 0, "elements_per_subsurface", [1]),
        r"elements_per_subsurface\[1\]: Field required",
    ),
    (put("obstacles", 2, "center", [9, 0]), r"obstacles\[2\] reaches from .* outside the room"),
    (put("obstacles", 0, "size", [4, 4, 5.1]), r"obstacles\[0\] reaches from .* outside the room"),
    (
        put("obstacles", 1, "size", [4, -4, 1.3]),
        r"obstacles\[1\].size\[1\]: .* greater than 0 \(got -4\)",
    ),
    (put("room", "x_max", -10), "room: .*x_max must be greater than x_min"),
    (put("room", "height", 0), r"room.height: .* greater than 0 \(got 0\)"),
    (put("antenna_height", 5.5), "antenna_height=5.5 exceeds the room's height 5.0"),
    (put("antenna_height", 0), r"antenna_height: .* greater than 0"),
    (put("carrier_ghz", -2), r"carrier_ghz: .* greater than 0 \(got -2\)"),
    (put("carrier_ghz", "2"), r"carrier_ghz: .* valid number \(got '2'\)"),
    (put("carrier_ghz", None), r"carrier_ghz: .* valid number \(got None\)"),
    (put("carrier_ghz", True), r"carrier_ghz: .* valid number \(got True\)"),
    (put("name", 3), r"name: .* valid string \(got 3\)"),
    (put("room", [20, 20, 5]), r"room: .* object"),
    (put("obstacles", {}), r"obstacles: .* array"),
    (put("start", [1, 2, 3]), r"start: .* at most 2 items"),
    (put("format_version", 3), r"format_version: Input should be 1 or 2 \(got 3\)"),
    (put("colour", "red"), r"colour: Extra inputs are not permitted \(got 'red'\)"),
    (put("room", "depth", 3), r"room.depth: Extra inputs are not permitted"),
    (put("irs_panels", 0, "tilt", 0), r"irs_panels\[0\].tilt: Extra inputs are not permitted"),
    (leave_out("room"), r"scene\.json': room: Field required$"),
    (leave_out("goal"), r"scene\.json': goal: Field required$"),
    (leave_out("irs_panels", 0, "wall"), r"irs_panels\[0\].wall: Field required$"),
    (
        leave_out("path_loss", "line_of_sight", "intercept_db"),
        r"path_loss.line_of_sight.intercept_db: Field required$",
    ),
]


@pytest.mark.parametrize(("change", "message"), MISTAKES, ids=[message for _, message in MISTAKES])
def test_a_mistake_in_a_scene_file_is_named(change, message, tmp_path):
    path = written(tmp_path, change)
    with pytest.raises(ValueError, match=message) as raised:
        load_scene(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def numbers(part, way=()):
    """The place of every number in a scene file."""
    if isinstance(part, dict | list):
        for key, value in part.items() if isinstance(part, dict) else enumerate(part):
            yield from numbers(value, (*way, key))
    elif not isinstance(part, str):
        yield way


def test_a_number_that_is_not_finite_is_refused_wherever_it_stands(tmp_path):
    places = list(numbers(json.loads(PAPER.model_dump_json())))
    assert len(places) == 57
    for place in places:
        field = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(
            "."
        )
        for value in (math.nan, math.inf, -math.inf):
            with pytest.raises(ValueError, match=r"scene '.*scene\.json': ") as raised:
                load_scene(written(tmp_path, put(*place, value)))
            assert f"{field}: Input should be" in str(raised.value)
            assert f"(got {value})" in str(raised.value)


def test_a_number_too_large_for_a_double_is_refused(tmp_path):
    text = PAPER.model_dump_json().replace('"antenna_height":1.0', '"antenna_height":1e999')
    with pytest.raises(ValueError, match="antenna_height: Input should be a finite number"):
        load_scene(written(tmp_path, text=text))


def test_all_mistakes_are_named_at_once(tmp_path):
    def change(data):
        data["start"], data["goal"], data["antenna_height"] = [0, 0], [99, 0], 6

    with pytest.raises(
        ValueError, match=r"antenna_height=6.0 .*; start=.* inside an obstacle; goal=.* outside"
    ):
        load_scene(written(tmp_path, change))


def test_a_scene_made_in_python_is_checked_too():
    with pytest.raises(ValueError, match=r"start=\(0.0, 0.0\) lies inside an obstacle"):
        Scene.model_validate({**PAPER.model_dump(), "start": (0, 0)})
    with pytest.raises(ValueError, match="columns"):
        IrsPanel.model_validate({**PAPER.irs_panels[0].model_dump(), "columns": 0})


def test_a_cell_size_that_does_not_divide_the_room_is_refused():
    assert PAPER.grid(0.4).shape == (50, 50)
    with pytest.raises(ValueError, match=r"cell_size=0\.3 does not divide the room's 20 m along x"):
        PAPER.grid(0.3)


# --- the task that a scene holds ------------------------------------------------------------------


def test_a_file_that_says_no_target_and_no_resolution_has_the_papers(tmp_path):
    def change(data):
        del data["target_db"], data["phase_bits"]

    scene = load_scene(written(tmp_path, change))
    assert (scene.target_db, scene.phase_bits, scene.format_version) == (-61.8, None, 1)
    assert scene == PAPER


def test_a_file_may_say_its_target_and_its_resolution(tmp_path):
    def change(data):
        data["target_db"], data["phase_bits"] = -63.5, 2

    scene = load_scene(written(tmp_path, change))
    assert (scene.target_db, scene.phase_bits) == (-63.5, 2)
    scene.save(tmp_path / "again.json")
    assert load_scene(tmp_path / "again.json") == scene


@pytest.mark.parametrize("bits", [0, 17, 1.5, "1", True])
def test_a_resolution_that_no_phase_shifter_has_is_refused(tmp_path, bits):
    with pytest.raises(ValueError, match="phase_bits: Input should be"):
        load_scene(written(tmp_path, put("phase_bits", bits)))


# --- the other scenes of the package --------------------------------------------------------------


def test_the_package_has_four_scenes():
    assert scene_names() == ["paper", "ward", "warehouse", "workshop"]


@pytest.mark.parametrize(
    ("name", "shape", "without_target", "at_target"),
    [("ward", (60, 52), 33.920, 38.485), ("warehouse", (120, 80), 55.0, 74.991)],
)
def test_in_ward_and_warehouse_the_panel_makes_the_task_and_the_target_a_detour(
    name, shape, without_target, at_target
):
    scene = load_scene(name)
    radio_map = build_radio_map(scene)
    ends = [radio_map.grid.cell_of(end) for end in (scene.start, scene.goal)]
    free = shortest_path(radio_map.free, *ends, cell_size=0.5)
    feasible = shortest_path(radio_map.feasible(scene.target_db), *ends, cell_size=0.5)
    assert radio_map.grid.shape == shape
    assert (free.distance, feasible.distance) == pytest.approx(
        (without_target, at_target), abs=1e-3
    )
    without = build_radio_map(scene, irs_elements=0)
    assert highest_feasible_target(without.gain_db, *ends) < scene.target_db - 1
    assert highest_feasible_target(radio_map.gain_db, *ends) > scene.target_db


def test_nobody_drives_through_a_wall_of_the_ward():
    scene = load_scene("ward")
    grid = scene.grid(0.5)
    thin = [each for each in scene.obstacles if isinstance(each, Obstacle) and min(each.size) < 0.2]
    assert len(thin) > 20
    for wall in thin:
        # each takes a whole line of cells, as long as itself
        taken = is_in_footprint(
            grid.centres(), Boxes(*np.array([[wall.lower], [wall.upper]]))
        ).sum()
        assert abs(taken - max(wall.size[:2]) / 0.5) < 1
