"""Facts of agents and reference policies where the robot goes anywhere on the floor."""

import json
from dataclasses import replace
from math import inf
from pathlib import Path
from shutil import copytree
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import torch
from evaluating import call as evaluate
from PIL import Image
from stable_baselines3 import PPO
from tiny import TINY, call, continuous_floor

from agents.networks.bounded_policy import Disc
from agents.policies.continuous_heuristics import CONTINUOUS_REFERENCES
from agents.registry import ALGORITHMS, drivers
from agents.rollout.episode import evaluation_env, roll_out, scene_task_of
from agents.runs.problem import problem_of
from agents.runs.run_folder import Run
from agents.vec_env import IrsNavVecEnv
from eval.commands import watch
from eval.scoreboard.continuous_scores import FINER, _replay
from irs_gym import RadioMap, shortest_path
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.envs.continuous_vector_nav import IrsNavContinuousVectorEnv
from train.config import defaults_of, parse
from train.plan import Plan, PlanError

ID = "irs_gym:IrsNavContinuous-v0"
SWEEPS = Path(__file__).resolve().parents[2] / "train" / "sweeps"
STEPS = ("--agent.total-timesteps", 128)


def play(name, **kwargs):
    env = gymnasium.make(ID, **kwargs)
    return roll_out(CONTINUOUS_REFERENCES[name](env, 0), env)


@pytest.mark.parametrize("target_db", [-60.0, -61.8, -62.5, -65.0])
@pytest.mark.parametrize("observation", ["dict", "flat"])
def test_the_oracles_polyline_is_as_long_as_the_optimum(target_db, observation):
    episode = play("oracle", target_db=target_db, observation=observation)
    assert episode.is_optimal
    assert episode.ratio == pytest.approx(1.0, abs=1e-12)
    assert episode.refused == 0
    assert episode.path.dtype == np.float64


@pytest.mark.parametrize("target_db", [-60.0, -61.8, -62.5])
def test_the_grids_path_from_centre_to_centre_is_longer_by_what_the_grid_costs(target_db):
    episode = play("grid_oracle", target_db=target_db)
    env = gymnasium.make(ID, target_db=target_db).unwrapped
    grid = shortest_path(env.world.feasible, env.world.start, env.world.goal, 0.5)
    assert episode.is_success
    assert episode.refused == 0
    assert episode.distance == pytest.approx(grid.distance - 0.25, abs=1e-9)
    assert episode.ratio > 1.02


def test_straight_to_the_goal_is_best_where_nothing_is_in_the_way_and_fails_at_a_wall():
    floor = RadioMap.from_array(np.zeros((9, 9)), 1.0)
    ends = {"start": (0.5, 0.5), "goal": (8.5, 6.5)}
    assert play("straight", radio_map=floor, target_db=-3.0, **ends).is_optimal
    assert not play("straight", target_db=-61.8).is_success


@pytest.mark.parametrize("name", ["oracle", "grid_oracle"])
def test_drawn_starts_lead_to_the_goal_at_no_less_than_the_optimum(name):
    env = gymnasium.make(ID, target_db=-61.8, random_start=True)
    policy = CONTINUOUS_REFERENCES[name](env, 0)
    for seed in range(8):
        episode = roll_out(policy, env, seed=seed)
        assert episode.is_success
        assert episode.ratio >= 1.0 - 1e-9
        assert name != "oracle" or episode.ratio <= 1.0 + 1e-9


def test_policies_act_for_all_robots_of_a_vector():
    envs = IrsNavContinuousVectorEnv(3, target_db=-61.8, random_start=True, infos="all")
    policy = CONTINUOUS_REFERENCES["oracle"](envs, 0)
    observation, _ = envs.reset(seed=0)
    state, ratios = None, []
    first, before = np.ones(3, bool), np.zeros(3, bool)
    for _ in range(70):
        action, state = policy.predict(observation, state, first, True)
        assert action.shape == (3, 2)
        observation, _, ended, _, info = envs.step(action)
        ratios += info["ratio"][ended].tolist()
        first, before = before, ended  # the step after an end begins anew, whatever is done
    assert len(ratios) >= 3
    assert ratios == pytest.approx([1.0] * len(ratios), abs=1e-9)


def test_sb3s_vector_moves_its_robots_by_headings():
    envs = IrsNavVecEnv(
        3, vector_env=IrsNavContinuousVectorEnv, target_db=-63.0, observation="flat"
    )
    observation = envs.reset()
    assert envs.spec.id == "IrsNavContinuous-v0"
    assert observation.shape == (3, *envs.observation_space.shape)
    headings = np.array([[1.0, 0.0], [0.6, 0.8], [0.0, 0.0]], dtype=np.float32)
    _, _, _, infos = envs.step(headings)
    assert [round(each["distance"], 6) for each in infos] == [0.5, 0.5, 0.0]


