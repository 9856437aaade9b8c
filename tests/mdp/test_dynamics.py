"""Facts of the rules of motion: many maps at once move as each of them alone."""

import numpy as np
import pytest
from tiny_pool import resized, tiny_pool

from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.mdp.dynamics import next_cells, permissions, transition, transitions

POOL = tiny_pool(5, (6, 8))
SIZE = 6 * 8


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
@pytest.mark.parametrize("cell_size", [0.5, 0.25])
def test_many_maps_move_as_each_alone(constraint, cell_size):
    pool = resized(POOL, cell_size)
    worlds = build_worlds(RandomTask(scenes=pool, constraint=constraint, goal_bonus=99.0))
    numbers = np.array([3, 0, 4])
    found = transitions(
        worlds.task.rules, pool.free[numbers], pool.feasible[numbers], pool.goal[numbers], cell_size
    )
    for n, number in enumerate(numbers.tolist()):
        alone = transition(worlds.world(number), tuple(pool.goal[number].tolist()))
        alone = alone._replace(next_cell=alone.next_cell + n * SIZE)
        for one, many in zip(alone, found, strict=True):
            np.testing.assert_array_equal(many[n * SIZE : (n + 1) * SIZE], one)
    assert found.is_at_goal.any()


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
def test_permissions_of_many_maps_are_those_of_each(constraint):
    found = permissions(constraint, POOL.free, POOL.feasible)
    for n in range(len(POOL)):
        alone = permissions(constraint, POOL.free[n], POOL.feasible[n])
        for one, many in zip(alone, found, strict=True):
            np.testing.assert_array_equal(many[n], one)


def test_a_refused_action_leads_nowhere():
    cells = np.array([9, 9, 48 + 9])
    found = next_cells(cells, np.array([1, 1, 6]), np.array([True, False, True]), (6, 8))
    assert found.tolist() == [9 + 8 + 1, 9, 48 + 9 - 1]
