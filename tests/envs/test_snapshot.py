"""Facts about the states of environments: small, exact, and refused where they are damaged or of
another task.
"""

import copy
from struct import pack
from zlib import crc32

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from tiny_pool import tiny_pool

POOL = tiny_pool(6, (9, 7))
NAV = (
    "irs_gym:IrsNav-v0",
    {"target_db": -62.2, "start": (30, 22), "goal": (33, 20), "goal_bonus": 100.0},
)
RANDOM = ("irs_gym:IrsNavRandom-v0", {"scenes": POOL, "goal_bonus": 100.0})


def walk(env, actions):
    """All that steps say, up to the end of the episode."""
    said = []
    for action in actions:
        said.append(env.step(action))
        if said[-1][2]:
            break
    return said


def _without_path(said):
    return [
        (*outcome, {key: value for key, value in info.items() if key != "path"})
        for *outcome, info in said
    ]


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_a_restored_state_goes_on_as_before(env_id, more, constraint):
    env = gymnasium.make(
        env_id, constraint=constraint, random_start=True, max_episode_steps=-1, **more
    ).unwrapped
    other = gymnasium.make(env_id, constraint=constraint, max_episode_steps=-1, **more).unwrapped
    rng, ends = np.random.default_rng(0), 0
    for seed in range(30):
        env.reset(seed=seed)
        if walk(env, rng.integers(0, 8, 10).tolist())[-1][2]:
            continue
        state, mask, cell = env.get_state(), env.action_masks(), env.path[-1]
        assert type(state) is bytes
        assert len(state) == 58
        actions = rng.integers(0, 8, 60).tolist()
        said = walk(env, actions)
        ends += said[-1][2]
        for again in (env, other):  # in the same environment, and in one that was never reset
            again.set_state(state)
            assert again.get_state() == state
            assert again.path == [cell]
            np.testing.assert_array_equal(again.action_masks(), mask)
            assert data_equivalence(_without_path(said), _without_path(walk(again, actions)))
            np.testing.assert_array_equal(again.oracle.cells, env.oracle.cells)
    assert ends > 1


@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_an_end_is_restored_as_an_end(env_id, more):
    env = gymnasium.make(env_id, **more).unwrapped
    fresh = env.get_state()
    env.reset(seed=0)
    for state in (fresh, _at_the_end(env)):
        env.set_state(state)
        with pytest.raises(ResetNeeded, match="call reset"):
            env.step(0)


def _at_the_end(env):
    while len(best := env.optimal_actions()):
        env.step(int(best[0]))
    return env.get_state()


def test_a_state_leads_back_to_its_scene_and_goal():
    env = gymnasium.make(RANDOM[0], **RANDOM[1]).unwrapped
    env.reset(seed=0, options={"scene_id": 3, "start": POOL.goal[3], "goal": POOL.start[3]})
    state, oracle = env.get_state(), env.oracle
    env.reset(options={"scene_id": 1})
    env.set_state(state)
    assert env.world is env.worlds.world(3)
    np.testing.assert_array_equal(env.oracle.cells, oracle.cells)
    assert env.step(0)[-1]["scene_id"] == "tiny-3"


def test_resets_are_no_part_of_a_state():
    env = gymnasium.make(NAV[0], random_start=True, **NAV[1]).unwrapped
    env.reset(seed=0)
    state = env.get_state()
    second, third = env.reset()[0], env.reset()[0]
    env.set_state(state)
    assert not data_equivalence(second, third)
    assert not data_equivalence(env.reset()[0], second)


@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_damaged_states_are_refused_and_change_nothing(env_id, more):
    env = gymnasium.make(env_id, **more).unwrapped
    env.reset(seed=0)
    state = env.get_state()
    env.step(0)
    now = env.get_state()
    for n in range(len(state)):
        for flipped in (1, 128):
            with pytest.raises(ValueError, match="state is damaged"):
                env.set_state(state[:n] + bytes([state[n] ^ flipped]) + state[n + 1 :])
    for bad in (b"", state[:-1], state + b"\0", bytearray(state), state.hex(), None):
        with pytest.raises(ValueError, match="state must be the 58 bytes"):
            env.set_state(bad)
    for where, value in (
        (12, 10**6),
        (16, 10**6),
        (20, 10**6),
        (12, 2**32 - 1),
    ):  # start, goal and cell off the map
        forged = state[:where] + pack("<I", value) + state[where + 4 : -4]
        with pytest.raises(ValueError, match=r"lies off the map|a robot cannot be in"):
            env.set_state(forged + pack("<I", crc32(forged)))
    assert env.get_state() == now


@pytest.mark.parametrize(
    "change",
    [
        {"target_db": -62.5},
        {"constraint": "allow"},
        {"shaping": False},
        {"goal_bonus": 10.0},
        {"phase_bits": 8},
    ],
)
def test_states_of_another_task_are_refused(change):
    env, other = (
        gymnasium.make(NAV[0], **NAV[1]).unwrapped,
        gymnasium.make(NAV[0], **{**NAV[1], **change}).unwrapped,
    )
    env.reset(seed=0)
    with pytest.raises(ValueError, match="state is of another task: its map or its rules differ"):
        other.set_state(env.get_state())


def test_states_of_other_scenes_are_refused():
    env = gymnasium.make(RANDOM[0], **RANDOM[1]).unwrapped
    env.reset(options={"scene_id": 5})
    state = env.get_state()
    fewer = gymnasium.make(RANDOM[0], scenes=tiny_pool(5, (9, 7)), goal_bonus=100.0).unwrapped
    with pytest.raises(ValueError, match="state is of scene 5, and there are 5 here"):
        fewer.set_state(state)
    others = gymnasium.make(
        RANDOM[0], scenes=tiny_pool(6, (9, 7), seed=9), goal_bonus=100.0
    ).unwrapped
    with pytest.raises(ValueError, match="state is of another task"):
        others.set_state(state)


def test_what_is_observed_is_no_part_of_the_rules():
    env = gymnasium.make(NAV[0], **NAV[1]).unwrapped
    env.reset(seed=0)
    env.step(0)
    cells = gymnasium.make(NAV[0], observation="cell", patch_radius=2, **NAV[1]).unwrapped
    cells.set_state(env.get_state())
    assert divmod(cells.step(0)[0], 40) == (32, 22)


@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_a_deep_copy_goes_on_alike(env_id, more):
    env = gymnasium.make(env_id, random_start=0.5, **more)
    env.reset(seed=3)
    twin = copy.deepcopy(env)
    assert twin.unwrapped.get_state() == env.unwrapped.get_state()
    assert data_equivalence(env.step(1), twin.step(1))
    assert data_equivalence(env.reset(), twin.reset())
