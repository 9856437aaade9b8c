"""`Plan`: the runs of a sweep, algorithms x settings x seeds, read from a small TOML file."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from agents.rollout.episode import SceneTask, arguments_of, evaluation_env, scene_task_of
from agents.runs.manifest import AlgorithmName, Config
from agents.runs.run_folder import COPIES, Run
from irs_gym.files import read_file
from irs_gym.mdp.task import Task, checked_fields
from train.config import (
    GeneralistConfig,
    Scenes,
    TrainConfig,
    defaults_of,
    record_of,
    with_codebook,
)
from train.resume import ENDED

MOST_BYTES = 2**20  # of a sweep file
MOST_RUNS = 100_000
Name = Annotated[str, StringConstraints(pattern=r"^\w[\w.+-]*$")]  # of a folder


class PlanError(ValueError):
    """A sweep file that is wrong, or at odds with the runs that are there."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Setting(_Table):
    """What is changed from the defaults of ``python -m train``, under the names of its command
    line.

    In ``agent.weights``, ``{seed}`` stands for the seed of the run.
    """

    algorithms: tuple[AlgorithmName, ...] | None = None
    """In place of those of the whole sweep."""
    env: dict[str, Any] = {}
    agent: dict[str, Any] = {}
    training: dict[str, Any] = {}


class Plan(_Table):
    """A sweep: each algorithm in each setting with the seeds 0, 1, and so on."""

    out: Path
    """Folder of the run folders, ``SETTING/ALGORITHM/seedN``."""
    seeds: int = Field(ge=1)
    algorithms: tuple[AlgorithmName, ...] = Field(min_length=1)
    settings: dict[Name, Setting] = Field(min_length=1)

    @classmethod
    def load(cls, file: Path) -> "Plan":
        """The plan in a file.

        Raises
        ------
        OSError
            Where the file cannot be read.
        PlanError
            Where it is no such plan; the message names the entry.
        """
        try:
            plan = cls.model_validate(tomllib.loads(read_file(file, MOST_BYTES).decode()))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise PlanError(f"{file}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        except (ValueError, RecursionError) as error:
            raise PlanError(f"{file}: {error}") from None

        runs = plan.seeds * sum(1 for _ in plan.cells())
        if runs > MOST_RUNS:
            raise PlanError(
                f"{file}: seeds={plan.seeds} make {runs:,} runs, "
                f"and a sweep has at most {MOST_RUNS:,}"
            )

        return plan

    def cells(self) -> Iterator[tuple[str, AlgorithmName]]:
        """Each setting with each of its algorithms."""
        for name, setting in self.settings.items():
            for algorithm in setting.algorithms or self.algorithms:
                yield name, algorithm

    def folder(self, setting: str, algorithm: str, seed: int) -> Path:
        """Run folder."""
        return self.out / setting / algorithm / f"seed{seed}"

    def configs(self) -> list[TrainConfig | GeneralistConfig]:
        """Settings of all runs, seed by seed, so that a sweep that is under way covers all cells.

        Raises ``PlanError`` where a setting has an unknown name or a value out of its range.
        """
        cells = [(name, self._configured(name, algorithm)) for name, algorithm in self.cells()]
        return [
            replace(_seeded(config, seed), out=self.folder(name, config.agent.algorithm, seed))
            for seed in range(self.seeds)
            for name, config in cells
        ]

    def check(self, *, trust: bool = False) -> None:
        """Refuse, before any work, what cannot be trained, and folders that hold anything else.

        Without ``trust``, also runs to go on with that this user has not made.

        Raises
        ------
        OSError
            Where a scene or map file cannot be read.
        PlanError
            Where an environment cannot be made, or a folder holds another run.
        RunError
            Where a folder holds no run, or one that is not this user's own.
        """
        configs = self.configs()

        for env in dict.fromkeys(
            config.env for config in configs if isinstance(config, TrainConfig)
        ):
            try:
                evaluation_env(env).close()
            except ValueError as error:
                raise PlanError(str(error)) from None

        for config in configs:
            assert config.out is not None
            if not config.out.exists():
                continue

            run = Run.open(config.out)
            if not _is_same(run.config, record_of(config)):
                raise PlanError(
                    f"{str(config.out)!r} holds a run with other settings: "
                    "name another folder as out"
                )

            if not trust and run.manifest.status not in ENDED:
                run.own_manifest()

    def _configured(self, name: str, algorithm: AlgorithmName) -> TrainConfig | GeneralistConfig:
        where = f"settings.{name}"
        setting = self.settings[name]
        default = defaults_of(algorithm)
        if "codebook" in setting.env and isinstance(default.env, Task):
            default = with_codebook(default)

        try:
            env: Any = _env_of(default.env, setting.env)
        except (TypeError, ValueError) as error:
            raise PlanError(f"{where}.env: {error}") from None

        agent = _changed(default.agent, setting.agent, f"{where}.agent ({algorithm})")

        return _changed(
            replace(default, agent=agent, env=env, progress=False),
            setting.training,
            f"{where}.training",
        )


def _env_of(default: SceneTask | Scenes, changes: Mapping[str, Any]) -> SceneTask | Scenes:
    arguments = {**arguments_of(default), **changes}
    return (
        scene_task_of(arguments)
        if not isinstance(default, Scenes)
        else Scenes(**checked_fields(Scenes, arguments, "Scenes"))
    )


def _seeded(config: TrainConfig | GeneralistConfig, seed: int) -> TrainConfig | GeneralistConfig:
    """With that seed, also where the weights to begin with are named by it."""
    weights = getattr(config.agent, "weights", None)
    if weights is None:
        return replace(config, seed=seed)

    agent = replace(config.agent, weights=Path(str(weights).replace("{seed}", str(seed))))

    return replace(config, agent=agent, seed=seed)


def _is_same(old: Config, new: Config) -> bool:
    """Whether two runs have the same settings, as JSON keeps them; a file of the user's own counts
    as the same.
    """
    old_json = old.model_dump(mode="json")
    new_json = new.model_dump(mode="json")

    for name, copy in COPIES.items():
        if old.env.get(name) == copy:
            old_json["env"][name] = new_json["env"][name]

    return old_json == new_json


_Settings = TypeVar("_Settings", bound=Any)


def _changed(settings: _Settings, changes: Mapping[str, Any], where: str) -> _Settings:
    known = [each.name for each in fields(settings)]
    unknown = [name for name in changes if name not in known]
    if unknown:
        raise PlanError(
            f"{where}: unknown name {', '.join(unknown)}: the names are {', '.join(known)}"
        )

    try:
        return replace(settings, **changes)
    except (TypeError, ValueError) as error:
        raise PlanError(f"{where}: {error}") from None
