"""Facts of robots with a body: what they keep away from, on which moves they meet an obstacle, and
that every environment holds them to it.
"""

import warnings
from itertools import pairwise, product
from math import inf

import gymnasium
import numpy as np
import pytest
import shapely
from alike import assert_equal_for, both
from gymnasium.vector import AutoresetMode
from tiny_pool import tiny_pool

from irs_gym import (
    RadioMap,
    Robot,
    build_radio_map,
    cost_map,
    distance_to_go,
    generate_scene,
    load_scene,
    shortest_path,
)
from irs_gym.datasets.scene_set import scene_set_of
from irs_gym.datasets.solved_scene import solve
from irs_gym.datasets.splits import scene_of
from irs_gym.grid import MOVES, octile_distance
from irs_gym.mdp.action_values import optimal_q
from irs_gym.mdp.dynamics import transition_table
from irs_gym.mdp.task import Task, build_world
from irs_gym.radio.geometry import is_in_footprint
from irs_gym.radio.scene import Obstacle, Scene
from irs_gym.radio.shapes import RasterObstacle

PAPER = load_scene("paper")
START, GOAL = (0, 20), (39, 20)
ROBOTS = [
    Robot(corner_cutting=False),
    Robot(robot_radius=0.2),
    Robot(collision="body"),
    Robot(corner_cutting=False, robot_radius=0.24, collision="body"),
]


def walled(x: float, thickness: float) -> Scene:
    """The paper's scene with a wall from one side to the other."""
    wall = Obstacle(center=(x, 0.0), size=(thickness, 20.0, 2.0))
    return PAPER.model_copy(update={"name": "walled", "obstacles": (*PAPER.obstacles, wall)})


def gap(first, second, box):
    """Metres from a segment to a box on the floor, and of the segment inside it: by its points,
    1 mm apart and less.
    """
    ends = np.array([first, second])
    points = ends[0] + np.linspace(0, 1, 751)[:, None] * (ends[1] - ends[0])  # (n, 2)
    beyond = np.maximum(np.array(box.lower[:2]) - points, points - np.array(box.upper[:2]))
    return np.hypot(*np.maximum(beyond, 0.0).T).min(), (beyond.max(axis=1) < -1e-6).any()


# --- cells and moves ------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "thickness"), [(5.0, 0.5), (5.0, 0.3), (5.1, 0.2)])
def test_a_wall_without_a_cell_is_named_and_stops_a_body(x, thickness):
    scene = walled(x, thickness)
    message = r"scene 'walled': no cell is blocked by obstacles\[5\] from .*: robots drive through"
    with pytest.warns(UserWarning, match=message):
        radio_map = build_radio_map(scene)
    assert shortest_path(radio_map.feasible(-90.0), START, GOAL, 0.5) is not None
    with pytest.warns(UserWarning, match=r"obstacles\[5\].* collision='centre', robots drive"):
        gymnasium.make("irs_gym:IrsNav-v0", scene=scene, target_db=-90.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit = Robot(collision="body").fit(radio_map, scene)
        with pytest.raises(ValueError, match="no target is"):
            gymnasium.make("irs_gym:IrsNav-v0", scene=scene, target_db=-90.0, collision="body")
    free = fit.radio_map.feasible(-90.0)
    assert shortest_path(free, START, GOAL, 0.5, **fit.motion) is None


def test_a_post_that_no_move_meets_is_named_for_a_body_too():
    post = Obstacle(center=(5.1, 5.0), size=(0.05, 0.05, 2.0))
    scene = PAPER.model_copy(update={"obstacles": (post,), "name": "post"})
    radio_map = RadioMap.from_array(np.full((40, 40), -60.0), 0.5, (-10.0, -10.0))
    with pytest.warns(UserWarning, match=r"obstacles\[0\].*collision='body', robots drive through"):
        Robot(collision="body").fit(radio_map, scene)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Robot(collision="body", robot_radius=0.2).fit(radio_map, scene)
        Robot().fit(build_radio_map("paper"), PAPER)
        Robot().fit(build_radio_map("workshop"), load_scene("workshop"))


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.25, 0.4])
def test_a_move_is_refused_where_the_disc_meets_a_box(radius):
    """The moves of some cells on random floors, against the distance of their points to boxes."""
    met = kept = 0
    rng = np.random.default_rng(3)
    for n in range(3):
        scene = scene_of("test", n)
        radio_map = RadioMap(build_radio_map(scene).gain_db, grid=scene.grid(0.5))
        fit = Robot(robot_radius=radius, collision="body").fit(radio_map, scene)
        free, grid = fit.radio_map.free, radio_map.grid
        is_edge = free & ~fit.motion["passable"].all(axis=-1)
        some = [rng.permutation(np.argwhere(each))[:15] for each in (free, is_edge)]
        for cell in np.concatenate(some).tolist():
            for move, way in enumerate(MOVES.tolist()):
                ahead = (cell[0] + way[0], cell[1] + way[1])
                if not grid.has(ahead) or not free[ahead]:
                    continue
                gaps = [
                    gap(grid.centre(tuple(cell)), grid.centre(ahead), box)
                    for box in scene.obstacles
                ]
                least = min(metres for metres, _ in gaps)
                if abs(least - radius) < 1e-3 and radius:  # too near to tell by points
                    continue
                if not radius and sum(metres == 0 for metres, _ in gaps) > 1:  # perhaps a seam
                    continue
                is_met = least < radius if radius else any(inside for _, inside in gaps)
                assert fit.motion["passable"][(*cell, move)] == (not is_met)
                met += is_met
                kept += not is_met
    assert kept > 250
    assert met > 3


