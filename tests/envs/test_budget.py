"""Under a budget: costs are paid, exhausted budgets end episodes, and the optimum is exact."""

import json
from itertools import product
from typing import Any

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, assert_same, both
from gymnasium.spaces.utils import flatten
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check_env
from tiny_pool import tiny_pool

import irs_gym
from irs_gym.grid import MOVE_LENGTHS, MOVES
from irs_gym.mdp.budget import scaled_amount
from irs_gym.mdp.packing import Packing
from irs_gym.radio.radio_map import RadioMap

ROOT2 = np.sqrt(2)


def make(budget: Any, target_db: float = -61.8, **more: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(
        "irs_gym:IrsNav-v0", constraint="budget", budget=budget, target_db=target_db, **more
    )


def actions_along(cells: Any) -> list[int]:
    steps = np.diff(np.asarray(cells), axis=0)
    return [int(np.flatnonzero((step == MOVES).all(axis=1))[0]) for step in steps]


def follow(env: gymnasium.Env[Any, Any], actions: list[int]) -> list[Any]:
    return [env.step(action) for action in actions]


# --- the optimum ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target_db", "budget", "metres"),
    [
        (-61.8, 0, 23.228),
        (-61.8, 1, 22.399),
        (-61.8, 2, 21.571),
        (-60.0, 0, 25.642),
        (-60.0, 13, 25.642),
        (-60.0, 26, 21.571),
    ],
)
def test_the_oracle_is_the_shortest_path_within_the_budget(target_db, budget, metres):
    env = make(budget, target_db)
    _, info = env.reset()
    assert info["oracle_distance"] == pytest.approx(metres, abs=5e-4)

    oracle = env.unwrapped.oracle
    assert oracle.distance == info["oracle_distance"] == info["distance_to_go"]
    steps = follow(env, actions_along(oracle.cells))
    _, _, is_terminated, _, last = steps[-1]
    assert is_terminated
    assert last["is_success"]
    assert last["spl"] == 1.0
    assert last["distance"] == pytest.approx(oracle.distance)
    assert info["cost"] + sum(step[-1]["cost"] for step in steps) <= budget
    assert last["budget_left"] == budget - info["cost"] - sum(step[-1]["cost"] for step in steps)


def shortest_within(cost: np.ndarray, start: Any, goal: Any, budget: float) -> float:
    """By brute force: least costs of all walks, length by length."""
    best = {(start, 0, 0): cost[start]}  # cell, straight and diagonal moves: least cost
    frontier = dict(best)
    while frontier:
        ahead: dict[Any, float] = {}
        for ((i, j), straight, diagonal), paid in frontier.items():
            for di, dj in product((-1, 0, 1), repeat=2):
                there = (i + di, j + dj)
                if (di, dj) == (0, 0) or not (
                    0 <= there[0] < cost.shape[0] and 0 <= there[1] < cost.shape[1]
                ):
                    continue
                is_diagonal = di != 0 and dj != 0
                key = (there, straight + (not is_diagonal), diagonal + is_diagonal)
                total = paid + cost[there]
                is_short = key[1] + key[2] < cost.size
                if is_short and total <= budget + 1e-9 and total < best.get(key, np.inf):
                    best[key] = ahead[key] = total
        frontier = ahead

    lengths = [straight + diagonal * ROOT2 for (cell, straight, diagonal) in best if cell == goal]
    return min(lengths, default=np.inf)


@pytest.mark.parametrize("kind", ["violation", "deficit"])
@pytest.mark.parametrize("seed", range(4))
def test_distances_from_every_start_with_every_budget_equal_brute_force(kind, seed):
    rng = np.random.default_rng(seed)
    gains = rng.uniform(-66, -60, (4, 4))
    gains[rng.random((4, 4)) < 0.2] = -np.inf
    gains[0, 0] = gains[1, 1] = gains[2, 2] = gains[3, 3] = -62.0  # there is always a path
    radio_map = RadioMap.from_array(gains, cell_size=1.0)
    cost = irs_gym.cost_map(radio_map, -63.0, kind)
    env = make(
        (0.0, 7.0),
        -63.0,
        cost=kind,
        goal_bonus=100.0,
        radio_map=radio_map,
        start=(0, 0),
        goal=(3, 3),
    )

    starts = [
        cell for cell in map(tuple, np.argwhere(np.isfinite(cost)).tolist()) if cell != (3, 3)
    ]
    for start, budget in product(starts, (0.0, 1.0, 2.5, 7.0)):
        expected = shortest_within(cost, start, (3, 3), budget)
        options = {"start": start, "budget": budget}
        if np.isfinite(expected):
            _, info = env.reset(options=options)
            assert info["oracle_distance"] == pytest.approx(expected, abs=1e-9)
        else:
            with pytest.raises(ValueError, match=r"cannot be kept|no path joins"):
                env.reset(options=options)


