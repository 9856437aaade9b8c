"""Facts about optimal actions, transition tables and optimal action values, against the
environment's own steps.
"""

import gymnasium
import numpy as np
import pytest
from tiny_pool import tiny_pool

import irs_gym
from irs_gym.grid import MOVE_LENGTHS, MOVES
from irs_gym.mdp.action_values import optimal_q
from irs_gym.mdp.dynamics import Transition

ID, RANDOM_ID = "irs_gym:IrsNav-v0", "irs_gym:IrsNavRandom-v0"
POOL = tiny_pool(4, (6, 5), seed=2)
CONSTRAINTS = ["refuse", "terminate", "allow"]


def stepped(env, number=0):
    """Next cell, reward and end of every action in every cell that a robot may be in, by stepping:
    ``(S, 8)``.
    """
    columns, world = env.world.feasible.shape[1], env.worlds.world(number)
    to, reward, ends = (
        np.zeros((world.feasible.size, 8), dtype=kind) for kind in (np.int64, float, bool)
    )
    starts = []
    for start in np.argwhere(
        np.isfinite(POOL.distance_to_go[number]) & (POOL.distance_to_go[number] > 0)
    ).tolist():
        here = start[0] * columns + start[1]
        starts.append(here)
        for action in range(8):
            env.reset(options={"scene_id": number, "start": start})
            to[here, action], reward[here, action], ends[here, action], _, _ = env.step(action)
    return np.array(starts), to, reward, ends


def make(**kwargs):
    return gymnasium.make(
        RANDOM_ID, scenes=POOL, observation="cell", goal_bonus=100.0, **kwargs
    ).unwrapped


@pytest.mark.parametrize("constraint", CONSTRAINTS)
@pytest.mark.parametrize("shaping", [True, False])
def test_the_transition_table_is_what_the_steps_do(constraint, shaping):
    env = make(constraint=constraint, shaping=shaping)
    for number in range(len(POOL)):
        starts, to, reward, ends = stepped(env, number)
        env.reset(options={"scene_id": number})
        table = env.transition_table()
        np.testing.assert_array_equal(table.next_cell[starts], to[starts])
        np.testing.assert_array_equal(table.reward[starts], reward[starts])
        np.testing.assert_array_equal(table.is_terminated[starts], ends[starts])
        goal = np.ravel_multi_index(POOL.goal[number], POOL.shape)
        assert (table.next_cell[goal] == goal).all()
        assert (table.reward[goal] == 0.0).all()
        assert table.is_terminated[goal].all()


@pytest.mark.parametrize(
    "constraint", ["refuse", "terminate"]
)  # allowed, a robot may go where no episode begins
@pytest.mark.parametrize("shaping", [True, False])
@pytest.mark.parametrize("gamma", [0.3, 0.9, 0.99, 1.0, 1])
def test_optimal_q_is_the_limit_of_value_iteration_over_the_environments_own_steps(
    constraint, shaping, gamma
):
    env = make(constraint=constraint, shaping=shaping)
    for number in range(len(POOL)):
        starts, to, reward, ends = stepped(env, number)
        q = np.zeros(to.shape)
        for _ in range(4000):
            q = reward + gamma * ~ends * q.max(axis=1)[to]
        env.reset(options={"scene_id": number})
        found = env.optimal_q(gamma)
        assert (found.dtype, found.shape) == (np.float64, (30, 8))
        np.testing.assert_allclose(found[starts], q[starts], rtol=0, atol=1e-10)
        assert (found[np.ravel_multi_index(POOL.goal[number], POOL.shape)] == 0.0).all()


@pytest.mark.parametrize("constraint", CONSTRAINTS)
@pytest.mark.parametrize("gamma", [0.5, 0.98, 0.9999, 1 - 1e-9])
def test_optimal_q_meets_bellmans_equation_in_the_papers_factory(constraint, gamma):
    env = gymnasium.make(ID, constraint=constraint).unwrapped
    table, q = env.transition_table(), env.optimal_q(gamma)
    ahead = np.where(table.is_terminated, 0.0, gamma * q.max(axis=1)[table.next_cell])
    np.testing.assert_allclose(q, table.reward + ahead, rtol=1e-12, atol=1e-10)


