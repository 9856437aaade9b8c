"""Facts of training generalists: their run folders, tests on other scenes, resuming, and what is
refused.
"""

from dataclasses import replace
from shlex import split

import numpy as np
import pytest
import torch
from tiny import call, curve
from tiny_pool import tiny_pool

from agents.networks.map_network import plan_scene_set
from agents.registry import generalists, observation_of
from agents.rollout.scene_set import follow
from agents.runs.run_folder import Run, RunError
from agents.single.model import build_model
from agents.vec_env import IrsNavVecEnv
from irs_gym.datasets import scene_set, splits
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from train.config import defaults_of, parse, record_of, settings_of

_IMITATION = split(
    "--agent.total-scenes 40 --agent.batch-scenes 4 --eval-every 16 --checkpoint-every 8"
)
_PPO = split(
    "--agent.total-timesteps 640 --agent.scenes 2 --agent.robots 4 --agent.n-steps 8 "
    "--eval-every 256 --checkpoint-every 128"
)
_SB3 = split(
    "--agent.total-timesteps 640 --agent.n-envs 8 --agent.n-steps 8 --agent.batch-size 32 --agent.n-epochs 1 "
    "--agent.net-arch 8 --eval-every 256 --checkpoint-every 128"
)
_UNET = split("--agent.width 8 --agent.passes 1")
TINY = {
    "planner": _IMITATION,
    "planner_ppo": _PPO,
    "unet": _IMITATION + _UNET,
    "unet_ppo": _PPO + _UNET,
    "explorer": split(
        "--agent.total-timesteps 640 --agent.robots 8 --agent.width 8 --eval-every 200 --checkpoint-every 100"
    ),
    "explorer_ppo": split(
        "--agent.total-timesteps 640 --agent.robots 8 --agent.width 8 --agent.n-plans 2 --agent.plan-steps 3 "
        "--eval-every 200 --checkpoint-every 100"
    ),
    "local_ppo": _SB3,
    "recurrent_ppo": _SB3 + split("--agent.lstm-hidden-size 8"),
    "map_ppo": _SB3,
    "vin": _IMITATION + split("--agent.rounds 4 --agent.width 8"),
}


class Crash(BaseException):
    """The end of the process, as far as one process can play it."""


@pytest.fixture(autouse=True)
def pools(monkeypatch):
    """Small pools in place of the generated ones; returns what was asked for."""
    asked = []

    def build(split, num_scenes, **_):
        asked.append((split, num_scenes))
        return tiny_pool(6, (8, 8), seed=len(split))

    monkeypatch.setattr(scene_set, "build_scene_set", build)
    for name, each in splits.SPLITS.items():
        monkeypatch.setitem(splits.SPLITS, name, replace(each, frame=(8, 8)))
    return asked


def train(algorithm, folder, *words):
    return call([algorithm, "--out", folder, *TINY[algorithm], "--no-progress", *words])


@pytest.mark.parametrize("algorithm", generalists())
def test_each_generalist_trains_into_a_run_and_goes_on_as_if_never_interrupted(
    tmp_path, monkeypatch, algorithm
):
    assert train(algorithm, tmp_path / "whole") == 0
    whole = Run.open(tmp_path / "whole")
    assert (whole.manifest.status, whole.is_generalist, whole.manifest.checkpoints) == (
        "finished",
        True,
        (),
    )
    rows = curve(whole.folder)
    planned = settings_of(
        whole
    ).agent.total_timesteps  # an explorer's last walk may be longer than what was left
    assert planned <= int(rows[-1]["steps"]) == whole.manifest.models["last"].steps < planned + 64
    assert max(float(row["spl"]) for row in rows) == whole.manifest.models["best"].spl

    save, written = Run.save_checkpoint, []

    def save_and_crash(*arguments):
        save(*arguments)
        written.append(arguments)
        if len(written) == 3:
            raise Crash

    with monkeypatch.context() as patch:
        patch.setattr(Run, "save_checkpoint", save_and_crash)
        with pytest.raises(Crash):
            train(algorithm, tmp_path / "cut")
    np.random.default_rng().random()
    assert call([algorithm, "--resume", tmp_path / "cut", "--no-progress"]) == 0
    cut = Run.open(tmp_path / "cut")
    assert curve(cut.folder) == rows
    for name in ("best", "last"):
        assert (
            cut.manifest.models[name] == whole.manifest.models[name]
        )  # equal weights give equal bytes


