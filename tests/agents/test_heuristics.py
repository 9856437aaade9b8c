"""Facts of the reference policies: what they read from an observation, and what they do with it."""

import gymnasium
import numpy as np
import pytest

from agents.policies.heuristics import (
    REFERENCE_POLICIES,
    greedy,
    greedy_margin,
    masked_random,
    oracle,
    random,
)
from agents.rollout.episode import evaluation_env, roll_out
from irs_gym import RadioMap
from irs_gym.mdp.packing import Packing
from irs_gym.mdp.task import Task

OBSERVATIONS = ("dict", "flat", "map")


def make(gain_db=None, **arguments) -> gymnasium.Env:
    """An environment over a map given as rows, the largest y first; the paper's without one."""
    if gain_db is not None:
        gain = np.array(gain_db, dtype=float)[::-1].T
        arguments = {"radio_map": RadioMap.from_array(gain, 1.0), "target_db": -60.0, **arguments}
    return gymnasium.make("irs_gym:IrsNav-v0", **arguments)


def states(env: gymnasium.Env, count: int):
    """Observations of a random walk, with the cells of robot and goal."""
    env.action_space.seed(0)
    goals = [None, (20, 35), (3, 2)]
    for n in range(count):
        if n % 20 == 0:
            goal = goals[n // 20 % 3]
            observation, _ = env.reset(seed=n, options={"goal": goal} if goal else None)
        yield observation, env.unwrapped.path[-1], goal or env.unwrapped.world.goal
        observation, _, terminated, _, _ = env.step(env.action_space.sample())
        assert not terminated


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_cells_of_robot_and_goal_are_read_from_every_observation(observation):
    env = make(observation=observation, random_start=True, target_db=-64.0)
    shape = env.unwrapped.radio_map.grid.shape
    for seen, robot, goal in states(env, 200):
        decoded = Packing.of(seen, shape).decode(seen)
        assert (decoded.cell, decoded.goal) == (
            np.ravel_multi_index(robot, shape),
            np.ravel_multi_index(goal, shape),
        )


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_oracle_policy_walks_a_shortest_path_from_anywhere(observation):
    env = make(observation=observation, random_start=True)
    policy = oracle(env)
    for seed in range(20):
        episode = roll_out(policy, env, seed=seed)
        assert episode.is_optimal
        assert episode.spl == pytest.approx(1.0)
        assert episode.refused == 0


@pytest.mark.parametrize("constraint", ["refuse", "terminate", "allow"])
def test_oracle_policy_keeps_to_feasible_cells_under_every_constraint(constraint):
    env = make(constraint=constraint, target_db=-61.2, goal_bonus=100.0)
    episode = roll_out(oracle(env), env)
    assert episode.is_optimal
    assert env.unwrapped.world.feasible[tuple(episode.path.T)].all()


def test_oracle_policy_serves_a_goal_set_at_the_reset():
    env = make()
    assert roll_out(oracle(env), env, options={"start": (2, 30), "goal": (37, 33)}).is_optimal


def test_batches_get_the_actions_of_their_observations():
    env = make(random_start=True, observation="dict", target_db=-64.0)
    seen = [observation for observation, _, _ in states(env, 60)]
    batch = {name: np.stack([each[name] for each in seen]) for name in seen[0]}
    for name in ("oracle", "greedy", "greedy_margin"):
        policy = REFERENCE_POLICIES[name](env, 0)
        actions, state = policy.predict(batch, state="kept")
        assert actions.tolist() == [int(policy.predict(each)[0]) for each in seen]
        assert state == "kept"


def test_random_actions_are_even_and_follow_their_seed():
    env = make()
    observation, _ = env.reset(seed=0)
    draws = {
        seed: [int(policy.predict(observation)[0]) for _ in range(8000)]
        for seed, policy in _seeded(env)
    }
    assert np.bincount(draws["first"], minlength=8) == pytest.approx(np.full(8, 1000), abs=150)
    assert draws["first"] == draws["again"] != draws["other"]


def _seeded(env):
    return ("first", random(env, 1)), ("again", random(env, 1)), ("other", random(env, 2))


def test_masked_random_is_never_refused_and_takes_every_open_action():
    env = make()
    episode = roll_out(masked_random(env, 0), env)
    assert episode.refused == 0
    observation, info = env.reset()
    policy = masked_random(env, 0)
    taken = {int(policy.predict(observation)[0]) for _ in range(500)}
    assert taken == set(np.flatnonzero(info["action_mask"]))


def test_greedy_is_optimal_on_an_open_floor():
    env = make(np.zeros((9, 12)), start=(0, 1), goal=(11, 7))
    assert roll_out(greedy(env), env).is_optimal


B = -np.inf  # an obstacle
TRAP = [
    [0, 0, 0, 0, 0, 0],
    [0, 0, 0, B, 0, 0],
    [0, 0, 0, B, 0, 0],
    [0, 0, 0, B, 0, 0],
    [0, 0, 0, 0, 0, 0],
]


def test_greedy_is_trapped_before_a_wall_where_the_oracle_goes_round():
    env = make(TRAP, start=(0, 2), goal=(5, 2))
    assert not roll_out(greedy(env), env).is_success
    assert roll_out(oracle(env), env).is_optimal


def test_greedy_never_enters_a_cell_below_the_target():
    env = make(
        [[0, 0, 0, 0], [0, -70, 0, 0], [0, 0, 0, 0]],
        start=(0, 1),
        goal=(3, 1),
        constraint="terminate",
    )
    assert roll_out(greedy(env), env).is_success


def test_greedy_on_the_margin_takes_the_strongest_of_the_cells_that_come_nearer():
    # The left column is the strongest, but farther from the goal at the right end.
    env = make(
        [[50, -1, -9, -3, -9], [50, -2, -5, -9, -1], [50, -9, -2, -4, -9]],
        start=(1, 1),
        goal=(4, 1),
    )
    assert roll_out(greedy_margin(env), env).path.tolist() == [[1, 1], [2, 0], [3, 0], [4, 1]]


def test_evaluation_starts_where_the_scene_says():
    env = evaluation_env(Task(random_start=1.0))
    starts = {tuple(roll_out(oracle(env), env).path[0]) for _ in range(5)}
    assert starts == {env.unwrapped.world.start}
