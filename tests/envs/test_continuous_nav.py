"""Facts of the environment whose robot goes anywhere on the floor."""

import json

import gymnasium
import numpy as np
import pytest
from alike import assert_same
from gymnasium.utils.env_checker import check_env

from agents.rollout.episode import evaluation_env
from irs_gym import build_radio_map, straight_line_bound
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.mdp.exact_field import RESOLUTION

ID = "irs_gym:IrsNavContinuous-v0"
START = (-9.75, 0.25)
GOAL = (9.75, 0.25)
# a wall with a gap at its upper end, and a cell below the target
GAINS = np.full((6, 5), -50.0)
GAINS[3, :4] = -np.inf
GAINS[1, 4] = -70.0
SMALL = {
    "radio_map": {"gain_db": None, "cell_size": 0.5, "origin": [0.0, 0.0]},
    "start": (0.25, 0.25),
    "goal": (2.75, 0.25),
}
SMALL["radio_map"]["gain_db"] = [
    [None if gain == -np.inf else gain for gain in row] for row in GAINS.tolist()
]


def make(**kwargs):
    return gymnasium.make(ID, **kwargs)


def follow(env, options=None, waypoints=None):
    """To the goal by the oracle's polyline, or straight from one of the waypoints to the next."""
    _, info = env.reset(options=options)
    robot = env.unwrapped
    waypoints = [] if waypoints is None else list(waypoints)
    for _ in range(400):
        if waypoints and np.hypot(*(waypoints[0] - robot.position)) < 1e-9:
            waypoints.pop(0)
        to = waypoints[0] if waypoints else robot.path_to_go[1]
        heading = (to - robot.position) / (robot.task.speed * robot.task.time_step)
        _, _, terminated, truncated, info = env.step(heading)
        if terminated or truncated:
            return info
    return info


@pytest.mark.parametrize(
    "kwargs",
    [
        {},
        {"observation": "flat"},
        {"constraint": "terminate", "goal_bonus": 30.0},
        {"constraint": "allow", "random_start": True, "observation": "flat"},
        {"constraint": "budget", "budget": (1.0, 5.0), "goal_bonus": 50.0},
        {"split": "val", "num_scenes": 2},
        SMALL | {"patch_radius": 1},
    ],
    ids=str,
)
@pytest.mark.filterwarnings("error")
def test_checkers_are_silent(kwargs):
    env = make(**kwargs)
    check_env(env.unwrapped)
    json.loads(env.spec.to_json())
    if kwargs.get("observation") == "flat":  # it warns of every Dict with a map
        pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, warn=True)


def test_the_optimum_is_that_of_the_straight_line_bound_less_the_radius():
    for target_db in (-61.8, -60.0):
        env = make(target_db=target_db)
        _, info = env.reset(seed=0)
        world = env.unwrapped.world
        bound = straight_line_bound(world.feasible, world.start, world.goal, 0.5)
        assert info["oracle_distance"] == pytest.approx(bound - 0.25, abs=1e-9)


def test_the_oracle_reaches_the_goal_by_the_optimum():
    env = make(target_db=-61.8, random_start=True)
    env.reset(seed=1)
    for _ in range(20):
        info = follow(env)
        assert info["is_success"]
        assert info["ratio"] == pytest.approx(1.0, abs=1e-12)
        assert info["distance"] == pytest.approx(info["oracle_distance"], abs=1e-12)


def test_nobody_is_better_than_the_optimum_by_cutting_corners():
    """Polylines over points near the corners that the oracle turns at, on either side of them."""
    env = make(target_db=-61.8, goal_radius=1.0)
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    corners = env.unwrapped.oracle_path[1:-1]
    reached = 0
    for trial in range(60):
        off = rng.normal(size=corners.shape) * 10.0 ** rng.integers(-13, -1)
        info = follow(env, waypoints=corners + off * (trial > 0))
        if info["is_success"]:
            reached += 1
            assert info["ratio"] >= 1 - 1e-9
            assert info["seconds"] >= info["oracle_distance"] * (1 - 1e-9)
    assert reached > 10


def test_nobody_arrives_through_a_wall():
    env = make(**SMALL, goal_radius=1.2)  # the disc reaches through the wall
    env.reset()
    for _ in range(6):
        _, _, terminated, _, info = env.step([1.0, 0.0])
    assert not terminated
    assert info["x"] == 1.5  # at the wall
    assert np.hypot(info["x"] - 2.75, info["y"] - 0.25) > 1.2
    env.reset(options={"start": (1.5, 0.6)})
    env.step([0.0, -0.7])
    assert not env.step([0.0, 0.0])[2]
    assert follow(env)["is_success"]


