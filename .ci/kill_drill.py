"""Kill a training again and again at random moments, resume it each time, and hold it against one
left in peace.
"""

import csv
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import tyro  # noqa: E402

from agents.rollout.episode import evaluation_env, roll_out  # noqa: E402
from agents.runs.run_folder import Run  # noqa: E402


def main(algorithm: str = "ppo", kills: int = 10, longest: float = 1.0, seed: int = 0) -> int:
    """Train with SIGKILLs and without; returns 0 where both runs end at the optimum, by the same
    learning curve.

    Parameters
    ----------
    algorithm
        As for ``python -m train``.
    kills
        How often the training is killed.
    longest
        A process is killed up to so many seconds after it has written a checkpoint, or after its
        start, by lot.
    seed
        Of the training and of the moments.
    """
    moments = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        killed, whole = Path(name) / "killed", Path(name) / "whole"
        settings = ["--seed", str(seed), "--checkpoint-every", "4096", "--no-progress"]
        for number in range(1, kills + 1):
            before, began = _steps(killed), time.monotonic()
            process = _start(algorithm, killed, settings)
            if moments.random() < 0.7:
                while process.poll() is None and _steps(killed)[:1] == before[:1]:
                    time.sleep(0.01)
            time.sleep(moments.uniform(0.0, longest))
            if process.poll() is not None:
                sys.exit(f"the training ended within {number - 1} kills: try a smaller --longest")
            process.kill()
            process.wait()
            life = time.monotonic() - began
            print(
                f"kill {number:2} after {life:4.1f} s, checkpoints after {_steps(killed)} steps",
                flush=True,
            )
        for folder in (killed, whole):
            if _start(algorithm, folder, settings).wait():
                sys.exit(f"{folder.name}: the training failed")
        return _judge(Run.open(killed), Run.open(whole))


def _start(algorithm: str, folder: Path, settings: list[str]) -> subprocess.Popen[bytes]:
    words = (
        ["--resume", str(folder), "--no-progress"]
        if folder.exists()
        else ["--out", str(folder), *settings]
    )
    return subprocess.Popen(
        [sys.executable, "-m", "train", algorithm, *words], cwd=ROOT, stderr=subprocess.DEVNULL
    )


def _steps(folder: Path) -> list[int]:
    return [each.steps for each in Run.open(folder).manifest.checkpoints] if folder.exists() else []


def _judge(killed: Run, whole: Run) -> int:
    curves = [_curve(run.folder) for run in (killed, whole)]
    for run in (killed, whole):
        episode = roll_out(run.load_model(), evaluation_env(run.task))
        print(
            f"{run.folder.name}: {run.manifest.status}, ratio {episode.ratio}, "
            f"{len(_curve(run.folder))} tests"
        )
        if run.manifest.status != "at_optimum" or not episode.is_optimal:
            return 1
    print(
        "the learning curves are the same"
        if curves[0] == curves[1]
        else "the learning curves differ"
    )
    return int(curves[0] != curves[1])


def _curve(folder: Path) -> list[list[str]]:
    """Learning curve without its seconds."""
    with (folder / "learning_curve.csv").open() as file:
        return [row[:1] + row[2:] for row in csv.reader(file)]


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