@pytest.mark.parametrize("algorithm", ["map_ppo", "local_ppo", "recurrent_ppo"])
def test_loaded_policy_of_sb3_acts_as_the_model_that_was_saved(tmp_path, algorithm):
    default = defaults_of(algorithm)
    agent, seen = default.agent, observation_of(algorithm)
    env = IrsNavVecEnv(
        agent.n_envs,
        vector_env=IrsNavRandomVectorEnv,
        scenes=tiny_pool(6, (8, 8)),
        observation=seen,
    )
    model = build_model(agent, env, seed=2)
    run = Run.create(tmp_path / "run", record_of(default))
    run.save_model("best", model, 0, success=0.0, spl=0.0)
    loaded = Run.open(run.folder).load_model()

    observation, starts, rng = (
        env.reset(),
        np.ones(agent.n_envs, dtype=bool),
        np.random.default_rng(0),
    )
    states = [None, None]
    for step in range(10):
        actions = []
        for n, policy in enumerate((loaded, model)):
            torch.manual_seed(step)
            found, states[n] = policy.predict(
                observation, states[n], starts, deterministic=step % 2 == 0
            )
            actions.append(found)
        np.testing.assert_array_equal(*actions)
        assert len(np.unique(actions)) > 1
        if algorithm == "recurrent_ppo":
            assert all(map(np.array_equal, *states))
        observation, _, starts, _ = env.step(rng.integers(8, size=agent.n_envs))


def test_model_of_a_run_plays_as_well_as_its_manifest_says(tmp_path):
    assert train("planner", tmp_path / "run") == 0
    run = Run.open(tmp_path / "run")
    tested = scene_set.build_scene_set("val", 200)
    episodes = follow(plan_scene_set(run.load_model("best").network, tested), tested)
    assert episodes.spl.mean() == run.manifest.models["best"].spl
    assert episodes.is_success.mean() == run.manifest.models["best"].success


def test_scenes_and_settings_of_the_command_line_reach_training(tmp_path, pools):
    words = split(
        "--env.num-scenes 10 --env.test-scenes 7 --env.test-split ood-clutter --agent.encoding margin --seed 3"
    )
    assert train("planner", tmp_path / "run", *words) == 0
    assert sorted(pools) == [("ood-clutter", 7), ("train", 10)]
    config = settings_of(Run.open(tmp_path / "run"))
    assert (config.env.num_scenes, config.env.test_scenes, config.seed, config.agent.encoding) == (
        10,
        7,
        3,
        "margin",
    )


def test_ctrl_c_ends_in_good_order_and_the_run_goes_on(tmp_path, monkeypatch):
    from train.generalisation import Generalisation

    test = Generalisation._test

    def interrupt(evaluation):
        test(evaluation)
        evaluation.is_interrupted = True

    with monkeypatch.context() as patch:
        patch.setattr(Generalisation, "_test", interrupt)
        assert train("planner", tmp_path / "run") == 130
    assert Run.open(tmp_path / "run").manifest.status == "interrupted"
    assert call(["planner", "--resume", tmp_path / "run", "--no-progress"]) == 0
    assert train("planner", tmp_path / "whole") == 0
    ours, theirs = (Run.open(tmp_path / name).manifest.models["last"] for name in ("run", "whole"))
    assert ours == theirs


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("planner --env.num-scenes 0", "num_scenes=0"),
        ("planner --env.split nowhere", "split='nowhere' must be one of"),
        ("planner --env.test-scenes 1001", "test_scenes=1001: there are 1000 in 'val'"),
        ("planner --agent.encoding all", "all"),
        ("planner --agent.batch-scenes 0", "batch_scenes=0"),
        ("planner_ppo --agent.gamma 2", "gamma=2.0"),
        ("unet_ppo --agent.weights nowhere.npz", "nowhere.npz"),
        ("vin --eval-every 0", "eval_every=0"),
    ],
)
def test_bad_settings_are_refused_before_any_file_is_written(capsys, tmp_path, words, message):
    assert call([*split(words), "--out", tmp_path / "run"]) == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert message in said
    assert "Traceback" not in said
    assert not (tmp_path / "run").exists()


def test_run_of_a_generalist_has_no_single_task(tmp_path):
    assert train("planner", tmp_path / "run") == 0
    with pytest.raises(RunError, match="learned on many scenes"):
        _ = Run.open(tmp_path / "run").task


@pytest.mark.parametrize("algorithm", generalists())
def test_settings_of_every_generalist_survive_the_run_folder(tmp_path, algorithm):
    config = parse(algorithm, [])
    assert config == defaults_of(algorithm)
    run = Run.create(tmp_path / "run", record_of(config))
    kept = settings_of(run)
    assert (kept.agent, kept.env, kept.seed, kept.eval_every) == (
        config.agent,
        config.env,
        config.seed,
        config.eval_every,
    )
