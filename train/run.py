"""`train`: one training run, from its settings to its run folder."""

import sys
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from agents.learning.map_learner import MapLearner, first_network
from agents.registry import ALGORITHMS, observation_of
from agents.rollout.episode import arguments_of, evaluation_env
from agents.runs.interruption import noticed
from agents.runs.run_folder import LockedError, Run, RunError
from agents.single.model import build_model
from agents.vec_env import IrsNavVecEnv
from irs_gym.datasets import scene_set as pools
from irs_gym.datasets.codebook_task import CodebookTask
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.envs.codebook_vector_nav import IrsNavCodebookVectorEnv
from irs_gym.envs.continuous_vector_nav import IrsNavContinuousVectorEnv
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv
from irs_gym.envs.vector_nav import IrsNavVectorEnv
from irs_gym.mdp.task import Task
from train import resume
from train.config import GeneralistConfig, TrainConfig, defaults_of, record_of, settings_of
from train.evaluation import Evaluation, FallingEntropy, FallingSpread, LaterStarts, Progress
from train.generalisation import Generalisation


def check(config: TrainConfig | GeneralistConfig) -> None:
    """Refuse what cannot be trained, before any work and before any file is touched.

    Raises
    ------
    OSError
        Where a scene, map or network file cannot be read.
    ValueError
        Where the environment cannot be made, an infeasible target included, or the run folder is
        taken; where a run cannot be resumed.
    """
    if config.resume is not None:
        _check_resumed(config, Run.open(config.resume))
        return

    if _is_taught(config):
        first_network(config.agent)
    elif isinstance(config, TrainConfig):
        evaluation_env(config.env).close()

    if config.out is not None:
        Run(config.out).check_vacant(overwrite=config.overwrite)


def train(config: TrainConfig | GeneralistConfig) -> tuple[Run, Evaluation]:
    """Train as the settings say; returns the run folder and what was seen of the agent on the way.

    Raises
    ------
    OSError
        Where a file cannot be written; the run is then kept as failed, as it is by any other error.
    RunError
        Where the run folder is taken, is another process's, or cannot be made.
    """
    with ExitStack() as locks:
        folder = config.resume or config.out
        if folder is None:
            run = _lock_new(config, locks)
        else:
            run = Run(folder)
            locks.enter_context(run.locked())

        return run, train_locked(run, config)


def train_locked(run: Run, config: TrainConfig | GeneralistConfig) -> Evaluation:
    """`train` for whoever holds the lock of the run's folder."""
    if config.resume is None:
        run.begin(record_of(config), overwrite=config.overwrite)
        if run.manifest.signature is None:
            print(
                f"{run.folder}: no key of yours can be kept, so resuming it will ask for --trust",
                file=sys.stderr,
            )
    else:
        run = Run.open(run.folder)
        config = replace(settings_of(run), progress=config.progress, trust=config.trust)

    try:
        return _train(run, config)
    except RunError:  # it cannot be resumed, and stays as it is
        raise
    except KeyboardInterrupt:  # before the first step, or for the second time
        _note(run, status="interrupted", error=None)
        raise
    except Exception as error:
        _note(run, status="failed", error=f"{type(error).__name__}: {error}")
        raise


def _note(run: Run, **changes: Any) -> None:
    """Change the manifest, if that is still possible."""
    with suppress(OSError, ValueError):
        run.update(**changes)


def _train(run: Run, config: TrainConfig | GeneralistConfig) -> Evaluation:
    torch.set_num_threads(config.threads)
    evaluation = _evaluation(run, config)
    model: Any = resume.restore(run, evaluation, trust=config.trust) if config.resume else None
    is_new = model is None
    if is_new:
        build = MapLearner if _is_taught(config) else build_model
        model = build(config.agent, _material(config), config.seed)
    elif _is_taught(config):
        model.pool = _material(config)

    outputs: list[KVWriter] = (
        [TensorBoardOutputFormat(str(run.folder / "tensorboard"))] if config.tensorboard else []
    )
    model.set_logger(Logger(folder=None, output_formats=outputs))

    callbacks = [evaluation, resume.Checkpoints(evaluation, config.checkpoint_every)]
    callbacks += [Progress()] if config.progress else []
    last = getattr(config.agent, "final_ent_coef", None)
    if last is not None:
        callbacks.append(FallingEntropy(config.agent.ent_coef, last))
    if hasattr(config.agent, "final_log_std"):
        callbacks.append(FallingSpread(config.agent.log_std_init, config.agent.final_log_std))
    if hasattr(config.agent, "final_random_start"):
        first = config.env.random_start  # type: ignore[union-attr]  # in one scene
        callbacks.append(LaterStarts(first, min(first, config.agent.final_random_start)))

    with noticed(evaluation.interrupt):
        steps = config.agent.total_timesteps - model.num_timesteps
        model.learn(steps, CallbackList(callbacks), reset_num_timesteps=is_new)

    evaluation.save("last")
    if ALGORITHMS[config.agent.algorithm].mixes:  # a mixture is there at the end alone
        evaluation.save("best")

    run.update(
        status=evaluation.status, **({} if evaluation.is_interrupted else {"checkpoints": ()})
    )
    if not _is_taught(config):
        model.get_env().close()

    return evaluation


