"""Facts of obstacles of any shape, against exact rational arithmetic and against boxes."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import shapely

from irs_gym import build_radio_map, focused_codebook
from irs_gym.radio.geometry import Boxes
from irs_gym.radio.irs import Hardware, channel
from irs_gym.radio.obstacles.floor import Floor
from irs_gym.radio.obstacles.prisms import Prisms
from irs_gym.radio.obstacles.raster import Raster
from irs_gym.radio.scene import Scene, load_scene
from irs_gym.radio.shapes import RasterObstacle

PAPER = load_scene("paper")
NO_BOXES = Boxes(np.zeros((0, 3)), np.zeros((0, 3)))
NO_PRISMS = Prisms((), ())

# corners on whole metres, so that rays graze sides and meet corners exactly
POLYGONS = {
    "wedge": ([(0, 0), (6, 1), (2, 5)], []),
    "horseshoe": ([(0, 0), (6, 0), (6, 6), (4, 6), (4, 2), (2, 2), (2, 6), (0, 6)], []),
    "star": ([(3, 0), (4, 2), (6, 3), (4, 4), (3, 6), (2, 4), (0, 3), (2, 2)], []),
    "frame": ([(0, 0), (6, 0), (6, 6), (0, 6)], [[(2, 2), (4, 2), (4, 4), (2, 4)]]),
}
HEIGHT = 2.0


# --- what is true ---------------------------------------------------------------------------------


def is_inside_ring(x, y, ring) -> bool:
    """Whether a point lies strictly inside a ring, by the parity of sides to its right."""
    is_inside = False
    for (x0, y0), (x1, y1) in zip(ring, ring[1:] + ring[:1], strict=True):
        across = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
        if across == 0 and min(x0, x1) <= x <= max(x0, x1) and min(y0, y1) <= y <= max(y0, y1):
            return False
        if (y0 > y) != (y1 > y) and x < x0 + Fraction(y - y0) * (x1 - x0) / (y1 - y0):
            is_inside = not is_inside
    return is_inside


def is_on_ring(x, y, ring) -> bool:
    return any(
        (x1 - x0) * (y - y0) == (y1 - y0) * (x - x0)
        and min(x0, x1) <= x <= max(x0, x1)
        and min(y0, y1) <= y <= max(y0, y1)
        for (x0, y0), (x1, y1) in zip(ring, ring[1:] + ring[:1], strict=True)
    )


def is_inside(x, y, z, ring, holes) -> bool:
    """Whether a point lies strictly inside a prism."""
    return (
        0 < z < Fraction(HEIGHT)
        and is_inside_ring(x, y, ring)
        and not any(is_inside_ring(x, y, hole) or is_on_ring(x, y, hole) for hole in holes)
    )


def true_runs(start, end, sides, inside) -> int:
    """How often a segment runs through a solid, whose sides are lines on the floor, exactly.

    The lines of its sides, its top and the floor cut the segment into pieces; each lies inside with
    its midpoint, or not at all. Pieces are one run where the point between them is inside too.
    """
    start, end = ([Fraction(float(value)) for value in point] for point in (start, end))
    cuts = {Fraction(0), Fraction(1)}
    for level in (0, Fraction(HEIGHT)):
        if start[2] != end[2]:
            cuts.add((level - start[2]) / (end[2] - start[2]))
    for (x0, y0), (x1, y1) in sides:
        normal = (y1 - y0, x0 - x1)
        slope = sum(n * (b - a) for n, a, b in zip(normal, start, end, strict=False))
        if slope:
            cuts.add((normal[0] * (x0 - start[0]) + normal[1] * (y0 - start[1])) / Fraction(slope))

    ordered = sorted(t for t in cuts if 0 <= t <= 1)

    def at(t) -> bool:
        return inside(*(a + t * (b - a) for a, b in zip(start, end, strict=True)))

    runs, goes_on = 0, False
    for first, second in pairwise(ordered):
        here = at((first + second) / 2)
        runs += here and not (goes_on and at(first))
        goes_on = here
    return runs


def some_segments(seed, count):
    """Segments between points of a raster of half metres, in and around the shapes."""
    rng = np.random.default_rng(seed)
    starts = rng.integers(-2, 15, (count, 3)) / [2, 2, 4]
    ends = rng.integers(-2, 15, (count, 3)) / [2, 2, 4]
    return starts, ends


def runs_of(floor, starts, ends):
    """As the floor tells: one by one, and all from the same end, for which it sorts them."""
    one_by_one = [int(floor.walls_crossed(a, b)) for a, b in zip(starts, ends, strict=True)]
    is_clear = [bool(floor.is_line_of_sight(a, b)) for a, b in zip(starts, ends, strict=True)]
    assert is_clear == [runs == 0 for runs in one_by_one]
    return one_by_one


# --- polygons -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", POLYGONS)
def test_a_prism_cuts_the_segments_that_it_cuts_in_exact_arithmetic(name):
    ring, holes = POLYGONS[name]
    floor = Floor(NO_BOXES, Prisms([shapely.Polygon(ring, holes)], [HEIGHT]), ())
    sides = [
        side for each in (ring, *holes) for side in zip(each, each[1:] + each[:1], strict=True)
    ]
    starts, ends = some_segments(1, 250)
    true = [
        true_runs(a, b, sides, lambda x, y, z: is_inside(x, y, z, ring, holes))
        for a, b in zip(starts, ends, strict=True)
    ]
    assert runs_of(floor, starts, ends) == true
    assert 30 < np.count_nonzero(true) < 220
    assert max(true) >= (1 if name == "wedge" else 2)


@pytest.mark.parametrize("name", POLYGONS)
def test_many_points_see_what_each_sees(name):
    ring, holes = POLYGONS[name]
    floor = Floor(NO_BOXES, Prisms([shapely.Polygon(ring, holes)], [HEIGHT]), ())
    starts, ends = some_segments(2, 150)
    for end in ends[:5]:
        one_by_one = [int(floor.walls_crossed(start, end)) for start in starts]
        assert floor.walls_crossed(starts, end).tolist() == one_by_one


@pytest.mark.parametrize("name", POLYGONS)
def test_a_prism_covers_the_points_strictly_inside(name):
    ring, holes = POLYGONS[name]
    floor = Floor(NO_BOXES, Prisms([shapely.Polygon(ring, holes)], [HEIGHT]), ())
    points = np.stack(np.meshgrid(np.arange(-2, 15), np.arange(-2, 15)), axis=-1) / 2  # (Y, X, 2)
    true = [[is_inside(Fraction(x), Fraction(y), 1, ring, holes) for x, y in row] for row in points]
    assert floor.is_covered(points).tolist() == true


# --- rasters --------------------------------------------------------------------------------------


def raster(seed, shape, share):
    return Raster(np.random.default_rng(seed).random(shape) < share, 0.5, (0.5, 0.0), HEIGHT)


def is_in_raster(x, y, z, cells) -> bool:
    """Whether a point lies strictly inside the closed blocked cells: all that touch it are."""
    if not 0 < z < Fraction(HEIGHT):
        return False
    i, j = (x - Fraction(1, 2)) * 2, y * 2
    across = {int(i // 1), int(-((-i) // 1)) - 1} if i == i // 1 else {int(i // 1)}
    up = {int(j // 1), int(-((-j) // 1)) - 1} if j == j // 1 else {int(j // 1)}
    return all(
        0 <= a < cells.shape[0] and 0 <= b < cells.shape[1] and cells[a, b]
        for a in across
        for b in up
    )


@pytest.mark.parametrize("shape", [(12, 12), (5, 13), (13, 4), (1, 1)])
@pytest.mark.parametrize("share", [0.15, 0.7, 1.0])
def test_a_raster_cuts_the_segments_that_it_cuts_in_exact_arithmetic(shape, share):
    solid = raster(3, shape, share)
    floor = Floor(NO_BOXES, NO_PRISMS, (solid,))
    half = Fraction(1, 2)
    sides = [((half + half * i, 0), (half + half * i, 1)) for i in range(shape[0] + 1)]
    sides += [((0, half * j), (1, half * j)) for j in range(shape[1] + 1)]
    starts, ends = some_segments(4, 100)
    true = [
        true_runs(a, b, sides, lambda x, y, z: is_in_raster(x, y, z, solid.is_filled))
        for a, b in zip(starts, ends, strict=True)
    ]
    assert runs_of(floor, starts, ends) == true
    for end in ends[:5]:
        one_by_one = [int(floor.walls_crossed(start, end)) for start in starts]
        assert floor.walls_crossed(starts, end).tolist() == one_by_one
        assert (floor.is_line_of_sight(starts, end) == (np.array(one_by_one) == 0)).all()


def test_a_raster_covers_the_points_strictly_inside():
    solid = raster(5, (12, 12), 0.6)
    points = np.stack(np.meshgrid(np.arange(-2, 30), np.arange(-2, 30)), axis=-1) / 4  # (Y, X, 2)
    true = [
        [is_in_raster(Fraction(x), Fraction(y), 1, solid.is_filled) for x, y in row]
        for row in points
    ]
    assert Floor(NO_BOXES, NO_PRISMS, (solid,)).is_covered(points).tolist() == true


def test_the_outline_of_a_raster_is_its_cells():
    solid = raster(6, (7, 9), 0.5)
    centres = np.stack(np.meshgrid(*(np.arange(n) for n in (7, 9)), indexing="ij"), axis=-1) / 2
    centres += np.array([0.75, 0.25])
    inside = shapely.contains_xy(solid.footprint, centres[..., 0], centres[..., 1])
    assert inside.tolist() == solid.is_filled.tolist()
    assert solid.footprint.area == pytest.approx(solid.is_filled.sum() / 4, rel=1e-12)


# --- one thing drawn in several ways --------------------------------------------------------------


def corners_of(box):
    (x, y), (width, depth, _) = box["center"], box["size"]
    return [[x + a * width / 2, y + b * depth / 2] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def as_polygon(box):
    return {"polygon": corners_of(box), "height": box["size"][2]}


def as_raster(box, cell_size):
    columns, rows = (round(side / cell_size) for side in box["size"][:2])
    return {
        "origin": corners_of(box)[0],
        "cell_size": cell_size,
        "rows": ["#" * columns] * rows,
        "height": box["size"][2],
    }


def redrawn(scene, how, **more):
    """The scene with each of its boxes drawn in another way."""
    data = scene.to_data()
    data["obstacles"] = [how(box) for box in data["obstacles"]]
    return Scene.from_data({**data, "format_version": 2, **more})


HOW = {
    "polygons": as_polygon,
    "rasters of whole metres": lambda box: as_raster(box, 1.0),
    "rasters of quarters": lambda box: as_raster(box, 0.25),
    "rasters of tenths": lambda box: as_raster(box, 0.1),
}


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("cell_size", [0.5, 0.4])
def test_boxes_polygons_and_rasters_make_the_same_map(how, cell_size):
    boxes = build_radio_map(PAPER, cell_size)
    others = build_radio_map(redrawn(PAPER, HOW[how]), cell_size)
    assert (others.free == boxes.free).all()
    free = boxes.free
    assert np.abs(others.gain_db[free] - boxes.gain_db[free]).max() < 1e-9


def test_boxes_polygons_and_rasters_count_as_walls_alike():
    points = np.random.default_rng(0).uniform((-10, -10, 0), (10, 10, 2), (300, 3))
    ends = [point.position for point in PAPER.access_points] + [(9.0, -9.0, 0.2), (2.0, 2.0, 1.0)]
    counts = [
        np.stack([scene.floor.walls_crossed(points, end) for end in ends])
        for scene in (PAPER, *(redrawn(PAPER, how) for how in HOW.values()))
    ]
    assert counts[0].max() > 1
    assert all((each == counts[0]).all() for each in counts)


def turned(scene, degrees):
    """The scene as polygons, turned about the origin, and how to turn a point."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def moved(point):
        return [*(turn @ point[:2]).tolist(), *point[2:]]

    data = redrawn(scene, as_polygon).to_data()
    room = data["room"]
    ring = [
        (room[x], room[y])
        for x, y in (("x_min", "y_min"), ("x_max", "y_min"), ("x_max", "y_max"), ("x_min", "y_max"))
    ]
    data["room"] = {"polygon": [moved(corner) for corner in ring], "height": room["height"]}
    for each in data["obstacles"]:
        each["polygon"] = [moved(corner) for corner in each["polygon"]]
    for each in (*data["access_points"], *data["irs_panels"]):
        each["position"] = moved(each["position"])
    for panel in data["irs_panels"]:
        panel["wall"] = degrees if panel["wall"].startswith("y") else degrees + 90.0
    for end in ("start", "goal"):
        data[end] = moved(data[end])
    return Scene.from_data(data), turn


