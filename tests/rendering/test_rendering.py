"""Facts of the pictures and the text: what they show, where, which way up, and what a frame costs."""

import copy
import pickle
import subprocess
import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import shapely

from irs_gym.datasets.splits import scene_of
from irs_gym.grid import Grid
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import load_scene
from irs_gym.rendering import View, draw_frame, text_frame
from irs_gym.rendering.background import COLOUR_MAP, OBSTACLE, ROBOT, background_of
from irs_gym.rendering.episode_view import view_of
from irs_gym.rendering.layout import round_steps
from irs_gym.rendering.primitives import font

SHAPES = [
    (10, 10),
    (40, 40),
    (60, 20),
    (20, 60),
    (400, 400),
    (400, 10),
    (10, 400),
    (33, 50),
    (1, 3),
]
START, GOAL = (0, 3), (9, 3)


def plain_view(**changes):
    """A 10 x 10 map at -50 dB, with an obstacle to the upper left and cells at -70 dB to the lower
    right.
    """
    gain_db = np.full((10, 10), -50.0)
    gain_db[:3, 7:] = -np.inf
    gain_db[6:, :3] = -70.0
    fields = {
        "gain_db": gain_db,
        "target_db": -60.0,
        "grid": Grid((10, 10), 0.5, (-3.0, 2.0)),
        "access_points": ((0.0, 7.0),),
        "irs_panels": ((-3.0, 6.0),),
        "start": START,
        "goal": GOAL,
        "oracle_cells": np.array([(i, 3) for i in range(10)]),
    }
    return View(**{**fields, **changes})


def random_view(shape, size):
    rng = np.random.default_rng(3)
    gain_db = rng.uniform(-90.0, -40.0, shape)
    gain_db[rng.random(shape) < 0.1] = -np.inf
    gain_db[0, 0] = gain_db[-1, -1] = -50.0
    grid = Grid(shape, 0.25, (-3.0, 2.0))
    return View(
        gain_db, -60.0, grid, ((-3.0, 2.0), grid.upper), ((grid.upper[0], 2.1),),
        (0, 0), (shape[0] - 1, shape[1] - 1), np.zeros((0, 2), dtype=int), size,
    )  # fmt: skip


def paper_view():
    scene = load_scene("paper")
    radio_map = build_radio_map(scene)
    grid = radio_map.grid
    stations = [
        tuple(station.position[:2] for station in kind)
        for kind in (scene.access_points, scene.irs_panels)
    ]
    row = np.array([(i, 20) for i in range(40)])
    return View(
        radio_map.gain_db,
        -61.8,
        grid,
        *stations,
        grid.cell_of(scene.start),
        grid.cell_of(scene.goal),
        row,
    )


def map_of(view, frame):
    """The part of a frame that shows the map."""
    layout = background_of(view).layout
    return frame[layout.top : layout.bottom, layout.left : layout.right]


def robot_of(view, cell):
    """Mean (row, column) of the pixels of the robot's colour in the map, when it is in this cell
    alone.
    """
    return np.argwhere((map_of(view, draw_frame(view, [cell])) == ROBOT).all(axis=-1)).mean(axis=0)


def changed(before, after):
    """Rows and columns (n, 2) of the pixels that differ."""
    return np.argwhere((before != after).any(axis=-1))


# --- The picture's size and layout ----------------------------------------------------------------


@pytest.mark.parametrize("size", [320, 512, 900])
@pytest.mark.parametrize("shape", SHAPES)
def test_longest_side_is_the_size_and_both_are_even(shape, size):
    frame = draw_frame(random_view(shape, size), [(0, 0)])
    assert frame.dtype == np.uint8
    assert frame.ndim == 3
    assert frame.shape[2] == 3
    assert max(frame.shape) == size
    assert frame.shape[0] % 2 == frame.shape[1] % 2 == 0  # video codecs need it


