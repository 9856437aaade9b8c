"""Facts about the masked observation and the cell: single and vector, over one scene and many, and
for learners.
"""

import warnings

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, both
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from tiny_pool import tiny_pool

from agents.policies.heuristics import REFERENCE_POLICIES
from agents.rollout.episode import roll_out
from irs_gym.mdp.packing import Packing

POOL = tiny_pool(12, (9, 7))
# close ends, or small maps, and a short limit: many episodes of every kind in few steps
NAV = (
    "irs_gym:IrsNav-v0",
    {"target_db": -62.2, "start": (30, 22), "goal": (33, 20), "goal_bonus": 100.0},
)
RANDOM = ("irs_gym:IrsNavRandom-v0", {"scenes": POOL, "goal_bonus": 100.0})
EVERY = [
    pytest.param(*each, kind, id=f"{each[0][8:]}-{kind}")
    for each in (NAV, RANDOM)
    for kind in ("masked", "cell")
]


@pytest.mark.parametrize(("env_id", "more", "kind"), EVERY)
@pytest.mark.filterwarnings("error")
def test_the_checkers_find_nothing(env_id, more, kind):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gymnasium.make(env_id, observation=kind, **more)
    with (
        warnings.catch_warnings()
    ):  # says so of every made environment, whose wrappers it is right to avoid
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version.*")
        check_env(env, skip_render_check=True)
    check_env(env.unwrapped, skip_render_check=True)
    checker.check_env(env, skip_render_check=True)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize(("env_id", "more", "kind"), EVERY)
def test_the_vector_env_equals_single_ones(env_id, more, kind, constraint, mode):
    kwargs = {
        "observation": kind,
        "constraint": constraint,
        "max_episode_steps": 25,
        "patch_radius": 2,
        **more,
    }
    ours, single = both(env_id, 4, mode, random_start=0.5, **kwargs)
    assert ours.observation_space == single.observation_space
    assert assert_equal_for(400, ours, single) > 50


@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_the_masked_observation_is_the_flat_one_beside_the_mask(env_id, more):
    masked = gymnasium.make(env_id, observation="masked", random_start=True, **more)
    flat = gymnasium.make(env_id, observation="flat", random_start=True, **more)
    assert masked.observation_space["observation"] == flat.observation_space
    assert masked.observation_space["action_mask"] == spaces.Box(0, 1, (8,), np.int8)
    for seed in range(10):
        (seen, info), (packed, _) = masked.reset(seed=seed), flat.reset(seed=seed)
        for action in (*range(8), None):
            assert set(seen) == {"observation", "action_mask"}
            np.testing.assert_array_equal(seen["observation"], packed)
            np.testing.assert_array_equal(seen["action_mask"], info["action_mask"])
            assert seen["action_mask"].dtype == np.int8
            if (
                action is None
                or flat.unwrapped.path[-1] == flat.unwrapped.oracle.cells[-1].tolist()
            ):
                break
            seen, _, is_over, _, info = masked.step(action)
            packed = flat.step(action)[0]
            if is_over:
                break


@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_the_cell_is_the_flat_index_of_the_robots_cell(env_id, more):
    env = gymnasium.make(env_id, observation="cell", random_start=True, **more)
    shape = env.unwrapped.world.feasible.shape
    assert env.observation_space == spaces.Discrete(shape[0] * shape[1])
    cells = set()
    for seed in range(20):
        cell, _ = env.reset(seed=seed)
        assert type(cell) is int
        assert divmod(cell, shape[1]) == env.unwrapped.path[-1]
        cells.add(cell)
    assert len(cells) > 10
    envs = gymnasium.make_vec(env_id, num_envs=3, observation="cell", random_start=True, **more)
    batch, _ = envs.reset(seed=0)
    assert (batch.dtype, batch.shape) == (np.int64, (3,))
    assert batch[2] == env.reset(seed=2)[0]


def test_more_cells_than_float32_can_number_are_refused():
    assert Packing("cell", 11, 3, (4096, 4096)).space == spaces.Discrete(2**24)
    with pytest.raises(
        ValueError, match=r"observation='cell' can tell 16777216 cells apart, and \(4096, 4097\)"
    ):
        Packing("cell", 11, 3, (4096, 4097))


def test_references_play_on_masked_observations_and_say_what_a_cell_lacks():
    env_id, more = RANDOM
    env = gymnasium.make(env_id, observation="masked", patch_radius=2, **more)
    plain = gymnasium.make(env_id, patch_radius=2, **more)
    for make_policy in REFERENCE_POLICIES.values():
        for number in (0, 5):
            options = {"scene_id": number}
            mine = roll_out(make_policy(env, 0), env, options=options)
            theirs = roll_out(make_policy(plain, 0), plain, options=options)
            np.testing.assert_array_equal(mine.path, theirs.path)
    told = gymnasium.make(env_id, observation="cell", **more)
    with pytest.raises(ValueError, match="observation='cell' tells no goal"):
        roll_out(REFERENCE_POLICIES["oracle"](told, 0), told)


@pytest.mark.parametrize(
    ("observation", "policy"), [("masked", "MultiInputPolicy"), ("cell", "MlpPolicy")]
)
@pytest.mark.parametrize("algorithm", ["PPO", "DQN"])
def test_learners_of_stable_baselines_take_both_kinds(observation, policy, algorithm):
    library = pytest.importorskip("stable_baselines3")
    from agents.vec_env import IrsNavVecEnv

    env = IrsNavVecEnv(2, max_episode_steps=12, observation=observation, patch_radius=1, **NAV[1])
    on_policy = {"n_steps": 16, "batch_size": 16, "n_epochs": 1}
    settings = (
        on_policy
        if algorithm == "PPO"
        else {"learning_starts": 16, "buffer_size": 64, "batch_size": 8}
    )
    model = getattr(library, algorithm)(policy, env, policy_kwargs={"net_arch": [8]}, **settings)
    model.learn(64)
    assert env.action_space.contains(int(model.predict(env.reset())[0][0]))


def test_q_learning_takes_the_cell():
    callbacks = pytest.importorskip("stable_baselines3.common.callbacks")
    from agents.single.q_learning import QLearning, QLearningConfig
    from agents.vec_env import IrsNavVecEnv

    tables = []
    for observation in ("cell", "flat"):
        env = IrsNavVecEnv(4, observation=observation, **NAV[1])
        model = QLearning.build(QLearningConfig(n_envs=4), env, 0)
        model.learn(400, callbacks.CallbackList([]))
        tables.append(model.table)
    np.testing.assert_array_equal(*tables)
    assert tables[0].any()
