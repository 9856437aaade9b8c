"""`Checkpoints`: writes the whole state of a training again and again; `restore` goes back to the
last such state.
"""

import pickle
import random
import sys
from io import BytesIO
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from agents.runs import provenance
from agents.runs.manifest import FileEntry
from agents.runs.run_folder import Run, RunError
from train.evaluation import Evaluation

ENDED = ("at_optimum", "finished")


class CannotResumeError(RunError):
    """A run without a checkpoint that could be used here; it can only be trained anew."""


class Checkpoints(BaseCallback):
    """Writes a checkpoint at the beginning of rollouts, `every` steps or more apart, and when
    Ctrl-C ends the training.

    There the model, with its optimiser, replay buffer and environment, and the state of all random
    numbers are all that the rest of the training depends on.
    """

    def __init__(self, evaluation: Evaluation, every: int) -> None:
        super().__init__()
        self.evaluation = evaluation
        self.every = every

    def _on_training_start(self) -> None:
        self._last = self.num_timesteps

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._last >= self.every or self.evaluation.is_interrupted:
            self.evaluation.run.save_checkpoint(
                _capture(self.model, self.evaluation), self.num_timesteps
            )
            self._last = self.num_timesteps

    def _on_step(self) -> bool:
        return True


def check(run: Run, *, trust: bool = False) -> None:
    """Refuse, before any file is touched, what cannot be resumed.

    Raises
    ------
    RunError
        Where the run has ended, was begun with other packages, or is not this user's own and not to
        be trusted either.
    """
    manifest = run.manifest
    here = provenance.versions()
    if manifest.status in ENDED:
        raise RunError(
            f"{str(run.folder)!r} has ended ({manifest.status}): there is nothing to resume"
        )

    others = [
        f"{name} {old}, not {here.get(name)}"
        for name, old in manifest.versions.items()
        if here.get(name) != old
    ]
    if others:
        raise CannotResumeError(
            f"{str(run.folder)!r} can be resumed only with the packages that began it: "
            f"{'; '.join(others)}"
        )

    if not trust:
        run.own_manifest()


def restore(run: Run, evaluation: Evaluation, *, trust: bool = False) -> Any:
    """The model as its last whole checkpoint holds it, with random numbers, folder and evaluation
    set back to then.

    Returns None where no checkpoint was written yet, so that the training begins anew. Nothing is
    unpickled unless its SHA-256 stands in a manifest that this user has signed, or ``trust``s and
    so signs now.

    Raises
    ------
    CannotResumeError
        Where there are checkpoints, but none of them is whole.
    RunError
        Where the manifest is neither signed nor to be trusted.
    """
    manifest = run.adopt() if trust else run.own_manifest()
    entries = manifest.checkpoints
    if not entries:
        print(
            f"{run.folder}: no checkpoint was written yet: the training begins anew",
            file=sys.stderr,
        )
        run.remove_drafts()
        run.update(status="running", error=None, models={})
        return None

    entry, content = _newest(run, entries)
    state = _Unpickler(BytesIO(content)).load()
    run.rewind(entry, state["models"])
    evaluation.state = state["evaluation"]
    random.setstate(state["random"])
    np.random.set_state(state["numpy"])  # noqa: NPY002  # the generator that Stable-Baselines3 draws from
    torch.set_rng_state(state["torch"])

    return state["model"]


def _newest(run: Run, entries: tuple[FileEntry, ...]) -> tuple[FileEntry, bytes]:
    for entry in entries:
        try:
            return entry, run.read(entry)
        except RunError as error:
            print(f"{error}: the checkpoint before it is used, if it is whole", file=sys.stderr)

    raise CannotResumeError(
        f"{str(run.folder)!r} holds no whole checkpoint: train anew with --overwrite"
    )


def _capture(model: Any, evaluation: Evaluation) -> bytes:
    run = evaluation.run
    state = {
        "model": model,
        "evaluation": evaluation.state,
        "models": {name: (entry, run.read(entry)) for name, entry in run.manifest.models.items()},
        "random": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002
        "torch": torch.get_rng_state(),
    }
    content = BytesIO()
    _Pickler(content, pickle.HIGHEST_PROTOCOL).dump(state)

    return content.getvalue()


class _Pickler(pickle.Pickler):
    """Leaves the logger out, whose files are open."""

    def persistent_id(self, obj: Any) -> str | None:
        return "logger" if isinstance(obj, Logger) else None


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, pid: str) -> Any:
        return Logger(folder=None, output_formats=[])
