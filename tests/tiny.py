"""What tests of training share: its command line in this process, and settings small enough to
train in a second.
"""

import csv
import sys
from pathlib import Path
from shlex import split

import numpy as np
import pytest

from agents.registry import drivers, specialists
from agents.runs.run_folder import Run
from irs_gym import RadioMap
from irs_gym.files import read_arrays
from train.__main__ import main

_RUN = split("--eval-every 64 --checkpoint-every 96 --env.patch-radius 1 --no-progress")
_ON_POLICY = split("--agent.n-steps 16 --agent.batch-size 32 --agent.n-epochs 2")
_OFF_POLICY = split("--agent.learning-starts 32 --agent.batch-size 32 --agent.buffer-size 256")
_DRIVING = split("--agent.gradient-steps 1")
_NETWORK = split("--agent.net-arch 8")
_ROUNDS = split("--agent.round-timesteps 256 --agent.test-every 64")
TINY: dict[str, list[str]] = {
    algorithm: [
        *_RUN,
        *split("--agent.n-envs 4"),
        *([] if algorithm == "q_learning" else _NETWORK),
        *(_ROUNDS if algorithm == "ppo_lagrangian" else []),
        *(_ON_POLICY if "ppo" in algorithm else _OFF_POLICY if algorithm.endswith("dqn") else []),
    ]
    for algorithm in specialists()
}
TINY |= {
    algorithm: [
        *_RUN,
        *split("--agent.n-envs 4"),
        *_NETWORK,
        *(_ON_POLICY if "ppo" in algorithm else [*_OFF_POLICY, *_DRIVING]),
    ]
    for algorithm in drivers()
}


def call(words: list[object]) -> int:
    """Exit status of `python -m train` in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["train", *map(str, words)])
        try:
            return main()
        except SystemExit as ended:  # the parser's own
            return ended.code


def curve(folder: Path) -> list[dict[str, str]]:
    """Learning curve of a run without the seconds, which are never the same."""
    with (folder / "learning_curve.csv").open() as file:
        return [
            {name: value for name, value in row.items() if name != "seconds"}
            for row in csv.DictReader(file)
        ]


def open_floor(folder: Path) -> list[str]:
    """Arguments for a small map without obstacles."""
    RadioMap.from_array(np.zeros((5, 4)), 1.0).save(folder / "floor.npz")
    return split(f"--env.radio-map {folder / 'floor.npz'} --env.start 0 0 --env.goal 4 2")


def continuous_floor(folder: Path) -> list[str]:
    """The same for a robot that goes anywhere on it."""
    RadioMap.from_array(np.zeros((5, 4)), 1.0).save(folder / "floor.npz")
    return split(
        f"--env.radio-map {folder / 'floor.npz'} --env.target-db -3 --env.start 0.5 0.5 "
        "--env.goal 4.5 2.5"
    )


def numbers(run: Run, name: str = "last") -> list[np.ndarray]:
    """All numbers that a model acts by."""
    return list(read_arrays(run.read_model(name)).values())
