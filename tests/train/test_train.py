"""Facts of training: its command line, what it refuses, that it learns, and that it can be repeated
and interrupted.
"""

import errno
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from shlex import split

import pytest
from tiny import TINY, call, curve, open_floor

from agents.rollout.episode import evaluation_env, roll_out
from agents.runs import run_folder
from agents.runs.run_folder import Run
from irs_gym.files import write_file
from irs_gym.mdp.task import Task
from train import run as training
from train.config import defaults_of, parse, record_of

ROOT = Path(__file__).resolve().parents[2]


def test_every_argument_of_the_environment_is_on_the_command_line():
    given = {
        "scene": "some.json", "target_db": -60.5, "cell_size": 1.0, "irs_elements": 400, "phase_bits": 2,
        "quantiser": "optimal", "array_model": "coherent", "patch_radius": 3, "observation": "dict",
        "irs_phases": False, "constraint": "budget", "cost": "deficit", "budget": (1.5, 4.0),
        "on_exhausted": "continue", "corner_cutting": False, "robot_radius": 0.25, "collision": "body",
        "random_start": 0.25, "shaping": False, "goal_bonus": 3.5, "start": (1, 2), "goal": (3, 4),
    }  # fmt: skip
    words = []
    for name, value in given.items():
        option = f"--env.{'no-' if value is False else ''}{name.replace('_', '-')}"
        words += (
            [option]
            if value is False
            else [option, *map(str, value if isinstance(value, tuple) else [value])]
        )
    assert parse("ppo", words).env == Task(**given)
    own_map = split("--env.radio-map my.npz --env.start 0 0 --env.goal 1 1")
    assert parse("ppo", own_map).env.radio_map == "my.npz"
    assert {*given, "radio_map"} == {each.name for each in fields(Task)}


def test_command_line_without_words_gives_the_tuned_settings():
    assert parse("ppo", []) == defaults_of("ppo")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--env.target-db -50", "target_db=-50.0 is infeasible"),
        ("--env.phase-bits 0", "phase_bits=0"),
        ("--env.target-db nan", "target_db=nan"),
        ("--env.quantiser best", "best"),
        ("--env.scene nowhere.json", "nowhere.json"),
        ("--env.irs-elements 1201", "irs_elements=1201"),
        ("--env.start 20 20", "start=(20, 20) lies in an obstacle"),
        ("--agent.batch-size 1000", "batch_size=1000"),
        ("--agent.gamma 1.5", "gamma=1.5"),
        ("--agent.learning-rate nan", "learning_rate=nan"),
        ("--hold 0", "hold=0"),
        ("--agent.epochs 3", "--agent.epochs"),
    ],
)
def test_bad_settings_are_refused_before_any_file_is_written(capsys, tmp_path, words, message):
    assert call(["ppo", "--out", tmp_path / "run", *split(words)]) == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert message in said
    assert "Traceback" not in said
    assert not (tmp_path / "run").exists()


def test_unknown_algorithm_is_answered_with_the_known_ones(capsys):
    assert call(["pop"]) == 2
    assert "{ppo," in capsys.readouterr().out


def test_run_folder_in_use_is_refused_unless_it_may_be_replaced(capsys, tmp_path):
    words = ["ppo", "--out", tmp_path, *TINY["ppo"], "--agent.total-timesteps", 64]
    assert call(words) == 0
    manifest = (tmp_path / "manifest.json").read_bytes()
    assert call(words) == 2
    assert "holds a run" in capsys.readouterr().err
    assert (tmp_path / "manifest.json").read_bytes() == manifest
    assert call([*words, "--overwrite", "--seed", 1]) == 0
    assert Run.open(tmp_path).config.seed == 1


def test_same_seed_gives_the_same_learning_curve_and_another_seed_another(tmp_path):
    for name, seed in (("first", 3), ("again", 3), ("other", 4)):
        call(
            [
                "ppo",
                "--out",
                tmp_path / name,
                *TINY["ppo"],
                "--agent.total-timesteps",
                640,
                "--seed",
                seed,
            ]
        )
    first, again, other = (curve(tmp_path / name) for name in ("first", "again", "other"))
    assert [int(row["steps"]) for row in first] == list(range(64, 641, 64))
    assert first == again
    assert first != other


