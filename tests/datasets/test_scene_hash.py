"""Facts of symmetries: what an image of a scene keeps, and what its hash tells apart."""

import numpy as np
import pytest

from irs_gym.datasets.generator import Difficulty, draw_solved_scene
from irs_gym.datasets.scene_hash import scene_hash, symmetries
from irs_gym.datasets.solved_scene import solve
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import Scene, load_scene

LEVEL = Difficulty(panels=("usual", "two"))
SAMPLE = [draw_solved_scene(np.random.default_rng([3, seed]), LEVEL) for seed in range(4)]
PAPER, WORKSHOP = load_scene("paper"), load_scene("workshop")
WARD = load_scene("ward")  # polygons, a raster, a room that is a polygon, a panel at an angle


def image_of(array, number):
    """The image of an array (X, Y) in the order of `symmetries`."""
    array = array.T if number & 4 else array
    array = array[::-1] if number & 2 else array
    return array[:, ::-1] if number & 1 else array


@pytest.mark.parametrize("each", SAMPLE, ids=lambda each: f"{each.scene.phase_bits}-bit")
def test_the_radio_map_of_an_image_is_the_image_of_the_radio_map(each):
    for number, scene in enumerate(symmetries(each.scene)):
        found, wanted = solve(scene), image_of(each.radio_map.gain_db, number)
        assert np.array_equal(found.radio_map.free, np.isfinite(wanted))
        free = np.isfinite(wanted)
        assert np.abs(found.radio_map.gain_db[free] - wanted[free]).max() < 1e-9


@pytest.mark.parametrize("each", SAMPLE, ids=lambda each: f"{each.scene.phase_bits}-bit")
def test_the_oracles_distance_in_an_image_is_the_same(each):
    for scene in symmetries(each.scene):
        assert solve(scene).oracle_distance == pytest.approx(each.oracle_distance, abs=1e-9)


@pytest.mark.parametrize("scene", [WORKSHOP, WARD], ids=lambda scene: scene.name)
def test_the_map_of_an_image_of_a_scene_of_the_package_is_the_image_of_its_map(scene):
    whole = build_radio_map(scene, 0.5)
    for number, image in enumerate(symmetries(scene)):
        found, wanted = build_radio_map(image, 0.5), image_of(whole.gain_db, number)
        assert np.array_equal(found.free, np.isfinite(wanted))
        assert np.abs(found.gain_db[found.free] - wanted[found.free]).max() < 1e-9


@pytest.mark.parametrize("ring", ["forwards", "backwards", "closed"])
def test_the_hash_is_the_same_however_a_ring_is_written(ring):
    number = next(n for n, each in enumerate(WARD.obstacles) if hasattr(each, "polygon"))
    corners = WARD.obstacles[number].polygon
    ways = {
        "forwards": corners[2:] + corners[:2],
        "backwards": corners[::-1],
        "closed": (*corners, corners[0]),
    }
    other = WARD.obstacles[number].model_copy(update={"polygon": ways[ring]})
    obstacles = (*WARD.obstacles[:number], other, *WARD.obstacles[number + 1 :])
    assert scene_hash(WARD.model_copy(update={"obstacles": obstacles})) == scene_hash(WARD)
    moved = other.model_copy(update={"polygon": tuple((x, y + 0.01) for x, y in corners)})
    obstacles = (*WARD.obstacles[:number], moved, *WARD.obstacles[number + 1 :])
    assert scene_hash(WARD.model_copy(update={"obstacles": obstacles})) != scene_hash(WARD)


@pytest.mark.parametrize("scene", [SAMPLE[0].scene, WORKSHOP, WARD], ids=lambda scene: scene.name)
def test_a_scene_has_eight_valid_images_the_first_its_own(scene):
    images = symmetries(scene)
    assert images[0] == scene
    assert len({image.model_dump_json() for image in images}) == 8
    for image in images:
        assert Scene.model_validate_json(image.model_dump_json()) == image


def test_images_of_images_are_images():
    scene = SAMPLE[1].scene
    texts = {image.model_dump_json() for image in symmetries(scene)}
    for image in symmetries(scene):
        assert {each.model_dump_json() for each in symmetries(image)} == texts


def test_the_papers_scene_mirrored_in_x_is_itself_but_for_its_ends():
    mirrored = symmetries(PAPER)[2]
    swapped = mirrored.model_copy(update={"start": mirrored.goal, "goal": mirrored.start})
    assert scene_hash(swapped) == scene_hash(PAPER)


@pytest.mark.parametrize(
    "scene", [SAMPLE[0].scene, SAMPLE[2].scene, PAPER, WORKSHOP, WARD], ids=lambda scene: scene.name
)
def test_the_hash_is_the_same_for_all_images(scene):
    assert {scene_hash(image) for image in symmetries(scene)} == {scene_hash(scene)}


def test_the_hash_is_the_same_whatever_the_name_the_place_and_the_order_of_the_parts():
    scene = WORKSHOP
    data = scene.model_dump()
    data["name"] = "other"
    for parts in ("obstacles", "access_points", "irs_panels"):
        data[parts] = data[parts][::-1]
    data["room"] |= {"x_min": 5.0, "x_max": 37.0}
    for place, parts in (
        ("center", "obstacles"),
        ("position", "access_points"),
        ("position", "irs_panels"),
    ):
        data[parts] = [
            {**part, place: (part[place][0] + 5, *part[place][1:])} for part in data[parts]
        ]
    data["start"], data["goal"] = ((data[end][0] + 5, data[end][1]) for end in ("start", "goal"))
    assert scene_hash(Scene.model_validate(data)) == scene_hash(scene)


@pytest.mark.parametrize(
    "change",
    [
        {"target_db": -61.79},
        {"phase_bits": 1},
        {"start": (-10.0, 0.5)},
        {"antenna_height": 1.1},
        {"rician_factor_db": 3.1},
        {"obstacles": PAPER.obstacles[1:]},
        {"irs_panels": ()},
        {"room": PAPER.room.model_copy(update={"height": 6.0})},
        {"irs_panels": (PAPER.irs_panels[0].model_copy(update={"columns": 6, "rows": 10}),)},
    ],
    ids=" ".join,
)
def test_the_hash_tells_other_scenes_apart(change):
    assert scene_hash(PAPER.model_copy(update=change)) != scene_hash(PAPER)
