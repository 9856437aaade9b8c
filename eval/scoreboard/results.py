"""`Result`: what one training run achieved, read from its folder and played anew."""

import csv
import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.registry import ALGORITHMS, config_class
from agents.rollout.episode import TOLERANCE, EpisodeResult, evaluation_env, roll_out
from agents.runs.manifest import Config
from agents.runs.problem import Problem, problem_of
from agents.runs.run_folder import Run, RunError
from eval.markdown import printable
from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.files import read_file

COMPLETE = ("at_optimum", "finished")
CURVE_BYTES = 2**26  # at most in learning_curve.csv
SETTINGS_LENGTH = 20_000  # at most of a run's settings as JSON, in characters


@dataclass(frozen=True, eq=False)
class Curve:
    """Tests of the greedy policy during training, arrays ``(T,)``: when they were, and how they
    went.
    """

    steps: NDArray[np.float64]
    seconds: NDArray[np.float64]
    spl: NDArray[np.float64]
    is_optimal: NDArray[np.bool_]

    def first_optimum(self, clock: NDArray[np.float64]) -> float:
        """Steps or seconds of the first test at the oracle's distance; infinite where none was."""
        return float(clock[self.is_optimal][0]) if self.is_optimal.any() else inf


@dataclass(frozen=True, eq=False)
class Result:
    """What one run achieved: its best (or last) policy's episode from the fixed start, and the
    tests on the way.
    """

    run: Run
    config: Config
    problem: Problem
    episode: EpisodeResult
    curve: Curve

    @property
    def seed(self) -> int:
        """Seed of the run."""
        return self.config.seed

    @property
    def steps_to_optimum(self) -> float:
        """Training steps before the first test at the oracle's distance; infinite for none."""
        return self.curve.first_optimum(self.curve.steps)

    @property
    def seconds_to_optimum(self) -> float:
        """Seconds of training and tests before that test."""
        return self.curve.first_optimum(self.curve.seconds)

    @property
    def rank(self) -> tuple[float, float, int]:
        """Sorts by ratio, then by steps to the optimum, then by seed."""
        return (
            inf if self.episode.ratio is None else self.episode.ratio,
            self.steps_to_optimum,
            self.seed,
        )

    @cached_property
    def group(self) -> "Group":
        """The runs that this one is comparable with."""
        return Group.of(self.problem, self.config)


@dataclass(frozen=True)
class Group:
    """Runs that differ in the seed alone: one problem, one algorithm, and the same settings."""

    problem: Problem
    algorithm: str
    settings: str  # JSON of all that is no part of the problem, such as {"agent.gamma": 0.98}

    def __post_init__(self) -> None:
        # Runs that are older than a setting were made with its default.
        own = self.values
        if not isinstance(own, dict):
            raise RunError(f"settings={self.settings[:80]!r} must be a JSON object")

        filled = settings_text({**default_settings(self.algorithm), **own})
        object.__setattr__(self, "settings", filled)

    @classmethod
    def of(cls, problem: Problem, config: Config) -> "Group":
        """The group of a run with that configuration."""
        fixed = {each.name for each in fields(Problem)}
        env = {name: value for name, value in config.env.items() if name not in fixed}
        parts = {"env": env, "agent": config.agent, "training": config.training}
        flat = {
            f"{part}.{name}": value
            for part, values in parts.items()
            for name, value in values.items()
        }
        algorithm: Any = config.algorithm  # one of those of one scene, since it has a problem
        return cls(problem, algorithm, settings_text(flat))

    @property
    def values(self) -> dict[str, Any]:
        """The settings by their names."""
        found: dict[str, Any] = json.loads(self.settings)
        return found


def default_settings(algorithm: str) -> dict[str, Any]:
    """The defaults of an algorithm's own settings, by the names and as the values of `Group`."""
    if algorithm not in ALGORITHMS:
        return {}

    own = asdict(config_class(algorithm)())
    found: dict[str, Any] = json.loads(json.dumps({f"agent.{name}": own[name] for name in own}))
    return found


def settings_text(settings: dict[str, Any]) -> str:
    """Settings as JSON, by which runs are compared; raises `RunError` where they are too long."""
    text = json.dumps(settings, sort_keys=True, allow_nan=False)
    if len(text) > SETTINGS_LENGTH:
        raise RunError(
            f"its settings have {len(text):,} characters, and at most {SETTINGS_LENGTH:,} are read"
        )

    return text


