"""What the files of a run folder hold: `Manifest` and `Config`."""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, field_validator
from pydantic_core import PydanticKnownError

from agents.registry import ALGORITHMS

Status = Literal["running", "at_optimum", "finished", "interrupted", "failed"]


def _known(name: Any) -> Any:
    """The name of an algorithm, with the error of a literal type for any other."""
    if not isinstance(name, str) or name not in ALGORITHMS:
        *others, last = map(repr, ALGORITHMS)
        expected = f"{', '.join(others)} or {last}"
        raise PydanticKnownError("literal_error", {"expected": expected})

    return name


AlgorithmName = Annotated[str, PlainValidator(_known)]


class Record(BaseModel):
    """A frozen JSON object without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class FileEntry(Record):
    """A file of the run, and the steps trained when it was written."""

    file: str = Field(pattern=r"^[\w-]+\.(zip|npz|pickle)$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    steps: int


class _Arrays(FileEntry):
    """The file of a model, which holds plain arrays."""

    @field_validator("file")
    @classmethod
    def _holds_arrays(cls, file: str) -> str:
        if not file.endswith(".npz"):
            raise ValueError(
                f"{file} is a model of an older version, "
                "and to read it could run its code: train anew"
            )
        return file


class ModelEntry(_Arrays):
    """A model's file, and how its greedy policy did when it was saved."""

    is_success: bool
    ratio: float | None  # distance over the oracle's, None for a failure


class GeneralistEntry(_Arrays):
    """The file of a generalist, and how its greedy policy did on the scenes it was tested on when
    it was saved.
    """

    success: float  # share of the scenes
    spl: float  # mean over them


class Manifest(Record):
    """What ``manifest.json`` holds."""

    format_version: Literal[1] = 1
    status: Status = "running"
    versions: dict[str, str]
    commit: str | None
    files: dict[
        str, str
    ] = {}  # SHA-256 of ``config.json`` and of the copies beside it, by their names
    models: dict[str, ModelEntry | GeneralistEntry] = {}
    checkpoints: tuple[FileEntry, ...] = ()  # the newest first
    error: str | None = None  # why the run has failed
    signature: str | None = (
        None  # of all else here, with the key of the user who trains; see `agents.runs.signature`
    )

    @property
    def content(self) -> bytes:
        """What is signed."""
        return json.dumps(
            self.model_dump(mode="json", exclude={"signature"}), sort_keys=True
        ).encode()


class Config(Record):
    """What ``config.json`` holds."""

    algorithm: AlgorithmName
    seed: int
    env: dict[
        str, Any
    ]  # fields of `agents.rollout.episode.SceneTask`; for a generalist, of `train.config.Scenes`
    agent: dict[str, Any]  # settings of the algorithm
    training: dict[str, Any]  # settings of the run
