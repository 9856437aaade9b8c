"""Facts of floor plans from elsewhere: what is blocked where, what a scene of them lacks, and which
field of which file is at fault.
"""

import json
import warnings
from io import BytesIO

import gymnasium
import numpy as np
import pytest
from PIL import Image

from irs_gym import (
    Scene,
    build_radio_map,
    load_scene,
    read_geojson,
    read_movingai_map,
    read_movingai_scenarios,
    read_picture,
    read_ros_map,
)
from irs_gym.convert import main as convert

YAML = """\
image: map.pgm
resolution: 0.5
origin: [-1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# from the top: y from 0 to -2, x from -1 to 2
SHADES = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [0, 254, 254, 254, 254, 0],
        [0, 254, 205, 254, 254, 254],
        [89, 90, 254, 206, 205, 100],
    ],
    dtype=np.uint8,
)


def pgm(shades, most=255):
    rows, columns = shades.shape
    return f"P5\n# a map\n{columns} {rows}\n{most}\n".encode() + shades.tobytes()


def ros(folder, yaml=YAML, picture=None):
    (folder / "map.yaml").write_text(yaml)
    (folder / "map.pgm").write_bytes(pgm(SHADES) if picture is None else picture)
    return folder / "map.yaml"


def blocked(plan):
    """Blocked cells from the top, as text."""
    return list(plan.data["obstacles"][0]["rows"])


# --- ROS ------------------------------------------------------------------------------------------


def test_a_ros_map_is_blocked_where_it_is_dark_or_unknown_and_its_origin_is_the_lower_left(
    tmp_path,
):
    plan = read_ros_map(ros(tmp_path))
    # occupancy (255 - shade) / 255: 205 and 206 are 0.196 and 0.192
    assert blocked(plan) == ["######", "#....#", "#.#...", "##..##"]
    assert plan.data["obstacles"][0]["origin"] == [-1.0, -2.0]
    scene = plan.scene(access_points=[{"position": [0.0, -1.0, 2.0]}], irs_panels=[])
    assert (scene.room.lower, scene.room.upper) == ((-1.0, -2.0), (2.0, 0.0))
    free = read_ros_map(ros(tmp_path), unknown_is_free=True)
    assert blocked(free) == ["######", "#....#", "#.....", "#....."]  # 0.651 is occupied


def test_a_negated_map_is_blocked_where_it_is_bright(tmp_path):
    plan = read_ros_map(ros(tmp_path, YAML.replace("negate: 0", "negate: 1"), pgm(255 - SHADES)))
    assert blocked(plan) == blocked(read_ros_map(ros(tmp_path)))


@pytest.mark.parametrize("mode", ["L", "RGB", "P", "LA", "RGBA", "1"])
def test_a_png_is_read_as_the_same_map_whatever_its_mode(tmp_path, mode):
    shades = np.where(SHADES > 200, 255, 0).astype(np.uint8)
    picture = BytesIO()
    Image.fromarray(shades).convert(mode).save(picture, "PNG")
    path = ros(tmp_path, YAML, picture.getvalue())
    assert blocked(read_ros_map(path)) == ["######", "#....#", "#.....", "##...#"]


def test_a_ros_map_of_16_bits_is_scaled(tmp_path):
    deep = pgm((SHADES.astype(">u2") * 257), 65535)
    assert blocked(read_ros_map(ros(tmp_path, YAML, deep))) == blocked(read_ros_map(ros(tmp_path)))


def test_a_plan_says_what_a_scene_lacks_by_field(tmp_path):
    plan = read_ros_map(ros(tmp_path))
    with pytest.raises(ValueError, match="access_points: Field required; irs_panels: Field"):
        plan.scene()
    plan.save(tmp_path / "draft.json")
    with pytest.raises(ValueError, match=r"draft.json': access_points: Field required"):
        load_scene(tmp_path / "draft.json")
    with pytest.raises(ValueError, match=r"access_points\[0\].position=.* outside the room"):
        plan.scene(access_points=[{"position": [9.0, 0.0, 1.0]}], irs_panels=[])


def big_map(folder):
    """400 x 400 pixels of 5 cm, with walls."""
    shades = np.full((400, 400), 254, dtype=np.uint8)
    shades[:8] = shades[-8:] = shades[:, :8] = shades[:, -8:] = 0
    shades[100:108, 50:300] = shades[250:258, 120:392] = shades[180:200, 200:240] = 0
    yaml = YAML.replace("0.5", "0.05", 1).replace("-1.0, -2.0", "-10.0, -10.0")
    return ros(folder, yaml, pgm(shades))


def test_a_map_of_400_by_400_becomes_an_environment_by_one_command(tmp_path):
    out = tmp_path / "floor.json"
    words = ["--access-point", "0", "9", "2.5", "--target-db", "-75"]
    assert convert([str(big_map(tmp_path)), str(out), *words]) == 0
    env = gymnasium.make(
        "irs_gym:IrsNav-v0", scene=out, robot_radius=0.2, corner_cutting=False, collision="body"
    )
    _, info = env.reset(seed=0)
    assert 25 < info["oracle_distance"] < 40
    world = env.unwrapped.world
    # a wall from x = -7.5 to 5.0 m at y = 4.6 to 5.0 m
    cells = world.radio_map.grid
    assert not world.radio_map.free[cells.cell_of((0.0, 4.8))]
    assert world.radio_map.free[cells.cell_of((7.0, 4.8))]


# --- MovingAI -------------------------------------------------------------------------------------

MAP = "type octile\nheight 3\nwidth 4\nmap\n.G@O\nTSW.\n....\n"


def test_a_movingai_map_is_turned_so_that_y_runs_upwards(tmp_path):
    (tmp_path / "a.map").write_text(MAP)
    plan = read_movingai_map(tmp_path / "a.map", cell_size=2.0)
    assert blocked(plan) == ["..##", "#.#.", "...."]
    scene = plan.scene(access_points=[{"position": [1.0, 1.0, 2.0]}], irs_panels=[])
    assert (scene.name, scene.room.upper) == ("a", (8.0, 6.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        free = build_radio_map(scene, cell_size=2.0).free
    assert free.T[::-1].astype(int).tolist() == [[1, 1, 0, 0], [0, 1, 0, 1], [1, 1, 1, 1]]


def test_scenarios_tell_start_goal_and_length(tmp_path):
    (tmp_path / "a.map").write_text(MAP)
    (tmp_path / "a.map.scen").write_text("version 1\n0\tmaps/a.map\t4\t3\t0\t0\t3\t1\t4.82843\n")
    (found,) = read_movingai_scenarios(tmp_path / "a.map.scen")
    assert (found.start, found.goal, found.length) == ((0, 2), (3, 1), 4.82843)
    out = tmp_path / "a.json"
    words = [str(tmp_path / "a.map.scen"), str(out), "--access-point", "2", "2", "2"]
    assert convert(words) == 0
    scene = load_scene(out)
    assert (scene.start, scene.goal) == ((0.5, 2.5), (3.5, 1.5))


# --- pictures -------------------------------------------------------------------------------------


def test_a_picture_is_blocked_where_it_is_dark(tmp_path):
    path = tmp_path / "plan.png"
    Image.fromarray(SHADES).save(path)
    plan = read_picture(path, 0.25, origin=(1.0, 2.0))
    assert blocked(plan) == ["######", "#....#", "#.....", "##...#"]
    assert plan.data["obstacles"][0]["origin"] == [1.0, 2.0]
    assert blocked(read_picture(path, 0.25, threshold=0.3)) == [
        "######",
        "#....#",
        "#.....",
        "......",
    ]


def test_a_picture_lies_on_white_where_it_is_transparent(tmp_path):
    colours = np.zeros((2, 2, 4), dtype=np.uint8)  # black
    colours[0, 0, 3] = 255
    Image.fromarray(colours).save(tmp_path / "plan.png")
    assert blocked(read_picture(tmp_path / "plan.png", 1.0)) == ["#.", ".."]


# --- GeoJSON --------------------------------------------------------------------------------------


def square(x, y, side, **properties):
    ring = [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


def geojson(folder, *features):
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [*features]}))
    return path


def test_polygons_are_obstacles_and_the_one_that_says_so_is_the_room(tmp_path):
    plan = read_geojson(geojson(tmp_path, square(0, 0, 10, room=True), square(4, 4, 2, height=1.5)))
    scene = plan.scene(access_points=[{"position": [1.0, 1.0, 2.0]}], irs_panels=[])
    assert scene.room.shape.area == 100
    assert [(each.shape.bounds, each.height) for each in scene.obstacles] == [((4, 4, 6, 6), 1.5)]
    alone = read_geojson(geojson(tmp_path, square(1, 2, 3), square(7, 8, 1)))
    room = alone.scene(access_points=[{"position": [5.0, 5.0, 2.0]}], irs_panels=[]).room
    assert (room.lower, room.upper) == ((1, 2), (8, 9))


def test_degrees_are_laid_flat(tmp_path):
    path = geojson(tmp_path, square(10.0, 60.0, 0.001, room=True), square(10.0004, 60.0004, 0.0001))
    room = read_geojson(path, unit="deg").data["room"]["polygon"]
    width, depth = np.ptp(np.array(room), axis=0)
    assert depth == pytest.approx(111.195, abs=0.01)  # a thousandth of a degree on a great circle
    assert width == pytest.approx(depth / 2, rel=1e-3)  # cos 60 degrees


# --- files that are damaged -----------------------------------------------------------------------

HUGE = b"P5\n100000 100000\n255\n"


@pytest.mark.parametrize(
    ("yaml", "picture", "message"),
    [
        (YAML, pgm(SHADES)[:-5], r"map.pgm: no picture that can be read: image file is truncated"),
        (YAML, b"P2\n2 2\n255\n1 2 3", r"map.pgm: not enough image data"),
        (YAML, HUGE, r"map.pgm: more than 16777216 pixels"),
        (YAML, b"P5\n9000 9000\n255\n", r"map.pgm: 9000 x 9000 cells are not from 1 to"),
        (YAML, b"", r"map.pgm: no picture"),
        (YAML, b"\x89PNG\r\n\x1a\n" + bytes(20), r"map.pgm: no picture"),
        (YAML.replace("resolution: 0.5\n", ""), None, r"map.yaml: resolution: Field required"),
        (YAML.replace("0.5", "0"), None, r"map.yaml: resolution: .* greater than 0"),
        (YAML.replace("0.5", ".nan"), None, r"map.yaml: resolution: "),
        (
            YAML.replace(" 0.0]", " 0.3]"),
            None,
            r"map.yaml: origin\[2\]: a turned map .* \(got 0.3\)",
        ),
        (YAML.replace(", 0.0]", "]"), None, r"map.yaml: origin\[2\]: Field required"),
        (YAML + "mode: raw\n", None, r"map.yaml: mode: Input should be 'trinary' \(got 'raw'\)"),
        (YAML.replace("map.pgm", "other.pgm"), None, r"map.yaml: image='other.pgm' is no file"),
        (YAML.replace("0.196", "0.9"), None, r"map.yaml: free_thresh=0.9 is above occupied_thresh"),
        (YAML.replace("negate: 0", "negate: 2"), None, r"map.yaml: negate: "),
        ("image: [", None, r"map.yaml: it is no yaml file: while parsing"),
        ("just words", None, r"map.yaml: it holds no settings"),
        ("a: !!python/object/apply:os.system [ls]", None, r"map.yaml: it is no yaml file"),
        ("resolution: " + "[" * 5000, None, r"map.yaml: it is no yaml file"),
        (YAML.replace("0.5", "{a: 1}"), None, r"map.yaml: resolution must be a number"),
    ],
    ids=str,
)
def test_a_damaged_ros_map_is_refused_by_file_and_field(tmp_path, yaml, picture, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_ros_map(ros(tmp_path, yaml, picture))


def test_yaml_that_stands_for_far_more_than_it_is_long_is_refused(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 30)]
    yaml = "\n".join([*lines, "image: *a29", YAML.replace("image: map.pgm\n", "")])
    with pytest.raises(ValueError, match=r"map.yaml: image must be a number, a word or three"):
        read_ros_map(ros(tmp_path, yaml))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MAP.replace("height 3", "height 4"), "height is 4, but there are 3 rows"),
        (MAP.replace("width 4", "width 5"), "row 0 has 4 cells, and width is 5"),
        (MAP.replace("width 4", "width x"), "'width x' must be 'width' and a number"),
        (MAP.replace("width 4", "width 100000").replace("height 3", "height 100000"), "100000 x"),
        (MAP.replace("octile", "tile"), "its first lines must be"),
        (MAP.replace("S", "X"), "row 1 holds 'X', no letter of such a map"),
        ("", "its first lines must be"),
    ],
)
def test_a_damaged_movingai_map_is_refused_by_file_and_field(tmp_path, text, message):
    (tmp_path / "a.map").write_text(text)
    with pytest.raises(ValueError, match=rf"a.map: {message}"):
        read_movingai_map(tmp_path / "a.map")


BOW = [[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]


def feature(coordinates, kind="Polygon", **properties):
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.mark.parametrize(
    ("features", "message"),
    [
        (
            [square(0, 0, 1), feature([BOW])],
            r"features\[1\]: polygon: it crosses or touches itself",
        ),
        (
            [feature([[[0, 0], [1, 1], [0, 0]]])],
            r"features\[0\].geometry.coordinates must be rings",
        ),
        ([feature([[[0, 0], [1, "a"], [1, 1], [0, 0]]])], r"features\[0\].geometry.coordinates"),
        ([feature([[0, 0], [1, 1]], "LineString")], r"features\[0\].geometry must be one of"),
        ([feature([[[0, 0], [1e9, 0], [1, 1], [0, 0]]])], r"features\[0\].geometry.coordinates"),
        ([square(0, 0, 1, height=-1)], r"features\[0\]: height: Input should be greater than 0"),
        ([square(0, 0, 1, height="x")], r"features\[0\]: height"),
        (
            [square(0, 0, 9, room=True), square(0, 0, 9, room=True)],
            r"features\[1\] is a second room",
        ),
        ([{"type": "Feature"}], r"features\[0\].geometry must be"),
        ([], "features must be a list of one or more"),
        ([feature([])], r"features\[0\].geometry.coordinates must be"),
    ],
)
def test_damaged_polygons_are_refused_by_file_and_feature(tmp_path, features, message):
    with pytest.raises(ValueError, match=rf"plan.geojson: {message}"):
        read_geojson(geojson(tmp_path, *features))


@pytest.mark.parametrize(
    "text", ["", "[]", "{", "[" * 100_000, '{"type": "Topology"}', '{"type": NaN}', "\xff"]
)
def test_a_file_that_is_no_geojson_is_refused(tmp_path, text):
    (tmp_path / "plan.geojson").write_text(text, encoding="latin-1")
    with pytest.raises(ValueError, match=r"plan.geojson: (it is no JSON file|its type must be)"):
        read_geojson(tmp_path / "plan.geojson")


def test_degrees_beyond_the_globe_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"plan.geojson: longitudes go to 180"):
        read_geojson(geojson(tmp_path, square(170, 0, 20)), unit="deg")
    with pytest.raises(ValueError, match="unit='ft' must be"):
        read_geojson(geojson(tmp_path, square(0, 0, 20)), unit="ft")


# --- the command ----------------------------------------------------------------------------------


def test_the_command_writes_a_draft_or_a_whole_scene(tmp_path, capsys):
    path, out = big_map(tmp_path), tmp_path / "floor.json"
    assert convert([str(path), str(out)]) == 0
    assert "access_points and irs_panels must be added" in capsys.readouterr().out
    draft = json.loads(out.read_text())
    whole = Scene.from_data(
        draft | {"access_points": [{"position": [0, 9, 2.5]}], "irs_panels": []}
    )
    panel = ["--irs-panel", "-9.6", "0", "2", "90"]
    words = ["--access-point", "0", "9", "2.5", "--access-point", "5", "9", "2.5", *panel]
    assert convert([str(path), str(out), *words, "--name", "hall", "--start", "-9", "-9"]) == 0
    scene = load_scene(out)
    assert (scene.name, scene.start, len(scene.access_points)) == ("hall", (-9.0, -9.0), 2)
    assert scene.irs_panels[0].elements == 1200
    assert scene.obstacles == whole.obstacles


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["map.xyz"], "a plan's name must end in one of .yaml"),
        (["none.yaml"], "none.yaml"),
        (["map.yaml", "--unit", "deg"], "--unit is not for map.yaml"),
        (["map.pgm"], "a picture needs --metres-per-pixel"),
        (["map.pgm", "--metres-per-pixel", "0"], "metres_per_pixel=0.0 must be"),
        (["map.yaml", "--access-point", "99", "0", "1"], r"access_points[0].position="),
        (["map.yaml", "--height", "-1"], "height=-1.0 must be a positive number of metres"),
        (["map.yaml", "--height", "nan"], "height=nan must be"),
    ],
)
def test_what_the_command_cannot_do_is_told_in_one_line(
    tmp_path, capsys, monkeypatch, words, message
):
    ros(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert convert([words[0], "out.json", *words[1:]]) == 2
    said = capsys.readouterr().err
    assert said.startswith("python -m irs_gym.convert: ")
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out.json").exists()
