"""`train`: one training run, from its settings to its run folder."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import torch

from agents.checkpoint import Run
from agents.manifest import Config
from agents.rollout import arguments_of, evaluation_env
from agents.vec_env import IrsNavVecEnv
from train.config import TrainConfig
from train.evaluation import Evaluation


def check(config: TrainConfig) -> None:
    """Refuse what cannot be trained, before any work and before any file is touched.

    Raises
    ------
    OSError
        Where a scene or map file cannot be read.
    ValueError
        Where the environment cannot be made, an infeasible target included, or the run folder is taken.
    """
    evaluation_env(config.env).close()
    Run(_folder(config)).check_vacant(overwrite=config.overwrite)


def train(config: TrainConfig) -> tuple[Run, Evaluation]:
    """Train as the settings say; returns the run folder and what was seen of the agent on the way."""
    torch.set_num_threads(config.threads)
    env = IrsNavVecEnv(config.agent.n_envs, **arguments_of(config.env))
    model = config.agent.build(env, config.seed)
    run = Run.create(_folder(config), _record(config), overwrite=config.overwrite)
    hold = config.hold if config.stop_at_optimum else None
    evaluation = Evaluation(run, evaluation_env(config.env), config.eval_every, hold)
    with _interruptible(evaluation):
        model.learn(config.agent.total_timesteps, evaluation, progress_bar=config.progress)
    evaluation.save("last")
    run.set_status(evaluation.status)
    env.close()
    return run, evaluation


def _folder(config: TrainConfig) -> Path:
    name = f"{config.agent.algorithm}-seed{config.seed}-{datetime.now():%Y%m%d-%H%M%S}"
    return config.out or Path("runs") / name


def _record(config: TrainConfig) -> Config:
    own = ("seed", "agent", "env", "out", "overwrite", "progress")
    return Config(
        algorithm=config.agent.algorithm,
        seed=config.seed,
        env=arguments_of(config.env),
        agent=asdict(config.agent),
        training={name: value for name, value in vars(config).items() if name not in own},
    )


@contextmanager
def _interruptible(evaluation: Evaluation) -> Iterator[None]:
    """Lets Ctrl-C end the training after the step in hand; a second one ends the program at once."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return

    def interrupt(number: int, frame: Any) -> None:
        evaluation.is_interrupted = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