@dataclass(frozen=True)
class LeftOut:
    """A folder below the searched one whose run is no result, and why."""

    folder: str
    reason: str
    group: Group | None = None  # where its configuration can be read

    @classmethod
    def of(cls, folder: Path, error: Exception, group: Group | None = None) -> "LeftOut":
        """A run that raised an error, whichever: a damaged one may raise any. The reason is one
        line.
        """
        said = (
            str(error)
            if isinstance(error, OSError | ValueError)
            else f"{type(error).__name__}: {error}"
        )
        return cls(printable(str(folder)), printable(" ".join(said.split())), group)


def tell_left_out(left_out: Iterable[LeftOut]) -> None:
    """Name on standard error what is left out, and why."""
    for each in left_out:
        print(f"left out: {each.folder}: {each.reason}", file=sys.stderr)


def find_runs(folder: Path) -> list[Path]:
    """Folders below, or the folder itself, that hold a run or what is left of one, sorted.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{str(folder)!r} is not a folder")

    found = {
        file.parent for name in ("config.json", "manifest.json") for file in folder.rglob(name)
    }

    # a name that begins with a dot is that of a draft of `Run.create`
    return sorted(each for each in found if not each.name.startswith("."))


def read_results(
    folders: Iterable[Path], model: str = "best"
) -> tuple[list[Result], list[LeftOut]]:
    """Results of complete runs, and the runs that are left out, in the order of the folders.

    A run is left out where it has not ended, is damaged, no longer does what its manifest says, or
    repeats another.
    """
    results: list[Result] = []
    left_out: list[LeftOut] = []
    seen: dict[tuple[Group, int], Path] = {}

    for folder in folders:
        group = None
        try:
            run = Run.open(folder)
            group = Group.of(problem_of(run.task), run.config)
            same = seen.get((group, run.config.seed))
            if same is not None:
                raise RunError(f"repeats seed {run.config.seed} of {same}")

            results.append(read_result(run, model))
            seen[group, run.config.seed] = folder
        except Exception as error:
            left_out.append(LeftOut.of(folder, error, group))

    return results, left_out


def read_result(run: Run, model: str = "best") -> Result:
    """The result of a complete run.

    Raises
    ------
    OSError
        Where a file of it cannot be read.
    ValueError
        Where the run has not ended, is damaged, or its policy no longer does what its manifest
        says.
    """
    manifest = run.manifest
    config = run.config
    if manifest.status == "failed":
        raise RunError(f"has failed: {manifest.error}")
    if manifest.status not in COMPLETE:
        raise RunError(f"has not ended: its status is {manifest.status!r}")

    episode = roll_out(run.load_model(model), evaluation_env(run.task))
    entry: Any = manifest.models[model]  # a `ModelEntry`, since the run has one task
    # Headings differ in their last digits from machine to machine, and moves over the grid do not.
    tolerance = 1e-6 if isinstance(run.task, ContinuousTask) else TOLERANCE
    if not _is_close(episode.ratio, entry.ratio, tolerance):
        raise RunError(
            f"its {model} policy now has the ratio {episode.ratio}, "
            f"and {entry.ratio} in the manifest"
        )

    return Result(run, config, problem_of(run.task), episode, _read_curve(run))


def _read_curve(run: Run) -> Curve:
    rows = read_curve(run)
    path = run.folder / "learning_curve.csv"

    try:
        steps, seconds, spl = (
            np.array([float(row[name]) for row in rows]) for name in ("steps", "seconds", "spl")
        )
        ratio = np.array([float(row["ratio"] or inf) for row in rows])
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{str(path)!r} is damaged: {error!r}") from None

    are_clocks = all(
        np.isfinite(each).all() and each[0] >= 0 and (np.diff(each) >= 0).all()
        for each in (steps, seconds)
    )
    if not are_clocks or not ((spl >= 0) & (spl <= 1)).all() or np.isnan(ratio).any():
        raise RunError(
            f"{str(path)!r} is damaged: steps or seconds go back, or a score is out of its range"
        )

    return Curve(steps, seconds, spl, ratio <= 1.0 + TOLERANCE)


def read_curve(run: Run) -> list[dict[str, str]]:
    """Rows of a run's learning curve, one or more; raises ``OSError``, or `RunError` where they
    cannot be read.
    """
    path = run.folder / "learning_curve.csv"

    try:
        rows = list(csv.DictReader(read_file(path, CURVE_BYTES).decode().splitlines()))
    except (ValueError, csv.Error) as error:
        raise RunError(f"{str(path)!r} is damaged: {error}") from None

    if not rows:
        raise RunError(f"{str(path)!r} holds no test")

    return rows


def _is_close(ratio: float | None, other: float | None, tolerance: float) -> bool:
    if ratio is None or other is None:
        return ratio is other
    return abs(ratio - other) <= tolerance
