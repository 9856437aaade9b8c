"""Facts of walls with doors: rooms that are connected, walls that nobody drives through."""

import numpy as np
import pytest
from scipy.ndimage import label

from irs_gym import Difficulty, generate_scene
from irs_gym.datasets.layouts.floor_plan import LEAST_SIDE, THICKNESS, draw_walls
from irs_gym.datasets.shard import definition_of
from irs_gym.grid import Grid
from irs_gym.radio.geometry import Boxes, is_in_footprint
from irs_gym.radio.scene import Room

CELL_SIZE = 0.5


def plan(seed):
    """A room with walls, how many rooms were asked for, and the floor that is left, (X, Y)."""
    rng = np.random.default_rng(seed)
    half_x, half_y = (rng.integers(14, 41, 2) / 4).tolist()
    room = Room(x_min=-half_x, x_max=half_x, y_min=-half_y, y_max=half_y, height=4.0)
    rooms = int(rng.integers(1, 12))
    walls = draw_walls(rng, room, rooms, CELL_SIZE)
    ends = (
        np.array([getattr(wall, end) for wall in walls]).reshape(-1, 3)
        for end in ("lower", "upper")
    )
    centres = Grid.tile(room.lower, room.upper, CELL_SIZE).centres()
    return room, rooms, walls, ~is_in_footprint(centres, Boxes(*ends))


PLANS = [plan(seed) for seed in range(100)]


def test_every_room_can_be_reached_without_cutting_a_corner():
    for _, _, _, floor in PLANS:
        assert label(floor)[1] == 1  # in four directions


def test_walls_divide_the_floor_into_as_many_rooms_as_asked_for_or_fewer_where_none_fits():
    for room, rooms, walls, _ in PLANS:
        # with the doors shut: lines of walls from end to end cut what they meet
        lines = {
            (axis, round((wall.center[axis] - room.lower[axis]) / CELL_SIZE - 0.5))
            for wall in walls
            for axis in [int(wall.size[0] > wall.size[1])]
        }
        assert len(lines) <= rooms - 1
    assert any(len(walls) >= rooms - 1 > 5 for _, rooms, walls, _ in PLANS)


def test_what_is_next_to_a_wall_on_its_line_is_a_door_of_its_own_or_another_wall():
    for room, _, walls, floor in PLANS:
        for wall in walls:
            axis = int(wall.size[0] > wall.size[1])
            at = round((wall.center[axis] - room.lower[axis]) / CELL_SIZE - 0.5)
            line = np.take(floor, at, axis)  # (n,), of cells on the wall's line
            middle = (wall.center[1 - axis] - room.lower[1 - axis]) / CELL_SIZE
            half = wall.size[1 - axis] / CELL_SIZE / 2
            after, before = line[round(middle + half) :], line[: round(middle - half)][::-1]
            for beside in (after, before):
                free = len(beside) if beside.all() else int(np.argmin(beside))
                assert free <= 3


def test_one_room_has_no_walls():
    room = Room(x_min=0, x_max=20, y_min=0, y_max=20, height=3)
    assert draw_walls(np.random.default_rng(0), room, 1, CELL_SIZE) == ()


def test_walls_are_thin_reach_the_ceiling_and_hold_a_line_of_cells():
    for room, _, walls, _ in PLANS:
        for wall in walls:
            assert min(wall.size[:2]) == THICKNESS
            assert wall.size[2] == room.height
            axis = int(wall.size[0] > wall.size[1])
            place = (wall.center[axis] - room.lower[axis]) / CELL_SIZE - 0.5
            assert abs(place - round(place)) < 1e-9
            assert place >= LEAST_SIDE


def test_equal_seeds_draw_equal_walls():
    room = PLANS[3][0]
    one, other = (draw_walls(np.random.default_rng(8), room, 6, CELL_SIZE) for _ in range(2))
    assert one == other != draw_walls(np.random.default_rng(9), room, 6, CELL_SIZE)


def test_scenes_may_have_rooms():
    level = Difficulty(rooms=(5, 5), boxes=(0, 0), detour_share=0.0)
    scene = generate_scene(np.random.default_rng(1), level)
    assert len(scene.obstacles) >= 4
    assert {min(wall.size[:2]) for wall in scene.obstacles} == {THICKNESS}
    assert scene.format_version == 1


@pytest.mark.parametrize("rooms", [(0, 3), (4, 2), (1, 1000), (2.0, 3), 5, "many"])
def test_rooms_that_cannot_be_are_refused(rooms):
    with pytest.raises(ValueError, match="rooms="):
        Difficulty(rooms=rooms)


def test_shards_of_splits_without_rooms_are_called_as_before_there_were_any():
    assert '"rooms"' not in definition_of("test", 0, 100)
    assert '"rooms": [4, 10]' in definition_of("ood-rooms", 0, 100)
