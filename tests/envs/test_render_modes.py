"""Facts about render modes: every one of Gymnasium's, single and vector, without a warning and
without a screen.
"""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from tiny_pool import tiny_pool

from irs_gym.rendering.window import mosaic

IDS = [("irs_gym:IrsNav-v0", {}), ("irs_gym:IrsNavRandom-v0", {"scenes": tiny_pool(3)})]


@pytest.fixture(autouse=True)
def no_screen_and_no_warning(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize(("env_id", "more"), IDS)
@pytest.mark.parametrize("mode", ["human", "rgb_array", "ansi", "rgb_array_list", "ansi_list"])
def test_every_mode_renders(env_id, more, mode):
    if mode == "human":
        pytest.importorskip("pygame")
    env = gymnasium.make(env_id, render_mode=mode, **more)
    envs = gymnasium.make_vec(env_id, num_envs=3, render_mode=mode, **more)
    env.reset(seed=0), envs.reset(seed=0)
    env.step(0), envs.step(np.array([0, 1, 2]))
    assert (env.render_mode, envs.render_mode) == (mode, mode)
    one, many = env.render(), envs.render()
    if mode == "human":
        assert (one, many) == (None, None)
    else:
        assert len(many) == 3
        np.testing.assert_array_equal(one, many[0])
    env.close(), envs.close()


@pytest.mark.parametrize("mode", ["human", "rgb_array_list"])
def test_a_spec_with_a_wrapped_mode_survives_json(mode):
    env = gymnasium.make("irs_gym:IrsNav-v0", render_mode=mode)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert str(again) == str(env)  # wrapped once
    assert again.render_mode == mode
    envs = gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=2, render_mode=mode)
    assert gymnasium.make_vec(EnvSpec.from_json(envs.unwrapped.spec.to_json())).render_mode == mode


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_lists_of_pictures_are_those_of_single_environments(mode):
    kwargs = {"render_mode": "ansi_list", "max_episode_steps": 3, "start": (37, 20)}
    ours = gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=2, autoreset_mode=mode, **kwargs)
    single = SyncVectorEnv(
        [lambda: gymnasium.make("irs_gym:IrsNav-v0", **kwargs)] * 2, autoreset_mode=mode
    )
    ours.reset(seed=0), single.reset(seed=0)
    rng = np.random.default_rng(0)
    for step in range(40):
        actions = rng.integers(0, 8, 2)
        ours.step(actions), single.step(actions)
        if step % 5 == 0:
            assert ours.render() == single.render()


def test_lists_of_pictures_follow_a_reset_mask():
    envs = gymnasium.make_vec(
        "irs_gym:IrsNav-v0", num_envs=2, autoreset_mode="Disabled", render_mode="ansi_list"
    )
    envs.reset(seed=0)
    envs.step(np.array([0, 0]))
    envs.reset(options={"reset_mask": np.array([True, False])})
    assert [len(frames) for frames in envs.render()] == [1, 2]
    assert [len(frames) for frames in envs.render()] == [0, 0]


@pytest.mark.parametrize(("env_id", "more"), IDS)
@pytest.mark.parametrize("mode", ["ansi", "rgb_array"])
def test_before_a_reset_the_first_episode_is_shown(env_id, more, mode):
    env, envs = (
        gymnasium.make(env_id, render_mode=mode, **more),
        gymnasium.make_vec(env_id, 2, render_mode=mode, **more),
    )
    before, each_before = env.render(), envs.render()
    assert len(each_before) == 2
    for picture in each_before:
        np.testing.assert_array_equal(picture, before)
    options = {"scene_id": 0} if more else None
    env.reset(options=options)
    np.testing.assert_array_equal(env.render(), before)


def test_a_mosaic_holds_every_picture_and_is_no_larger_than_a_screen():
    frames = np.arange(3 * 2 * 4 * 3, dtype=np.uint8).reshape(3, 2, 4, 3)
    whole = mosaic(frames)
    assert whole.shape == (4, 8, 3)
    np.testing.assert_array_equal(whole[:2, 4:], frames[1])
    np.testing.assert_array_equal(whole[2:, :4], frames[2])
    assert (whole[2:, 4:] == 255).all()
    assert max(mosaic(np.zeros((100, 300, 300, 3), dtype=np.uint8)).shape) <= 1200
