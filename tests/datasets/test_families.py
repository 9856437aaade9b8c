"""Facts of families: walls that no robot passes, detours that they alone make, and what each is
named after.
"""

import networkx
import numpy as np
import pytest

from irs_gym.datasets.generator import (
    CELL_SIZE,
    DETOURS,
    SLACK_DB,
    Difficulty,
    draw_solved_scene,
    generate_scene,
)
from irs_gym.datasets.layouts.families import draw_layout
from irs_gym.datasets.layouts.floor_plan import THICKNESS
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.datasets.shard import definition_of
from irs_gym.datasets.splits import FAMILIES, SPLITS, all_but, scene_of, solved_scene_of, split_of
from irs_gym.grid import MOVES, Grid, octile_distance
from irs_gym.mdp.robot import Robot
from irs_gym.oracle.shortest_path import largest_component
from irs_gym.radio.scene import Room

WALLED = [name for name, level in FAMILIES.items() if level.family is not None]
SCENES = {name: [solved_scene_of(f"train-{name}", n) for n in range(6)] for name in FAMILIES}
ROOM = Room(x_min=-8.0, x_max=8.0, y_min=-7.0, y_max=7.0, height=5.0)


def graph_of(solved):
    """The free cells and moves of a scene in networkx, a straight move one long."""
    free = solved.radio_map.free
    graph = networkx.Graph()
    for cell in np.argwhere(free).tolist():
        for move in MOVES.tolist():
            to = tuple(np.add(cell, move).tolist())
            if min(to) >= 0 and all(np.less(to, free.shape)) and free[to]:
                graph.add_edge(tuple(cell), to, weight=float(np.hypot(*move)))
    return graph


def test_there_are_six_families_of_walls_and_two_more():
    assert WALLED == ["maze", "doors", "spiral", "zigzag", "trap", "racks"]
    assert list(FAMILIES) == [*WALLED, "hall", "aps"]


@pytest.mark.parametrize("name", WALLED)
def test_walls_alone_decide_and_make_detours_of_1_2_to_6(name):
    for each in SCENES[name][:3]:
        length = networkx.shortest_path_length(
            graph_of(each), each.start, each.goal, weight="weight"
        )
        straight = octile_distance(np.subtract(each.goal, each.start))
        assert DETOURS[0] < length / straight <= DETOURS[1]
        assert each.oracle_distance == pytest.approx(length * CELL_SIZE)


@pytest.mark.parametrize("name", WALLED)
def test_the_target_excludes_no_cell_of_the_floor(name):
    for each in SCENES[name]:
        gain_db = each.radio_map.gain_db[largest_component(each.radio_map.free)]
        assert gain_db.min() - SLACK_DB - 0.01 <= each.scene.target_db <= gain_db.min()


@pytest.mark.parametrize("name", ["hall", "aps"])
def test_in_the_others_the_target_excludes_some(name):
    for each in SCENES[name]:
        gain_db = each.radio_map.gain_db[each.radio_map.free]
        assert gain_db.min() < each.scene.target_db < gain_db.max()


@pytest.mark.parametrize("name", ["maze", "doors", "spiral", "zigzag", "trap"])
def test_walls_are_thin_and_reach_the_ceiling(name):
    for each in SCENES[name]:
        walls = [box for box in each.scene.obstacles if min(box.size[:2]) == THICKNESS]
        assert len(walls) >= 3
        assert {wall.size[2] for wall in walls} == {each.scene.room.height}


def blocked_by(layout) -> np.ndarray:
    """Cells of the room whose centre lies in a box."""
    grid = Grid.tile(ROOM.lower, ROOM.upper, CELL_SIZE)
    centres = grid.centres()  # (X, Y, 2)
    blocked = np.zeros(grid.shape, dtype=bool)
    for box in layout.obstacles:
        low, high = np.array(box.lower[:2]), np.array(box.upper[:2])
        blocked |= ((centres >= low) & (centres <= high)).all(axis=2)
    return blocked


@pytest.mark.parametrize("family", ["maze", "spiral", "zigzag"])
def test_all_of_the_floor_between_the_walls_is_connected(family):
    for seed in range(8):
        free = ~blocked_by(draw_layout(np.random.default_rng(seed), family, ROOM, CELL_SIZE))
        assert (largest_component(free) == free).all()


def test_a_zigzag_and_a_spiral_have_one_way_through():
    # one way: without the cells of the path's narrowest place, start and goal are apart
    for name in ("zigzag", "spiral"):
        for each in SCENES[name]:
            graph = graph_of(each)
            distance = networkx.single_source_shortest_path_length(graph, each.goal)
            rings = [[] for _ in range(max(distance.values()) + 1)]
            for cell, moves in distance.items():
                rings[moves].append(cell)
            narrowest = min(rings[5 : distance[each.start] - 5], key=len)
            assert len(narrowest) <= 8
            graph.remove_nodes_from(narrowest)
            assert not networkx.has_path(graph, each.start, each.goal)


