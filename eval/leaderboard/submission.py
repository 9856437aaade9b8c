"""`Submission`: the file of an agent's episodes on a track, read within limits."""

import gzip
import json
import zlib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError
from pydantic.functional_validators import AfterValidator

from irs_gym.files import read_file, write_file

MOST_BYTES = (
    2 * 2**20
)  # of a file, and of what it unpacks to: 1,000 episodes of 800 steps have 1 MB
MADE = "01234567"  # an action that moves the robot
REFUSED = "abcdefgh"  # the same, of a move that is refused
_GZIP = b"\x1f\x8b"


class Refusal(ValueError):
    """Why a submission is refused; the message names the scene and the step at fault."""


def _printable(line: str) -> str:
    if not line.isprintable():
        raise ValueError("must be printable characters on one line")
    return line


Line = Annotated[
    str,
    StringConstraints(min_length=1, max_length=100, strip_whitespace=False),
    AfterValidator(_printable),
]


class Form(BaseModel):
    """A frozen JSON object without unknown keys, in which no value is taken for one of another
    type.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Agent(Form):
    """Who acted."""

    name: Line
    authors: Line
    version: Line
    commit: str | None = Field(pattern=r"^[0-9a-f]{7,64}(\+changes)?$")


class Episode(Form):
    """What was done in a scene, and what is said to have come of it.

    ``actions`` has a character a step: the digit of an action that moves the robot, 0 to 7, and a
    letter, a to h, where the move of that number is refused.
    """

    scene: str = Field(pattern=r"^[\w.-]{1,64}$")
    sha256: str = Field(pattern=r"^[0-9a-f]{8}$")  # the start of that of the scene's JSON
    actions: str = Field(max_length=100_000)
    is_success: bool
    distance: float = Field(ge=0)  # metres


class Scores(Form):
    """What is claimed over all episodes."""

    success: float = Field(ge=0, le=1)  # share of the episodes
    spl: float = Field(ge=0, le=1)
    ratio: float | None = Field(gt=0)  # mean over the successes; None without any
    optimal: int = Field(ge=0)  # episodes whose path is as short as the oracle's


class Submission(Form):
    """An agent's episodes on a track, one in each of its scenes."""

    format_version: Literal[1]
    track: str = Field(pattern=r"^[\w.-]{1,64}$")
    env_id: str = Field(pattern=r"^[\w.-]{1,64}$")
    arguments: dict[str, str | int | float | bool | None] = Field(max_length=50)
    seed: int
    agent: Agent
    episodes: tuple[Episode, ...] = Field(min_length=1, max_length=10_000)
    scores: Scores


def parse(content: bytes) -> Submission:
    """The submission of a file's content, JSON or gzip of it; `Refusal` where it is none."""
    text = _unpacked(content)

    try:
        submission = Submission.model_validate_json(text)
        json.loads(text, object_pairs_hook=_without_doubles)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise Refusal(f"{where}: {first['msg']}") from None
    except (RecursionError, ValueError) as error:
        raise Refusal(f"the file: {error}") from None

    return submission


def load(path: Path) -> Submission:
    """The submission of a file.

    Raises
    ------
    OSError
        Where it cannot be read.
    ValueError
        Where it is no regular file, or larger than `MOST_BYTES`; `Refusal` where it is no
        submission.
    """
    return parse(read_file(path, MOST_BYTES))


def save(submission: Submission, path: Path) -> None:
    """Write a submission, packed where the file's name ends in ``.gz``; equal ones give equal
    bytes.
    """
    content = (submission.model_dump_json() + "\n").encode()
    if path.suffix == ".gz":
        content = gzip.compress(content, mtime=0)
    if len(content) > MOST_BYTES:
        raise ValueError(
            f"the submission has {len(content):,} bytes, and at most {MOST_BYTES:,} are read"
        )

    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, content)


def _unpacked(content: bytes) -> bytes:
    """The content, out of one layer of gzip where it has one; never more than `MOST_BYTES` of
    it.
    """
    if not content.startswith(_GZIP):
        return content

    stream = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)  # gzip alone
    try:
        text = stream.decompress(content, MOST_BYTES + 1)
    except zlib.error as error:
        raise Refusal(f"the file: it is not a whole gzip archive: {error}") from None

    if len(text) > MOST_BYTES:
        raise Refusal(f"the file: it unpacks to more than the {MOST_BYTES:,} bytes that are read")
    if not stream.eof or stream.unused_data:
        raise Refusal("the file: it is not one whole gzip archive")

    return text


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys stand in it once each: readers differ in which of two they take."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        double = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {double[:50]!r} stands twice in one object")

    return found