@pytest.mark.parametrize("name", ["paper", "workshop"])
@pytest.mark.parametrize("degrees", [30.0, 201.5])
def test_a_turned_scene_has_the_same_gains_at_turned_points(name, degrees):
    scene = load_scene(name)
    other, turn = turned(scene, degrees)
    floor = scene.grid(0.5).centres().reshape(-1, 2)  # (n, 2)
    assert (other.floor.is_covered(floor @ turn.T) == scene.floor.is_covered(floor)).all()
    floor = floor[~scene.floor.is_covered(floor)]
    height = np.full((len(floor), 1), scene.antenna_height)
    for hardware in (Hardware(), Hardware(1), Hardware(2, "optimal", "coherent")):
        for one, image in zip(scene.access_points, other.access_points, strict=True):
            gains = channel(scene, one, np.hstack([floor, height])).expected_gain(hardware)
            images = channel(other, image, np.hstack([floor @ turn.T, height])).expected_gain(
                hardware
            )
            assert np.abs(10 * np.log10(images / gains)).max() < 1e-9


# --- rooms ----------------------------------------------------------------------------------------

ELL = [[0, 0], [8, 0], [8, 3], [3, 3], [3, 8], [0, 8]]


def ell(**more):
    """A room round a corner, whose access point is at the end of one leg."""
    data = {
        **PAPER.to_data(),
        "format_version": 2,
        "name": "ell",
        "obstacles": [],
        "irs_panels": [],
    }
    data |= {"room": {"polygon": ELL, "height": 4.0}, "access_points": [{"position": [8, 1.5, 2]}]}
    return Scene.from_data({**data, "start": [1, 7], "goal": [7, 1], **more})