def test_ppo_finds_the_optimum_of_an_open_floor_and_stops_there(tmp_path):
    words = split(
        "--agent.n-envs 16 --agent.n-steps 32 --agent.batch-size 128 --eval-every 512 --no-progress"
    )
    assert call(["ppo", "--out", tmp_path / "run", *words, *open_floor(tmp_path)]) == 0
    run = Run.open(tmp_path / "run")
    assert run.manifest.status == "at_optimum"
    assert roll_out(run.load_model(), evaluation_env(run.task)).is_optimal
    rows = curve(run.folder)
    assert [float(row["ratio"]) for row in rows[-3:]] == pytest.approx([1.0] * 3)
    assert run.manifest.models["best"].steps <= int(rows[-3]["steps"])
    assert int(rows[-1]["steps"]) < run.config.agent["total_timesteps"] / 10


def test_best_model_is_that_of_the_shortest_tested_path(tmp_path):
    words = [
        *TINY["ppo"],
        "--no-stop-at-optimum",
        "--agent.total-timesteps",
        3200,
        "--agent.learning-rate",
        0.01,
    ]
    assert call(["ppo", "--out", tmp_path / "run", *words, *open_floor(tmp_path)]) == 0
    run = Run.open(tmp_path / "run")
    rows = [row for row in curve(run.folder) if row["is_success"] == "1"]
    shortest = min(rows, key=lambda row: float(row["distance"]))
    assert run.manifest.models["best"].steps == int(shortest["steps"])
    assert roll_out(run.load_model(), evaluation_env(run.task)).distance == float(
        shortest["distance"]
    )
    assert run.manifest.models["last"].steps == 3200
    assert run.manifest.status == "finished"


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for one process there")
def test_ctrl_c_saves_the_run_and_ends_without_a_traceback(tmp_path):
    command = [
        sys.executable,
        "-m",
        "train",
        "ppo",
        "--out",
        str(tmp_path / "run"),
        "--no-progress",
    ]
    process = subprocess.Popen(
        command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not (tmp_path / "run/learning_curve.csv").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "interrupted after" in out
    assert "Traceback" not in err
    run = Run.open(tmp_path / "run")
    assert run.manifest.status == "interrupted"
    assert run.manifest.models["last"].steps == int(curve(run.folder)[-1]["steps"])
    for name in ("best", "last"):
        run.load_model(name)


def test_two_trainings_that_begin_in_one_second_get_two_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = parse("q_learning", [])

    class Noon(datetime):
        @classmethod
        def now(cls, tz=None):
            return cls(2026, 11, 1, 12)

    monkeypatch.setattr(training, "datetime", Noon)
    with ExitStack() as locks:
        names = [training._lock_new(config, locks).folder.name for _ in range(2)]
        Run.create(tmp_path / "runs/q_learning-seed0-20261101-120000-3", record_of(config))
        names.append(training._lock_new(config, locks).folder.name)
    assert names == [f"q_learning-seed0-20261101-120000{suffix}" for suffix in ("", "-2", "-4")]


@pytest.mark.parametrize(
    "file", ["manifest.json", "learning_curve.csv", "checkpoint-96.pickle", "last-320.npz"]
)
def test_full_disk_ends_a_training_in_a_line_and_the_run_says_how_it_stands(
    capsys, tmp_path, monkeypatch, file
):
    written = []

    def write(path: Path, content: bytes) -> None:
        written.append(path.name)
        if path.name == file and written.count(file) == (3 if file == "manifest.json" else 1):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write_file(path, content)

    monkeypatch.setattr(run_folder, "write_file", write)
    words = [
        "q_learning",
        "--out",
        tmp_path / "run",
        *TINY["q_learning"],
        "--agent.total-timesteps",
        320,
    ]
    assert call(words) == 1
    said = capsys.readouterr().err
    assert (
        said
        == f"python -m train q_learning: [Errno 28] No space left on device: '{tmp_path / 'run' / file}'\n"
    )
    manifest = Run.open(tmp_path / "run").manifest
    assert (manifest.status, "No space left" in manifest.error) == ("failed", True)
    monkeypatch.setattr(run_folder, "write_file", write_file)
    assert call(["q_learning", "--resume", tmp_path / "run", "--no-progress"]) == 0
    assert Run.open(tmp_path / "run").manifest.status == "finished"


@pytest.mark.parametrize("place", ["file/run", "link", "locked"])
def test_place_where_no_run_can_be_is_refused_in_a_line(capsys, tmp_path, place):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".locked.lock").mkdir()
    words = ["q_learning", *TINY["q_learning"], "--agent.total-timesteps", 64]
    assert call([*words, "--out", tmp_path / place]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"python -m train q_learning: '{tmp_path / place}' ")
    assert said.count("\n") == 1
