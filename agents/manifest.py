"""What the files of a run folder hold: `Manifest` and `Config`."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from agents.algorithms import Algorithm, Generalist

Status = Literal["running", "at_optimum", "finished", "interrupted", "failed"]


class Record(BaseModel):
    """A frozen JSON object without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Entry(Record):
    """A file of the run, and the steps trained when it was written."""

    file: str = Field(pattern=r"^[\w-]+\.(zip|npz|pickle)$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    steps: int


class ModelEntry(Entry):
    """A model's file, and how its greedy policy did when it was saved."""

    is_success: bool
    ratio: float | None  # distance over the oracle's, None for a failure


class GeneralistEntry(Entry):
    """The file of a generalist, and how its greedy policy did on the scenes it was tested on when it was saved."""

    success: float  # share of the scenes
    spl: float  # mean over them


class Manifest(Record):
    """What ``manifest.json`` holds."""

    format_version: Literal[1] = 1
    status: Status = "running"
    versions: dict[str, str]
    commit: str | None
    models: dict[str, ModelEntry | GeneralistEntry] = {}
    checkpoints: tuple[Entry, ...] = ()  # the newest first
    error: str | None = None  # why the run has failed


class Config(Record):
    """What ``config.json`` holds."""

    algorithm: Algorithm | Generalist
    seed: int
    env: dict[str, Any]  # fields of `irs_gym.task.Task`; for a generalist, of `train.config.Scenes`
    agent: dict[str, Any]  # settings of the algorithm
    training: dict[str, Any]  # settings of the run