def test_nobody_enters_what_is_outside_of_the_room():
    radio_map = build_radio_map(ell(), 1.0)
    assert radio_map.grid.shape == (8, 8)
    assert radio_map.free.sum() == 8 * 3 + 3 * 5
    assert not radio_map.free[3:, 3:].any()


def test_rays_do_not_leave_the_room_however_high():
    floor = ell().floor
    points = np.array([[1.0, 7.0, 1.0], [1.0, 2.5, 1.0], [2.0, 3.2, 1.0], [1.0, 7.0, 3.9]])
    assert floor.is_line_of_sight(points, (8.0, 1.5, 2.0)).tolist() == [False, True, True, False]


def test_cells_over_a_polygon_reach_beyond_it():
    grid = ell().grid(0.7)
    assert grid.shape == (12, 12)
    assert grid.origin == (0, 0)


def test_a_room_with_a_courtyard_has_no_way_through_it():
    room = {
        "polygon": [[0, 0], [8, 0], [8, 8], [0, 8]],
        "holes": [[[3, 3], [5, 3], [5, 5], [3, 5]]],
    }
    scene = ell(room={**room, "height": 4.0}, start=[1, 1], goal=[7, 7])
    assert build_radio_map(scene, 1.0).free.sum() == 64 - 4
    assert not scene.floor.is_line_of_sight(np.array([1.0, 4.0, 3.0]), (7.0, 4.0, 3.0))