@pytest.mark.parametrize("radius", [0.2, 0.25, 0.3, 1.0])
@pytest.mark.parametrize("collision", ["centre", "body"])
def test_cells_nearer_than_the_radius_to_a_box_or_wall_cannot_be_entered(radius, collision):
    radio_map = build_radio_map("paper")
    fit = Robot(robot_radius=radius, collision=collision).fit(radio_map, PAPER)
    centres = radio_map.grid.centres()
    metres = 10.0 - np.abs(centres).max(axis=-1)
    for box in PAPER.obstacles:
        beyond = np.maximum(np.array(box.lower[:2]) - centres, centres - np.array(box.upper[:2]))
        metres = np.minimum(metres, np.hypot(*np.moveaxis(np.maximum(beyond, 0.0), -1, 0)))
    expected = radio_map.free & (metres >= radius - 1e-9)
    assert (fit.radio_map.free == expected).all()
    assert (np.isfinite(fit.radio_map.gain_db) == expected).all()
    assert (fit.radio_map.gain_db[expected] == radio_map.gain_db[expected]).all()


def test_on_a_map_from_elsewhere_blocked_cells_are_squares():
    gain_db = np.full((7, 5), -60.0)
    gain_db[3, 2] = -inf
    radio_map = RadioMap.from_array(gain_db, 1.0)
    fit = Robot(robot_radius=0.5, collision="body").fit(radio_map)
    assert fit.radio_map.free.sum() == 34  # 0.5 m from the nearest
    moves = fit.motion["passable"]
    assert moves[2, 1, 0]  # east, below the square at 0.5 m
    assert not moves[2, 2, 1]  # north-east, over its corner
    point = Robot(collision="body").fit(radio_map).motion["passable"]
    assert point[2, 2, 1]  # from beside the square to above it: over its corner, and no more
    wide = Robot(robot_radius=0.51, collision="body").fit(radio_map)
    assert wide.radio_map.free.sum() == 15 - 5  # neither at the walls nor beside the square


def test_the_papers_robot_crosses_boxes_between_centres_and_a_body_does_not():
    crossed = {"centre": 0, "body": 0}
    for n, collision in product(range(12), crossed):
        scene = scene_of("test", n)
        robot = Robot(collision=collision)
        solved = solve(scene, robot=robot)
        motion = robot.fit(solved.radio_map, scene).motion
        free = solved.radio_map.feasible(scene.target_db)
        path = shortest_path(free, solved.start, solved.goal, 0.5, **motion)
        assert path.distance == pytest.approx(solved.oracle_distance)
        grid = solved.radio_map.grid
        for first, second in pairwise(map(tuple, path.cells.tolist())):
            ends = grid.centre(first), grid.centre(second)
            crossed[collision] += any(gap(*ends, box)[1] for box in scene.obstacles)
    assert crossed["body"] == 0 < crossed["centre"]


# --- environments ---------------------------------------------------------------------------------


CONSTRAINTS = {
    **{name: {"constraint": name} for name in ("refuse", "terminate", "allow")},
    "budget": {"constraint": "budget", "budget": 3.0},
}