def test_random_starts_are_those_from_which_the_budget_can_be_kept():
    env = make((0, 3), random_start=True)
    distances = set()
    for seed in range(300):
        _, info = env.reset(seed=seed)
        assert np.isfinite(info["oracle_distance"])
        assert info["budget_left"] >= 0
        distances.add(info["oracle_distance"])

    assert len(distances) > 100


def test_optimal_actions_are_those_that_lose_nothing():
    env = make(2, observation="flat")
    env.reset()
    robot = env.unwrapped
    rng = np.random.default_rng(0)
    while True:
        state = robot.get_state()
        here = robot.distance_to_go
        best = set(robot.optimal_actions().tolist())
        for action in range(8):
            _, _, _, _, info = robot.step(action)
            length = 0.0 if info["is_refused"] else MOVE_LENGTHS[action] * 0.5
            is_best = not info["is_refused"] and np.isclose(length + robot.distance_to_go, here)
            assert is_best == (action in best)
            robot.set_state(state)

        if robot.step(rng.choice(sorted(best)))[2]:
            break

    assert robot.optimal_actions().tolist() == []


# --- what is paid ---------------------------------------------------------------------------------

# from left to right: nothing, 1 dB, 2 dB, nothing below the target
ROW = RadioMap.from_array([[-60.0], [-64.0], [-65.0], [-60.0], [-60.0]], cell_size=1.0)
EAST, WEST, NORTH = 0, 4, 2


def row(budget: Any, **more: Any) -> gymnasium.Env[Any, Any]:
    ends = {"start": (0, 0), "goal": (3, 0)}
    return make(budget, -63.0, radio_map=ROW, cost="deficit", **{**ends, **more})


def test_each_step_pays_for_the_cell_it_ends_in_refused_ones_too():
    env = row((3, 10))
    _, info = env.reset(options={"budget": 10})
    assert (info["cost"], info["budget_left"]) == (0.0, 10.0)
    steps = follow(env, [EAST, NORTH, EAST, WEST])
    assert [step[-1]["cost"] for step in steps] == [1.0, 1.0, 2.0, 1.0]
    assert [step[-1]["budget_left"] for step in steps] == [9.0, 8.0, 6.0, 5.0]
    shares = [step[0]["budget"].tolist() for step in steps]
    assert shares == [[np.float32(left / (1 + left))] for left in (9, 8, 6, 5)]


def test_the_start_is_paid_for():
    env = row((3, 10), start=(1, 0))
    _, info = env.reset(options={"budget": 4})
    assert (info["cost"], info["budget_left"]) == (1.0, 3.0)
    with pytest.raises(ValueError, match=r"budget=2.5 cannot be kept .* cost of a path is 3"):
        env.reset(options={"budget": 2.5})


def test_an_exhausted_budget_ends_the_episode_as_a_failure():
    env = row(3)
    env.reset()
    _, _, is_terminated, _, info = follow(env, [EAST, EAST])[-1]
    assert (is_terminated, info["budget_left"]) == (False, 0.0)
    observation, _, is_terminated, _, info = env.step(NORTH)
    assert is_terminated
    assert (info["is_success"], info["spl"], info["distance_to_go"]) == (False, 0.0, np.inf)
    assert observation["budget"].tolist() == [np.float32(-2 / 3)]


@pytest.mark.parametrize(("on_exhausted", "bonus"), [("terminate", 0.0), ("continue", 10.0)])
def test_a_goal_that_exhausts_the_budget_is_no_success(on_exhausted, bonus):
    env = row((3, 4), goal=(2, 0), on_exhausted=on_exhausted)  # the goal itself costs 2 dB
    env.reset(options={"budget": 3})
    _, reward, is_terminated, _, info = follow(env, [EAST, EAST])[-1]
    assert (reward, is_terminated, info["is_success"]) == (10.0, True, True)

    env.reset(options={"budget": 3})
    _, reward, is_terminated, _, info = follow(env, [EAST, NORTH, EAST])[-1]
    assert (reward, is_terminated, info["is_success"]) == (bonus, True, False)