def test_a_move_takes_what_it_needs_and_the_reward_says_so():
    env = make(**SMALL)
    env.reset(options={"start": (2.75, 1.25)})
    _, reward, terminated, _, info = env.step([0.0, -0.5])
    assert (info["distance"], info["seconds"], info["steps"]) == (0.25, 0.5, 1)
    assert reward == pytest.approx(-0.5 + 0.25)  # the time of a whole step, and the shaping
    assert not terminated
    env.step([0.0, -0.2])
    _, reward, terminated, _, info = env.step([0.0, -3.0])
    assert terminated
    assert info["is_success"]
    assert info["y"] == pytest.approx(0.5)  # where the disc begins: 0.4 s of the step were needed
    assert info["seconds"] == pytest.approx(1.4)
    assert info["distance"] == pytest.approx(0.75)
    assert reward == pytest.approx(10.0)
    assert info["spl"] == pytest.approx(1.0)


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow", "budget"])
def test_below_the_target_the_constraint_decides(constraint):
    kwargs = {"budget": 0.2} if constraint == "budget" else {}
    env = make(**SMALL, constraint=constraint, target_db=-61.8, goal_bonus=50.0, **kwargs)
    env.reset(options={"start": (0.75, 1.75)})
    _, _, terminated, _, info = env.step([0.0, 1.0])  # 0.25 m ahead it begins, to 2.5 m
    if constraint in ("refuse", "terminate"):
        assert info["y"] == 2.0
        assert info["is_refused"]
        assert (terminated, info["cost"]) == ((False, 0.0), (True, 1.0))[constraint == "terminate"]
    else:
        assert info["y"] == 2.25
        assert info["cost"] == pytest.approx(0.25, abs=1e-9)  # seconds
        assert terminated == (constraint == "budget")
    if constraint == "refuse":
        assert env.step([0.0, -1.0])[4]["y"] == 1.5  # and back it goes
        assert env.step([0.0, -1.0])[4]["refused"] == 1
    if constraint == "allow":
        _, _, _, _, info = env.step([0.0, 1.0])
        assert (info["y"], info["cost"]) == (2.5, 0.5)  # and stands at the wall, below the target
        assert env.step([0.0, 0.0])[4]["cost"] == 0.5
        for heading in ([0.0, -1.0], [0.0, -1.0]):
            env.step(heading)
        assert env.step([0.0, 0.0])[4]["cost"] == 0.0


def test_who_is_stopped_may_stay_where_it_was():
    floor = {**SMALL, "target_db": -61.8, "random_start": 0.5}
    env = make(**floor, on_refused="stay")
    env.reset(options={"start": (0.75, 1.75)})
    _, reward, _, _, info = env.step([0.0, 1.0])
    assert (info["y"], info["distance"], info["is_refused"]) == (1.75, 0.0, True)
    assert (reward, info["seconds"]) == (-0.5, 0.5)  # the time passes
    tested = evaluation_env(ContinuousTask(**floor, on_refused="stay"))
    tested.reset(options={"start": (0.75, 1.75)})
    assert tested.step([0.0, 1.0])[4]["y"] == 2.0  # in tests it stands on the border


def test_a_budget_that_refuses_leaves_the_robot_where_it_is():
    env = make(**SMALL, constraint="budget", budget=0.2, on_exhausted="refuse", target_db=-61.8)
    env.reset(options={"start": (0.75, 1.75)})
    _, reward, _, _, info = env.step([0.0, 1.0])
    assert (info["y"], info["cost"], info["is_refused"], info["seconds"]) == (1.75, 0.0, True, 0.5)
    assert reward == -0.5
    assert info["budget_left"] == 0.2


def test_the_exact_field_is_lemma_1_at_the_point():
    env = make(field="exact", infos=["x", "y", "gain_db", "is_refused", "margin_db"])
    fine = build_radio_map("paper", 0.1)  # whose centres lie within the cells of 0.5 m
    env.reset(options={"start": fine.grid.centre((20, 145))})
    info = env.step([0.0, 0.0])[4]
    assert info["gain_db"] == pytest.approx(fine.gain_db[20, 145], abs=1e-9)
    # north of the start it is well above the target; into the box at y = 2 it cannot go
    env.reset(options={"start": (-3.05, 1.7)})
    info = env.step([0.0, 1.0])[4]
    assert info["is_refused"]
    assert 2.0 - RESOLUTION <= info["y"] <= 2.0