# --- what scene files say -------------------------------------------------------------------------


def test_a_raster_is_drawn_as_on_a_map():
    drawn = RasterObstacle(origin=(0, 0), cell_size=1, rows=("#.", "..", ".#"), height=1)
    assert drawn.is_filled.tolist() == [[False, False, True], [True, False, False]]
    assert RasterObstacle.from_array(drawn.is_filled, 1.0, (0.0, 0.0), 1.0) == drawn


BOWTIE = [[0, 0], [2, 2], [2, 0], [0, 2]]
SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2]]
HOSTILE = {
    "crossing": ({"polygon": BOWTIE, "height": 1}, r"obstacles\[0\]\.polygon: it crosses"),
    "two corners": (
        {"polygon": SQUARE[:2], "height": 1},
        r"obstacles\[0\]\.polygon: .* at least 3",
    ),
    "a line": ({"polygon": [[0, 0], [1, 1], [2, 2]], "height": 1}, r"obstacles\[0\]\.polygon: it "),
    "one point": ({"polygon": [[1, 1]] * 4, "height": 1}, r"obstacles\[0\]\.polygon: it "),
    "NaN": ({"polygon": [[float("nan"), 0], *SQUARE], "height": 1}, r"polygon\[0\]\[0\]: .*finite"),
    "no height": ({"polygon": SQUARE}, r"obstacles\[0\]\.height: Field required"),
    "hole outside": (
        {"polygon": SQUARE, "holes": [[[5, 5], [6, 5], [6, 6]]], "height": 1},
        r"obstacles\[0\]: holes must lie inside polygon",
    ),
    "crossing hole": (
        {"polygon": [[-3, -3], [3, -3], [3, 3], [-3, 3]], "holes": [BOWTIE], "height": 1},
        r"obstacles\[0\]\.holes\[0\]: it crosses",
    ),
    "outside": (
        {"polygon": [[9, 0], [12, 0], [9, 2]], "height": 1},
        r"obstacles\[0\] reaches from .* outside the room",
    ),
    "no rows": (
        {"origin": [0, 0], "cell_size": 1, "rows": [], "height": 1},
        r"obstacles\[0\]\.rows: .* at least 1 item",
    ),
    "empty rows": (
        {"origin": [0, 0], "cell_size": 1, "rows": ["", ""], "height": 1},
        r"obstacles\[0\]: rows make 0 x 2 cells",
    ),
    "ragged rows": (
        {"origin": [0, 0], "cell_size": 1, "rows": ["##", "#"], "height": 1},
        r"obstacles\[0\]: rows\[1\] has 1 cells, the first one 2",
    ),
    "strange letters": (
        {"origin": [0, 0], "cell_size": 1, "rows": ["#.", "#@"], "height": 1},
        r"obstacles\[0\]: rows\[1\] must be made of '#' and '\.' alone",
    ),
    "huge raster": (
        {"origin": [0, 0], "cell_size": 1e-4, "rows": ["." * 5000] * 5000, "height": 1},
        r"obstacles\[0\]: rows make 5000 x 5000 cells",
    ),
    "large cells": (
        {"origin": [0, 0], "cell_size": 50, "rows": ["#"], "height": 1},
        r"obstacles\[0\] reaches from .* outside the room",
    ),
    "two kinds": (
        {"polygon": SQUARE, "rows": ["#"], "height": 1},
        r"obstacles\[0\]\.rows: Extra inputs",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_shape_that_cannot_be_is_named(name):
    obstacle, message = HOSTILE[name]
    with pytest.raises(ValueError, match=message):
        Scene.from_data({**PAPER.to_data(), "format_version": 2, "obstacles": [obstacle]})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"obstacles": [as_polygon({"center": [5, 5], "size": [1, 1, 1]})]}, r"obstacles\[0\]"),
        ({"path_loss": "InF-SH"}, "path_loss='InF-SH'"),
        ({"path_loss": {"wall_loss_db": 3.4}}, "path_loss=MultiWall"),
        ({"room": {"polygon": [[-10, -10], [10, -10], [10, 10], [-10, 10]], "height": 5}}, "room"),
    ],
)
def test_a_file_of_format_1_knows_nothing_of_format_2(change, message):
    Scene.from_data({**PAPER.to_data(), **change, "format_version": 2})
    with pytest.raises(ValueError, match=f"{message}.* needs format_version 2"):
        Scene.from_data({**PAPER.to_data(), **change})


