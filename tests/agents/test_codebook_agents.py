"""Facts of agents and reference policies where the robot switches the panel's configuration."""

from dataclasses import replace
from pathlib import Path
from shlex import split

import gymnasium
import numpy as np
import pytest
import torch
from tiny import call

from agents.networks.sign_extractor import SCALES, UNITS, SignExtractor
from agents.policies.codebook_heuristics import CODEBOOK_REFERENCES
from agents.rollout.episode import evaluation_env, roll_out, scene_task_of
from agents.runs.problem import problem_of
from agents.runs.run_folder import Run, RunError
from agents.single.model import policy_class, policy_kwargs
from agents.vec_env import IrsNavVecEnv
from eval.commands import score
from irs_gym import focused_codebook
from irs_gym.datasets.codebook_task import CodebookTask
from irs_gym.envs.codebook_vector_nav import IrsNavCodebookVectorEnv
from irs_gym.mdp.budget import scaled_amount
from train.config import parse, record_of
from train.plan import Plan, PlanError

ID = "irs_gym:IrsNavCodebook-v0"
SWEEPS = Path(__file__).resolve().parents[2] / "train" / "sweeps"
FEW = focused_codebook("paper", [(12, 19), (22, 15), (31, 22), (4, 20), (36, 22), (20, 35)])


def make(**kwargs):
    return gymnasium.make(ID, **{"codebook": FEW, "target_db": -61.5, **kwargs})


def played(name, **kwargs):
    env = make(**kwargs)
    return roll_out(CODEBOOK_REFERENCES[name](env, 0), env)


@pytest.mark.parametrize("switch_cost", [0.0, 0.5, 4.0])
@pytest.mark.parametrize("observation", ["dict", "flat", "masked"])
def test_the_oracle_policy_pays_what_the_joint_oracle_pays(switch_cost, observation):
    env = make(switch_cost=switch_cost, observation=observation)
    episode = roll_out(CODEBOOK_REFERENCES["oracle"](env, 0), env)
    assert episode.is_optimal
    assert episode.refused == 0
    assert episode.distance == pytest.approx(env.unwrapped.oracle.distance, abs=1e-9)
    assert len(episode.switch_cells) == env.unwrapped.oracle.switches


def test_greedy_on_the_gain_walks_the_shortest_path_of_free_switches():
    episode = played("greedy_gain", switch_cost=0.25)
    free = make(switch_cost=0.0).unwrapped
    metres = episode.distance - 0.25 * len(episode.switch_cells)
    assert episode.is_success
    assert metres == pytest.approx(free.oracle.distance, abs=1e-9)
    assert episode.distance >= make(switch_cost=0.25).unwrapped.oracle.distance - 1e-9


def test_who_never_switches_stays_in_the_first_configuration():
    lost = played("never_switch")
    assert not lost.is_success
    assert not len(lost.switch_cells)
    found = played("never_switch", target_db=-63.5)
    assert found.is_success
    assert not len(found.switch_cells)


@pytest.mark.parametrize("collision", ["centre", "body"])
def test_references_know_what_the_body_of_a_robot_can_do(collision):
    robot = {"corner_cutting": False, "robot_radius": 0.2, "collision": collision}
    ends = {"start": (1, 20), "goal": (38, 20)}
    env = make(**robot, **ends)
    episode = roll_out(CODEBOOK_REFERENCES["oracle"](env, 0), env)
    assert episode.is_optimal
    assert episode.distance > make(**ends).unwrapped.oracle.distance

    greedy = played("greedy_gain", switch_cost=0.25, **robot, **ends)
    free = make(switch_cost=0.0, **robot, **ends).unwrapped
    assert greedy.is_success
    assert greedy.refused == 0
    metres = greedy.distance - 0.25 * len(greedy.switch_cells)
    assert metres == pytest.approx(free.oracle.distance, abs=1e-9)

    alone = played("never_switch", target_db=-63.5, **robot, **ends)
    assert alone.is_success
    assert alone.refused == 0