@pytest.mark.parametrize("size", [320, 512])
@pytest.mark.parametrize("shape", SHAPES)
def test_nothing_is_cut_off_at_the_picture_s_edges(shape, size):
    frame = draw_frame(random_view(shape, size), [(0, 0)])
    edges = np.concatenate([frame[0], frame[-1], frame[:, 0], frame[:, -1]])
    assert (edges == 255).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_legend_lies_outside_the_map_and_the_colour_bar(shape):
    layout = background_of(random_view(shape, 512)).layout
    left, top, width, height = layout.bar
    assert left >= layout.right
    assert (
        (layout.legend[:, 0] > left + width) | (layout.legend[:, 1] - layout.em > top + height)
    ).all()


@pytest.mark.parametrize(
    ("shape", "share"), [((40, 40), 0.7), ((60, 20), 0.7), ((33, 50), 0.7), ((20, 60), 0.85)]
)
def test_map_takes_most_of_the_picture(shape, share):
    assert max(background_of(random_view(shape, 512)).layout.map_size) > share * 512


@pytest.mark.parametrize("size", [320, 512, 900])
@pytest.mark.parametrize("shape", SHAPES)
def test_title_has_room_for_the_longest_numbers(shape, size):
    view = replace(random_view(shape, size), target_db=-100.5)
    background = background_of(view)
    title_end = background.margin_at[0] + font(background.layout.em).getlength("margin -100.00 dB")
    assert title_end < background.image.width


@pytest.mark.parametrize("shape", SHAPES)
def test_cells_are_square(shape):
    layout = background_of(random_view(shape, 900)).layout
    width, height = np.divide(layout.map_size, shape)
    assert abs(width - height) <= 1 / min(shape)  # whole pixels for the whole map


# --- What the map shows ---------------------------------------------------------------------------


def test_map_runs_right_with_x_and_up_with_y():
    view = plain_view(oracle_cells=np.zeros((0, 2), dtype=int))
    picture = map_of(view, draw_frame(view, [START]))
    rows, columns = picture.shape[:2]
    is_obstacle = (picture == OBSTACLE).all(axis=-1)
    upper_left = is_obstacle[: int(0.29 * rows), : int(0.29 * columns)]
    assert upper_left.mean() > 0.95  # the panel and its name hide a little
    is_obstacle[: int(0.31 * rows), : int(0.31 * columns)] = False
    assert not is_obstacle.any()


def test_every_obstacle_of_the_paper_is_where_the_scene_has_it():
    view, scene = paper_view(), load_scene("paper")
    frame = draw_frame(view, [view.start])
    for obstacle in scene.obstacles:
        if obstacle.center != (0.0, 0.0):  # the row drawn as the oracle's path crosses this one
            column, row = background_of(view).layout.pixels(obstacle.center).astype(int)
            assert tuple(frame[row, column]) == OBSTACLE
    assert np.isneginf(view.gain_db).sum() == 5 * 64


def test_outlines_are_drawn_where_they_are_whatever_cells_they_take():
    triangle = np.array([(-2.5, 2.5), (1.5, 3.0), (-0.5, 6.0), (-2.5, 2.5)])
    plain, outlined = plain_view(), plain_view(outlines=(triangle,))
    at = changed(draw_frame(plain, [START]), draw_frame(outlined, [START]))[:, ::-1]  # (n, 2), x, y
    assert len(at) > 100
    corners = background_of(outlined).layout.pixels(triangle)
    sides = shapely.LineString(corners)
    assert shapely.distance(sides, shapely.points(at + 0.5)).max() < 3
    middles = (corners[1:] + corners[:-1]) / 2
    assert all(np.hypot(*(at - middle).T).min() < 2 for middle in middles)


def test_a_panel_with_an_angle_lies_along_it():
    flat, steep = (
        plain_view(irs_panels=((-0.5, 5.5),), panel_angles=(angle,), access_points=())
        for angle in (0.0, 60.0)
    )
    bare = plain_view(irs_panels=(), access_points=())
    empty = draw_frame(bare, [START])
    spread = []
    for view in (flat, steep):
        at = changed(empty, draw_frame(view, [START])).astype(float)  # row, column
        near = at[np.hypot(*(at - background_of(view).layout.pixels((-0.5, 5.5))[::-1]).T) < 14]
        spread.append(np.cov(near.T)[0, 1])
    assert abs(spread[0]) < 5 < 0.5 * abs(spread[1])
    assert spread[1] < 0  # rows run down: up to the right