def test_undiscounted_the_best_action_is_the_oracles_and_its_value_the_return_of_the_oracles_path():
    env = gymnasium.make(ID, observation="cell").unwrapped
    cell, info = env.reset()
    q = env.optimal_q(1.0)
    octile = 39 * 0.5  # start and goal are in one row
    assert q[cell].max() == pytest.approx(10.0 + octile - info["oracle_distance"], abs=1e-10)
    for i, j in np.argwhere(np.isfinite(env._episode.tables.distance_to_go)).tolist():
        values = q[i * 40 + j]
        if (i, j) != env.world.goal:
            best = np.flatnonzero(values >= values.max() - 1e-9)
            assert env.optimal_actions((i, j)).tolist() == best.tolist()
    cut_off = np.flatnonzero(env.world.feasible & ~np.isfinite(env._episode.tables.distance_to_go))
    assert len(cut_off)
    assert (q[cut_off] == -np.inf).all()


def test_greedy_steps_by_optimal_q_collect_its_value():
    env = make(constraint="allow")
    for number in range(len(POOL)):
        cell, _ = env.reset(options={"scene_id": number})
        q, total, factor, is_over = env.optimal_q(0.9), 0.0, 1.0, False
        promised = q[cell].max()
        for _ in range(400):
            cell, reward, is_over, _, _ = env.step(int(q[cell].argmax()))
            total, factor = total + factor * reward, factor * 0.9
            if is_over:
                break
        assert total == pytest.approx(promised, abs=1e-10)


def test_a_walk_that_never_ends_is_worth_its_discounted_sum_and_undiscounted_nothing_finite():
    zeros, never = np.zeros((1, 8)), np.zeros((1, 8), dtype=bool)
    loop = Transition(zeros.astype(int), zeros - 1.0, zeros, ~never, zeros, never, never)
    np.testing.assert_allclose(optimal_q(loop, 0.75), -4.0, rtol=1e-14)
    np.testing.assert_allclose(optimal_q(loop, 1 - 2**-40), -(2.0**40), rtol=1e-10)
    assert (optimal_q(loop, 1.0) == -np.inf).all()


@pytest.mark.parametrize(
    "gamma", [0, 0.0, -0.5, 1.0001, float("nan"), float("inf"), True, "0.9", None, np.zeros(1)]
)
def test_a_discount_out_of_range_is_refused(gamma):
    with pytest.raises(ValueError, match=r"gamma=.* must be a number above 0 and up to 1"):
        make().optimal_q(gamma)


def test_all_optimal_actions_are_told_from_any_cell():
    env = gymnasium.make(ID).unwrapped
    env.reset(options={"start": (20, 35), "goal": (30, 37)})
    assert env.optimal_actions().tolist() == [
        0,
        1,
    ]  # two of the ten moves are diagonal, in any order
    assert env.optimal_actions().dtype == np.int64
    env.step(1), env.step(1)
    assert env.optimal_actions().tolist() == [0]
    assert env.optimal_actions((20, 35)).tolist() == [0, 1]
    assert env.optimal_actions(np.array([30, 38])).tolist() == [6]
    for nowhere in ((30, 37), (8, 8), (39, 10)):  # the goal, an obstacle, a cell that is cut off
        assert env.optimal_actions(nowhere).shape == (0,)
    for bad, message in (
        ((40, 0), "lies off the map"),
        ((-1, 0), "lies off the map"),
        (7, "cell=7 must be a cell"),
    ):
        with pytest.raises(ValueError, match=message):
            env.optimal_actions(bad)


@pytest.mark.parametrize("cell_size", [0.1, 0.3, 1 / 3, 0.7, 1e-3])
def test_no_tie_is_lost_to_the_rounding_of_lengths(cell_size):
    """On an open floor, every move that comes nearer by octile distance as counted in whole numbers
    is optimal.
    """
    env = gymnasium.make(ID, radio_map=irs_gym.RadioMap.from_array(np.zeros((60, 45)), cell_size), start=(0, 0),
                         goal=(41, 23), target_db=-1.0).unwrapped  # fmt: skip
    for i in range(60):
        for j in range(45):
            apart = np.abs(np.array([41 - i, 23 - j]))
            after = np.abs(np.array([41, 23]) - (np.array([i, j]) + MOVES))
            diagonal, straight = (
                apart.min() - after.min(axis=1),
                np.ptp(apart) - np.ptp(after, axis=1),
            )
            is_long = MOVE_LENGTHS > 1
            on_map = ((np.array([i, j]) + MOVES >= 0) & (np.array([i, j]) + MOVES < [60, 45])).all(
                axis=1
            )
            is_optimal = on_map & (diagonal == is_long) & (straight == ~is_long)
            assert env.optimal_actions((i, j)).tolist() == np.flatnonzero(is_optimal).tolist(), (
                i,
                j,
            )