def test_where_the_episode_continues_the_cost_is_only_counted():
    env = row(3, on_exhausted="continue")
    env.reset()
    steps = follow(env, [EAST, EAST, WEST, EAST, EAST])
    assert [step[2] for step in steps] == [False, False, False, False, True]
    assert [step[-1]["budget_left"] for step in steps] == [2.0, 0.0, -1.0, -3.0, -3.0]
    assert not steps[-1][-1]["is_success"]


def test_where_a_step_is_refused_nothing_is_paid_and_masks_tell_of_it():
    env = row(3, on_exhausted="refuse", observation="masked")
    env.reset()
    follow(env, [EAST, EAST])  # 1 dB and 2 dB are paid
    before = env.unwrapped.path
    for action in (NORTH, WEST):  # to stay would cost 2 dB, to go back 1 dB
        observation, reward, is_terminated, _, info = env.step(action)
        assert (reward, is_terminated, info["cost"], info["budget_left"]) == (-1.0, False, 0.0, 0.0)
        assert info["is_refused"]
        assert env.unwrapped.path == before
        assert np.flatnonzero(info["action_mask"]).tolist() == [EAST]
        assert np.flatnonzero(observation["action_mask"]).tolist() == [EAST]
        assert np.flatnonzero(env.unwrapped.action_masks()).tolist() == [EAST]

    _, _, is_terminated, _, info = env.step(EAST)
    assert is_terminated
    assert info["is_success"]


def test_what_a_front_says_can_be_paid_to_the_last_digit():
    env = make((0, 100), -60.0, cost="deficit", goal_bonus=30)
    cost = irs_gym.cost_map(env.unwrapped.radio_map, -60.0, "deficit")
    start, goal = env.unwrapped.world.start, env.unwrapped.world.goal
    front = irs_gym.pareto_front(cost, start, goal, 0.5)
    assert len(front.costs) == 20
    for n, (budget, metres) in enumerate(zip(front.costs, front.distances, strict=True)):
        _, info = env.reset(options={"budget": min(budget, 100.0)})
        assert info["oracle_distance"] == pytest.approx(metres, abs=1e-9)
        _, _, is_terminated, _, info = follow(env, actions_along(front.path(n).cells))[-1]
        assert is_terminated
        assert info["is_success"]


