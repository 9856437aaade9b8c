"""Facts of many robots that go anywhere on the floor at once: they do as single ones do."""

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, assert_same, both
from gymnasium.vector import AutoresetMode

from irs_gym.envs.continuous_vector_nav import IrsNavContinuousVectorEnv

ID = "irs_gym:IrsNavContinuous-v0"
# close ends and a short limit: many episodes of every kind in few steps
OFTEN = {
    "target_db": -61.8,
    "patch_radius": 2,
    "start": (8.3, 1.1),
    "max_episode_steps": 30,
    "goal_radius": 0.6,  # seen from a part of the disc alone
    "goal_bonus": 50.0,
}
CONSTRAINTS = {
    "refuse": {},
    "terminate": {"constraint": "terminate"},
    "allow": {"constraint": "allow"},
    "budget": {"constraint": "budget", "budget": (0.0, 3.0), "cost": "deficit"},
    "budget, counted": {"constraint": "budget", "budget": 1.0, "on_exhausted": "continue"},
    "budget, refused": {"constraint": "budget", "budget": (0.0, 2.0), "on_exhausted": "refuse"},
    "refuse, stay": {"on_refused": "stay"},
    "terminate, stay": {"constraint": "terminate", "on_refused": "stay"},
    "budget, stay": {
        "constraint": "budget",
        "budget": 3.0,
        "cost": "deficit",
        "on_refused": "stay",
    },
}


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", CONSTRAINTS)
def test_vector_env_equals_n_single_envs(constraint, mode):
    steps = 2_000 if (constraint, mode) == ("refuse", AutoresetMode.NEXT_STEP) else 500
    kwargs = {"random_start": 0.5, **OFTEN, **CONSTRAINTS[constraint]}
    ours, single = both(ID, 5, mode, **kwargs)
    assert assert_equal_for(steps // 5, ours, single) > steps // 50


@pytest.mark.parametrize("observation", ["dict", "flat"])
@pytest.mark.parametrize("budget", [None, 2.0])
def test_observations_of_every_kind_are_equal_in_both(observation, budget):
    kwargs = {} if budget is None else {"constraint": "budget", "budget": budget}
    ours, single = both(
        ID,
        3,
        AutoresetMode.SAME_STEP,
        observation=observation,
        random_start=True,
        **OFTEN,
        **kwargs,
    )
    assert assert_equal_for(80, ours, single) > 5


@pytest.mark.parametrize("constraint", CONSTRAINTS)
def test_vector_env_equals_n_single_envs_over_many_scenes(constraint):
    kwargs = {"split": "val", "num_scenes": 3, "random_start": 0.5, "max_episode_steps": 20}
    kwargs |= {"goal_bonus": 50.0, "goal_radius": 3.0, **CONSTRAINTS[constraint]}
    ours, single = both(ID, 4, AutoresetMode.SAME_STEP, **kwargs)
    assert assert_equal_for(60, ours, single) > 8


def test_paths_are_those_of_the_robots():
    envs = gymnasium.make_vec(ID, num_envs=3, autoreset_mode="SameStep", infos="all", **OFTEN)
    _, infos = envs.reset(seed=0)
    walked = [[(x, y)] for x, y in zip(infos["x"], infos["y"], strict=True)]
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(60):
        _, _, terminated, truncated, infos = envs.step(rng.uniform(-1, 1, (3, 2)))
        for i, path in enumerate(envs.unwrapped.paths()):
            is_over = terminated[i] or truncated[i]
            last = infos["final_info"] if is_over else infos
            walked[i].append((last["x"][i], last["y"][i]))
            np.testing.assert_array_equal(path, walked[i])
            if is_over:
                walked[i] = [(infos["x"][i], infos["y"][i])]
                ends += 1
    assert ends >= 6


def test_options_hold_for_all():
    envs = gymnasium.make_vec(ID, num_envs=2, infos="all")
    _, infos = envs.reset(options={"start": (0.3, -4.2), "goal": (9.0, 4.0)})
    assert infos["x"].tolist() == pytest.approx([0.3, 0.3])
    assert envs.unwrapped.get_attr("goal")[1].tolist() == pytest.approx([9.0, 4.0])
    with pytest.raises(ValueError, match=r"start=.* must be two finite numbers"):
        envs.reset(options={"start": 3})


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(2), r"shape \(2,\)"),
        (np.zeros((3, 2)), r"shape \(3, 2\)"),
        ([[0, 0], [0, np.nan]], r"actions\[1\]=\[0.0, nan\] must be two finite numbers"),
        ([[np.inf, 0], [0, 0]], r"actions\[0\]"),
        ([[1e200, 0], [0, 0]], r"actions\[0\]"),
        ([["a", 0], [0, 0]], "shape"),
        (None, "shape"),
    ],
)
def test_actions_that_mean_nothing_are_refused(actions, message):
    envs = gymnasium.make_vec(ID, num_envs=2)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.step(actions)


def test_copies_of_observations_are_asked_for():
    kwargs = {"num_envs": 4, **OFTEN}
    kept = gymnasium.make_vec(ID, copy=False, **kwargs)
    fresh = gymnasium.make_vec(ID, **kwargs)
    assert_same(kept.reset(seed=0), fresh.reset(seed=0))
    rng = np.random.default_rng(0)
    for _ in range(50):
        actions = rng.uniform(-1, 1, (4, 2))
        assert_same(kept.step(actions), fresh.step(actions))


@pytest.mark.parametrize("constraint", ["terminate", "budget"])
def test_of_the_exact_field_many_are_as_single_ones(constraint):
    kwargs = {**OFTEN, **CONSTRAINTS[constraint], "random_start": 0.5, "field": "exact"}
    ours, single = both(ID, 2, AutoresetMode.SAME_STEP, **kwargs)
    assert_equal_for(12, ours, single)


def test_the_share_of_drawn_starts_may_be_changed_between_steps():
    envs = IrsNavContinuousVectorEnv(64, 3, "SameStep", target_db=-61.8, random_start=1.0)
    twin = IrsNavContinuousVectorEnv(64, 3, "SameStep", target_db=-61.8, random_start=1.0)
    still = np.zeros((64, 2))
    own = envs.maps.own_start(0)

    envs.reset(seed=5)
    twin.reset(seed=5)
    assert not any(envs.ends_of(i).start == own for i in range(64))

    envs.random_start = 0.0
    for _ in range(2):
        assert_same(envs.step(still)[0], twin.step(still)[0])  # episodes under way stay as they are

    observation, *_ = envs.step(still)
    assert all(envs.ends_of(i).start == own for i in range(64))
    assert len(np.unique(observation["position"], axis=0)) == 1

    envs.random_start = 0.5
    for _ in range(3):
        envs.step(still)
    drawn = sum(envs.ends_of(i).start != own for i in range(64))
    assert 12 < drawn < 52


@pytest.mark.parametrize(
    ("made", "value", "message"),
    [
        (1.0, 1.5, "random_start=1.5 must be a bool or a probability"),
        (1.0, np.nan, "random_start=nan must be a bool or a probability"),
        (1.0, "often", "random_start='often' must be a bool or a probability"),
        (0.0, 0.5, "random_start=0.5 cannot be set in an environment made without"),
    ],
)
def test_a_share_of_drawn_starts_that_cannot_be_is_refused(made, value, message):
    envs = IrsNavContinuousVectorEnv(2, random_start=made)
    with pytest.raises(ValueError, match=message):
        envs.random_start = value
    assert envs.random_start == made