def _is_taught(config: TrainConfig | GeneralistConfig) -> bool:
    """Whether a teacher improves a network on the scenes themselves, in no environment."""
    return ALGORITHMS[config.agent.algorithm].is_taught


def _evaluation(run: Run, config: TrainConfig | GeneralistConfig) -> Evaluation:
    if isinstance(config, GeneralistConfig):
        pool = _pool(config, config.env.test_split, config.env.test_scenes)
        return Generalisation(run, pool, config.eval_every, observation_of(config.agent.algorithm))

    hold = config.hold if config.stop_at_optimum else None
    return Evaluation(run, evaluation_env(config.env), config.eval_every, hold)


def _material(config: TrainConfig | GeneralistConfig) -> Any:
    """What is trained on: an environment, or a pool of scenes."""
    if isinstance(config, TrainConfig):
        # no learner reads more of the infos, and dicts of all of them take longer than the steps
        told = ["cost", "is_success"]
        kind = _VECTOR_ENVS[type(config.env)]
        named = getattr(config.agent, "env_settings", ())  # a table has none
        own = {name: getattr(config.agent, name) for name in named}
        return IrsNavVecEnv(
            config.agent.n_envs, vector_env=kind, infos=told, **arguments_of(config.env), **own
        )

    scenes = _pool(config, config.env.split, config.env.num_scenes)
    if _is_taught(config):
        return scenes

    return IrsNavVecEnv(  # whose pool is named, not handed over, so that a checkpoint holds no maps
        config.agent.n_envs,
        vector_env=IrsNavRandomVectorEnv,
        split=config.env.split,
        num_scenes=config.env.num_scenes,
        observation=observation_of(config.agent.algorithm),
        **{name: getattr(config.agent, name) for name in config.agent.env_settings},
    )


_VECTOR_ENVS: dict[type[Any], Any] = {
    Task: IrsNavVectorEnv,
    CodebookTask: IrsNavCodebookVectorEnv,
    ContinuousTask: IrsNavContinuousVectorEnv,
}


def _pool(config: GeneralistConfig, split: str, scenes: int) -> pools.SceneSet:
    return pools.build_scene_set(split, scenes, progress=None if config.progress else False)


def _check_resumed(config: TrainConfig | GeneralistConfig, run: Run) -> None:
    algorithm = config.agent.algorithm
    if run.config.algorithm != algorithm:
        raise RunError(
            f"{str(run.folder)!r} is a run of {run.config.algorithm}, not of {algorithm}"
        )

    own = replace(
        defaults_of(algorithm), resume=config.resume, trust=config.trust, progress=config.progress
    )
    if config != own:
        raise ValueError(
            "--resume goes on with the run's own settings: "
            "give none beside it but --no-progress, --trust"
        )

    settings_of(run)
    resume.check(run, trust=config.trust)


def _lock_new(config: TrainConfig | GeneralistConfig, locks: ExitStack) -> Run:
    """A new folder under runs/, named by algorithm, seed and time, and locked; a number follows
    where that is taken.
    """
    name = f"{config.agent.algorithm}-seed{config.seed}-{datetime.now():%Y%m%d-%H%M%S}"
    number = 1

    while True:
        run = Run(Path("runs") / (name if number == 1 else f"{name}-{number}"))
        with suppress(LockedError), ExitStack() as lock:
            lock.enter_context(run.locked())
            if not run.folder.exists():
                locks.push(lock.pop_all())
                return run

        number += 1
