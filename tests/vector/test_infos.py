"""Facts about the infos: one set of keys at every step, as plain dicts of arrays and numbers."""

import json
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from irs_gym.radio.scene import load_scene
from irs_gym.vector.infos import KEYS, SLOW, spread

FAST = [key for key in KEYS if key not in SLOW]
ONE = ("irs_gym:IrsNav-v0", {})
MANY = ("irs_gym:IrsNavRandom-v0", {"scenes": [load_scene("paper"), load_scene("workshop")]})


def episodes(env, steps):
    """Infos of resets and random steps, resets after each end among them."""
    rng = np.random.default_rng(0)
    yield env.reset(seed=0)[1]
    for _ in range(steps):
        _, _, terminated, truncated, info = env.step(rng.integers(8))
        yield info
        if terminated or truncated:
            yield env.reset()[1]


@pytest.mark.parametrize(("env_id", "arguments"), [ONE, MANY])
@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
def test_a_single_environment_tells_the_same_keys_at_every_step(env_id, arguments, constraint):
    arguments = {**arguments, "constraint": constraint, "goal_bonus": 60.0, "random_start": True}
    env = gymnasium.make(env_id, max_episode_steps=20, **arguments)
    expected = [*KEYS, "scene_number", "scene_id"] if "scenes" in arguments else [*KEYS]
    for info in episodes(env, 300):
        assert [*info] == expected
        kinds = {key: type(value) for key, value in info.items()}
        assert kinds.pop("action_mask") is np.ndarray
        assert {key for key, kind in kinds.items() if kind is bool} == {"is_success", "is_refused"}
        assert {key for key, kind in kinds.items() if kind is int} == {"refused", *expected} & {
            "refused",
            "scene_number",
        }
        assert set(kinds.values()) <= {bool, float, int, str}
        assert (
            json.loads(json.dumps({**info, "action_mask": info["action_mask"].tolist()}))["spl"]
            == info["spl"]
        )


def test_infos_chooses_the_keys():
    def told(infos):
        single = gymnasium.make(ONE[0], infos=infos).reset(seed=0)[1]
        vector = gymnasium.make_vec(ONE[0], num_envs=2, infos=infos).reset(seed=0)[1]
        assert [key for key in vector if not key.startswith("_")] == [*single]
        return [*single]

    assert told("fast") == FAST
    assert told("all") == [*KEYS]
    assert told(["spl", "gain_db"]) == ["gain_db", "spl"]
    assert told([]) == []
    assert [key for key in gymnasium.make_vec(ONE[0]).reset()[1] if not key.startswith("_")] == FAST
    many = gymnasium.make(MANY[0], **MANY[1])
    assert [*many.reset()[1]] == [*KEYS, "scene_number", "scene_id"]
    assert [*many.step(0)[4]] == [*KEYS, "scene_number", "scene_id"]


@pytest.mark.parametrize("infos", ["spl", None, ["speed"], 3, [1], {"spl": True}, True])
def test_unknown_keys_are_refused_by_name(infos):
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(
            ValueError,
            match=r"infos=.* must be 'all', 'fast', or a list of some of distance, refused",
        ):
            make(ONE[0], infos=infos)


@pytest.mark.parametrize(("env_id", "arguments"), [ONE, MANY])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_vector_environment_tells_plain_dicts_with_the_same_keys_at_every_step(
    env_id, arguments, mode
):
    env = gymnasium.make_vec(
        env_id, num_envs=3, autoreset_mode=mode, max_episode_steps=4, infos="all", **arguments
    )
    keys = [*env.reset(seed=0)[1]]
    rng, ends = np.random.default_rng(0), 0
    for _ in range(30):
        infos = env.step(rng.integers(0, 8, 3))[4]
        assert type(infos) is dict
        assert [key for key in infos if "final" not in key] == keys
        final = infos.get("final_info", {})
        ends += bool(final)
        assert [*final] in ([], keys)
        for key in keys:
            assert type(infos[key]) is np.ndarray
            assert infos[key].shape[0] == 3
            assert infos[key].flags.c_contiguous
            assert infos[key].flags.writeable
        assert pickle.loads(pickle.dumps(infos)).keys() == infos.keys()
    assert ends == (7 if mode is AutoresetMode.SAME_STEP else 0)


def test_arrays_of_a_step_are_nobody_elses():
    ours = gymnasium.make_vec(
        ONE[0], num_envs=3, infos="all", constraint="allow", random_start=True
    )
    theirs = gymnasium.make_vec(
        ONE[0], num_envs=3, infos="all", constraint="allow", random_start=True
    )
    rng = np.random.default_rng(0)
    mine, other = ours.reset(seed=0), theirs.reset(seed=0)
    for _ in range(50):
        for array in (*mine[0].values(), *mine[1:-1], *mine[-1].values()):
            array[...] = 1  # whatever a user writes into them
        actions = rng.integers(0, 8, 3)
        mine, other = ours.step(actions), theirs.step(actions)
        for key in KEYS:
            np.testing.assert_array_equal(mine[4][key], other[4][key], err_msg=key)


def test_gymnasiums_own_vector_tells_the_same():
    ours = gymnasium.make_vec(ONE[0], num_envs=2, infos="all")
    single = SyncVectorEnv([lambda: gymnasium.make(ONE[0])] * 2)
    assert ours.reset(seed=0)[1].keys() == single.reset(seed=0)[1].keys()
    assert ours.step(np.array([0, 4]))[4].keys() == single.step(np.array([0, 4]))[4].keys()


def test_spread_zeroes_the_others():
    assert spread(np.array([1.5]), np.array([1]), 3).tolist() == [0.0, 1.5, 0.0]
    assert spread(np.array(["a"], dtype=object), np.array([0]), 2).tolist() == ["a", None]
    assert spread(np.array([[1, 2]]), np.array([0]), 2).tolist() == [[1, 2], [0, 0]]


@pytest.mark.parametrize(("env_id", "arguments"), [ONE, MANY])
def test_by_default_a_vectors_infos_are_numbers_alone(env_id, arguments):
    env = gymnasium.make_vec(env_id, num_envs=2, **arguments)
    for infos in (env.reset(seed=0)[1], env.step(np.array([0, 4]))[4]):
        assert {array.dtype.kind for array in infos.values()} == {"b", "f", "i"}