# --- what is seen ---------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", ["IrsNav-v0", "IrsNavRandom-v0"])
@pytest.mark.parametrize("kind", ["dict", "flat", "masked", "map"])
def test_every_kind_of_observation_tells_what_is_left(env_id, kind):
    more = {"scenes": tiny_pool(3, (9, 7))} if "Random" in env_id else {"target_db": -61.0}
    env = gymnasium.make(
        f"irs_gym:{env_id}",
        constraint="budget",
        budget=(0, 8),
        goal_bonus=50.0,
        observation=kind,
        patch_radius=1,
        **more,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warnings.warn", _fail)
        check_env(env.unwrapped, skip_render_check=True)

    observation, info = env.reset(seed=3, options={"budget": 4})
    share = scaled_amount(info["budget_left"])
    packing = Packing.of(observation, env.unwrapped.radio_map.grid.shape, 1, has_budget=True)
    assert packing.space == env.observation_space
    if kind == "map":
        assert (observation[4] == share).all()
    else:
        assert packing.decode(observation).budget == share


def _fail(message: Any, *_: Any, **__: Any) -> None:
    raise AssertionError(message)


def test_a_flat_observation_is_the_flattened_dict():
    as_dict, as_flat = (make(2, observation=kind) for kind in ("dict", "flat"))
    one, _ = as_dict.reset()
    other, _ = as_flat.reset()
    np.testing.assert_array_equal(flatten(as_dict.observation_space, one), other)
    assert other[0] == np.float32(2 / 3)


def test_stable_baselines_finds_no_fault():
    sb3_check_env(make(2), warn=True)


def test_infos_are_plain_with_one_set_of_keys():
    env = make(1)
    _, info = env.reset()
    keys = list(info)
    assert "budget_left" in keys
    for step in follow(env, actions_along(env.unwrapped.oracle.cells)):
        assert list(step[-1]) == keys
        json.dumps({key: value for key, value in step[-1].items() if key != "action_mask"})

    assert "budget_left" not in gymnasium.make("irs_gym:IrsNav-v0").reset()[1]


# --- many robots ----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("on_exhausted", ["terminate", "continue", "refuse"])
@pytest.mark.parametrize(
    ("observation", "cost"), [("dict", "violation"), ("flat", "deficit"), ("masked", "outage")]
)
def test_vector_env_equals_n_single_envs(observation, cost, on_exhausted, mode):
    ours, single = both(
        "irs_gym:IrsNav-v0",
        5,
        mode,
        constraint="budget",
        cost=cost,
        budget=(4.0, 15.0) if cost != "outage" else (8.0, 20.0),
        on_exhausted=on_exhausted,
        observation=observation,
        random_start=0.5,
        goal_bonus=30.0,
        infos="all",
        target_db=-61.5,
        patch_radius=2,
        start=(30, 22),
        goal=(33, 20),
        max_episode_steps=30,
    )
    assert assert_equal_for(240, ours, single) > 36


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("on_exhausted", ["terminate", "refuse"])
@pytest.mark.parametrize("cost", ["violation", "deficit"])
def test_vector_env_over_many_scenes_equals_n_single_envs(cost, on_exhausted, mode):
    ours, single = both(
        "irs_gym:IrsNavRandom-v0",
        4,
        mode,
        scenes=tiny_pool(12, (9, 7)),
        constraint="budget",
        cost=cost,
        on_exhausted=on_exhausted,
        observation="masked" if on_exhausted == "refuse" else "dict",
        budget=(0.0, 6.0),
        random_start=0.5,
        goal_bonus=100.0,
        max_episode_steps=15,
        infos="all",
    )
    assert assert_equal_for(120, ours, single) > 20


def test_a_state_goes_on_as_before_and_knows_what_is_left():
    env = make((1, 2), random_start=True)
    for seed in range(20):
        env.reset(seed=seed)
        robot = env.unwrapped
        robot.step(int(robot.optimal_actions()[0]))
        if not len(robot.optimal_actions()):
            continue
        state = robot.get_state()
        once = robot.step(int(robot.optimal_actions()[0]))
        robot.set_state(state)
        again = robot.step(int(robot.optimal_actions()[0]))
        assert_same(once[0], again[0])
        assert once[1:4] == again[1:4]
        assert once[4]["budget_left"] == again[4]["budget_left"]

    with pytest.raises(ValueError, match="of another task"):
        gymnasium.make("irs_gym:IrsNav-v0").unwrapped.set_state(state)


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"budget": -1.0}, r"budget=-1.0 must be a finite number from 0"),
        ({"budget": np.nan}, r"budget=nan must be a finite number from 0"),
        ({"budget": np.inf}, r"budget=inf must be a finite number from 0"),
        ({"budget": True}, r"budget=True must be a finite number from 0"),
        ({"budget": (3, 1)}, r"budget=\(3, 1\) must be"),
        ({"budget": (0, 1, 2)}, r"budget=\(0, 1, 2\) must be"),
        ({"budget": "2"}, r"budget='2' must be"),
        ({"budget": None}, r"budget=None must be given along with constraint='budget'"),
        ({"budget": 1, "cost": "energy"}, r"cost='energy' must be one of"),
        ({"budget": 1, "on_exhausted": "stop"}, r"on_exhausted='stop' must be one of"),
        ({"budget": 1, "observation": "cell"}, r"observation='cell' cannot tell the budget"),
        ({"budget": 1, "constraint": "refuse"}, r"budget needs constraint='budget'"),
        ({"budget": None, "constraint": "allow", "cost": "deficit"}, r"cost needs constraint="),
        ({"budget": 1e-3, "cost": "outage"}, r"budget=0.001 cannot be kept .* least outage cost"),
        ({"budget": 0, "target_db": -50.0}, r"the least violation cost of a path is \d+"),
        ({"budget": 0, "goal_bonus": 0.5}, r"goal_bonus=0.5 is too small for on_exhausted="),
    ],
)
@pytest.mark.parametrize("make_one", [gymnasium.make, gymnasium.make_vec])
def test_what_can_mean_nothing_is_refused_by_name(arguments, message, make_one):
    with pytest.raises(ValueError, match=message):
        make_one("irs_gym:IrsNav-v0", **{"constraint": "budget"} | arguments)


@pytest.mark.parametrize("asked", [-1, np.nan, 3, "1", True])
def test_a_budget_of_one_episode_is_checked(asked):
    env = make((0, 2))
    with pytest.raises(ValueError, match=r"must be a number from 0 to 2\.0"):
        env.reset(options={"budget": asked})


def test_without_a_budget_none_can_be_asked_for():
    for envs in (
        gymnasium.make("irs_gym:IrsNav-v0"),
        gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=2),
    ):
        with pytest.raises(ValueError, match="unknown key budget"):
            envs.reset(options={"budget": 1})