def test_a_room_that_crosses_itself_is_named():
    with pytest.raises(ValueError, match=r"room\.polygon: it crosses"):
        ell(room={"polygon": BOWTIE, "height": 4})


def test_a_panel_with_an_angle_hangs_in_the_room_and_in_no_obstacle():
    data = {**PAPER.to_data(), "format_version": 2}
    panel = data["irs_panels"][0]
    Scene.from_data(
        {**data, "irs_panels": [{**panel, "wall": 0, "position": [0, -2, 2]}]}
    )  # a face
    for place in ([0, 0, 2], [0, -11, 2], [0, -10, 6]):
        with pytest.raises(ValueError, match=r"irs_panels\[0\]\.position=.* must lie in the room"):
            Scene.from_data({**data, "irs_panels": [{**panel, "wall": 0.0, "position": place}]})


def test_a_scene_of_format_2_survives_the_round_trip(tmp_path):
    obstacles = [
        {"center": [5, -5], "size": [1, 2, 3]},
        as_polygon({"center": [-5, -5], "size": [1, 2, 3]}),
        as_raster({"center": [5, 5], "size": [1, 2, 3]}, 0.5),
    ]
    scene = Scene.from_data({**PAPER.to_data(), "format_version": 2, "obstacles": obstacles})
    scene.save(tmp_path / "scene.json")
    again = load_scene(tmp_path / "scene.json")
    assert again == scene
    assert hash(again) == hash(scene)
    assert Scene.from_data(again.to_data()) == scene


def test_a_panel_is_focused_on_no_cell_inside_a_polygon():
    scene = redrawn(PAPER, as_polygon)
    focused_codebook(scene, [(0, 20)])
    with pytest.raises(ValueError, match=r"cells\[1\]=\(20, 20\) lies inside an obstacle"):
        focused_codebook(scene, [(0, 20), (20, 20)])
