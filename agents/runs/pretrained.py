"""`load_pretrained`: policies that come with the package, from ``models/``, and what is known of
each.

A file holds the weights that act, as plain arrays: nothing in it is unpickled, and it is read only
where its SHA-256 stands in ``models/manifest.json``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from agents.policies.explorer_policy import Explorer
from agents.registry import generalists, observation_of
from agents.rollout.episode import EpisodeResult, arguments_of, roll_out
from agents.runs import provenance
from agents.runs.manifest import Config, Record
from agents.runs.problem import Problem, problem_of
from agents.runs.weights import WeightsError, load
from irs_gym.datasets.random_task import random_task_of
from irs_gym.datasets.splits import split_of
from irs_gym.files import write_file
from irs_gym.mdp.task import Task, task_of

MODELS = provenance.ROOT / "models"


class PretrainedError(ValueError):
    """A pretrained model that is missing, damaged, or does not fit."""


class PretrainedScore(Record):
    """What a policy achieves from the fixed start; lengths in metres."""

    is_success: bool
    distance: float
    oracle_distance: float
    ratio: float | None
    spl: float
    soft_spl: float
    refused: int
    steps: int

    @classmethod
    def of(cls, episode: EpisodeResult) -> "PretrainedScore":
        """The score of an episode."""
        return cls(**{name: getattr(episode, name) for name in cls.model_fields})


class PretrainedEntry(Record):
    """A model: its file, where it comes from, and its score."""

    file: str = Field(pattern=r"^[\w.-]+\.npz$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    config: Config
    steps: int
    chosen_among: int  # runs of other seeds; the model is that of the best
    score: PretrainedScore
    versions: dict[str, str]
    commit: str | None

    @cached_property
    def task(self) -> Task:
        """The environment that it was trained in, with the fixed start."""
        return replace(task_of(self.config.env), random_start=False)

    @cached_property
    def problem(self) -> Problem:
        """What it solves."""
        return problem_of(self.task)


class GeneralistPretrainedEntry(Record):
    """A model that learned on many scenes: its file, where it comes from, and its score on
    validation scenes.
    """

    file: str = Field(pattern=r"^[\w.-]+\.npz$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    config: Config
    steps: int
    chosen_among: int  # runs; the model is that of the greatest SPL
    success: float
    spl: float
    versions: dict[str, str]
    commit: str | None


class Models(Record):
    """What ``models/manifest.json`` holds."""

    format_version: Literal[1] = 1
    models: tuple[PretrainedEntry, ...] = ()
    generalists: tuple[GeneralistPretrainedEntry, ...] = ()

    @classmethod
    def read(cls, folder: Path) -> "Models":
        """The manifest of a folder; an empty one where there is none."""
        path = folder / "manifest.json"
        if not path.exists():
            return cls()

        try:
            return cls.model_validate_json(path.read_bytes())
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            raise PretrainedError(f"{str(path)!r} is damaged: {where}: {first['msg']}") from None

    def find_generalist(self, algorithm: str) -> GeneralistPretrainedEntry:
        """The model of an algorithm that learned on many scenes; the `PretrainedError` for none
        lists all.
        """
        for entry in self.generalists:
            if entry.config.algorithm == algorithm:
                return entry

        known = ", ".join(each.config.algorithm for each in self.generalists) or "none"
        raise PretrainedError(f"no pretrained {algorithm!r} for many scenes; there are {known}")

    def find(self, algorithm: str, task: Task) -> PretrainedEntry:
        """The model of an algorithm for a task's problem; `PretrainedError` for none lists all."""
        wanted = problem_of(task)

        for entry in self.models:
            if entry.config.algorithm == algorithm and entry.problem == wanted:
                return entry

        known = "".join(
            f"\n  {each.config.algorithm}: {each.problem.label}" for each in self.models
        )
        raise PretrainedError(
            f"no pretrained {algorithm!r} for {wanted.label}; there are{known or ' none'}"
        )


