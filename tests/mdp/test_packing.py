"""Facts of the layout of observations: what is read from one is what is around the robot."""

import gymnasium
import numpy as np
import pytest
from tiny_pool import tiny_pool

from irs_gym.mdp.packing import Packing, cells_of_positions, own_positions, vectors_to_goal

POOL = tiny_pool(6, (9, 7))
KINDS = ("dict", "flat", "masked")
NAV = ("irs_gym:IrsNav-v0", {"patch_radius": 2})
RANDOM = ("irs_gym:IrsNavRandom-v0", {"patch_radius": 2, "scenes": POOL})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_parts_of_an_observation_are_those_of_the_world(env_id, more, kind):
    env = gymnasium.make(env_id, observation=kind, random_start=True, **more)
    for seed in range(5):
        observation, info = env.reset(seed=seed)
        world = env.unwrapped.world
        i, j = env.unwrapped.path[-1]
        decoded = Packing.of(observation, world.feasible.shape, radius=2).decode(observation)
        for (a, b), margin in np.ndenumerate(decoded.margin):
            cell = (i + a - 2, j + b - 2)
            is_inside = all(0 <= at < n for at, n in zip(cell, world.feasible.shape, strict=True))
            assert (margin >= 0) == (is_inside and world.feasible[cell])
        assert decoded.cell == np.ravel_multi_index((i, j), world.feasible.shape)
        assert decoded.goal == np.ravel_multi_index(world.goal, world.feasible.shape)
        np.testing.assert_array_equal(decoded.irs, world.irs[i, j, :3])
        np.testing.assert_array_equal(decoded.phases, world.irs[i, j, 3:])
        if kind == "masked":
            np.testing.assert_array_equal(decoded.action_mask, info["action_mask"])
        else:
            assert decoded.action_mask is None


def test_parts_of_a_map_are_those_of_the_world():
    env = gymnasium.make(RANDOM[0], observation="map", scenes=POOL)
    observation, _ = env.reset(options={"scene_id": 3})
    decoded = Packing.of(observation, POOL.shape).decode(observation)
    np.testing.assert_array_equal(decoded.margin >= 0, POOL.feasible[3])
    assert decoded.cell == np.ravel_multi_index(POOL.start[3], POOL.shape)
    assert decoded.goal == np.ravel_multi_index(POOL.goal[3], POOL.shape)
    assert decoded.irs.size == decoded.phases.size == 0


@pytest.mark.parametrize("kind", [*KINDS, "map"])
def test_a_batch_is_decoded_as_its_observations_are(kind):
    envs = gymnasium.make_vec(
        RANDOM[0], num_envs=4, observation=kind, random_start=True, **RANDOM[1]
    )
    batch, _ = envs.reset(seed=0)
    packing = Packing.of(batch, POOL.shape)
    together = packing.decode(batch)
    for n in range(4):
        one = {key: each[n] for key, each in batch.items()} if isinstance(batch, dict) else batch[n]
        for whole, part in zip(together, packing.decode(one), strict=True):
            if whole is not None:
                np.testing.assert_array_equal(whole[n], part)


@pytest.mark.parametrize("kind", [*KINDS, "map", "cell"])
@pytest.mark.parametrize(("env_id", "more"), [NAV, RANDOM])
def test_an_observation_of_any_kind_tells_the_robots_own_cell(env_id, more, kind):
    env = gymnasium.make(env_id, observation=kind, random_start=True, **more)
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        shape = env.unwrapped.world.feasible.shape
        cell = Packing.of(observation, shape).own_cells(observation)
        assert np.unravel_index(cell, shape) == env.unwrapped.path[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_encoded_is_decoded_again(kind):
    packing = Packing(kind, side=3, settings=5, shape=(9, 7))
    rng = np.random.default_rng(0)
    cells, goals = rng.integers((9, 7), size=(2, 20, 2))
    patch, irs, mask = rng.random((20, 9)), rng.random((20, 5)), rng.integers(2, size=(20, 8))
    parts = packing.encode(
        packing.empty(20),
        patch=patch,
        irs=irs,
        own=own_positions(cells, packing.shape),
        to_goal=vectors_to_goal(cells - goals, packing.shape),
        action_mask=mask.astype(np.int8) if kind == "masked" else None,
    )
    observation = packing.unpack(parts)
    assert Packing.of(observation, (9, 7), radius=1) == packing
    decoded = packing.decode(observation)
    np.testing.assert_array_equal(decoded.margin, patch.reshape(20, 3, 3).astype(np.float32))
    np.testing.assert_array_equal(decoded.irs, irs[:, :3].astype(np.float32))
    np.testing.assert_array_equal(decoded.phases, irs[:, 3:].astype(np.float32))
    np.testing.assert_array_equal(decoded.cell, cells @ [7, 1])
    np.testing.assert_array_equal(decoded.goal, goals @ [7, 1])
    if kind == "masked":
        np.testing.assert_array_equal(decoded.action_mask, mask)


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (40, 40), (80, 60), (1000, 999)])
def test_cells_and_goals_come_back_from_scaled_positions(shape):
    rng = np.random.default_rng(0)
    cells, goals = rng.integers(shape, size=(2, 500, 2))
    positions = np.concatenate(
        [own_positions(cells, shape), vectors_to_goal(cells - goals, shape)], axis=-1
    )
    for found, wanted in zip(cells_of_positions(positions, shape), (cells, goals), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_a_patch_that_cannot_be_told_from_phase_shifts_is_left_out():
    packing = Packing.of(np.zeros(25 + 3 + 25 + 4), (40, 40))
    assert (packing.side, packing.settings) == (0, 25 + 3 + 25)
    assert Packing.of(np.zeros(25 + 3 + 25 + 4), (40, 40), radius=2).side == 5
