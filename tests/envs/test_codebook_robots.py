"""Facts of robots with a body that switch the panel: the rules are those of `IrsNav-v0`, under every
configuration.
"""

from functools import cache

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, both
from gymnasium.vector import AutoresetMode

from irs_gym import (
    Codebook,
    Robot,
    build_radio_map,
    codebook_gain_db,
    cover_codebook,
    focused_codebook,
    generate_scene,
    highest_joint_target,
    joint_distance_to_go,
    joint_shortest_path,
    load_scene,
)
from irs_gym.grid import MOVES
from irs_gym.mdp import task as task_module
from irs_gym.radio.radio_map import RadioMap

ID = "irs_gym:IrsNavCodebook-v0"
PAPER = load_scene("paper")
CELLS = [(12, 19), (22, 15), (31, 22), (4, 20), (36, 22), (20, 35)]
FEW = focused_codebook("paper", CELLS)
START, GOAL = (1, 20), (38, 20)
ROBOTS = [
    Robot(corner_cutting=False),
    Robot(robot_radius=0.2),
    Robot(collision="body"),
    Robot(corner_cutting=False, robot_radius=0.24, collision="body"),
]
CONSTRAINTS = ["refuse", "terminate", "allow"]
# each robot and each constraint
CASES = [*zip(ROBOTS, CONSTRAINTS, strict=False), *((ROBOTS[3], each) for each in CONSTRAINTS)]


def arguments(robot):
    return {
        "corner_cutting": robot.corner_cutting,
        "robot_radius": robot.robot_radius,
        "collision": robot.collision,
    }


def make(robot, **kwargs):
    usual = {"codebook": FEW, "target_db": -62.2, "start": START, "goal": GOAL}
    return gymnasium.make(ID, **{**usual, **arguments(robot), **kwargs})


@cache
def gains_for(robot):
    """Gains of the few where the robot can be, (6, 40, 40), and its moves."""
    fit = robot.fit(build_radio_map("paper"), PAPER)
    return np.where(fit.radio_map.free, codebook_gain_db("paper", FEW), -np.inf), fit.motion


# --- the rules ------------------------------------------------------------------------------------


def may_move(cells, passable, corner_cutting, i, j, move):
    """Whether a move from (i, j) stays on the cells, by hand."""
    di, dj = MOVES[move].tolist()
    if not (0 <= i + di < 40 and 0 <= j + dj < 40 and cells[i + di, j + dj]):
        return False
    if passable is not None and not passable[i, j, move]:
        return False
    return corner_cutting or not (di and dj) or bool(cells[i + di, j] and cells[i, j + dj])


@pytest.mark.parametrize(("robot", "constraint"), CASES, ids=str)
def test_what_is_refused_and_missed_is_that_of_the_rules_written_down_once_more(robot, constraint):
    env = make(robot, constraint=constraint, goal_bonus=100.0).unwrapped
    env.reset()
    table = env.transition_table()
    gain_db, motion = gains_for(robot)
    free = np.isfinite(gain_db[0])
    meets = gain_db >= -62.2
    moves = (motion["passable"], robot.corner_cutting)
    stays = env.maps.size * np.arange(6)
    rng = np.random.default_rng(0)
    seen = {True: 0, False: 0}

    for i, j in rng.permutation(np.argwhere(free))[:60].tolist():
        if (i, j) == GOAL:
            continue
        for state in (stays + i * 40 + j).tolist():
            k = state // env.maps.size
            for move in range(8):
                is_open = may_move(free, *moves, i, j, move)
                keeps = may_move(meets[k], *moves, i, j, move)
                is_done = is_open if constraint == "allow" else keeps
                is_missed = {
                    "refuse": False,
                    "terminate": is_open and not keeps,
                    "allow": not keeps if is_open else not meets[k, i, j],
                }[constraint]
                assert table.is_refused[state, move] != is_done
                assert table.cost[state, move] == is_missed
                ahead = state + (MOVES[move] @ (40, 1) if is_done else 0)
                assert table.next_cell[state, move] == ahead
                seen[bool(is_done)] += 1
            for to in range(6):  # a switch is in place, whatever the body
                is_done = to != k and (constraint == "allow" or bool(meets[to, i, j]))
                assert table.is_refused[state, 8 + to] != is_done

    assert min(seen.values()) > 50


