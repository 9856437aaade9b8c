"""Facts of the algorithms: their settings reach the learner, each trains, is kept and scored, and
tables are exact.
"""

from dataclasses import asdict, replace
from io import BytesIO
from shlex import split

import gymnasium
import numpy as np
import pytest
import torch
from tiny import TINY, call, curve, open_floor

from agents.networks.sign_extractor import SignExtractor
from agents.policies.policy import takes_masks
from agents.registry import ALGORITHMS, learner_class, specialists
from agents.rollout.episode import arguments_of, evaluation_env, roll_out
from agents.runs.manifest import Config
from agents.runs.run_folder import Run
from agents.runs.weights import WeightsError, load, pack
from agents.single.model import build_model
from agents.single.q_learning import QLearning, QLearningConfig
from agents.vec_env import IrsNavVecEnv
from eval.commands.score import score_run
from irs_gym import RadioMap
from irs_gym.mdp.dynamics import tabulate
from irs_gym.mdp.task import Task, build_world
from train.config import defaults_of

NETWORKS = [algorithm for algorithm in specialists() if ALGORITHMS[algorithm].is_sb3]
SMALL = {
    "maskable_ppo": "--agent.n-envs 16 --agent.n-steps 32 --agent.batch-size 128 --eval-every 512",
    "dqn": "--agent.n-envs 8 --agent.learning-starts 256 --agent.batch-size 64 --agent.net-arch 32 "
    "--agent.total-timesteps 20000 --agent.exploration-fraction 0.1 --eval-every 512",
    "q_learning": "--agent.n-envs 8 --eval-every 512",
}
BUDGET = ("constraint", "budget", "on_exhausted")
SMALL["qr_dqn"] = SMALL["dqn"] + " --agent.n-quantiles 5"


def obstructed(algorithm: str = "ppo") -> Task:
    of_row = ALGORITHMS[algorithm].env
    gain_db = np.zeros((6, 5))
    gain_db[2, :4] = -np.inf
    floor = RadioMap.from_array(gain_db, 1.0)
    return Task(
        radio_map=floor,
        start=(0, 0),
        goal=(5, 0),
        observation="flat",
        patch_radius=0,
        random_start=True,
        **{name: of_row[name] for name in BUDGET if name in of_row},
    )