def test_problems_tell_robots_apart_and_old_ones_are_the_papers():
    old = {"codebook": ["dft", 4], "switch_cost": 0.5, "target_db": -65.0}  # of a run folder
    usual = problem_of(scene_task_of(old))
    assert usual == problem_of(CodebookTask(codebook=("dft", 4), target_db=-65.0))
    assert usual.label == "-65.0 dB, continuous, codebook dft 4, 0.5 m a switch"
    robots = [{"corner_cutting": False}, {"robot_radius": 0.2}, {"collision": "body"}]
    labels = {problem_of(scene_task_of({**old, **robot})).label for robot in robots}
    assert len({usual.label, *labels}) == 4


def test_masked_random_is_never_refused_and_takes_every_open_action():
    env = make()
    policy = CODEBOOK_REFERENCES["masked_random"](env, 0)
    observation, info = env.reset()
    taken = set()
    for _ in range(300):
        action = int(policy.predict(observation)[0])
        assert info["action_mask"][action]
        taken.add(action)
        observation, *_, info = env.step(action)
        observation, info = env.reset() if info["is_success"] else (observation, info)
    assert len(taken) > 8


def test_policies_act_for_all_robots_of_a_vector():
    envs = gymnasium.make_vec(ID, num_envs=3, codebook=FEW, target_db=-61.5, random_start=True)
    policy = CODEBOOK_REFERENCES["oracle"](envs, 0)
    observations, infos = envs.reset(seed=0)
    oracle = infos["oracle_distance"].copy()
    arrived = np.zeros(3)
    for _ in range(80):
        observations, _, terminated, _, infos = envs.step(policy.predict(observations)[0])
        arrived[(arrived == 0) & terminated] = infos["spl"][(arrived == 0) & terminated]
    np.testing.assert_allclose(arrived, 1.0)
    assert (oracle > 0).all()


def test_the_vec_env_of_stable_baselines3_tells_masks_and_ends():
    env = IrsNavVecEnv(
        3, 30, vector_env=IrsNavCodebookVectorEnv, codebook=FEW, target_db=-61.5, observation="flat"
    )
    env.seed(0)
    observation = env.reset()
    assert observation.shape == (3, 2 * 6 + 121 + 3 + 4)
    assert np.stack(env.env_method("action_masks")).shape == (3, 14)
    assert env.get_attr("spec")[0].id == "IrsNavCodebook-v0"
    for _ in range(30):
        *_, done, infos = env.step(np.full(3, 13))
    assert done.all()
    assert infos[0]["TimeLimit.truncated"]
    assert infos[0]["terminal_observation"].shape == (140,)


def test_with_a_codebook_the_command_line_is_that_of_its_environment(tmp_path):
    config = parse("ppo", split("--env.codebook dft 8 --env.switch-cost 0.3 --env.target-db -63"))
    assert config.env.codebook == ("dft", 8)
    assert (config.env.switch_cost, config.env.random_start) == (0.3, 0.9)
    tuned = (config.env.observation, config.agent.total_timesteps)
    assert tuned == ("masked", 1_500_000)  # for it
    assert config.agent.signs
    FEW.save(tmp_path / "few.npz")
    wide = parse("ppo", split("--env.codebook dft 8 --env.robot-radius 0.2 --env.collision body"))
    assert (wide.env.robot_radius, record_of(wide).env["collision"]) == (0.2, "body")
    named = parse("dqn", split(f"--env.codebook {tmp_path / 'few.npz'}"))
    assert named.env.codebook == str(tmp_path / "few.npz")
    assert record_of(config).env["target_db"] == -63.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--env.codebook dft", "give a design and a size"),
        ("--env.codebook dft 0", "codebook=('dft', 0) must be"),
        ("--env.codebook dft 4 --env.switch-cost -1", "switch_cost=-1.0 must be"),
        ("--env.codebook dft 4 --env.split val", "split and scenes cannot be given here"),
        ("--env.codebook dft 4", "highest joint target"),
        ("--env.codebook nowhere.npz", "nowhere.npz"),
    ],
)
def test_bad_settings_are_refused_before_any_file_is_written(capsys, tmp_path, words, message):
    assert call(["q_learning", "--out", tmp_path / "run", *split(words)]) == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert message in said
    assert not (tmp_path / "run").exists()


