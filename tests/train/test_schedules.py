"""Facts of what falls over the schedule of a training, and of noise in actions."""

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.policies import ActorCriticPolicy
from tiny import TINY, call, continuous_floor

from agents.runs.run_folder import Run
from agents.single.model import build_model
from agents.vec_env import IrsNavVecEnv
from irs_gym.envs.continuous_vector_nav import IrsNavContinuousVectorEnv
from train.config import defaults_of
from train.evaluation import Evaluation

STEPS = ("--agent.total-timesteps", 640)  # ten rollouts of `TINY`
LEFT = np.linspace(1.0, 0.1, 10)  # of the schedule, at the begin of each of its ten rollouts


@pytest.fixture
def updates(monkeypatch):
    """For each update of PPO, the weight of the entropy bonus, and the log std by which its actions
    were drawn and by which it learns.
    """
    seen = []
    drawn = []
    forward, learn = ActorCriticPolicy.forward, PPO.train

    def act(policy, *arguments, **settings):
        drawn.append(_log_std(policy))
        return forward(policy, *arguments, **settings)

    def train(model):
        before = _log_std(model.policy)
        learn(model)
        assert _log_std(model.policy) == before  # it is not learned
        assert all(each == before for each in drawn)
        drawn.clear()
        seen.append((model.ent_coef, before))

    monkeypatch.setattr(ActorCriticPolicy, "forward", act)
    monkeypatch.setattr(PPO, "train", train)
    return seen


def _log_std(policy):
    return policy.log_std.tolist() if hasattr(policy, "log_std") else None


def interrupt_at(monkeypatch, steps):
    """Let the next training end after so many steps."""
    test = Evaluation._test

    def interrupt(evaluation):
        test(evaluation)
        evaluation.is_interrupted |= evaluation.num_timesteps >= steps
        if evaluation.is_interrupted:
            monkeypatch.setattr(Evaluation, "_test", test)

    monkeypatch.setattr(Evaluation, "_test", interrupt)


def spread_words(folder):
    return [*TINY["continuous_ppo"], *continuous_floor(folder), *STEPS]


def test_spread_of_actions_falls_from_the_first_to_the_last_log_std(tmp_path, updates):
    words = [*spread_words(tmp_path), "--agent.log-std-init", -0.5, "--agent.final-log-std", -2.5]
    assert call(["continuous_ppo", "--out", tmp_path / "run", *words]) == 0
    spreads = np.array([each for _, each in updates])  # (10, 2)
    np.testing.assert_allclose(spreads, (-2.5 + 2.0 * LEFT)[:, None].repeat(2, 1), atol=1e-6)
    policy = Run.open(tmp_path / "run").load_model("last")
    np.testing.assert_allclose(policy.log_std.tolist(), spreads[-1], atol=1e-6)


def test_spread_goes_on_where_a_run_was_interrupted(tmp_path, updates, monkeypatch):
    words = spread_words(tmp_path)
    assert call(["continuous_ppo", "--out", tmp_path / "whole", *words]) == 0
    whole = updates.copy()
    updates.clear()
    interrupt_at(monkeypatch, 256)
    assert call(["continuous_ppo", "--out", tmp_path / "run", *words]) == 130
    assert len(updates) == 4
    assert call(["continuous_ppo", "--resume", tmp_path / "run", "--no-progress"]) == 0
    assert updates == whole
    first = defaults_of("continuous_ppo").agent.log_std_init
    assert whole[0][1] == pytest.approx([first, first])
    ran = Run.open(tmp_path / "whole").load_model("last")
    resumed = Run.open(tmp_path / "run").load_model("last")
    assert ran.log_std.tolist() == resumed.log_std.tolist()


def test_weight_of_the_entropy_falls_on_the_grid_where_a_last_one_is_given(tmp_path, updates):
    words = [*TINY["ppo"], *STEPS, "--agent.ent-coef", 0.05]
    assert call(["ppo", "--out", tmp_path / "fixed", *words]) == 0
    assert [each for each, _ in updates] == [0.05] * 10
    updates.clear()
    words += ["--agent.final-ent-coef", 0.01]
    assert call(["ppo", "--out", tmp_path / "falling", *words]) == 0
    assert [each for each, _ in updates] == pytest.approx(0.01 + 0.04 * LEFT)


def test_weight_of_the_entropy_goes_on_where_a_run_was_interrupted(tmp_path, updates, monkeypatch):
    words = [*TINY["ppo"], *STEPS, "--agent.ent-coef", 0.05, "--agent.final-ent-coef", 0]
    interrupt_at(monkeypatch, 256)
    assert call(["ppo", "--out", tmp_path / "run", *words]) == 130
    assert call(["ppo", "--resume", tmp_path / "run", "--no-progress"]) == 0
    assert [each for each, _ in updates] == pytest.approx(0.05 * LEFT)


def test_td3_strays_from_its_policy_in_training_as_far_as_its_settings_say():
    env = IrsNavVecEnv(
        500, vector_env=IrsNavContinuousVectorEnv, target_db=-63.0, observation="flat"
    )
    agent = defaults_of("td3").agent
    assert agent.action_noise > 0
    model = build_model(agent, env, 0)
    assert isinstance(model.action_noise, NormalActionNoise)
    np.random.seed(0)  # noqa: NPY002  # from which SB3 draws its noise
    drawn = np.array([model.action_noise() for _ in range(4000)])  # (4000, 2)
    assert np.abs(drawn.mean(axis=0)).max() < 0.02
    np.testing.assert_allclose(drawn.std(axis=0), agent.action_noise, rtol=0.05)
    assert np.abs(np.corrcoef(drawn.T)[0, 1]) < 0.05
    assert (model.target_policy_noise, model.target_noise_clip) == (
        agent.target_policy_noise,
        agent.target_noise_clip,
    )
    env.close()