@pytest.mark.parametrize("name", ["ward", "warehouse"])
def test_scenes_of_format_2_show_their_outlines_and_those_of_format_1_do_not(name):
    assert paper_view().outlines == ()
    env = gymnasium.make("irs_gym:IrsNav-v0", scene=name)
    world = env.unwrapped.world
    view = view_of(world, world.start, world.goal)
    scene = load_scene(name)
    shapes = len(scene.obstacles) + (scene.floor.room is not None)
    assert len(view.outlines) == shapes
    assert all((ring[0] == ring[-1]).all() for ring in view.outlines)


def test_infeasible_cells_are_paler_and_hatched_in_the_map_and_in_the_colour_bar():
    views = [plain_view(target_db=target_db) for target_db in (-60.0, -80.0)]
    left, top, width, height = background_of(views[0]).layout.bar
    for part in (
        lambda view, frame: map_of(view, frame)[-80:-2, -100:-2],
        lambda view, frame: frame[top + height - 40 : top + height - 20, left : left + width],
    ):
        below, above = (part(view, draw_frame(view, [START])).astype(float) for view in views)
        assert below.mean() > above.mean() + 40
        assert below.std(axis=(0, 1)).min() > above.std(axis=(0, 1)).max() + 5


def test_lightness_rises_along_the_colour_map_and_obstacles_are_darker():
    luma = np.array([0.299, 0.587, 0.114])
    lightness = COLOUR_MAP @ luma
    assert (np.diff(lightness) > 10).all()
    assert np.dot(OBSTACLE, luma) < lightness[0] - 30


def test_a_flat_map_and_a_target_off_the_scale_are_drawn():
    view = plain_view(
        gain_db=np.full((10, 10), -50.0), target_db=-200.0, access_points=(), irs_panels=()
    )
    colours = {
        tuple(pixel) for pixel in map_of(view, draw_frame(view, [START]))[5:60, 5:60].reshape(-1, 3)
    }
    assert colours == {tuple(COLOUR_MAP[4].astype(int))}


def test_ticks_are_round_and_within_the_range():
    assert round_steps(-10.0, 10.0, 8) == [-10, -5, 0, 5, 10]
    assert np.allclose(round_steps(-0.35, 0.31, 7), [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3])
    assert round_steps(-67.4, -38.1, 6) == [-65, -60, -55, -50, -45, -40]


# --- The robot ------------------------------------------------------------------------------------


def test_robot_goes_right_with_i_and_up_with_j():
    view = plain_view()
    cell = np.array(background_of(view).layout.map_size) / 10
    right = robot_of(view, (8, 5)) - robot_of(view, (5, 5))
    up = robot_of(view, (5, 8)) - robot_of(view, (5, 5))
    assert right == pytest.approx([0.0, 3 * cell[0]], abs=1.0)
    assert up == pytest.approx([-3 * cell[1], 0.0], abs=1.0)


def test_a_move_changes_the_picture_around_the_robot_and_its_margin_only():
    view, path = plain_view(), [(1, 3), (2, 3), (3, 4), (4, 5)]
    pixels = changed(draw_frame(view, path[:-1]), draw_frame(view, path))
    layout = background_of(view).layout
    ends, cell = layout.cell_pixels(path[-2:])[:, ::-1], layout.map_size[0] / 10
    is_near = ((pixels > ends.min(axis=0) - cell) & (pixels < ends.max(axis=0) + cell)).all(axis=1)
    is_title = pixels[:, 0] < layout.top
    assert is_near.any()
    assert (is_near | is_title).all()