def test_q_learning_finds_the_joint_optimum_and_is_scored_beside_the_references(tmp_path, capsys):
    FEW.save(tmp_path / "few.npz")
    folder = tmp_path / "run"
    words = f"--env.codebook {tmp_path / 'few.npz'} --env.target-db -61.5"
    words += " --env.start 20 15 --no-progress"
    assert call(["q_learning", "--out", folder, *split(words)]) == 0
    (tmp_path / "few.npz").unlink()  # the run has a copy

    run = Run.open(folder)
    assert run.manifest.status == "at_optimum"
    assert isinstance(run.task, CodebookTask)
    table = run.load_model().table
    assert table.shape == (6 * 1600, 14)
    episode = roll_out(run.load_model(), evaluation_env(run.task))
    assert episode.is_optimal
    assert len(episode.switch_cells) > 0
    place = "-61.5 dB, continuous, start (20, 15), codebook 6-"
    assert problem_of(run.task).label.startswith(place)

    assert score.main((str(folder),), episodes=2) == 0
    said = capsys.readouterr().out
    for name in ("oracle", "q learning", "never switch", "greedy gain"):
        assert name in said
    assert (folder / "paths.png").stat().st_size > 10_000

    # a codebook that is not the run's own is not read
    FEW.save(folder / "codebook.npz")
    content = (folder / "codebook.npz").read_bytes()
    (folder / "codebook.npz").write_bytes(content[:-1] + b"x")
    with pytest.raises(RunError, match="SHA-256"):
        _ = Run.open(folder).task


@pytest.mark.parametrize("algorithm", ["ppo", "dqn"])
@pytest.mark.parametrize("signs", [False, True])
def test_one_weight_times_the_mask_is_added_to_the_scores_of_actions(algorithm, signs):
    env = evaluation_env(parse(algorithm, split("--env.codebook focused 6")).env)
    agent = replace(parse(algorithm, split("--env.codebook focused 6")).agent, signs=signs)
    make_policy = policy_class(agent, env.observation_space)
    policy = make_policy(
        env.observation_space, env.action_space, lambda _: 0.0, **policy_kwargs(agent)
    )
    seen, info = env.reset()
    observation, _ = policy.obs_to_tensor(seen)

    def scores():
        with torch.no_grad():
            if algorithm == "dqn":
                return policy.q_net(observation)[0].numpy()
            return policy.get_distribution(observation).distribution.logits[0].numpy()

    [name] = [
        each
        for each in policy.state_dict()
        if each.endswith("weight") and "target" not in each and not policy.state_dict()[each].shape
    ]
    before = scores()
    policy.state_dict()[name].fill_(0.7)
    more = scores() - before
    refused = ~info["action_mask"].astype(bool)
    assert refused.any()
    assert not refused.all()
    np.testing.assert_allclose(np.ptp(more[refused]), 0, atol=1e-4)
    np.testing.assert_allclose(more[~refused] - more[refused][0], 7.0, atol=1e-4)


def test_a_network_without_a_mask_has_no_weight_for_it():
    env = make(observation="flat")
    agent = parse("ppo", split("--env.codebook focused 6")).agent
    with pytest.raises(ValueError, match="mask_head=True needs observation='masked'"):
        policy_class(agent, env.observation_space)(
            env.observation_space, env.action_space, lambda _: 0.0, **policy_kwargs(agent)
        )


