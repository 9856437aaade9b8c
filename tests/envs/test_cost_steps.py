"""Facts of steps that return the cost: sums over an episode are those of the front."""

import gymnasium
import numpy as np
import pytest

import irs_gym
from irs_gym import SixTuple, VectorReward, build_radio_map, cost_map, pareto_front

BUDGET = {"constraint": "budget", "on_exhausted": "continue", "target_db": -58.0}


def actions_of(path) -> list[int]:
    """The moves along a path of cells."""
    names = irs_gym.grid.MOVES.tolist()
    return [names.index(step) for step in np.diff(path.cells, axis=0).tolist()]


@pytest.mark.parametrize("kind", ["violation", "deficit"])
def test_costs_of_an_episode_add_up_to_those_of_its_path_with_the_start(kind):
    cost = cost_map(build_radio_map("paper"), -58.0, kind)
    start = tuple(np.argwhere(np.isfinite(cost) & (cost > 0))[0].tolist())
    front = pareto_front(cost, start, (39, 20), 0.5)
    assert cost[start] > 0
    env = SixTuple(gymnasium.make("irs_gym:IrsNav-v0", cost=kind, budget=400.0, **BUDGET))
    for n in range(len(front.costs)):
        env.reset(options={"start": start})
        steps = [env.step(action) for action in actions_of(front.path(n))]
        assert sum(step[2] for step in steps) == pytest.approx(front.costs[n], abs=1e-9)
        assert [step[3] for step in steps] == [False] * (len(steps) - 1) + [True]
        assert steps[-1][5]["distance"] == pytest.approx(front.distances[n])


def test_rewards_are_vectors_of_the_reward_and_minus_the_cost():
    arguments = {"cost": "violation", "budget": 400.0, **BUDGET}
    scalar = SixTuple(gymnasium.make("irs_gym:IrsNav-v0", **arguments))
    vector = VectorReward(gymnasium.make("irs_gym:IrsNav-v0", **arguments))
    first, _ = scalar.reset(seed=1)
    second, _ = vector.reset(seed=1)
    np.testing.assert_array_equal(first["position"], second["position"])
    assert vector.unwrapped.reward_space.shape == (2,)
    for action in np.random.default_rng(0).integers(0, 8, 100).tolist():
        _, reward, cost, *ends, _ = scalar.step(action)
        _, both, *its_ends, _ = vector.step(action)
        assert both in vector.reward_space
        assert both.tolist() == [np.float32(reward), np.float32(-cost)]
        assert ends == its_ends


def test_an_environment_that_tells_no_cost_is_refused():
    env = SixTuple(gymnasium.make("irs_gym:IrsNav-v0", infos=["distance"]))
    with pytest.raises(ValueError, match="hold no cost: infos= must name 'cost'"):
        env.reset()
