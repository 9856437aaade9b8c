"""Facts of scoring: the oracle scores one, failures count as failures, and a run is scored as it
was trained.
"""

import json
from dataclasses import asdict, dataclass
from io import BytesIO, StringIO

import numpy as np
import pytest
from evaluating import call
from PIL import Image
from rich.console import Console

from agents.policies.heuristics import REFERENCE_POLICIES, greedy, oracle
from agents.rollout.episode import EpisodeResult, arguments_of, evaluation_env, roll_out
from agents.runs.manifest import Config
from agents.runs.run_folder import Run
from agents.single.model import build_model
from agents.single.ppo import PpoConfig
from agents.vec_env import IrsNavVecEnv
from eval.commands.score import table
from eval.scoreboard.overlay import draw_path_overlay
from eval.scoreboard.score import play_references, score
from irs_gym import RadioMap
from irs_gym.mdp.task import Task

TASK = Task(observation="flat", patch_radius=1, irs_phases=False, random_start=0.7)
TINY = PpoConfig(n_envs=2, n_steps=4, batch_size=8, net_arch=(4,))


@pytest.fixture
def run(tmp_path) -> Run:
    """A run whose agent has learned nothing."""
    config = Config(
        algorithm="ppo", seed=0, env=arguments_of(TASK), agent=asdict(TINY), training={}
    )
    run = Run.create(tmp_path / "run", config)
    run.save_model("best", untrained(), 0, is_success=False, ratio=None)
    return run


def untrained():
    return build_model(TINY, IrsNavVecEnv(TINY.n_envs, **arguments_of(TASK)), 0)


def episode(*, is_success: bool, distance: float, refused: int = 0) -> EpisodeResult:
    spl = 10.0 / distance if is_success else 0.0
    progress = 1.0 if is_success else 0.25
    return EpisodeResult(
        is_success,
        distance,
        10.0,
        spl,
        progress,
        refused,
        20,
        0.0,
        np.zeros((1, 2), dtype=np.int64),
    )


@pytest.mark.parametrize("target_db", [-63.0, -61.8, -60.0])
def test_oracle_policy_scores_one(target_db):
    env = evaluation_env(Task(target_db=target_db))
    result = score("oracle", [roll_out(oracle(env), env)])
    assert (result.success, result.refused) == (1.0, 0.0)
    assert (result.ratio, result.spl) == pytest.approx((1.0, 1.0), abs=1e-12)
    assert result.distance == pytest.approx(env.unwrapped.oracle.distance, abs=1e-9)


def test_failures_count_as_failures_and_lend_no_distance():
    result = score(
        "some",
        [
            episode(is_success=True, distance=12.5, refused=1),
            episode(is_success=False, distance=3.0),
        ],
    )
    assert (result.episodes, result.success, result.distance, result.ratio) == (2, 0.5, 12.5, 1.25)
    assert (result.spl, result.refused) == (0.4, 0.5)  # (10 / 12.5 + 0) / 2, and (1 + 0) / 2
    assert result.soft_spl == 0.525  # (10 / 12.5 + 0.25) / 2: a failure counts by its progress


@dataclass
class Script:
    """A policy that takes the moves of a list, the last one for ever."""

    moves: list[int]

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.array(self.moves.pop(0) if len(self.moves) > 1 else self.moves[0]), state


@pytest.mark.parametrize(
    ("moves", "progress", "soft_spl"),
    [
        ([0], 1.0, 1.0),  # straight to the goal, 4 m away
        ([2, 6, 0], 1.0, 4 / 6),  # there after 1 m north and 1 m south
        ([0, 0, 4, 0, 2], (4 - 1 - 2**0.5) / 4, (4 - 1 - 2**0.5) / 5),  # ends at (2, 1) after 5 m
        ([4], 0.0, 0.0),  # into the wall at once
        ([2], 0.0, 0.0),  # 1 m north: farther from the goal than at the start
    ],
)
def test_soft_spl_weighs_progress_by_the_way_taken(moves, progress, soft_spl):
    env = evaluation_env(
        Task(radio_map=RadioMap.from_array(np.zeros((5, 2)), 1.0), start=(0, 0), goal=(4, 0))
    )
    episode = roll_out(Script(moves), env)
    assert (episode.progress, episode.soft_spl) == pytest.approx((progress, soft_spl))


def test_progress_over_cells_below_the_target_is_none():
    gain_db = np.zeros((5, 2))
    gain_db[2, 0] = -100.0
    task = Task(
        radio_map=RadioMap.from_array(gain_db, 1.0), start=(0, 0), goal=(4, 0), constraint="allow"
    )
    episode = roll_out(Script([0]), evaluation_env(task))
    assert (episode.distance, episode.is_success, episode.spl, episode.soft_spl) == (
        4.0,
        False,
        0.0,
        0.0,
    )


def test_policy_that_never_arrives_has_no_ratio():
    result = score("some", [episode(is_success=False, distance=1.0)] * 3)
    assert (result.success, result.distance, result.ratio, result.spl) == (0.0, None, None, 0.0)