def test_a_problem_tells_how_the_robot_moves():
    task = ContinuousTask(target_db=-61.8, start=(-9.0, 0.25))
    problem = problem_of(task)
    assert (problem.field, problem.speed, problem.goal_radius) == ("cells", 1.0, 0.25)
    assert problem.label == "-61.8 dB, continuous, start (-9.0, 0.25), anywhere, field cells"
    assert problem != problem_of(ContinuousTask(target_db=-61.8, speed=0.5))
    assert problem_of(ContinuousTask(target_db=-61.8)) != problem_of(task.one_scene())
    assert problem_of(scene_task_of({"field": "cells", "target_db": -61.8})).start is None


def test_tests_begin_at_the_fixed_start_and_many_scenes_are_refused():
    env = evaluation_env(ContinuousTask(target_db=-61.8, random_start=0.7))
    assert env.spec.id == "IrsNavContinuous-v0"
    assert {env.reset(seed=n)[1]["x"] for n in range(5)} == {-9.75}
    with pytest.raises(ValueError, match="this agent learns in one scene"):
        scene_task_of({"field": "cells", "split": "train"})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for algorithm in drivers():
        for seed in range(2):
            out = folder / algorithm / f"seed{seed}"
            words = [*TINY[algorithm], *STEPS, *continuous_floor(folder), "--seed", seed]
            assert call([algorithm, "--out", out, *words]) == 0
    return folder


@pytest.mark.parametrize("algorithm", drivers())
def test_a_run_is_kept_and_its_policy_does_again_what_it_did(runs, algorithm):
    run = Run.open(runs / algorithm / "seed0")
    assert run.manifest.status == "finished"
    assert isinstance(run.task, ContinuousTask)
    policy = run.load_model("last")
    env = evaluation_env(run.task)
    observation, _ = env.reset()
    action = policy.predict(observation, deterministic=True)[0]
    assert env.action_space.contains(action)
    again = Run.open(runs / algorithm / "seed0").load_model("last")
    assert again.predict(observation, deterministic=True)[0].tolist() == action.tolist()
    held = {name.partition(".")[0] for name in policy.state_dict()}
    assert held if algorithm == "continuous_ppo" else "actor" in held


def test_scores_stand_beside_those_of_the_references(runs, monkeypatch):
    assert evaluate(monkeypatch, "score", runs / "continuous_ppo" / "seed0", "--episodes", 3) == 0
    scores = json.loads((runs / "continuous_ppo" / "seed0" / "scores.json").read_text())["scores"]
    assert [each["policy"] for each in scores] == [
        *("oracle", "continuous_ppo", "grid_oracle", "straight", "random")
    ]
    by_name = {each["policy"]: each for each in scores}
    assert by_name["oracle"]["ratio"] == by_name["straight"]["ratio"] == pytest.approx(1.0)
    assert by_name["grid_oracle"]["ratio"] > 1.0


def test_the_page_holds_every_algorithm_and_reference(runs, tmp_path, monkeypatch):
    assert evaluate(monkeypatch, "continuous", runs, "--out", tmp_path, "--episodes", 4) == 0
    board = json.loads((tmp_path / "continuous.json").read_text())
    (problem,) = board["problems"]
    assert [each["name"] for each in problem["policies"]] == [
        *(ALGORITHMS[name].title for name in drivers()),
        *("oracle", "grid oracle", "straight", "random"),
    ]
    assert problem["optimum"] == pytest.approx(np.hypot(4, 2) - 0.25)
    assert problem["grid_optimum"] == pytest.approx(2 + 2 * np.sqrt(2) - 0.25)
    learned = problem["policies"][0]
    for each, seed in zip(learned["distances"], learned["seeds"], strict=True):
        entry = Run.open(runs / "continuous_ppo" / f"seed{seed}").manifest.models["best"]
        found = None if each is None else each / problem["optimum"]
        assert found == (None if entry.ratio is None else pytest.approx(entry.ratio))
    page = (tmp_path / "continuous.md").read_text()
    assert "| *grid oracle* |" in page
    assert "replayed in steps of 0.25 and 0.125 s" in page
    assert evaluate(monkeypatch, "continuous", tmp_path) == 2