@pytest.mark.parametrize(("robot", "constraint"), CASES, ids=str)
def test_one_configuration_is_irsnav_with_the_same_robot(robot, constraint, monkeypatch):
    """Of a scene whose map is that of the configuration."""
    one = Codebook.from_array(FEW.phase_shifts[:1])
    gain_db = codebook_gain_db("paper", one)[0]

    def its_map(radio, *, needs_shifts):
        return RadioMap(gain_db, grid=radio.grid), np.zeros((40, 40, 0), dtype=np.float32)

    monkeypatch.setattr(task_module, "build_map_and_shifts", its_map)
    task_module._build_world.cache_clear()
    target_db = highest_joint_target(gain_db[None], (10, 20), (15, 21)) - 2.0
    kwargs = {
        **arguments(robot),
        "target_db": target_db,
        "constraint": constraint,
        "goal_bonus": 60.0,
        "start": (10, 20),
        "goal": (15, 21),
        "random_start": 0.7,
        "max_episode_steps": 60,
    }
    ours = gymnasium.make(ID, codebook=one, **kwargs)
    theirs = gymnasium.make("irs_gym:IrsNav-v0", irs_phases=False, **kwargs)
    task_module._build_world.cache_clear()
    rng = np.random.default_rng(0)
    refused = arrived = 0

    for seed in range(20):
        mine, its = ours.reset(seed=seed), theirs.reset(seed=seed)
        is_over = False
        while not is_over:
            for key, value in its[0].items():
                np.testing.assert_array_equal(mine[0][key], value)
            for key, value in its[-1].items():
                if key == "action_mask":
                    np.testing.assert_array_equal(mine[-1][key], [*value, 0])
                else:
                    assert mine[-1][key] == pytest.approx(value, abs=1e-9), key
            # mostly along a best path, so that some arrive
            best = theirs.unwrapped.optimal_actions()
            action = int(rng.choice(best) if len(best) and rng.random() < 0.6 else rng.integers(8))
            mine, its = ours.step(action), theirs.step(action)
            assert mine[1:4] == its[1:4]
            refused += its[-1]["is_refused"]
            arrived += its[-1]["is_success"]
            is_over = its[2] or its[3]
        assert ours.unwrapped.path == theirs.unwrapped.path

    assert refused > 15
    assert arrived > 5


@pytest.mark.parametrize(("robot", "constraint"), CASES, ids=str)
def test_vector_environments_have_the_same_robots(robot, constraint):
    ours, single = both(
        ID,
        4,
        AutoresetMode.NEXT_STEP if robot.is_point else AutoresetMode.SAME_STEP,
        codebook=FEW,
        target_db=-62.2,
        patch_radius=2,
        start=(30, 22),
        goal=(33, 20),
        max_episode_steps=30,
        constraint=constraint,
        random_start=0.5,
        goal_bonus=100.0,
        **arguments(robot),
    )
    assert assert_equal_for(120, ours, single) > 8


# --- the oracle, and where episodes begin ---------------------------------------------------------


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
@pytest.mark.parametrize("switch_cost", [0.0, 0.5])
def test_the_best_actions_lead_to_the_goal_at_the_joint_oracles_cost(robot, switch_cost):
    env = make(robot, switch_cost=switch_cost)
    _, info = env.reset()
    gain_db, motion = gains_for(robot)
    path = joint_shortest_path(gain_db, -62.2, START, GOAL, 0.5, switch_cost, **motion)
    assert info["oracle_distance"] == pytest.approx(path.distance, abs=1e-9)
    assert env.unwrapped.oracle.distance == path.distance
    while not info["is_success"]:
        *_, info = env.step(int(env.unwrapped.optimal_actions()[0]))
        assert not info["is_refused"]
    assert info["distance"] == pytest.approx(path.distance, abs=1e-9)
    assert info["spl"] == pytest.approx(1.0)

    # to another goal as well
    other = (20, 33)
    _, info = env.reset(options={"goal": other})
    to_go = joint_distance_to_go(gain_db, -62.2, other, 0.5, switch_cost, **motion)
    assert info["oracle_distance"] == pytest.approx(to_go[(info["configuration"], *START)])


def test_a_robot_with_a_body_has_a_longer_way():
    lengths = [make(robot).unwrapped.oracle.distance for robot in (Robot(), *ROBOTS)]
    assert lengths[0] == min(lengths) < lengths[1]
    assert lengths[4] == max(lengths)


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
def test_random_starts_are_all_that_lead_to_the_goal(robot):
    env = make(robot, random_start=True).unwrapped
    gain_db, motion = gains_for(robot)
    to_go = joint_distance_to_go(gain_db, -62.2, GOAL, 0.5, 0.5, **motion)
    drawn = set()
    for seed in range(100):
        _, info = env.reset(seed=seed)
        here = (info["configuration"], *env.path[0])
        assert 0 < to_go[here] == pytest.approx(info["oracle_distance"], abs=1e-9)
        drawn.add(here)
    assert len(drawn) > 80


# --- many scenes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ROBOTS[3:], ids=str)
@pytest.mark.filterwarnings("ignore:.*cannot be solved by", "ignore:.*robots drive through")
def test_many_scenes_are_those_of_irsnavrandom_and_equal_in_both(robot):
    kwargs = {"split": "test", "num_scenes": 6, **arguments(robot)}
    ours, single = both(
        ID,
        3,
        AutoresetMode.SAME_STEP,
        codebook=("focused", 4),
        patch_radius=2,
        max_episode_steps=40,
        random_start=0.5,
        **kwargs,
    )
    assert_equal_for(100, ours, single)
    env = gymnasium.make(ID, codebook=("focused", 4), **kwargs).unwrapped
    names = gymnasium.make("irs_gym:IrsNavRandom-v0", **kwargs).unwrapped.worlds.pool.names
    assert env.maps.names == names
    for n, scene in enumerate(env.maps.scenes):
        info = env.reset(options={"scene_id": n})[1]
        target_db = float(env.maps.target_db[n])
        fit = robot.fit(build_radio_map(scene), scene)
        columns, rows = fit.radio_map.grid.shape
        assert (env.maps.free[n, :columns, :rows] == fit.radio_map.free).all()
        gains = env.maps.gain_db[n, :, :columns, :rows]
        ends = (env.maps.own_start(n), env.maps.own_goal(n))
        path = joint_shortest_path(gains, target_db, *ends, 0.5, 0.5, **fit.motion)
        assert info["oracle_distance"] == pytest.approx(path.distance, abs=1e-9)
        assert target_db <= highest_joint_target(gains, *ends, **fit.motion)


