"""Facts of interruption: Ctrl-C ends every command in one line, wherever it hits; a training keeps
what it has.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tiny import TINY, open_floor

from agents.runs.interruption import ALL, Interruption, interruptible, noticed
from agents.runs.run_folder import Run

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no signals for one process there")


# What makes a process send itself a Ctrl-C the moment a module is looked for, as if the user had.
AT_IMPORT = """
import os, runpy, signal, sys
sys.argv[:] = sys.argv[1:]
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            sys.argv.pop()
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("module", "words", "hit"),
    [
        ("train", ["ppo"], "numpy"),
        ("train", ["ppo"], "torch"),
        ("train", ["sweep", "any.toml"], "ray"),
        ("eval", ["score", "any"], "tyro"),
        ("eval", ["board", "any"], "torch.nn"),
        ("irs_gym.proof", [], "irs_gym.datasets.build_shards"),
    ],
)
def test_ctrl_c_during_imports_ends_in_one_line(module, words, hit):
    command = [sys.executable, "-c", AT_IMPORT, module, *words, hit]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert (done.returncode, done.stderr) == (130, f"python -m {module}: interrupted\n")
    assert done.stdout == ""


# A command that takes its time, and tells when it has begun.
AT_WORK = """
import runpy, sys, time
import eval.commands.score
def work(*_):
    print("begun", flush=True)
    time.sleep(60)
eval.commands.score.scene_sets_of = work
sys.argv[:] = ["eval", "score", "replanning"]
runpy.run_module("eval", run_name="__main__", alter_sys=True)
"""


def test_ctrl_c_ends_a_command_at_work_in_one_line():
    process = subprocess.Popen(
        [sys.executable, "-c", AT_WORK],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "python -m eval score: interrupted\n")


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_signal_lets_a_training_write_a_checkpoint_and_end(tmp_path, name):
    number = getattr(signal, name)
    words = [
        *TINY["q_learning"],
        "--no-stop-at-optimum",
        "--checkpoint-every",
        "1000000",
        *open_floor(tmp_path),
    ]
    command = [sys.executable, "-m", "train", "q_learning", "--out", tmp_path / "run", *words]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not (tmp_path / "run/learning_curve.csv").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (128 + number, "")
    assert "interrupted after" in out
    assert out.count("\n") == 1
    manifest = Run.open(tmp_path / "run").manifest
    assert manifest.status == "interrupted"
    assert 0 < manifest.checkpoints[0].steps <= manifest.models["last"].steps


def test_command_that_is_to_outlive_its_terminal_does():
    """As under nohup."""
    seen = []
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with noticed(seen.append):
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert seen == []


@pytest.mark.parametrize("number", ALL)
def test_first_signal_is_told_and_the_second_ends_the_command(capfd, number):
    seen, before = [], [signal.getsignal(each) for each in ALL]

    def command() -> int:
        with noticed(seen.append):
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)
        return 0

    assert interruptible("it", command, ALL) == 128 + number
    assert seen == [number]
    assert capfd.readouterr().err == "it: interrupted\n"
    assert [signal.getsignal(each) for each in ALL] == before


def test_interruption_passes_what_catches_errors():
    assert not issubclass(Interruption, Exception)
