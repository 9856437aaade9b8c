"""Facts of the parts of a scene: what a hand takes hold of, where parts go, and what is said of
those that cannot be there.
"""

import numpy as np
import pytest

from irs_gym import load_scene
from irs_gym.radio.scene import Scene, scene_names
from irs_gym.workbench.handle import (
    Handle,
    duplicated,
    edited,
    footprint_of,
    handle_at,
    moved,
    numbers_of,
    place_of,
    without,
)


def handles(scene: Scene) -> list[Handle]:
    lists = ("obstacles", "access_points", "irs_panels")
    return [
        Handle("start"),
        Handle("goal"),
        *(Handle(kind, n) for kind in lists for n in range(len(getattr(scene, kind)))),
    ]


EVERY_PART = [
    pytest.param(load_scene(name), handle, id=f"{name}-{handle}")
    for name in scene_names()
    for handle in handles(load_scene(name))
]
WARD = load_scene("ward")


@pytest.mark.parametrize(("scene", "handle"), EVERY_PART)
def test_a_part_that_is_moved_by_nothing_or_given_its_own_numbers_is_the_same(scene, handle):
    assert moved(scene, handle, (0.0, 0.0)) == scene
    for label, value in numbers_of(scene, handle).items():
        assert edited(scene, handle, label, value) == scene


@pytest.mark.parametrize(("scene", "handle"), EVERY_PART)
def test_a_hand_takes_a_mark_where_it_is(scene, handle):
    if handle.kind == "obstacles":
        inside = footprint_of(scene.obstacles[handle.number]).representative_point()
        taken = handle_at(scene, (inside.x, inside.y), reach=1e-9)
        shape = footprint_of(scene.obstacles[taken.number])
        assert shape.area <= footprint_of(scene.obstacles[handle.number]).area
        assert shape.covers(inside)
    else:
        assert handle_at(scene, place_of(scene, handle), reach=0.5) == handle


def test_a_hand_on_the_bare_floor_takes_nothing():
    assert handle_at(load_scene("paper"), (-8.0, 8.0), reach=0.5) is None


@pytest.mark.parametrize("number", [0, 43, 44, 46])  # a box, a triangle, a round table, a raster
def test_an_obstacle_of_any_kind_keeps_its_shape(number):
    handle = Handle("obstacles", number)
    by = (0.25, 0.0) if number == 0 else (-0.25, -0.5)
    before = footprint_of(WARD.obstacles[number])
    after = footprint_of(moved(WARD, handle, by).obstacles[number])
    np.testing.assert_allclose(np.subtract(after.bounds, before.bounds), [*by, *by], atol=1e-6)
    assert after.area == pytest.approx(before.area)


def test_a_panel_on_a_wall_goes_to_the_nearest_one_and_no_further():
    paper = load_scene("paper")
    panel = Handle("irs_panels", 0)
    assert moved(paper, panel, (3.0, 1.0)).irs_panels[0].position == (3.0, -10.0, 2.0)
    there = moved(paper, panel, (9.0, 6.0)).irs_panels[0]
    assert (there.wall, there.position) == ("x_max", (10.0, -4.0, 2.0))
    assert moved(paper, panel, (50.0, 0.0)).irs_panels[0].position[:2] == (10.0, -10.0)


def test_a_panel_at_an_angle_goes_where_the_hand_does():
    panel = moved(WARD, Handle("irs_panels", 0), (-1.0, 1.0)).irs_panels[0]
    assert (panel.wall, panel.position) == (45.0, (23.5, 8.5, 1.8))


def test_a_panel_is_typed_in_along_its_wall():
    paper = load_scene("paper")
    assert numbers_of(paper, Handle("irs_panels", 0)) == {"x": 0.0, "z": 2.0}
    assert edited(paper, Handle("irs_panels", 0), "z", 3.0).irs_panels[0].position[2] == 3.0


@pytest.mark.parametrize(
    ("handle", "by", "why"),
    [
        (Handle("start"), (9.0, 1.0), r"start=\(-1.0, 1.0\) lies inside an obstacle"),
        (Handle("start"), (-1.0, 0.0), r"start=\(-11.0, 0.0\) lies outside the room"),
        (Handle("goal"), (-20.0, 0.0), r"goal=\(-10.0, 0.0\) must differ from start"),
        (Handle("access_points", 0), (0.0, 1.0), r"access_points\[0\].position=.* outside the"),
        (Handle("obstacles", 2), (0.0, 9.0), r"obstacles\[2\] reaches from .* outside the room"),
    ],
)
def test_what_cannot_be_there_is_named(handle, by, why):
    with pytest.raises(ValueError, match=rf"^{why}"):
        moved(load_scene("paper"), handle, by)


def test_a_twin_lies_beside_its_part_and_can_be_taken_away_again():
    paper = load_scene("paper")
    for handle in handles(paper)[2:]:
        twice, twin = duplicated(paper, handle)
        assert place_of(twice, twin) != place_of(twice, handle)
        assert without(twice, twin) == paper


@pytest.mark.parametrize("handle", [Handle("start"), Handle("access_points", 0)])
def test_a_part_that_a_scene_needs_is_not_removed(handle):
    with pytest.raises(ValueError, match=r"start is needed|access_points: .* at least 1 item"):
        without(load_scene("paper"), handle)


def test_no_end_can_be_there_twice():
    with pytest.raises(ValueError, match="goal cannot be there twice"):
        duplicated(load_scene("paper"), Handle("goal"))
