"""Facts of PPO under a bound on the expected cost."""

import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecEnv

from agents.single.ppo_lagrangian import PpoLagrangian, PricedVecEnv, budgets_of, own_start
from agents.vec_env import IrsNavVecEnv

BUDGET = {
    "target_db": -55.0,
    "constraint": "budget",
    "budget": 30.0,
    "on_exhausted": "continue",
    "observation": "flat",
}


def played(env: VecEnv, actions: np.ndarray) -> list[tuple]:
    env.seed(3)
    env.reset()
    return [env.step(each) for each in actions]


def test_rewards_are_less_by_the_price_of_the_costs_and_totals_are_those_of_whole_episodes():
    actions = np.random.default_rng(0).integers(0, 8, (60, 4))
    plain = IrsNavVecEnv(4, max_episode_steps=25, **BUDGET)
    start = own_start(plain)
    priced = PricedVecEnv(IrsNavVecEnv(4, max_episode_steps=25, **BUDGET), start, (30.0, 30.0))
    priced.charge(0.5, spread=1.0)
    steps = played(plain, actions)
    totals = []
    total = np.array([info["cost"] for info in plain.reset_infos])
    assert (total == 1).all()  # the start lies below the target
    unpaid = total.copy()
    for (_, reward, done, infos), (_, less, same, _) in zip(
        steps, played(priced, actions), strict=True
    ):
        costs = np.array([info["cost"] for info in infos])
        np.testing.assert_allclose(less, reward - 0.5 * (costs + unpaid), atol=1e-6)
        np.testing.assert_array_equal(done, same)
        total += costs
        totals += total[done].tolist()
        total[done] = unpaid[done] = 1.0
        unpaid[~done] = 0.0
    assert len(totals) == 8
    assert priced.take_costs() == totals
    assert priced.take_costs() == []


def test_episodes_from_random_starts_are_learned_from_and_not_counted():
    env = IrsNavVecEnv(64, max_episode_steps=2, random_start=0.5, **BUDGET)
    priced = PricedVecEnv(env, own_start(env), (30.0, 30.0))
    played(priced, np.zeros((2, 64), dtype=int))
    counted = len(priced.take_costs())
    began = sum(single["path"][0] == (0, 20) for single in [{"path": p} for p in env.envs.paths()])
    assert counted == began
    assert 10 < counted < 54


def test_a_larger_budget_is_charged_less_and_the_mean_is_the_multiplier():
    env = IrsNavVecEnv(64, **{**BUDGET, "budget": (24.0, 40.0)})
    priced = PricedVecEnv(env, own_start(env), (24.0, 40.0))
    priced.charge(0.5, spread=0.6)
    plain = IrsNavVecEnv(64, **{**BUDGET, "budget": (24.0, 40.0)})
    actions = np.zeros((1, 64), dtype=int)
    ((_, reward, _, infos),) = played(plain, actions)
    ((_, less, _, _),) = played(priced, actions)
    costs = np.array([1.0 + info["cost"] for info in infos])  # with that of the start
    budgets = np.array([1.0 + info["budget_left"] for info in plain.reset_infos])
    np.testing.assert_allclose(
        reward - less, 0.5 * (1 + 0.6 * (32 - budgets) / 8) * costs, rtol=1e-5
    )
    assert budgets.std() > 2


@pytest.mark.parametrize(
    ("mean_cost", "multiplier"),
    [
        (40.0, 0.3),  # 10 above the bound
        (5.0, 0.0),  # a multiplier is not negative
        (500.0, 0.5),  # an excess counts up to the bound
    ],
)
def test_the_multiplier_ascends_the_dual(monkeypatch, mean_cost, multiplier):
    model = PpoLagrangian(
        "MlpPolicy",
        IrsNavVecEnv(2, **BUDGET),
        n_steps=4,
        batch_size=8,
        multiplier=0.2,
        multiplier_rate=0.01,
        policy_kwargs={"net_arch": [4]},
        device="cpu",
    )
    model.learn(8)
    assert model.multiplier == 0.2  # no episode has ended
    monkeypatch.setattr(model.priced, "take_costs", lambda: [mean_cost - 1, mean_cost + 1])
    model.train()
    assert model.multiplier == pytest.approx(multiplier)


@pytest.mark.parametrize(
    "changes",
    [{"on_exhausted": "terminate"}, {"constraint": "refuse", "budget": None, "target_db": -61.0}],
)
def test_environments_that_do_not_count_costs_to_the_end_are_refused(changes):
    arguments = {**BUDGET, **changes}
    if changes.get("constraint"):
        del arguments["on_exhausted"]
    with pytest.raises(ValueError, match="needs constraint='budget' and on_exhausted='continue'"):
        budgets_of(IrsNavVecEnv(1, **arguments))