def test_margin_is_written_anew_and_the_target_is_not():
    view = plain_view()
    pixels = changed(draw_frame(view, [(1, 1)]), draw_frame(view, [(7, 1)]))  # +10 dB, -10 dB
    title = pixels[pixels[:, 0] < background_of(view).layout.top]
    assert len(title)
    assert title[:, 1].min() >= background_of(view).margin_at[0]


def test_refused_moves_leave_no_trace():
    view, path = (
        plain_view(),
        [(1, 6), (1, 6), (2, 6), (3, 6), (3, 6), (4, 5), (4, 5), (4, 4), (4, 4)],
    )
    distinct = [cell for k, cell in enumerate(path) if k == 0 or cell != path[k - 1]]
    assert np.array_equal(draw_frame(view, path), draw_frame(view, distinct))
    assert np.array_equal(draw_frame(view, [START, START]), draw_frame(view, [START]))


def test_trail_and_oracle_path_are_both_visible_where_they_coincide():
    view = plain_view(access_points=(), irs_panels=())
    bare = replace(view, oracle_cells=np.zeros((0, 2), dtype=int))
    path = view.oracle_cells
    layout = background_of(view).layout
    (left, row), (right, _) = layout.cell_pixels([(2, 3), (7, 3)]).astype(int)
    band = slice(row - layout.em, row + layout.em), slice(left, right)

    def share(frame, colour):
        return (frame[band] == colour).all(axis=-1).mean()

    assert share(draw_frame(view, path), ROBOT) == share(draw_frame(bare, path), ROBOT) > 0.05
    assert share(draw_frame(view, path), (255, 255, 255)) > 0.01
    assert share(draw_frame(bare, path), (255, 255, 255)) == 0


# --- Frames ---------------------------------------------------------------------------------------


def test_same_input_gives_the_same_frame():
    path = [(0, 3), (1, 3), (2, 4)]
    view = plain_view()
    assert np.array_equal(draw_frame(view, path), draw_frame(view, path))
    assert np.array_equal(
        draw_frame(view, path), draw_frame(plain_view(), np.array(path, dtype=np.int32))
    )


def test_drawing_leaves_the_background_as_it_was():
    view = plain_view()
    background = background_of(view)
    before = np.array(background.image)
    frame = draw_frame(view, [(0, 3), (5, 5), (9, 9)])
    assert background_of(view) is background
    frame[:] = 0  # a frame is the caller's
    assert np.array_equal(np.array(background.image), before)
    assert not np.shares_memory(draw_frame(view, [START]), draw_frame(view, [START]))


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda view: pickle.loads(pickle.dumps(view))]
)
def test_a_copied_or_pickled_view_draws_the_same(duplicate):
    view = plain_view()
    frame = draw_frame(view, [START])
    assert np.array_equal(draw_frame(duplicate(view), [START]), frame)