def test_random_policies_play_many_episodes_and_do_the_same_again():
    env = evaluation_env(Task(target_db=-64.0))
    played = [play_references(env, {}, episodes=3, seed=5) for _ in range(2)]
    assert {name: len(each) for name, each in played[0].items()} == {
        "oracle": 1,
        "replanning": 1,
        "greedy": 1,
        "greedy_margin": 1,
        "masked_random": 3,
        "random": 3,
    }
    assert [each.refused for each in played[0]["random"]] == [
        each.refused for each in played[1]["random"]
    ]
    assert len({each.refused for each in played[0]["random"]}) > 1


def test_run_is_scored_beside_all_references(monkeypatch, capsys, run):
    assert call(monkeypatch, "score", run.folder, "--episodes", 2) == 0
    record = json.loads((run.folder / "scores.json").read_text())
    rows = {row["policy"]: row for row in record["scores"]}
    assert list(rows) == [
        "oracle",
        "ppo",
        *(name for name in REFERENCE_POLICIES if name != "oracle"),
    ]
    assert rows["oracle"]["ratio"] == pytest.approx(1.0, abs=1e-12)
    assert (rows["ppo"]["success"], rows["ppo"]["ratio"]) == (0.0, None)
    env = evaluation_env(TASK)
    assert rows["greedy"]["success"] == roll_out(greedy(env), env).is_success
    assert record["oracle_distance"] == pytest.approx(env.unwrapped.oracle.distance, abs=1e-9)
    assert record["config"]["env"]["random_start"] == 0.7
    assert record["model"]["sha256"] == run.manifest.models["best"].sha256
    table = capsys.readouterr().out
    assert all(name.replace("_", " ") in table for name in rows)
    with Image.open(run.folder / "paths.png") as picture:
        assert picture.size == (1200, 990)


def test_table_of_a_terminal_of_80_columns_is_not_cut():
    failed = score("masked_random", [episode(is_success=False, distance=3.0, refused=33)] * 100)
    console = Console(width=80, file=StringIO())
    console.print(
        table([score("greedy_margin", [episode(is_success=True, distance=12.345)]), failed])
    )
    assert "12.345" in console.file.getvalue()
    assert "…" not in console.file.getvalue()


def test_several_runs_are_scored_in_one_call(monkeypatch, run, tmp_path):
    other = Run.create(tmp_path / "other", run.config)
    other.save_model("last", untrained(), 0, is_success=False, ratio=None)
    assert (
        call(monkeypatch, "score", run.folder, other.folder, "--episodes", 1) == 2
    )  # the other has no best model
    assert call(monkeypatch, "score", other.folder, "--model", "last", "--episodes", 1) == 0
    assert (run.folder / "scores.json").exists()
    assert (other.folder / "scores.json").exists()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda run: (run.folder / "best-0.npz").write_bytes(b"other"),
            "is not loaded: its SHA-256",
        ),
        (lambda run: (run.folder / "best-0.npz").unlink(), "cannot be read"),
        (lambda run: (run.folder / "config.json").write_text("{"), "config.json' is not loaded"),
        (lambda run: (run.folder / "manifest.json").unlink(), "not a run folder"),
    ],
)
def test_damaged_run_is_refused_in_one_line(monkeypatch, capsys, run, damage, message):
    damage(run)
    assert call(monkeypatch, "score", run.folder) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (run.folder / "scores.json").exists()


def test_folder_that_is_not_there_and_no_folder_are_refused(monkeypatch, capsys, tmp_path):
    assert call(monkeypatch, "score", tmp_path / "nowhere") == 2
    assert "nowhere' is not a run folder" in capsys.readouterr().err
    assert call(monkeypatch, "score") == 2
    assert call(monkeypatch, "scoer") == 2


def test_picture_shows_each_path_in_its_place():
    env = evaluation_env(Task(target_db=-62.5))
    world, best = env.unwrapped.world, roll_out(oracle(env), env)
    pictures = [
        np.asarray(Image.open(BytesIO(draw_path_overlay(world, paths))).convert("RGB")).astype(int)
        for paths in ({"oracle": best}, {"oracle": best, "PPO": best})
    ]
    is_orange = [(np.abs(each - (255, 127, 14)).sum(axis=2) < 30) for each in pictures]
    assert is_orange[0].sum() < 50
    columns = np.flatnonzero(is_orange[1][:800].any(axis=0))
    assert (
        np.ptp(columns) > 0.9 * 812
    )  # the path crosses the map from wall to wall, and the map is 812 px wide


def test_picture_of_a_map_from_elsewhere():
    gain_db = np.zeros((6, 3))
    gain_db[3, 1] = -np.inf
    env = evaluation_env(
        Task(radio_map=RadioMap.from_array(gain_db, 1.0), start=(0, 1), goal=(5, 1))
    )
    content = draw_path_overlay(env.unwrapped.world, {"oracle": roll_out(oracle(env), env)})
    assert Image.open(BytesIO(content)).format == "PNG"
