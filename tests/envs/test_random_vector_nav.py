"""Facts about the vector environment over many scenes, most of them against Gymnasium's own over
single ones.
"""

import copy
import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from alike import assert_equal_for, assert_same, both
from gymnasium.vector import AutoresetMode
from tiny_pool import tiny_pool

from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv

ID = "irs_gym:IrsNavRandom-v0"
# small maps and a short limit: many episodes of every kind in few steps
OFTEN = {"scenes": tiny_pool(12, (9, 7)), "goal_bonus": 100.0, "max_episode_steps": 15}


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize(("observation", "patch_radius"), [("dict", 3), ("flat", 0), ("map", 1)])
def test_vector_env_equals_n_single_envs(constraint, observation, patch_radius, mode):
    kwargs = {
        "infos": "all",
        "constraint": constraint,
        "observation": observation,
        "patch_radius": patch_radius,
        **OFTEN,
    }
    ours, single = both(ID, 4, mode, random_start=0.5, **kwargs)
    assert assert_equal_for(120, ours, single) > 30


def test_every_move_in_every_state_is_that_of_single_envs():
    pool = tiny_pool(2, (5, 4), seed=3)
    for constraint in ("refuse", "terminate", "allow"):
        kwargs = {
            "infos": "all",
            "scenes": pool,
            "constraint": constraint,
            "goal_bonus": 100.0,
            "patch_radius": 2,
        }
        single = gymnasium.make(ID, **kwargs).unwrapped
        ours = gymnasium.make_vec(ID, num_envs=8, autoreset_mode="Disabled", **kwargs)
        for number in range(2):
            for start in np.argwhere(
                np.isfinite(pool.distance_to_go[number]) & (pool.distance_to_go[number] > 0)
            ):
                options = {"scene_id": number, "start": start.tolist()}
                assert_same(
                    ours.reset(options=options)[0]["gain_patch"][3],
                    single.reset(options=options)[0]["gain_patch"],
                )
                obs, reward, terminated, _, infos = ours.step(np.arange(8))
                for action in range(8):
                    single.reset(options=options)
                    one = single.step(action)
                    assert_same({key: value[action] for key, value in obs.items()}, one[0])
                    assert (reward[action], terminated[action]) == one[1:3]
                    for key in one[4]:
                        np.testing.assert_array_equal(infos[key][action], one[4][key])


def test_a_goal_of_ones_own_equals_that_of_a_single_env():
    pool = tiny_pool(3, (9, 7), seed=1)
    kwargs = {"infos": "all", "scenes": pool, "max_episode_steps": 12}
    ours = gymnasium.make_vec(ID, num_envs=3, **kwargs)
    single = gymnasium.make(ID, **kwargs)
    options = {"scene_id": "tiny-1", "start": pool.goal[1].tolist(), "goal": pool.start[1].tolist()}
    ours.reset(seed=0)
    mask = np.array([False, True, False])
    obs, infos = ours.reset(options={**options, "reset_mask": mask})
    one, info = single.reset(options=options)
    assert infos["oracle_distance"][1] == info["oracle_distance"]
    assert infos["scene_id"][1] == "tiny-1"
    rng, kept = np.random.default_rng(0), []
    for _ in range(12):
        actions = rng.integers(0, 8, 3)
        obs, reward, terminated, _, infos = ours.step(actions)
        one, value, is_terminated, _, info = single.step(actions[1])
        assert_same({key: value[1] for key, value in obs.items()}, one)
        assert (reward[1], terminated[1], infos["spl"][1]) == (value, is_terminated, info["spl"])
        kept.append((infos, info["distance_to_go"]))
        if is_terminated:
            break
    assert [infos["distance_to_go"][1] for infos, _ in kept] == [
        to_go for _, to_go in kept
    ]  # looked at late


def test_the_scene_of_each_environment_can_be_chosen():
    env = gymnasium.make_vec(ID, num_envs=4, scenes=OFTEN["scenes"], infos="all")
    assert env.reset(seed=0, options={"scene_id": 5})[1]["scene_id"].tolist() == ["tiny-5"] * 4
    names = ["tiny-3", 2, np.int64(11), "tiny-0"]
    assert env.reset(options={"scene_id": names})[1]["scene_id"].tolist() == [
        "tiny-3",
        "tiny-2",
        "tiny-11",
        "tiny-0",
    ]
    assert env.unwrapped.world_of(2).goal == tuple(OFTEN["scenes"].goal[11])
    with pytest.raises(ValueError, match="scene_id holds 3 scenes for 4 environments"):
        env.reset(options={"scene_id": names[:3]})
    with pytest.raises(
        ValueError,
        match=r"scene_id='tiny-12' must be a name of a scene \('tiny-0', .* from 0 to 11",
    ):
        env.reset(options={"scene_id": "tiny-12"})


def test_seeds_decide_over_the_scenes():
    env = gymnasium.make_vec(ID, num_envs=50, scenes=OFTEN["scenes"], infos="all")
    first = env.reset(seed=1)[1]["scene_id"].tolist()
    assert env.reset(seed=1)[1]["scene_id"].tolist() == first
    assert (
        env.reset(seed=2)[1]["scene_id"].tolist()[:-1] == first[1:]
    )  # environment i has the seed + i
    assert set(first) == set(
        OFTEN["scenes"].names
    )  # 50 draws of 12: each is missed by chance once in 80
    assert env.reset()[1]["scene_id"].tolist() != first


@pytest.mark.parametrize("copy_observations", [True, False])
def test_observations_have_memory_of_their_own_unless_told_otherwise(copy_observations):
    env = gymnasium.make_vec(ID, num_envs=2, copy=copy_observations, **OFTEN)
    first, _ = env.reset(seed=0)
    second = env.step(np.array([0, 1]))[0]
    assert np.shares_memory(first["gain_patch"], second["gain_patch"]) == (not copy_observations)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_alike(duplicate):
    env = IrsNavRandomVectorEnv(3, 15, random_start=0.5, scenes=OFTEN["scenes"])
    env.reset(seed=0)
    twin = duplicate(env)
    for step in range(40):
        actions = np.array([step, step + 3, step + 5]) % 8
        assert_same(twin.step(actions), env.step(actions))


def test_pictures_are_those_of_single_environments():
    for mode in ("ansi", "rgb_array"):
        ours, single = (
            make(ID, render_mode=mode, **OFTEN, **more)
            for make, more in ((gymnasium.make_vec, {"num_envs": 2}), (gymnasium.make, {}))
        )
        ours.reset(seed=0), single.reset(seed=0)
        for action in (0, 1, 4, 2):
            ours.step(np.array([action, 4]))
            single.step(action)
        np.testing.assert_array_equal(ours.render()[0], single.render())
    assert gymnasium.make_vec(ID, num_envs=2, **OFTEN).render() is None


def test_more_cells_than_states_can_number_are_refused_before_any_work():
    one = tiny_pool(1, (9, 7))
    arrays = {name: value for name, value in vars(one).items() if isinstance(value, np.ndarray)}
    repeated = {
        name: np.broadcast_to(value, (2_000_000, *value.shape[1:]))
        for name, value in arrays.items()
    }
    many = replace(one, names=("tiny",) * 2_000_000, **repeated)
    with pytest.raises(
        ValueError, match=r"2000000 scenes of \(14, 12\) cells, borders included, are more than"
    ):
        IrsNavRandomVectorEnv(1, scenes=many)
