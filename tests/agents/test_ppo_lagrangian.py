"""Facts of PPO under a bound on the expected cost: prices, rounds, and mixtures of policies."""

from io import BytesIO
from math import inf, isinf

import gymnasium
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecEnv
from tiny import TINY, call

from agents.runs import weights
from agents.runs.run_folder import Run
from agents.single import priced_vec_env
from agents.single.mixture import Mixture, least_distance
from agents.single.ppo_lagrangian import PpoLagrangian, PpoLagrangianConfig, check_bound
from agents.single.priced_vec_env import Outcome, PricedVecEnv, play
from agents.vec_env import IrsNavVecEnv
from irs_gym.grid import MOVES
from irs_gym.mdp.task import Task

BUDGET = {
    "target_db": -55.0,
    "constraint": "budget",
    "budget": 30.0,
    "on_exhausted": "continue",
    "observation": "flat",
}


class Always:
    """Takes one action."""

    def __init__(self, action: int) -> None:
        self.action = action

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.full(np.shape(observation)[:-1], self.action), state


def played(env: VecEnv, actions: np.ndarray) -> list[tuple]:
    env.seed(3)
    env.reset()
    return [env.step(each) for each in actions]


def test_rewards_are_less_by_the_price_of_the_costs():
    actions = np.random.default_rng(0).integers(0, 8, (60, 4))
    plain = played(IrsNavVecEnv(4, max_episode_steps=25, **BUDGET), actions)
    priced = PricedVecEnv(IrsNavVecEnv(4, max_episode_steps=25, **BUDGET), 0.5)
    for (_, reward, done, infos), (_, less, same, _) in zip(
        plain, played(priced, actions), strict=True
    ):
        costs = np.array([info["cost"] for info in infos])
        np.testing.assert_allclose(less, reward - 0.5 * costs, atol=1e-6)
        np.testing.assert_array_equal(done, same)


class Steps:
    """Takes these actions, one after the other."""

    def __init__(self, actions: list[int]) -> None:
        self.actions = iter(actions)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return next(self.actions), state


def test_an_episode_costs_what_its_cells_cost_the_start_included():
    env = gymnasium.make("irs_gym:IrsNav-v0", **BUDGET).unwrapped
    _, info = env.reset()
    best = env.oracle.cells
    moves = [int(np.flatnonzero((step == MOVES).all(axis=1))[0]) for step in np.diff(best, axis=0)]
    cost, distance = play(Steps(moves), Task(**{**BUDGET, "random_start": 0.5}))
    assert cost == env.world.cost[tuple(best.T)].sum() > info["cost"] == 1.0
    assert distance == pytest.approx(info["oracle_distance"])
    assert all(map(isinf, play(Always(0), Task(**BUDGET))))  # into the wall, for ever


def test_best_weights_meet_the_bound_at_the_hull_and_the_dual_is_its_slope():
    found = least_distance([26.0, 0.0, 20.0], [21.0, 25.0, 24.9], bound=6.5)
    np.testing.assert_allclose(found.shares, [0.25, 0.75, 0.0])
    assert found.distance == pytest.approx(24.0)
    assert found.multiplier == pytest.approx(4 / 26)
    assert least_distance([14.0], [20.0], bound=13.0) is None
    free = least_distance([3.0, 0.0], [20.0, 30.0], bound=13.0)
    assert (free.distance, free.multiplier) == (20.0, 0.0)


def test_one_policy_is_drawn_for_each_episode_as_often_as_its_share():
    mixture = Mixture([Always(2), Always(5)], np.array([0.3, 0.7]), 4, np.zeros((0, 3)))
    seen = np.zeros((2000, 3))
    first, state = mixture.predict(seen, None, np.ones(2000, dtype=bool))
    assert (first == 2).mean() == pytest.approx(0.3, abs=0.04)
    again, state = mixture.predict(seen, state, np.zeros(2000, dtype=bool))
    np.testing.assert_array_equal(again, first)
    starts = np.arange(2000) < 1000
    anew, _ = mixture.predict(seen, state, starts)
    np.testing.assert_array_equal(anew[1000:], first[1000:])
    assert (anew[:1000] != first[:1000]).mean() == pytest.approx(0.42, abs=0.06)
    alone, memory = mixture.predict(seen[0], None, np.ones(1, dtype=bool))
    assert alone.shape == ()
    assert mixture.predict(seen[0], memory, np.zeros(1, dtype=bool))[0] == alone


def test_equal_seeds_draw_equal_policies():
    draws = [
        [
            int(mixture.predict(np.zeros(3), None, np.ones(1, dtype=bool))[0])
            for _ in range(50)
        ]
        for mixture in (
            Mixture([Always(0), Always(1)], np.full(2, 0.5), seed, np.zeros((0, 3)))
            for seed in (1, 1, 2)
        )
    ]  # fmt: skip
    assert draws[0] == draws[1] != draws[2]


class Untrained(PpoLagrangian):
    """Whose rounds bring what is said, without training."""

    outcomes: list[Outcome]

    def _train_round(self, end, callback):
        self.num_timesteps += 1
        return True

    def _test(self):
        outcome = type(self).outcomes.pop(0)
        self._best = None if isinf(outcome.cost) else (object(), *outcome)


class NoCallback:
    def init_callback(self, model): ...
    def on_training_start(self, *_): ...
    def on_training_end(self): ...


