"""Facts about Stable-Baselines3's view of the vector environment."""

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor
from tiny_pool import tiny_pool

from agents.vec_env import IrsNavVecEnv
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from irs_gym.envs.vector_nav import IrsNavVectorEnv

ID, RANDOM_ID = "irs_gym:IrsNav-v0", "irs_gym:IrsNavRandom-v0"
OFTEN = {
    "target_db": -62.2,
    "patch_radius": 2,
    "start": (30, 22),
    "goal": (33, 20),
    "random_start": 0.5,
}
# over many scenes, small ones for the same reason
OFTEN_RANDOM = {"scenes": tiny_pool(12, (9, 7)), "patch_radius": 2, "random_start": 0.5}


def dummy(n: int, **kwargs):
    return make_vec_env(RANDOM_ID if "scenes" in kwargs else ID, n, env_kwargs=kwargs)


def fast(n: int, **kwargs):
    return IrsNavVecEnv(
        n, vector_env=IrsNavRandomVectorEnv if "scenes" in kwargs else IrsNavVectorEnv, **kwargs
    )


def weights(model) -> np.ndarray:
    return torch.cat([p.detach().ravel() for p in model.policy.parameters()]).numpy()


@pytest.mark.parametrize(
    ("arguments", "observation", "steps"),
    [(OFTEN, "dict", 2000), (OFTEN, "flat", 2000), (OFTEN_RANDOM, "flat", 1000)],
)
def test_steps_rewards_dones_and_final_infos_equal_those_of_dummy_vec_env(
    arguments, observation, steps
):
    ours, theirs = (make(4, observation=observation, **arguments) for make in (fast, dummy))
    ours.seed(3), theirs.seed(3)
    same = np.testing.assert_array_equal
    parts = list if observation == "flat" else lambda obs: [obs[key] for key in sorted(obs)]
    for mine, other in zip(parts(ours.reset()), parts(theirs.reset()), strict=True):
        same(mine, other)
    rng, ends = np.random.default_rng(0), 0
    for _ in range(steps):
        actions = rng.integers(0, 8, 4)
        (obs, reward, done, infos), (obs2, reward2, done2, infos2) = (
            ours.step(actions),
            theirs.step(actions),
        )
        for mine, other in zip(parts(obs), parts(obs2), strict=True):
            same(mine, other)
        same(reward, reward2)
        same(done, done2)
        assert reward.dtype == reward2.dtype
        for info, info2 in zip(infos, infos2, strict=True):
            assert info["TimeLimit.truncated"] == info2["TimeLimit.truncated"]
            if "episode" in info2:
                ends += 1
                assert {k: v for k, v in info["episode"].items() if k != "t"} == {
                    k: v for k, v in info2["episode"].items() if k != "t"
                }
                for key in (
                    "is_success",
                    "spl",
                    "distance",
                    "refused",
                    "cost",
                    "distance_to_go",
                    "scene_id",
                ):
                    assert info.get(key) == info2.get(key), key
                for mine, other in zip(
                    parts(info["terminal_observation"]),
                    parts(info2["terminal_observation"]),
                    strict=True,
                ):
                    same(mine, other)
        for info, info2 in zip(ours.reset_infos, theirs.reset_infos, strict=True):
            assert info.keys() == info2.keys()
            for key in info:
                same(info[key], info2[key])
        same(np.stack(ours.env_method("action_masks")), np.stack(theirs.env_method("action_masks")))
    assert ends > 20


@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [
        (PPO, {"n_steps": 32, "batch_size": 64, "n_epochs": 2}),
        (MaskablePPO, {"n_steps": 32, "batch_size": 64, "n_epochs": 2}),
        (DQN, {"learning_starts": 100, "train_freq": 4, "batch_size": 32}),
    ],
)
def test_training_equals_training_with_dummy_vec_env(algorithm, settings):
    trained = []
    for make in (IrsNavVecEnv, dummy):
        env = make(4, observation="flat", **OFTEN)
        model = algorithm(
            "MlpPolicy", env, seed=1, device="cpu", policy_kwargs={"net_arch": [16]}, **settings
        )
        trained.append(weights(model.learn(600)))
    np.testing.assert_array_equal(*trained)


def test_over_many_scenes_training_equals_training_with_dummy_vec_env_too():
    trained = []
    for make in (fast, dummy):
        model = PPO(
            "MultiInputPolicy", make(4, **OFTEN_RANDOM), 1e-3, 32, 64, 2, seed=1, device="cpu"
        )
        trained.append(weights(model.learn(300)))
    np.testing.assert_array_equal(*trained)


def test_infos_tell_the_scene_of_the_episode_that_begins_and_of_the_one_that_ended():
    env = fast(3, scenes=OFTEN_RANDOM["scenes"], max_episode_steps=1)
    env.seed(0)
    env.reset()
    begun = [info["scene_id"] for info in env.reset_infos]
    for _ in range(5):
        infos = env.step(np.array([0, 1, 2]))[3]
        assert [info["scene_id"] for info in infos] == begun
        begun = [info["scene_id"] for info in env.reset_infos]
    assert len(set(begun)) > 1


def test_monitor_is_taken_for_granted_and_other_wrappers_are_not():
    env = IrsNavVecEnv(2, **OFTEN)
    assert env.env_is_wrapped(Monitor) == [True, True]
    assert env.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False, False]
    assert VecMonitor(env).reset() is not None


def test_attributes_are_shared_and_cannot_be_set():
    env = IrsNavVecEnv(3, **OFTEN)
    assert env.get_attr("task") == [env.envs.task] * 3
    assert len(env.env_method("action_masks", indices=[0, 2])) == 2
    with pytest.raises(AttributeError, match="cannot be set"):
        env.set_attr("task", None)
    with pytest.raises(AttributeError, match="no method"):
        env.env_method("fly")
    with pytest.raises(AttributeError, match="no attribute"):
        env.get_attr("wings")