def test_a_scene_among_larger_ones_is_the_scene_alone():
    robot = Robot(corner_cutting=False, robot_radius=0.2, collision="body")
    scenes = [generate_scene(np.random.default_rng(n), "easy", **arguments(robot)) for n in (3, 5)]
    scenes = [each.model_copy(update={"target_db": -200.0}) for each in scenes]
    many = gymnasium.make(ID, codebook=("focused", 3), scenes=scenes, **arguments(robot)).unwrapped
    assert len({scene.grid(0.5).shape for scene in scenes}) == 2
    for n, scene in enumerate(scenes):
        alone = gymnasium.make(ID, codebook=("focused", 3), scene=scene, **arguments(robot))
        info = many.reset(options={"scene_id": n})[1]
        its = alone.reset()[1]
        assert info["oracle_distance"] == its["oracle_distance"]
        assert info["gain_db"] == its["gain_db"]
        np.testing.assert_array_equal(info["action_mask"], its["action_mask"])


# --- codebooks, states, refusals ------------------------------------------------------------------


def test_a_cover_is_one_for_the_robot():
    robot = Robot(corner_cutting=False, robot_radius=0.6, collision="body")
    where = {"target_db": -60.5, "start": (1, 10), "goal": (18, 10), "cell_size": 1.0}
    env = make(robot, codebook=("cover", 4), **where).unwrapped
    cover = cover_codebook("paper", 4, **where, **arguments(robot))
    free = robot.fit(build_radio_map("paper", 1.0), PAPER).radio_map.free
    expected = np.where(free, codebook_gain_db("paper", cover, 1.0), -np.inf)
    np.testing.assert_array_equal(env.maps.gain_db[0], expected)
    plain = cover_codebook("paper", 4, **where)
    assert not np.array_equal(plain.phase_shifts, cover.phase_shifts)


def test_a_state_of_one_robot_is_none_of_anothers():
    env = make(Robot())
    env.reset()
    state = env.unwrapped.get_state()
    for robot in ROBOTS:
        other = make(robot).unwrapped
        other.reset()
        with pytest.raises(ValueError, match="state is of another task"):
            other.set_state(state)
        again = other.get_state()
        other.step(0)
        other.set_state(again)
        assert other.get_state() == again


@pytest.mark.parametrize("codebook", [FEW, ("cover", 4), ("dft", 4)], ids=["few", "cover", "dft"])
def test_ends_too_near_to_a_wall_are_named_with_the_radius(codebook):
    for name, end in (("start", (0, 20)), ("goal", (39, 20))):
        with pytest.raises(ValueError, match=rf"{name}=\({end[0]}, 20\) .*robot_radius=0.3 m"):
            make(Robot(robot_radius=0.3), codebook=codebook, **{name: end})


def test_a_target_that_the_robot_cannot_hold_names_the_highest_that_it_can():
    robot = Robot(corner_cutting=False, robot_radius=0.7, collision="body")
    gain_db, motion = gains_for(robot)
    ends = {"start": (1, 22), "goal": (21, 12)}
    highest = highest_joint_target(gain_db, *ends.values(), **motion)
    told = np.floor(highest * 1e4) / 1e4
    assert told < highest_joint_target(codebook_gain_db("paper", FEW), *ends.values()) - 1
    with pytest.raises(ValueError, match=f"highest joint target is {told} dB"):
        make(robot, target_db=highest + 0.01, **ends)
    make(robot, target_db=told, **ends)


def test_scenes_of_one_robot_are_not_taken_for_those_of_another():
    with pytest.raises(ValueError, match=r"scene 'paper': target_db=-61.8 is infeasible from"):
        gymnasium.make(ID, scenes=[PAPER], codebook=("dft", 4), robot_radius=0.3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("robot_radius", value) for value in (-0.1, float("nan"), float("inf"), True, "1", None)),
        *(
            (name, value)
            for name in ("corner_cutting", "collision")
            for value in ("x", 1, None, [])
        ),
    ],
    ids=str,
)
@pytest.mark.parametrize("where", [{"codebook": FEW}, {"split": "val", "num_scenes": 2}])
def test_a_robot_that_is_none_is_refused_by_name(name, value, where):
    for work in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError, match=rf"{name}="):
            work(ID, **where, **{name: value})
