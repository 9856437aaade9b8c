"""Facts of resuming: a run killed at any moment goes on and ends as it would have; what is damaged
is never used.
"""

import os
import pickle
import subprocess
import sys
import time
from itertools import product
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny import TINY, call, curve, numbers, open_floor

from agents.registry import drivers, specialists
from agents.runs import run_folder
from agents.runs.run_folder import Run
from irs_gym.files import write_file
from train.evaluation import Evaluation

ROOT = Path(__file__).resolve().parents[2]
STEPS = ("--agent.total-timesteps", 640)


class Crash(BaseException):
    """The end of the process, as far as one process can play it."""


def train(algorithm: str, folder: Path, *words: object) -> int:
    return call([algorithm, "--out", folder, *TINY[algorithm], *STEPS, *words])


def resume(folder: Path) -> int:
    return call([Run.open(folder).config.algorithm, "--resume", folder, "--no-progress"])


def crash_after(monkeypatch, checkpoints: int) -> None:
    """Let the training crash once it has written so many checkpoints."""
    save, written = Run.save_checkpoint, []

    def save_and_crash(*arguments):
        save(*arguments)
        written.append(arguments)
        if len(written) == checkpoints:
            monkeypatch.setattr(Run, "save_checkpoint", save)
            raise Crash

    monkeypatch.setattr(Run, "save_checkpoint", save_and_crash)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Runs that were never interrupted, each trained once."""
    runs: dict[str, Run] = {}

    def run_of(algorithm: str) -> Run:
        if algorithm not in runs:
            folder = tmp_path_factory.mktemp("whole") / algorithm
            assert train(algorithm, folder) == 0
            runs[algorithm] = Run.open(folder)
        return runs[algorithm]

    return run_of


@pytest.fixture
def cut(tmp_path, monkeypatch, whole) -> Run:
    """A run of Q-learning that crashed with two checkpoints, after 192 and 288 steps."""
    whole("q_learning")
    crash_after(monkeypatch, 3)
    with pytest.raises(Crash):
        train("q_learning", tmp_path / "cut")
    return Run.open(tmp_path / "cut")


def assert_equal(run: Run, other: Run) -> None:
    """Same learning curve, same models, same results, and nothing left over."""
    assert curve(run.folder) == curve(other.folder)
    for name in ("best", "last"):
        assert all(map(np.array_equal, numbers(run, name), numbers(other, name)))
        assert (
            run.manifest.models[name] == other.manifest.models[name]
        )  # equal weights give equal bytes
    assert run.manifest.status == other.manifest.status
    files, others = ({path.name for path in each.folder.iterdir()} for each in (run, other))
    assert files == others


@pytest.mark.parametrize("algorithm", [*specialists(), *drivers()])
def test_resumed_run_equals_one_that_was_never_interrupted(tmp_path, monkeypatch, whole, algorithm):
    reference = whole(algorithm)
    crash_after(monkeypatch, 2)
    with pytest.raises(Crash):
        train(algorithm, tmp_path / "cut")
    run = Run.open(tmp_path / "cut")
    assert run.manifest.status == "running"
    expected = [256, 128] if "ppo" in algorithm else [192, 96]  # a rollout of PPO is of 64 steps
    assert [each.steps for each in run.manifest.checkpoints] == expected
    np.random.default_rng().random()
    assert resume(run.folder) == 0
    assert_equal(run, reference)


def test_run_that_crashes_at_any_write_goes_on_and_ends_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(
        os, "fsync", lambda _: None
    )  # slow, and only for crashes of the whole machine
    words = ("q_learning", tmp_path / "whole", "--agent.total-timesteps", 256)
    writes: list[Path] = []

    def crash_at(number: int, *, is_written: bool) -> None:
        def write(path: Path, content: bytes) -> None:
            writes.append(path)
            is_now = len(writes) - 1 == number
            if is_now and not is_written:
                path.with_name(f".{path.name}.{os.getpid()}").write_bytes(
                    content[: len(content) // 2]
                )
            else:
                write_file(path, content)
            if is_now:
                raise Crash

        writes.clear()
        monkeypatch.setattr(run_folder, "write_file", write)

    crash_at(-1, is_written=False)
    assert train(*words) == 0
    reference, total = Run.open(tmp_path / "whole"), len(writes)
    assert total > 20
    for number, is_written in product(range(total), (False, True)):
        folder = tmp_path / f"{number}{is_written}"
        crash_at(number, is_written=is_written)
        with pytest.raises(Crash):
            train("q_learning", folder, *words[2:])
        monkeypatch.setattr(run_folder, "write_file", write_file)
        if not folder.exists():
            assert train("q_learning", folder, *words[2:]) == 0
        elif Run.open(folder).manifest.status == "running":
            assert resume(folder) == 0
        else:
            assert (number, is_written) == (total - 1, True)
            continue  # it has ended; only a checkpoint is left over
        assert_equal(Run.open(folder), reference)


def test_run_killed_again_and_again_loses_at_most_an_interval_and_ends_the_same(tmp_path, whole):
    words = [
        *TINY["ppo"],
        "--agent.total-timesteps",
        "6400",
        "--checkpoint-every",
        "640",
        *open_floor(tmp_path),
    ]
    words += ["--no-stop-at-optimum"]
    assert call(["ppo", "--out", tmp_path / "whole", *words]) == 0
    folder, steps = tmp_path / "killed", 0
    command = ["--out", str(folder), *words]
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-m", "train", "ppo", *command], cwd=ROOT, stdout=subprocess.DEVNULL
        )
        steps = wait_for_checkpoint(process, folder, steps)
        process.kill()
        process.wait()
        command = ["--resume", str(folder), "--no-progress"]
    assert resume(folder) == 0
    assert_equal(Run.open(folder), Run.open(tmp_path / "whole"))


def wait_for_checkpoint(process: subprocess.Popen, folder: Path, steps: int) -> int:
    """Steps of the first checkpoint that the process writes beyond so many."""
    deadline = time.monotonic() + 120
    while True:
        assert process.poll() is None
        assert time.monotonic() < deadline
        found = (
            [each.steps for each in Run.open(folder).manifest.checkpoints]
            if folder.exists()
            else []
        )
        if max(found, default=0) > steps:
            return max(found)
        time.sleep(0.01)


def test_run_ended_by_ctrl_c_goes_on_where_it_ended(tmp_path, monkeypatch, whole):
    reference = whole("q_learning")
    test = Evaluation._test

    def interrupt(evaluation):
        test(evaluation)
        evaluation.is_interrupted |= evaluation.num_timesteps == 256

    monkeypatch.setattr(Evaluation, "_test", interrupt)
    assert train("q_learning", tmp_path / "run") == 130
    run = Run.open(tmp_path / "run")
    assert (run.manifest.status, run.manifest.checkpoints[0].steps) == ("interrupted", 256)
    monkeypatch.setattr(Evaluation, "_test", test)
    assert resume(run.folder) == 0
    assert_equal(run, reference)


def test_checkpoint_cut_in_half_is_refused_and_the_one_before_it_used(capsys, cut, whole):
    newest, older = (cut.folder / each.file for each in cut.manifest.checkpoints)
    newest.write_bytes(newest.read_bytes()[: newest.stat().st_size // 2])
    assert resume(cut.folder) == 0
    assert f"{newest.name}' is not loaded: its SHA-256 is" in capsys.readouterr().err
    assert older.name == "checkpoint-192.pickle"
    assert_equal(cut, whole("q_learning"))


def test_missing_checkpoint_is_told_and_the_one_before_it_used(capsys, cut, whole):
    (cut.folder / cut.manifest.checkpoints[0].file).unlink()
    assert resume(cut.folder) == 0
    assert (
        "checkpoint-288.pickle', which the manifest lists, cannot be read"
        in capsys.readouterr().err
    )
    assert_equal(cut, whole("q_learning"))


def test_run_without_a_whole_checkpoint_is_refused_and_left_as_it_is(capsys, cut):
    for entry in cut.manifest.checkpoints:
        (cut.folder / entry.file).write_bytes(b"")
    before = (cut.folder / "manifest.json").read_bytes()
    assert resume(cut.folder) == 2
    assert "holds no whole checkpoint: train anew with --overwrite" in capsys.readouterr().err
    assert (cut.folder / "manifest.json").read_bytes() == before


class Malice:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_exchanged_checkpoint_is_never_unpickled(cut, tmp_path):
    for entry in cut.manifest.checkpoints:
        (cut.folder / entry.file).write_bytes(pickle.dumps(Malice(tmp_path / "harm")))
    assert resume(cut.folder) == 2
    assert not (tmp_path / "harm").exists()
    pickle.loads(pickle.dumps(Malice(tmp_path / "harm")))
    assert (tmp_path / "harm").exists()


def test_run_that_was_moved_can_be_resumed(tmp_path, cut, whole):
    copytree(cut.folder, tmp_path / "elsewhere")
    assert resume(tmp_path / "elsewhere") == 0
    assert_equal(Run.open(tmp_path / "elsewhere"), whole("q_learning"))


def test_own_map_is_not_needed_to_resume(tmp_path, monkeypatch):
    crash_after(monkeypatch, 1)
    with pytest.raises(Crash):
        train("q_learning", tmp_path / "run", *open_floor(tmp_path))
    (tmp_path / "floor.npz").unlink()
    assert resume(tmp_path / "run") == 0


def test_what_cannot_be_resumed_is_refused(capsys, cut, whole, monkeypatch):
    def refused(*words: object) -> str:
        assert call(words) == 2
        return capsys.readouterr().err

    ended = whole("q_learning").folder
    assert "has ended (finished): there is nothing to resume" in refused(
        "q_learning", "--resume", ended
    )
    assert "is a run of q_learning, not of ppo" in refused("ppo", "--resume", cut.folder)
    assert "give none beside it" in refused("q_learning", "--resume", cut.folder, "--seed", 3)
    assert "is not a run folder" in refused("q_learning", "--resume", cut.folder / "nowhere")
    with cut.locked():
        assert "is being trained by another process" in refused(
            "q_learning", "--resume", cut.folder
        )
    cut.update(versions={**cut.manifest.versions, "torch": "1.0"})
    assert "only with the packages that began it: torch 1.0, not " in refused(
        "q_learning", "--resume", cut.folder
    )


def test_seconds_go_on_from_those_of_the_checkpoint(cut):
    cut_rows = (cut.folder / "learning_curve.csv").read_text().splitlines()
    seconds = float(cut_rows[-1].split(",")[1])
    assert resume(cut.folder) == 0
    rows = (cut.folder / "learning_curve.csv").read_text().splitlines()[1:]
    times = [float(row.split(",")[1]) for row in rows]
    assert times == sorted(times)
    assert times[-1] > seconds


def test_tensorboard_shows_training_and_tests(tmp_path):
    assert train("ppo", tmp_path / "run", "--tensorboard") == 0
    events = EventAccumulator(str(tmp_path / "run/tensorboard")).Reload()
    tests = curve(tmp_path / "run")
    assert [(each.step, each.value) for each in events.Scalars("eval/spl")] == [
        (int(row["steps"]), pytest.approx(float(row["spl"]))) for row in tests
    ]
    assert {"eval/is_success", "time/fps", "train/loss"} <= set(events.Tags()["scalars"])