@pytest.mark.parametrize("algorithm", ["ppo", "maskable_ppo", "dqn"])
def test_networks_of_a_run_come_back_with_as_many_actions(tmp_path, algorithm):
    words = "--env.codebook focused 6 --env.target-db -63.5 --no-progress --agent.n-envs 4"
    short = {"dqn": "--agent.total-timesteps 2100 --agent.buffer-size 5000"}.get(
        algorithm, "--agent.total-timesteps 256 --agent.n-steps 32 --agent.batch-size 64"
    )
    folder = tmp_path / "run"
    assert call([algorithm, "--out", folder, *split(words), *split(short)]) == 0
    run = Run.open(folder)
    env = evaluation_env(run.task)
    observation, info = env.reset()
    mask = {"action_masks": info["action_mask"]} if algorithm == "maskable_ppo" else {}
    actions = {int(run.load_model("last").predict(observation, **mask)[0]) for _ in range(3)}
    assert actions <= set(range(14))


def test_a_plan_with_a_codebook_trains_in_its_environment(tmp_path):
    file = tmp_path / "plan.toml"
    text = 'out = "runs"\nseeds = 2\nalgorithms = ["ppo", "q_learning"]\n[settings]\n'
    file.write_text(
        text + 'a.env = { codebook = ["dft", 4], switch_cost = 0.5, target_db = -65.0 }'
    )
    plan = Plan.load(file)
    configs = plan.configs()
    assert len(configs) == 4
    assert {config.env.codebook for config in configs} == {("dft", 4)}
    file.write_text(text + 'a.env = { codebook = ["dft", 4], split = "val" }')
    with pytest.raises(PlanError, match="split and scenes"):
        Plan.load(file).configs()


def test_the_sweep_of_the_page_is_a_plan():
    plan = Plan.load(SWEEPS / "codebook.toml")
    assert {config.env.codebook[1] for config in plan.configs()} == {4, 8, 16}
    assert {config.env.target_db for config in plan.configs()} == {-61.8, -60.0}


@pytest.mark.parametrize("observation", ["flat", "masked", "dict"])
def test_signs_tell_which_cells_and_configurations_meet_the_target(observation):
    env = make(observation=observation, patch_radius=2)
    seen, info = env.reset()
    extractor = SignExtractor(env.observation_space)
    batch = (
        {key: torch.as_tensor(each)[None].float() for key, each in seen.items()}
        if isinstance(seen, dict)
        else torch.from_numpy(seen)[None]
    )
    features = extractor(batch)[0].numpy()
    assert features.shape == (extractor.features_dim,)

    flat = make(observation="flat", patch_radius=2)
    plain, _ = flat.reset()
    mask = info["action_mask"] if observation == "masked" else []
    want = [mask, plain, plain >= 0, *(np.clip(plain[-2:] * scale, -1, 1) for scale in SCALES)]
    np.testing.assert_allclose(features, np.concatenate(want), rtol=1e-6)

    # of the gains, those are at least 0 whose configurations may be switched to, or are there
    gains = len(mask) + len(plain) + 6 + 25 + np.arange(6)
    may = info["action_mask"][8:].astype(bool)
    may[info["configuration"]] = True
    np.testing.assert_array_equal(features[gains].astype(bool), may)


@pytest.mark.parametrize("left", [0.0, 0.25, 1.0, 2.5, 13.0, 26.0, 500.0, -3.0])
def test_each_unit_of_a_budget_is_told_by_itself(left):
    task = {"target_db": -61.8, "constraint": "budget", "budget": 40.0}
    env = gymnasium.make("irs_gym:IrsNav-v0", observation="dict", **task)
    seen, _ = env.reset()
    extractor = SignExtractor(env.observation_space)
    seen["budget"][:] = scaled_amount(left)
    batch = {key: torch.as_tensor(each)[None] for key, each in seen.items()}
    features = extractor(batch)[0].numpy()
    assert features.shape == (extractor.features_dim,)
    want = [min(max(left - unit, 0.0), 1.0) for unit in range(UNITS)]
    np.testing.assert_allclose(features[-UNITS:], want, atol=1e-3)


def test_signs_are_of_what_is_seen_around_the_robot_alone():
    with pytest.raises(ValueError, match="needs observation='flat', 'dict' or 'masked'"):
        SignExtractor(make(observation="cell").observation_space)