@pytest.mark.parametrize("algorithm", NETWORKS)
def test_every_setting_reaches_the_learner(algorithm):
    agent = replace(
        defaults_of(algorithm).agent,
        gamma=0.9,
        learning_rate=0.5,
        final_learning_rate=0.25,
        net_arch=(9, 7),
        signs=True,
    )
    model = build_model(
        agent, IrsNavVecEnv(agent.n_envs, **arguments_of(obstructed(algorithm))), seed=7
    )
    assert [model.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == [0.5, 0.375, 0.25]
    own = set(vars(agent)) - {
        "total_timesteps",
        "learning_rate",
        "final_learning_rate",
        "final_ent_coef",
        "signs",
        "mask_head",
        *agent.policy_settings,
        *agent.env_settings,
    }
    for name in own - {"clip_range", "train_freq"}:
        assert getattr(model, name) == getattr(agent, name), name
    if "clip_range" in own:
        assert model.clip_range(1.0) == agent.clip_range
    else:
        assert (model.train_freq.frequency, model.replay_buffer.buffer_size) == (
            agent.train_freq,
            agent.buffer_size // agent.n_envs,
        )
    assert tuple(model.policy_kwargs["net_arch"]) == agent.net_arch
    assert model.policy_kwargs["features_extractor_class"] is SignExtractor
    assert model.seed == 7


def test_only_the_masked_learner_takes_masks():
    assert [name for name in specialists() if takes_masks(learner_class(name))] == ["maskable_ppo"]


@pytest.mark.parametrize(
    ("algorithm", "setting", "message"),
    [
        ("dqn", "--agent.gradient-steps 0", "gradient_steps=0"),
        ("dqn", "--agent.mask-head", "mask_head=True needs observation='masked'"),
        ("maskable_ppo", "--agent.mask-head", "mask_head=True is for ppo and dqn"),
        ("dqn", "--agent.exploration-final-eps 1.5", "exploration_final_eps=1.5"),
        ("dqn", "--agent.learning-starts -1", "learning_starts=-1"),
        ("dqn", "--agent.max-episode-steps 0", "max_episode_steps=0 must be"),
        ("ppo", "--agent.max-episode-steps 0", "max_episode_steps=0 must be"),
        (
            "dqn",
            "--agent.n-steps 3 --env.observation dict",
            "n_steps=3 needs observation='flat' or 'map'",
        ),
        ("dqn", "--agent.buffer-size 10", "buffer_size=10 must be at least"),
        ("dqn", "--agent.final-learning-rate 0", "final_learning_rate=0"),
        ("qr_dqn", "--agent.n-quantiles 0", "n_quantiles=0"),
        ("maskable_ppo", "--agent.batch-size 1000", "batch_size=1000"),
        ("q_learning", "--agent.learning-rate 1.5", "learning_rate=1.5"),
        ("q_learning", "--agent.n-envs 0", "n_envs=0"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(capsys, tmp_path, algorithm, setting, message):
    assert call([algorithm, "--out", tmp_path / "run", *split(setting)]) == 2
    assert message in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("algorithm", specialists())
def test_each_algorithm_trains_into_a_run_that_can_be_scored(tmp_path, algorithm):
    assert (
        call(
            [algorithm, "--out", tmp_path / "run", *TINY[algorithm], "--agent.total-timesteps", 256]
        )
        == 0
    )
    run = Run.open(tmp_path / "run")
    assert (run.manifest.status, run.config.algorithm) == ("finished", algorithm)
    assert [int(row["steps"]) for row in curve(run.folder)] == [64, 128, 192, 256]
    assert score_run(run, "last", episodes=1, seed=0)[1].policy == algorithm


@pytest.mark.parametrize("algorithm", ["ppo", "dqn"])
def test_robots_are_set_elsewhere_as_soon_as_is_asked_in_training_alone(
    tmp_path, monkeypatch, algorithm
):
    made = []

    class Watched(IrsNavVecEnv):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            made.append(self.spec.max_episode_steps)

    monkeypatch.setattr("train.run.IrsNavVecEnv", Watched)
    words = [*TINY[algorithm], "--agent.total-timesteps", 64, "--agent.max-episode-steps", 3]
    assert call([algorithm, "--out", tmp_path / "run", *words]) == 0
    assert made == [3]
    assert evaluation_env(Run.open(tmp_path / "run").task).spec.max_episode_steps == 400


@pytest.mark.parametrize("algorithm", SMALL)
def test_optimum_of_an_open_floor_is_found(tmp_path, algorithm):
    words = [*split(SMALL[algorithm]), "--no-progress", *open_floor(tmp_path)]
    assert call([algorithm, "--out", tmp_path / "run", *words]) == 0
    run = Run.open(tmp_path / "run")
    assert run.manifest.status == "at_optimum"
    assert roll_out(run.load_model(), evaluation_env(run.task)).is_optimal


def test_masked_learner_never_makes_a_refused_move(tmp_path):
    words = [
        "--no-progress",
        "--agent.total-timesteps",
        4096,
        "--agent.n-envs",
        16,
        "--agent.ent-coef",
        1,
    ]
    assert call(["maskable_ppo", "--out", tmp_path, *words, "--eval-every", 1024]) == 0
    rows = curve(tmp_path)
    assert len(rows) == 4
    assert {row["refused"] for row in rows} == {"0"}


def test_table_converges_to_the_values_of_dynamic_programming():
    task, gamma = obstructed(), 0.9
    agent = QLearningConfig(
        total_timesteps=40_000, n_envs=16, gamma=gamma, exploration_final_eps=1.0
    )
    model = build_model(agent, IrsNavVecEnv(16, **arguments_of(task)), seed=1)
    model.learn(agent.total_timesteps, Nothing())

    world = build_world(task)
    rules = tabulate(world, world.goal).transition.reshape(-1, 8)
    values = np.zeros((len(rules), 8))
    for _ in range(300):
        values = (
            rules["reward"]
            + gamma * ~rules["is_terminated"] * values.max(axis=1)[rules["next_cell"]]
        )
    starts = tabulate(world, world.goal).starts
    np.testing.assert_allclose(
        model.table[starts], values[starts], atol=1e-5
    )  # rewards come as float32


class Nothing:
    """A callback that does nothing."""

    def __getattr__(self, name):
        return lambda *_: True


@pytest.mark.parametrize("observation", ["flat", "dict", "map"])
def test_table_reads_its_cell_from_every_kind_of_observation(observation):
    task = replace(obstructed(), observation=observation, random_start=False)
    env = gymnasium.make("irs_gym:IrsNav-v0", **arguments_of(task))
    model = QLearning(np.random.default_rng(0).random((30, 8)), (6, 5))
    seen, _ = env.reset(seed=0)
    cell = task.start
    for _ in range(30):
        action, _ = model.predict(seen, deterministic=True)
        assert action == model.table[cell[0] * 5 + cell[1]].argmax()
        seen, *_ = env.step(int(action))
        cell = env.unwrapped.path[-1]


def test_truncated_episode_is_no_end_to_a_table():
    task = replace(obstructed(), random_start=False)
    agent = QLearningConfig(
        n_envs=1, exploration_initial_eps=0.0, exploration_final_eps=0.0, gamma=1.0
    )
    model = build_model(agent, IrsNavVecEnv(1, max_episode_steps=1, **arguments_of(task)), seed=0)
    model.table[:] = 5.0
    model.learn(1, Nothing())
    assert model.table[0, 0] == pytest.approx(5.0)  # 1 m east, 1 m nearer: no reward, and 5 m ahead


def test_table_is_kept_without_pickles():
    task = obstructed()
    config = Config(algorithm="q_learning", seed=0, env={}, agent={}, training={})
    table = np.arange(240.0).reshape(30, 8)
    loaded = load(config, task, pack(config, QLearning(table, (6, 5))))
    assert (loaded.shape, loaded.table.tolist()) == ((6, 5), table.tolist())
    for bad, message in (
        (np.array([print], dtype=object), "would have to be unpickled"),
        (table[1:], "not one table of float64"),
    ):
        content = BytesIO()
        np.savez(content, table=bad)
        with pytest.raises(WeightsError, match=message):
            load(config, task, content.getvalue())


def choose(policy, observation: object, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a policy does deterministically, and what it draws with random numbers from one seed."""
    masks = {"action_masks": mask} if takes_masks(policy) else {}
    greedy, _ = policy.predict(observation, deterministic=True, **masks)
    torch.manual_seed(3)
    drawn, _ = policy.predict(observation, deterministic=False, **masks)
    return greedy, drawn


@pytest.mark.parametrize("observation", ["flat", "dict"])
@pytest.mark.parametrize("algorithm", specialists())
def test_loaded_policy_acts_as_the_model_that_was_saved(tmp_path, algorithm, observation):
    task = replace(obstructed(algorithm), observation=observation, patch_radius=1)
    agent = defaults_of(algorithm).agent
    env = IrsNavVecEnv(agent.n_envs, **arguments_of(task))
    model = build_model(agent, env, seed=5)
    if algorithm == "q_learning":
        model.table[:] = np.random.default_rng(0).random(model.table.shape)
    config = Config(
        algorithm=algorithm, seed=5, env=arguments_of(task), agent=asdict(agent), training={}
    )
    run = Run.create(tmp_path / "run", config)
    run.save_model("best", model, 0, is_success=False, ratio=None)
    loaded = Run.open(run.folder).load_model()
    assert takes_masks(loaded) == takes_masks(model) == (algorithm == "maskable_ppo")

    seen, rng = env.reset(), np.random.default_rng(0)
    for _ in range(10):
        mask = np.stack(env.env_method("action_masks"))
        (greedy, drawn), (same, redrawn) = choose(loaded, seen, mask), choose(model, seen, mask)
        np.testing.assert_array_equal(greedy, same)
        if "ppo" in algorithm:  # the others' random moves are for learning
            np.testing.assert_array_equal(drawn, redrawn)
            assert len(np.unique(drawn)) > 2
        seen, *_ = env.step(rng.integers(8, size=agent.n_envs))