@pytest.mark.parametrize("field", ["cells", "exact"])
def test_all_of_a_move_meets_the_target(field):
    env = make(field=field, target_db=-61.8)
    model = env.unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    refused = 0
    for _ in range(60 if field == "exact" else 300):
        here = model.position
        info = env.step(env.action_space.sample())[4]
        refused += info["is_refused"]
        for share in np.linspace(0, 1, 7):
            x, y = model.maps.in_cells(0, here + share * (model.position - here))
            assert model._episode.site.judge.gain_db(x, y) >= -61.8
    assert refused


def test_seeds_decide_starts():
    env = make(random_start=True)
    first = env.reset(seed=5)
    assert_same(env.reset(seed=5), first)
    others = {env.reset(seed=seed)[1]["x"] for seed in range(8)}
    assert len(others) == 8


def test_a_state_is_taken_up_again():
    counted = {"constraint": "budget", "budget": 3.0, "on_exhausted": "continue"}
    env = make(**counted, observation="flat")
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(20):
        env.step(env.action_space.sample())
    other = make(**counted, observation="flat")
    other.reset(seed=1)
    state = env.unwrapped.get_state()
    other.unwrapped.set_state(state)
    for _ in range(20):
        action = env.action_space.sample()
        assert_same(env.step(action), other.step(action))
    with pytest.raises(ValueError, match="state is damaged"):
        other.unwrapped.set_state(state[:-1] + b"!")
    with pytest.raises(ValueError, match="state is of another task"):
        make().unwrapped.set_state(state)


@pytest.mark.parametrize(
    "action",
    [[np.nan, 0.0], [0.0, np.inf], [1e200, 0.0], [0.0], [0.0, 0.0, 0.0], 3, None, "ab", [None, 1]],
    ids=str,
)
def test_actions_that_mean_nothing_are_refused(action):
    env = make()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action=.* must be two finite numbers"):
        env.step(action)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"speed": 0.0}, "speed=0.0 must be a number above 0"),
        ({"speed": np.nan}, "speed=nan must be"),
        ({"time_step": -1}, "time_step=-1 must be"),
        ({"goal_radius": np.inf}, "goal_radius=inf must be"),
        ({"time_step": 3.0}, r"time_step=3.0 s at speed=1.0 m/s leads over 6 cells"),
        ({"patch_radius": 0, "speed": 2.0}, "further than the 0.5 that the robot sees"),
        ({"field": "smooth"}, "field='smooth' must be one of"),
        ({"on_refused": "slide"}, "on_refused='slide' must be one of"),
        ({"observation": "masked"}, "observation='masked' must be one of"),
        ({"start": (0.0, np.nan)}, "start=.* must be two finite numbers"),
        ({"start": (0.0, 30.0)}, "start: the point .* lies outside the floor"),
        ({"start": (0.0, 0.0)}, "start=.* lies in an obstacle"),
        ({"start": (-9.0, -9.0)}, "target_db=-61.8 is infeasible from"),
        ({"start": (9.7, 0.2)}, "start=.* must lie outside of the goal"),
        ({"split": "val", "target_db": -60.0}, "target_db cannot be given along with split"),
        ({"field": "exact", **SMALL}, "field='exact' cannot be given along with radio_map"),
        ({"radio_map": SMALL["radio_map"]}, r"start must be given as a point \(x, y\)"),
        ({"constraint": "terminate", "goal_bonus": 0.1}, "goal_bonus=0.1 is too small"),
        ({"target_db": -40.0}, "highest feasible target"),
        ({"field": "exact", "target_db": -40.0}, "start=.* has a gain of -59.5106 dB, below"),
        ({"budget": 3.0}, "budget needs constraint='budget'"),
    ],
    ids=str,
)
def test_arguments_that_mean_nothing_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


def test_options_that_mean_nothing_are_refused():
    env = make()
    for options, message in (
        ({"begin": 1}, "options has the unknown key begin"),
        ({"start": (1, 2, 3)}, "start=.* must be two finite numbers"),
        ({"goal": (0.0, 0.0)}, "goal=.* lies in an obstacle"),
    ):
        with pytest.raises(ValueError, match=message):
            env.reset(options=options)


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_pictures_show_the_path(mode):
    env = make(render_mode=mode, target_db=-61.8)
    env.reset(seed=0)
    first = env.render()
    for _ in range(10):
        env.step([1.0, 0.3])
    last = env.render()
    if mode == "rgb_array":
        assert first.dtype == np.uint8
        assert first.shape == last.shape
        assert (first != last).any()
    else:
        assert "*" in last
        assert last.count("o") > 10  # the oracle's way, cell by cell