def rounds_of(*outcomes: tuple[float, float], bound: float) -> Untrained:
    config = PpoLagrangianConfig(n_envs=2, n_steps=4, batch_size=8, net_arch=(4,), first_price=1.0)
    model = Untrained(config, IrsNavVecEnv(2, **{**BUDGET, "budget": bound}), 0)
    Untrained.outcomes = [Outcome(*each) for each in outcomes]
    return model.learn(len(outcomes), NoCallback())


def test_multipliers_are_the_duals_of_what_was_found_until_a_round_brings_nothing_better():
    model = rounds_of((52.0, 21.0), (40.0, 24.0), (30.0, 25.0), (52.0, 21.0), bound=35.0)
    multipliers = [each[0] for each in model.rounds]
    assert multipliers == pytest.approx([0.0, 1.0, 2.0, 4 / 22])
    np.testing.assert_allclose(model.mixture.shares, [5 / 22, 17 / 22])


def test_a_better_policy_goes_on_and_one_that_did_not_arrive_is_tried_again():
    model = rounds_of(
        (52.0, 21.0), (inf, inf), (30.0, 25.0), (41.0, 22.0), (41.0, 22.0), (1.0, 1.0), bound=35.0
    )
    multipliers = [each[0] for each in model.rounds]
    assert multipliers == pytest.approx([0.0, 1.0, 1.0, 4 / 22, 3 / 11])
    assert model.rounds[1][1:] == pytest.approx((inf, inf))
    assert len(model.mixture.policies) == 2
    np.testing.assert_allclose(sorted(model.mixture.shares), [5 / 11, 6 / 11])


def test_where_nothing_meets_the_bound_what_costs_least_acts():
    model = rounds_of((52.0, 21.0), (40.0, 24.0), (45.0, 23.0), bound=35.0)
    assert model.mixture.shares.tolist() == [1.0]
    assert model.mixture.policies[0] is model._found[1][0]


def test_a_round_ends_where_its_tests_hold_one_value(monkeypatch):
    config = PpoLagrangianConfig(
        n_envs=2, n_steps=4, batch_size=8, net_arch=(4,), test_every=8, hold=3
    )
    model = PpoLagrangian(config, IrsNavVecEnv(2, **BUDGET), 0)
    values = iter([(inf, inf), (5.0, 30.0), (5.0, 29.0), (5.0, 29.0), (5.0, 29.0)] * 2)

    def say(policy, task):
        policy.predict(np.zeros(policy.observation_space.shape))  # as any play does
        return Outcome(*next(values))

    monkeypatch.setattr(priced_vec_env, "play", say)
    callback = NoCallback()
    callback.on_rollout_start = lambda: None
    callback.on_step = lambda: True
    model._train_round(10**6, callback)
    assert model._tested_at == 5 * 8
    assert model._best[1:] == (5.0, 29.0)


def test_saved_mixture_acts_as_the_trained_one_and_a_damaged_one_is_refused(tmp_path):
    words = [*TINY["ppo_lagrangian"], "--agent.total-timesteps", 256]
    assert call(["ppo_lagrangian", "--out", tmp_path / "run", *words]) == 0
    run = Run.open(tmp_path / "run")
    world = {**BUDGET, "target_db": -60.0, "patch_radius": 1}
    world |= {"observation": "dict", "irs_phases": False}
    model = PpoLagrangian(
        PpoLagrangianConfig(net_arch=(8,), n_envs=4, n_steps=16, batch_size=32),
        IrsNavVecEnv(4, **{**world, "budget": 13.0}),
        run.config.seed,
    )
    policies = [model._ppo.policy]
    model._begin(1.0)
    policies.append(model._ppo.policy)
    model.mixture = Mixture(
        policies, np.array([0.25, 0.75]), run.config.seed, np.array([[0.0, 26.0, 21.5]])
    )
    run.save_model("best", model, 1, is_success=False, ratio=None)
    loaded = run.load_model()
    np.testing.assert_array_equal(loaded.shares, [0.25, 0.75])
    np.testing.assert_array_equal(loaded.rounds, [[0.0, 26.0, 21.5]])
    env = IrsNavVecEnv(64, random_start=True, **world)
    seen = env.reset()
    ours, theirs = (each.predict(seen, deterministic=True)[0] for each in (model, loaded))
    np.testing.assert_array_equal(ours, theirs)
    assert len(np.unique(ours)) > 1

    arrays = dict(np.load(BytesIO(weights.pack(run.config, model))))
    for name, value, message in (
        ("shares", np.array([0.5, 0.6]), "shares of policies"),
        ("shares", np.array([1.5, -0.5]), "shares of policies"),
        ("shares", np.array([1.0]), "belongs to none of its 1 policies"),
        ("shares", np.full(3, 1 / 3), "missing|larger"),
        ("rounds", np.zeros((2, 2)), "rounds"),
        ("0.action_net.bias", np.zeros(8), "does not fit"),
    ):
        content = BytesIO()
        np.savez_compressed(content, **{**arrays, name: value})
        with pytest.raises(weights.WeightsError, match=message):
            weights.load(run.config, run.task, content.getvalue())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"on_exhausted": "terminate"}, "needs constraint='budget' and on_exhausted='continue'"),
        (
            {"constraint": "refuse", "budget": None, "on_exhausted": "terminate"},
            "needs constraint='budget' and on_exhausted='continue'",
        ),
        ({"budget": (0.0, 30.0)}, "one budget"),
    ],
)
def test_environments_without_a_bound_on_the_whole_cost_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        check_bound(Task(**{**BUDGET, **changes}).rules)