def test_importing_brings_no_pillow_and_drawing_no_plotting_or_window_package():
    program = """
import sys
import numpy as np
from irs_gym.datasets.splits import scene_of
from irs_gym.grid import Grid
from irs_gym.rendering import View, draw_frame, text_frame
assert "PIL" not in sys.modules
view = View(np.full((4, 4), -50.0), -60.0, Grid((4, 4), 1.0, (0.0, 0.0)), (), (), (0, 0), (3, 3), np.zeros((0, 2), int))
text_frame(view, [(0, 0)])
assert "PIL" not in sys.modules
draw_frame(view, [(0, 0)])
assert not {"matplotlib", "pygame", "tkinter"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


# --- Text -----------------------------------------------------------------------------------------


def test_text_marks_each_thing_in_its_row_and_column():
    view = plain_view()
    lines = text_frame(view, [(0, 3), (1, 3), (2, 4)]).split("\n")[1:13]
    assert lines == [
        "+------A---+",
        "|###.......|",
        "I###.......|",
        "|###.......|",
        "|..........|",
        "|..........|",
        "|..R.......|",
        "|S*oooooooG|",
        "|......~~~~|",
        "|......~~~~|",
        "|......~~~~|",
        "+----------+",
    ]


@pytest.mark.parametrize("shape", [(10, 10), (33, 50), (60, 20)])
def test_text_has_a_row_for_each_j_and_a_column_for_each_i(shape):
    view = random_view(shape, 512)
    rows = text_frame(view, [(0, 0)]).split("\n")[1:-2]
    assert len(rows) == shape[1] + 2
    assert {len(row) for row in rows} == {shape[0] + 2}
    assert sum(row[1:-1].count("#") for row in rows[1:-1]) == np.isneginf(view.gain_db).sum()


def test_text_begins_with_target_gain_and_margin():
    view = plain_view()
    assert text_frame(view, [(1, 1)]).startswith(
        "target -60.00 dB   gain -50.00 dB   margin +10.00 dB\n"
    )
    assert text_frame(view, [(7, 1)]).startswith(
        "target -60.00 dB   gain -70.00 dB   margin -10.00 dB\n"
    )


def test_text_puts_stations_on_their_wall_or_in_their_cell():
    view = plain_view(access_points=((2.0, 4.1), (-3.0, 2.0)), irs_panels=((2.0, 7.0), (-2.9, 2.1)))
    rows = text_frame(view, [START]).split("\n")[1:13]
    marks = {(k, row.index(mark)) for mark in "AI" for k, row in enumerate(rows) if mark in row}
    assert marks == {(6, 11), (11, 0), (0, 11), (10, 1)}


def test_text_without_stations_or_oracle_has_none_of_their_marks():
    view = plain_view(access_points=(), irs_panels=(), oracle_cells=np.array([]))
    rows = "".join(text_frame(view, [START]).split("\n")[1:13])
    assert set(rows) == set("+-|#.~RG")


# --- Bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize("show", [draw_frame, text_frame])
@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([], r"path must be integers of shape \(T, 2\)"),
        ([1, 2], r"path must be integers of shape \(T, 2\)"),
        ([(0.5, 1.0)], "path must be integers"),
        ([(0, 0), (10, 3)], r"path holds \(10, 3\), which is off the grid of \(10, 10\)"),
        ([(-1, 0)], r"path holds \(-1, 0\)"),
    ],
)
def test_a_path_that_is_none_is_refused(show, path, message):
    with pytest.raises(ValueError, match=message):
        show(plain_view(), path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gain_db": np.zeros((10, 9))}, r"gain_db has shape \(10, 9\), but the grid \(10, 10\)"),
        ({"gain_db": np.full((10, 10), -np.inf)}, "gain_db must hold a finite gain"),
        ({"gain_db": np.full((10, 10), np.nan)}, "gain_db must hold a finite gain"),
        ({"gain_db": np.where(np.eye(10) > 0, np.nan, -50.0)}, "neither NaN nor"),
        ({"gain_db": np.where(np.eye(10) > 0, np.inf, -50.0)}, "neither NaN nor"),
        ({"target_db": np.nan}, "target_db=nan"),
        ({"size": 100}, "size=100"),
        ({"start": (10, 0)}, r"start holds \(10, 0\)"),
        ({"goal": (0, -1)}, r"goal holds \(0, -1\)"),
        ({"oracle_cells": np.array([(0, 0), (0, 99)])}, r"oracle_cells holds \(0, 99\)"),
    ],
)
def test_a_view_that_cannot_be_drawn_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        plain_view(**changes)


def test_a_room_is_drawn_at_its_own_size_and_all_pictures_of_a_set_are_of_one_size():
    scenes = [scene_of("test", n) for n in range(3)]
    env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=scenes, render_mode="rgb_array")
    pictures = []
    for n, scene in enumerate(scenes):
        env.reset(options={"scene_id": n})
        robot = env.unwrapped
        view = view_of(robot.world, robot.world.start, robot.world.goal)
        assert view.grid == scene.grid(0.5)
        assert view.gain_db.shape == view.grid.shape
        pictures.append(env.render())
    assert {picture.shape for picture in pictures} == {(512, 512, 3)}
    assert len({scene.grid(0.5).shape for scene in scenes}) > 1