@dataclass(frozen=True)
class Pretrained:
    """A pretrained policy, for the environment of `make_env`."""

    entry: PretrainedEntry
    policy: Any
    """The policy of Stable-Baselines3, without its critic or target network."""

    @property
    def predict(self) -> Callable[..., tuple[NDArray[np.int64], Any]]:
        """The `predict` of `agents.policies.policy.Policy`; that of MaskablePPO takes
        ``action_masks`` too.

        It is that of Stable-Baselines3: PPO draws its moves unless ``deterministic=True`` is given.
        """
        predict: Callable[..., tuple[NDArray[np.int64], Any]] = self.policy.predict
        return predict

    def make_env(self, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
        """The environment that it was trained in, from the fixed start."""
        arguments = arguments_of(self.entry.task)
        return gymnasium.make("irs_gym:IrsNav-v0", render_mode=render_mode, **arguments)

    def play(self) -> EpisodeResult:
        """Its episode from the fixed start."""
        return roll_out(self, self.make_env())


@dataclass(frozen=True)
class PretrainedGeneralist:
    """A pretrained policy for scenes that it has never seen, as the environment of `make_env` shows
    them.
    """

    entry: GeneralistPretrainedEntry
    policy: Any
    """`agents.policies.map_policy.MapPolicy`, `agents.policies.explorer_policy.Explorer`, or a
    policy of Stable-Baselines3.
    """
    env: dict[str, Any]
    """Arguments of `irs_gym.datasets.random_task.RandomTask`."""

    @property
    def predict(self) -> Callable[..., tuple[NDArray[np.int64], Any]]:
        """The `predict` of `agents.policies.policy.Policy`; what remembers needs its ``state``
        handed back.
        """
        predict: Callable[..., tuple[NDArray[np.int64], Any]] = self.policy.predict
        return predict

    def make_env(self, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
        """`IrsNavRandom-v0` over the test scenes, unless other arguments were given."""
        return gymnasium.make("irs_gym:IrsNavRandom-v0", render_mode=render_mode, **self.env)


def load_pretrained(
    algorithm: str, *, folder: str | Path = MODELS, **env: Any
) -> Pretrained | PretrainedGeneralist:
    """A pretrained policy for the environment with these arguments.

    ``load_pretrained("ppo", target_db=-61.8)`` is a policy that fits
    ``load_pretrained(...).make_env()``, and so is ``load_pretrained("planner", split="test")``.

    Parameters
    ----------
    algorithm
        ``"ppo"`` or ``"dqn"`` for one task; ``"planner"``, ``"explorer"`` and others for scenes
        never seen.
    folder
        Folder of the models.
    **env
        Arguments of `irs_gym.mdp.task.Task`. Those that make the problem choose the model; of the
        others, such as ``observation``, each that is given must be what the model was trained with.
        For scenes never seen, arguments of `irs_gym.datasets.random_task.RandomTask`.

    Raises
    ------
    OSError
        Where the model's file cannot be read.
    ValueError
        `PretrainedError` where there is no such model, or its file is not the one of the manifest.
    """
    models = Models.read(Path(folder))
    if algorithm in generalists():
        return _load_generalist(models.find_generalist(algorithm), Path(folder), env)

    entry = models.find(algorithm, task_of(env))
    fixed = {each.name for each in fields(Problem)} | {"random_start"}

    for name in sorted(set(env) - fixed):
        trained = getattr(entry.task, name)
        if env[name] != trained:
            raise PretrainedError(
                f"{entry.file} was trained with {name}={trained!r}, not {env[name]!r}"
            )

    return Pretrained(entry, _load(entry, entry.task, Path(folder)))


def write_models(
    folder: Path,
    entries: Sequence[PretrainedEntry],
    contents: Mapping[str, bytes],
    generalists: Sequence[GeneralistPretrainedEntry] = (),
) -> None:
    """Write files by their names, then a manifest that lists all entries."""
    folder.mkdir(parents=True, exist_ok=True)

    for name, content in contents.items():
        write_file(folder / name, content)

    manifest = Models(models=tuple(entries), generalists=tuple(generalists))
    write_file(folder / "manifest.json", (manifest.model_dump_json(indent=1) + "\n").encode())


def _read(entry: PretrainedEntry | GeneralistPretrainedEntry, folder: Path) -> bytes:
    path = folder / entry.file
    content = path.read_bytes()
    digest = sha256(content).hexdigest()
    if digest != entry.sha256:
        raise PretrainedError(
            f"{str(path)!r} is not loaded: its SHA-256 is {digest}, in the manifest {entry.sha256}"
        )

    return content


def _load(
    entry: PretrainedEntry | GeneralistPretrainedEntry, task: Task | None, folder: Path
) -> Any:
    content = _read(entry, folder)
    try:
        return load(entry.config, task, content)
    except WeightsError as error:
        raise PretrainedError(f"{str(folder / entry.file)!r} is not loaded: {error}") from None


def _load_generalist(
    entry: GeneralistPretrainedEntry, folder: Path, env: Mapping[str, Any]
) -> PretrainedGeneralist:
    observation = observation_of(entry.config.algorithm)
    is_local = observation != "map"
    task = random_task_of({"split": "test", **env} if "scenes" not in env else dict(env))
    if "observation" in env and (env["observation"] == "map") is is_local:
        kind = "'dict' or 'flat'" if is_local else "'map'"
        raise PretrainedError(
            f"{entry.file} was trained with observation={kind}, not {env['observation']!r}"
        )

    policy = _load(entry, None, folder)
    if isinstance(policy, Explorer) and task.scenes is None:
        policy = replace(policy, shape=split_of(task.split).frame)

    own = {
        "observation": observation,
        **({} if "scenes" in env else {"split": "test"}),
    }

    return PretrainedGeneralist(entry, policy, {**own, **env})
