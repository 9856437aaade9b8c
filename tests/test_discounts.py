"""Facts about what a discount makes of the returns on a problem."""

import numpy as np
import pytest

from eval.discounts import optimal_values, outlooks, random_spread, reached
from irs_gym.dynamics import tabulate, transition
from irs_gym.radio_map import RadioMap
from irs_gym.task import Task, World, build_world

WALL = np.array([[0, 0, 0, 0, 0], [0, -9, -9, -9, 0], [0, 0, 0, 0, 0], [0, -9, 0, -9, 0]], dtype=float)


@pytest.fixture
def world() -> World:
    radio_map = RadioMap.from_array(WALL, cell_size=0.5)
    return build_world(Task(radio_map=radio_map, start=(0, 2), goal=(2, 2), target_db=-1.0, shaping=False))


def flat(world: World, cell: tuple[int, int]) -> int:
    return int(np.ravel_multi_index(cell, world.feasible.shape))


def test_undiscounted_optimal_values_are_the_bonus_minus_the_distance_to_go(world):
    moves = transition(world, world.goal)
    values = optimal_values(moves, 1.0, flat(world, world.start))
    to_go = tabulate(world, world.goal).distance_to_go.ravel()
    seen = reached(moves, flat(world, world.start))
    assert set(seen) == set(np.flatnonzero(np.isfinite(to_go) & (to_go > 0)))
    np.testing.assert_allclose(values[seen], world.task.goal_bonus - to_go[seen], atol=1e-9)


@pytest.mark.parametrize("gamma", [0.9, 1.0])
def test_the_spread_is_that_of_sampled_returns(world, gamma):
    rng, moves = np.random.default_rng(0), transition(world, world.goal)
    samples = 20_000
    cells, returns, weight = np.full(samples, flat(world, world.start)), np.zeros(samples), np.ones(samples)
    while weight.any():
        actions = rng.integers(8, size=samples)
        returns += weight * moves.reward[cells, actions]
        weight *= gamma * ~moves.is_terminated[cells, actions]
        weight[weight < 1e-9] = 0.0
        cells = moves.next_cell[cells, actions]
    spread = random_spread(moves, gamma, flat(world, world.start))
    assert spread == pytest.approx(returns.std(), rel=0.05)


def test_a_discount_near_one_leaves_the_best_path_the_best_and_a_small_one_does_not():
    # the goal's bonus is far away: under a strong discount, moves that cost nothing now are worth more
    world = build_world(Task())
    near, far = outlooks(world, [0.98, 0.3])
    assert near.ratio == pytest.approx(1.0, abs=1e-12)
    assert far.ratio > 1.0
    assert near.episodes == pytest.approx((near.spread / (0.02 * 23.2279)) ** 2, rel=1e-4)