def arguments(robot: Robot) -> dict:
    return {
        "corner_cutting": robot.corner_cutting,
        "robot_radius": robot.robot_radius,
        "collision": robot.collision,
    }


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
def test_masks_oracle_and_returns_of_an_environment_are_those_of_the_robot(robot):
    task = Task(target_db=-63.0, start=(1, 20), goal=(38, 20), **arguments(robot))
    world = build_world(task)
    fit = robot.fit(build_radio_map("paper"), PAPER)
    feasible = fit.radio_map.feasible(-63.0)
    env = gymnasium.make(
        "irs_gym:IrsNav-v0",
        target_db=-63.0,
        start=(1, 20),
        goal=(38, 20),
        **arguments(robot),
    ).unwrapped
    env.reset(seed=0)

    expected = shortest_path(feasible, (1, 20), (38, 20), 0.5, **fit.motion)
    assert env.oracle.distance == expected.distance
    to_go = distance_to_go(feasible, (38, 20), 0.5, **fit.motion)
    table = transition_table(world, (38, 20))
    values = optimal_q(table, 1.0).max(axis=1).reshape(40, 40)
    reached = np.isfinite(to_go) & (to_go > 0)
    octile = octile_distance(np.argwhere(reached) - np.array((38, 20))) * 0.5
    np.testing.assert_allclose(values[reached], 10.0 - to_go[reached] + octile, atol=1e-9)

    for first, second in pairwise(map(tuple, env.oracle.cells.tolist())):
        move = MOVES.tolist().index([second[0] - first[0], second[1] - first[1]])
        assert env.action_masks()[move]
        assert move in env.optimal_actions()
        _, _, terminated, _, info = env.step(move)
        assert not info["is_refused"]
    assert terminated
    assert info["spl"] == 1.0


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow", "budget"])
def test_vector_environments_have_the_same_robots(robot, constraint):
    constraint = CONSTRAINTS[constraint]
    scene = {"target_db": -62.5, "start": (1, 20), "goal": (38, 20), "goal_bonus": 100.0}
    kwargs = {**arguments(robot), **constraint, "observation": "masked"}
    ours, single = both(
        "irs_gym:IrsNav-v0", 4, AutoresetMode.NEXT_STEP, random_start=0.9, **scene, **kwargs
    )
    assert_equal_for(60, ours, single)


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow", "budget"])
@pytest.mark.filterwarnings("ignore:.*cannot be solved by")
def test_vector_environments_over_many_scenes_have_the_same_robots(robot, constraint):
    kwargs = {
        **arguments(robot),
        "scenes": tiny_pool(8, (9, 7)),
        "goal_bonus": 100.0,
        "max_episode_steps": 12,
        **CONSTRAINTS[constraint],
    }
    ours, single = both(
        "irs_gym:IrsNavRandom-v0", 4, AutoresetMode.SAME_STEP, random_start=0.5, **kwargs
    )
    assert assert_equal_for(80, ours, single) > 10


def test_scenes_that_a_robot_cannot_solve_are_left_out_of_a_split_with_a_warning():
    with pytest.warns(UserWarning, match=r"\d of 12 scenes cannot be solved by Robot.*left out"):
        envs = gymnasium.make_vec(
            "irs_gym:IrsNavRandom-v0", num_envs=2, split="test", num_scenes=12, robot_radius=0.3
        ).unwrapped
    kept = envs.worlds.pool
    assert 0 < len(kept) < 12
    assert np.isfinite(kept.oracle_distance).all()
    for n, name in enumerate(kept.names):
        assert kept.scenes[n].name == name


def test_given_scenes_that_a_robot_cannot_solve_are_refused_by_name():
    robot = Robot(robot_radius=0.3, collision="body")  # the scene's ends are at the walls
    with pytest.raises(ValueError, match=r"scene 'paper': target_db=-61.8 is infeasible from"):
        scene_set_of([PAPER], robot=robot)
    with pytest.raises(ValueError, match=r"scene 'paper': target_db=-61.8 is infeasible from"):
        gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=[PAPER], **arguments(robot))


def test_scenes_of_one_robot_are_not_taken_for_those_of_another():
    pool = tiny_pool(4, (9, 7))
    mine = pool.for_robot(Robot(collision="body"))
    assert mine.for_robot(Robot(collision="body")) is mine
    with pytest.raises(ValueError, match="scenes are those of Robot"):
        mine.for_robot(Robot(corner_cutting=False))


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
def test_generated_scenes_can_be_solved_by_the_robot_they_are_drawn_for(robot):
    for seed in range(4):
        scene = generate_scene(np.random.default_rng(seed), **arguments(robot))
        assert np.isfinite(solve(scene, robot=robot).oracle_distance)


def test_a_start_too_near_to_a_wall_is_named_with_the_radius():
    with pytest.raises(ValueError, match=r"start=\(0, 20\) .* nearer than robot_radius=0.3 m"):
        gymnasium.make("irs_gym:IrsNav-v0", robot_radius=0.3)


def test_outages_are_paid_for_by_a_robot_with_a_radius_too():
    radio_map = build_radio_map("paper")
    fit = Robot(robot_radius=0.2).fit(radio_map, PAPER)
    costs = cost_map(fit.radio_map, -61.8, "outage")
    free = fit.radio_map.free
    assert (costs[free] == cost_map(radio_map, -61.8, "outage")[free]).all()
    assert np.isinf(costs[~free]).all()