def test_robots_start_in_traps():
    for seed in range(8):
        layout = draw_layout(np.random.default_rng(seed), "trap", ROOM, CELL_SIZE)
        assert not (blocked_by(layout) & layout.starts).any() or layout.starts.any()
    for n, each in enumerate(SCENES["trap"]):
        # walls on three sides or two of them in view: rays along the axes meet one
        free, (i, j) = each.radio_map.free, each.start
        rays = [free[i:, j], free[: i + 1, j], free[i, j:], free[i, : j + 1]]
        assert sum(not ray.all() for ray in rays) >= 2, n


def test_halls_are_long_and_narrow_either_way():
    sides = [np.subtract(each.scene.room.upper, each.scene.room.lower) for each in SCENES["hall"]]
    assert all(10 <= min(each) <= 14 and 26 <= max(each) <= 32 for each in sides)
    assert {int(np.argmax(each)) for each in sides} == {0, 1}


def test_some_have_several_access_points_and_some_no_panel():
    assert {len(each.scene.access_points) for each in SCENES["aps"]} <= {2, 3, 4}
    for name in ("maze", "spiral", "zigzag"):
        assert not any(each.scene.irs_panels for each in SCENES[name])


def test_racks_have_aisles_and_are_lower_than_the_ceiling():
    for each in SCENES["racks"]:
        racks = [box for box in each.scene.obstacles if 1.0 in box.size[:2]]
        assert len(racks) >= 4
        assert all(2.0 <= box.size[2] <= 4.0 for box in racks)


def test_a_robot_with_a_body_gets_a_task_that_it_can_solve():
    body = Robot(robot_radius=0.2, collision="body")
    solved = draw_solved_scene(np.random.default_rng(0), Difficulty(family="zigzag"), body)
    assert DETOURS[0] < solved.detour <= DETOURS[1]


def test_equal_seeds_give_equal_scenes_and_splits_of_one_family_differ():
    level = Difficulty(family="trap")
    scenes = [generate_scene(np.random.default_rng(seed), level) for seed in (3, 3, 4)]
    assert scenes[0] == scenes[1] != scenes[2]
    assert SPLITS["ood-trap"].difficulty == SPLITS["train-trap"].difficulty
    assert SPLITS["ood-trap"].is_frozen
    assert not SPLITS["train-trap"].is_frozen


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"family": "castle"}, "family='castle' must be one of"),
        ({"other_sides": (1.0, 2.0)}, "other_sides="),
        ({"access_points": (0, 1)}, "access_points="),
        ({"access_points": (3, 2)}, "access_points="),
    ],
)
def test_bad_families_are_refused_by_field(change, message):
    with pytest.raises(ValueError, match=message):
        Difficulty(**change)


def test_shards_of_before_there_were_families_are_as_good_as_new_ones():
    assert "family" not in definition_of("test", 0, 100)
    assert '"family": "maze"' in definition_of("ood-maze", 0, 100)
    assert '"access_points": [2, 4]' in definition_of("ood-aps", 0, 100)


def test_joined_sets_give_their_scenes_in_turn_in_a_frame_that_holds_all(tmp_path):
    joined = build_scene_set("train-hall+train-trap", 3, jobs=1, cache=tmp_path)
    assert joined.names == ("train-hall-0", "train-trap-0", "train-hall-1")
    assert joined.shape == split_of("train-hall+train-trap").frame == (64, 64)
    for n, name in enumerate(joined.names):
        assert joined.scenes[n].name == name == scene_of("train-hall+train-trap", n).name
    trap = build_scene_set("train-trap", 1, jobs=1, cache=tmp_path)
    np.testing.assert_array_equal(joined.gain_db[1, :40, :40], trap.gain_db[0])
    assert joined.oracle_distance[1] == trap.oracle_distance[0]
    assert np.isneginf(joined.gain_db[1, 40:]).all()


def test_joined_sets_may_have_shares(tmp_path):
    split = "3*train-trap+train-maze+train-racks"
    joined = build_scene_set(split, 7, jobs=1, cache=tmp_path)
    assert joined.names == (
        *("train-trap-0", "train-trap-1", "train-trap-2", "train-maze-0", "train-racks-0"),
        *("train-trap-3", "train-trap-4"),
    )
    for n, name in enumerate(joined.names):
        assert joined.scenes[n].name == name == scene_of(split, n).name
    assert scene_of(split, 12).name == "train-trap-8"
    traps = build_scene_set("train-trap", 5, jobs=1, cache=tmp_path)
    np.testing.assert_array_equal(joined.gain_db[[0, 1, 2, 5, 6]], traps.gain_db)

    # of a million, three in each turn
    assert split_of(split).size == 5 * 333_333
    assert split_of("train-trap+train-maze+train-trap").size == 3 * 500_000


def test_all_families_but_one_may_be_learned_on():
    members = all_but("maze").split("+")
    assert len(members) == len(FAMILIES)
    assert "train-maze" not in members
    assert split_of(all_but("hall")).frame == (40, 40)


@pytest.mark.parametrize(
    "name",
    [
        *("train+test", "train+train", "train+", "train+castle"),
        *("2*train", "2*train+train", "2*test", "2*test+train", "2*train+", "2*"),
        *("0*train+train-maze", "100*train+train-maze", "-1*train+train-maze", "2*2*train+train"),
    ],
)
def test_what_cannot_be_learned_on_cannot_be_joined(name):
    with pytest.raises(ValueError, match="split="):
        split_of(name)