def test_steps_of_another_length_are_another_problem_with_the_same_optima(
    runs, tmp_path, monkeypatch
):
    words = [*TINY["sac"], *STEPS, *continuous_floor(tmp_path), "--env.time-step", 0.25]
    assert call(["sac", "--out", tmp_path / "runs" / "finer", *words]) == 0
    copytree(runs / "sac", tmp_path / "runs" / "sac")
    assert evaluate(monkeypatch, "continuous", tmp_path / "runs", "--out", tmp_path) == 0
    usual, finer = json.loads((tmp_path / "continuous.json").read_text())["problems"]
    assert finer["problem"] == f"{usual['problem']}, time step 0.25"
    assert (usual["time_step"], finer["time_step"]) == (0.5, 0.25)
    for name in ("optimum", "grid_optimum"):
        assert usual[name] == pytest.approx(finer[name], abs=1e-9)
    assert [len(each["policies"][0]["seeds"]) for each in (usual, finer)] == [2, 1]
    page = (tmp_path / "continuous.md").read_text()
    assert page.count("\n## ") == 3
    assert "A step takes 0.25 s: at full speed 0.25 m." in page


class East:
    """A policy that always goes to the east."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.array([1.0, 0.0]), state


def test_a_policy_is_replayed_in_parts_of_a_step_and_a_failure_is_infinite(runs):
    run = Run.open(runs / "td3" / "seed0")
    result = SimpleNamespace(
        run=SimpleNamespace(
            task=replace(run.task, start=(0.5, 2.5)), load_model=lambda name: East()
        )
    )
    for parts in FINER:
        assert _replay(result, parts) == pytest.approx(3.75)
    result.run.task = replace(run.task, start=(0.5, 0.5))
    assert [_replay(result, parts) for parts in FINER] == [inf, inf]


@pytest.mark.parametrize("algorithm", ["continuous_ppo", "sac"])
def test_a_run_is_shown_as_a_picture_and_as_text(runs, tmp_path, monkeypatch, capsys, algorithm):
    folder = runs / algorithm / "seed0"
    assert evaluate(monkeypatch, "animate", folder, "--out", tmp_path / "run.gif") == 0
    assert "the oracle needs 4.222 m" in capsys.readouterr().out
    with Image.open(tmp_path / "run.gif") as picture:
        assert picture.n_frames > 1
    assert evaluate(monkeypatch, "watch", folder) == 0
    assert "S start   G goal" in capsys.readouterr().out


def test_references_are_shown_in_a_window_and_as_a_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(watch.time, "sleep", lambda seconds: None)
    words = ["--continuous", "--target-db", -61.8, "--fps", 50]
    assert evaluate(monkeypatch, "watch", "oracle", "--human", *words) == 0
    assert "after 21.493 m; the oracle needs 21.493 m" in capsys.readouterr().out
    file = tmp_path / "grid.gif"
    assert evaluate(monkeypatch, "animate", "grid_oracle", "--out", file, *words) == 0
    assert "after 22.978 m, the oracle needs 21.493 m" in capsys.readouterr().out
    with Image.open(file) as picture:
        assert picture.n_frames > 45


def test_the_sweep_has_ten_seeds_of_each_algorithm_at_three_targets(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # where no runs are
    plan = Plan.load(SWEEPS / "continuous.toml")
    plan.check()
    configs = plan.configs()
    assert len(configs) == 3 * 3 * 10
    assert {each.env.target_db for each in configs} == {-61.8, -62.5, -60.0}
    assert {each.env.field for each in configs} == {"cells"}
    assert all(each.agent == defaults_of(each.agent.algorithm).agent for each in configs)


@pytest.mark.parametrize(
    ("algorithm", "setting", "message"),
    [
        ("continuous_ppo", "--agent.log-std-init nan", "log_std_init=nan must be"),
        ("continuous_ppo", "--agent.final-log-std -21", "final_log_std=-21.0 must be"),
        ("continuous_ppo", "--agent.log-std-init 3", "log_std_init=3.0 must be"),
        ("continuous_ppo", "--agent.ent-coef -0.1", "ent_coef=-0.1 must not be negative"),
        ("continuous_ppo", "--agent.final-ent-coef nan", "final_ent_coef=nan must not be"),
        ("continuous_ppo", "--agent.max-episode-steps 0", "max_episode_steps=0 must be"),
        ("continuous_ppo", "--agent.final-random-start 1.1", "final_random_start=1.1 must be"),
        ("continuous_ppo", "--agent.batch-size 1000", "batch_size=1000 must be 2 or more"),
        ("td3", "--agent.action-noise -0.1", "action_noise=-0.1 must not be negative"),
        ("td3", "--agent.target-policy-noise nan", "target_policy_noise=nan must not be"),
        ("td3", "--agent.target-noise-clip inf", "target_noise_clip=inf must not be"),
        ("td3", "--agent.tau 1.5", "tau=1.5 must be a number from 0 to 1"),
        ("sac", "--agent.target-entropy nan", "target_entropy=nan must be a finite number"),
        ("sac", "--agent.buffer-size 10", "buffer_size=10 must be at least n_envs"),
        ("sac", "--agent.learning-starts -1", "learning_starts=-1 must not be negative"),
        ("sac", "--agent.gradient-steps 0", "gradient_steps=0 must be"),
        ("ppo", "--agent.final-ent-coef -0.01", "final_ent_coef=-0.01 must not be negative"),
        ("ppo_lagrangian", "--agent.final-ent-coef 0.01", "final_ent_coef=0.01 must be None"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(capsys, tmp_path, algorithm, setting, message):
    assert call([algorithm, "--out", tmp_path / "run", *setting.split()]) == 2
    assert message in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert not (tmp_path / "run").exists()


def test_ppo_learns_to_go_round_a_wall_that_stops_who_goes_straight(tmp_path):
    gain_db = np.zeros((6, 5))
    gain_db[3, :2] = -9.0
    wall = RadioMap.from_array(gain_db, 1.0)
    wall.save(tmp_path / "wall.npz")
    ends = {"start": (0.5, 0.5), "goal": (5.5, 0.5)}
    assert not play("straight", radio_map=wall, target_db=-3.0, **ends).is_success
    words = (
        f"--env.radio-map {tmp_path / 'wall.npz'} --env.target-db -3 --env.start 0.5 0.5 "
        "--env.goal 5.5 0.5 --env.patch-radius 1 --env.random-start 0.8 --agent.n-envs 64 "
        "--agent.batch-size 256 --agent.net-arch 32 32 --agent.max-episode-steps 24 "
        "--agent.total-timesteps 45000 --eval-every 4096 --no-progress"
    )
    assert call(["continuous_ppo", "--out", tmp_path / "run", *words.split()]) == 0
    run = Run.open(tmp_path / "run")
    found = roll_out(run.load_model("best"), evaluation_env(run.task))
    assert found.is_success
    assert 1.0 < found.ratio < 1.25


@pytest.mark.parametrize(
    ("first", "last", "later"),
    [(0.9, 0.2, 0.2), (0.9, 0.95, 0.9), (0.3, 0.0, 0.0), (0.0, 0.1, 0.0)],
)
def test_ppo_draws_fewer_starts_in_the_second_half(tmp_path, monkeypatch, first, last, later):
    seen = []
    rollout = PPO.collect_rollouts

    def watched(self, env, *arguments, **kwargs):
        done = rollout(self, env, *arguments, **kwargs)
        seen.append(env.envs.random_start)
        return done

    monkeypatch.setattr(PPO, "collect_rollouts", watched)
    words = (
        f"--env.random-start {first} --agent.final-random-start {last} --agent.n-envs 4 "
        "--agent.n-steps 8 --agent.batch-size 32 --agent.total-timesteps 192 --no-progress"
    )
    assert call(["continuous_ppo", "--out", tmp_path / "run", *words.split()]) == 0
    assert seen == [first] * 3 + [later] * 3


def test_what_moves_over_a_grid_and_what_goes_anywhere_are_not_mixed_up(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(
        'out = "runs"\nseeds = 1\nalgorithms = ["sac"]\n'
        '[settings.a]\nenv = { codebook = ["cover", 4] }\n'
    )
    with pytest.raises(PlanError, match="unexpected keyword argument 'codebook'"):
        Plan.load(file).configs()
    assert parse("td3", ["--env.speed", "0.5"]).env.speed == 0.5


def test_means_beyond_the_disc_are_on_its_border_and_go_on_turning():
    disc = Disc(torch.nn.Identity())
    points = torch.tensor([[0.3, -0.4], [30.0, 40.0], [0.0, 0.0]], requires_grad=True)
    bounded = disc(points)
    assert bounded.flatten().tolist() == pytest.approx([0.3, -0.4, 0.6, 0.8, 0.0, 0.0])
    turned = (bounded[1] * torch.tensor([-0.8, 0.6])).sum()  # along the border
    turned.backward()
    assert points.grad[1].tolist() == pytest.approx([-0.8 / 50, 0.6 / 50])