def test_another_robot_is_another_task_for_saved_states_and_for_problems():
    from agents.runs.problem import problem_of

    usual = gymnasium.make("irs_gym:IrsNav-v0").unwrapped
    usual.reset(seed=0)
    state = usual.get_state()
    other = gymnasium.make("irs_gym:IrsNav-v0", corner_cutting=False).unwrapped
    other.reset(seed=0)
    with pytest.raises(ValueError, match="state is of another task"):
        other.set_state(state)
    assert problem_of(Task(corner_cutting=False)) != problem_of(Task())
    assert "no corner cutting" in problem_of(Task(corner_cutting=False)).label


# --- other shapes ---------------------------------------------------------------------------------


def as_shapes(scene: Scene, kind: str) -> Scene:
    """A scene of boxes on a raster of 0.25 m with these as polygons or as one raster."""
    data = scene.to_data() | {"format_version": 2}
    if kind == "polygons":
        corners = [shapely.box(*box.lower[:2], *box.upper[:2]).exterior for box in scene.obstacles]
        data["obstacles"] = [
            {"polygon": [list(corner) for corner in ring.coords], "height": box.size[2]}
            for ring, box in zip(corners, scene.obstacles, strict=True)
        ]
        return Scene.from_data(data)

    centres = scene.grid(0.25).centres()
    is_filled = is_in_footprint(centres, scene.boxes)
    raster = RasterObstacle.from_array(is_filled, 0.25, scene.room.lower, 2.0)
    return Scene.from_data(data | {"obstacles": [raster.model_dump(mode="json")]})


@pytest.mark.parametrize("kind", ["polygons", "raster"])
@pytest.mark.parametrize("radius", [0.0, 0.2])
def test_a_robot_fits_boxes_polygons_and_rasters_alike(kind, radius):
    robot = Robot(robot_radius=radius, collision="body")
    refused = 0
    for n in range(4):
        scene = scene_of("test", n).with_irs_elements(0)
        whole = build_radio_map(scene)
        expected = robot.fit(whole, scene)
        found = robot.fit(whole, as_shapes(scene, kind))
        assert (found.radio_map.free == expected.radio_map.free).all()
        assert (found.motion["passable"] == expected.motion["passable"]).all()
        refused += (~expected.motion["passable"]).sum()
    assert refused > 10


@pytest.mark.parametrize(
    "edge", [0.25, 0.1 + 0.2 + 0.45]
)  # the second one is 0.75 but for rounding
def test_there_is_no_way_between_boxes_side_by_side(edge):
    low = Obstacle(center=(0.0, edge - 2.0), size=(4.0, 4.0, 2.0))
    high = Obstacle(center=(0.0, round(edge, 2) + 2.0), size=(4.0, 4.0, 2.0))
    scene = PAPER.model_copy(update={"obstacles": (low, high)})
    radio_map = RadioMap.from_array(np.full((40, 40), -60.0), 0.5, (-10.0, -10.0))
    cell = radio_map.grid.cell_of((0.0, edge))
    assert radio_map.grid.centre(cell)[1] == pytest.approx(edge)
    moves = Robot(collision="body").fit(radio_map, scene).motion["passable"]
    assert not moves[cell].any()


def test_a_thin_wall_at_an_angle_and_the_outside_of_a_room_stop_a_body():
    data = PAPER.to_data() | {"format_version": 2, "irs_panels": []}
    data["room"] = {"polygon": [[-10, -10], [10, -10], [10, 10], [0, 10], [0, 9], [-10, 9]], "height": 5.0}  # fmt: skip
    ends = np.array([[-3.0, -10.0], [3.0, 10.0]])
    aside = np.array([0.01, 0.0])
    data["obstacles"] = [{"polygon": [*(ends - aside).tolist(), *(ends[::-1] + aside).tolist()], "height": 3.0}]  # fmt: skip
    scene = Scene.from_data(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        radio_map = build_radio_map(scene)
    free = radio_map.feasible(-200.0)
    assert shortest_path(free, (2, 20), (37, 20), 0.5) is not None
    fit = Robot(collision="body").fit(radio_map, scene)
    assert (
        shortest_path(fit.radio_map.feasible(-200.0), (2, 20), (37, 20), 0.5, **fit.motion) is None
    )
    wide = Robot(robot_radius=0.3, collision="body").fit(radio_map, scene).radio_map.free
    assert not wide[10, 37]  # 0.25 m from the room's edge at y = 9
    assert wide[10, 36]
