"""`Shard`: scenes in a row of one split, solved and stacked, as bytes of a file and back.

``python -m irs_gym.datasets.shard SPLIT FIRST COUNT`` writes the bytes of one to the standard
output, for a program that has several built at once.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.generator import CELL_SIZE, VERSION, Difficulty
from irs_gym.datasets.solved_scene import SolvedScene
from irs_gym.datasets.splits import solved_scene_of, split_of
from irs_gym.files import read_arrays
from irs_gym.mdp.task import irs_settings
from irs_gym.radio.irs import PHYSICS_VERSION


@dataclass(frozen=True, eq=False)
class Shard:
    """The arrays of `irs_gym.datasets.scene_set.SceneSet` for n scenes, and the scenes as JSON."""

    texts: NDArray[np.bytes_]  # (n,)
    target_db: NDArray[np.float64]  # (n,)
    gain_db: NDArray[np.float64]  # (n, X, Y)
    distance_to_go: NDArray[np.float64]  # (n, X, Y)
    irs: NDArray[np.float32]  # (n, 3)
    start: NDArray[np.int64]  # (n, 2)
    goal: NDArray[np.int64]  # (n, 2)

    @classmethod
    def of(cls, solved: Sequence[SolvedScene], frame: tuple[int, int]) -> "Shard":
        """Shard of solved scenes, each map padded to the frame."""
        scenes = [each.scene for each in solved]
        return cls(
            texts=np.array([scene.model_dump_json().encode() for scene in scenes]),
            target_db=np.array([scene.target_db for scene in scenes]),
            gain_db=np.stack([_padded(each.radio_map.gain_db, frame, -np.inf) for each in solved]),
            distance_to_go=np.stack(
                [_padded(each.distance_to_go, frame, np.inf) for each in solved]
            ),
            irs=np.array(
                [irs_settings(scene, scene.phase_bits) for scene in scenes], dtype=np.float32
            ),
            start=np.array([each.start for each in solved], dtype=np.int64),
            goal=np.array([each.goal for each in solved], dtype=np.int64),
        )

    @classmethod
    def joined(cls, shards: Sequence["Shard"], count: int) -> "Shard":
        """The first ``count`` scenes of shards in a row."""
        return cls(
            **{
                name: np.concatenate([vars(each)[name] for each in shards])[:count]
                for name in _names()
            }
        )

    def to_bytes(self, definition: str) -> bytes:
        """An ``.npz`` archive that names what it should hold, and the SHA-256 of what it does."""
        content = BytesIO()
        said = np.array([definition.encode(), self._digest(definition)])
        np.savez_compressed(content, said=said, **{name: vars(self)[name] for name in _names()})

        return content.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes, definition: str) -> "Shard":
        """Shard of an archive; never unpickles. Raises ``ValueError`` for one that is damaged or
        another's.
        """
        try:
            arrays = read_arrays(content, needed=["said", *_names()])
            shard = cls(**{name: arrays[name] for name in _names()})
            if arrays["said"].tolist() != [definition.encode(), shard._digest(definition)]:
                raise ValueError("it holds something else")

            shard._check(json.loads(definition))
        except ValueError as error:
            raise ValueError(f"not the shard {definition}: {error}") from None

        return shard

    def _check(self, definition: dict[str, Any]) -> None:
        """Refuse arrays of other shapes or types than a shard has, and cells off its maps."""
        count = definition["count"]
        frame = definition["frame"]
        shapes = {"gain_db": (count, *frame), "distance_to_go": (count, *frame), "irs": (count, 3)}
        shapes |= {
            "texts": (count,),
            "target_db": (count,),
            "start": (count, 2),
            "goal": (count, 2),
        }
        kinds = {"texts": "S", "irs": "f4", "start": "i8", "goal": "i8"}

        for name, shape in shapes.items():
            array: NDArray[Any] = getattr(self, name)
            if array.shape != shape or not array.dtype.str[1:].startswith(kinds.get(name, "f8")):
                raise ValueError(f"{name} has the shape {array.shape} and the type {array.dtype}")

        ends = np.concatenate([self.start, self.goal])
        if (ends < 0).any() or (ends >= frame).any() or not np.isfinite(self.target_db).all():
            raise ValueError("start, goal or target_db has a value that none can have")

    def _digest(self, definition: str) -> bytes:
        """The SHA-256 of the definition and of all arrays, in hexadecimal digits."""
        # types and shapes as well, so that no two different shards have the same bytes
        summed = sha256(definition.encode())
        for name in _names():
            array = vars(self)[name]
            summed.update(f"{name} {array.dtype.str} {array.shape}".encode())
            summed.update(array.tobytes())

        return summed.hexdigest().encode()


def build_shard(
    split: str, first: int, count: int, report: Callable[[], Any] = lambda: None
) -> Shard:
    """The scenes ``first`` to before ``first + count`` of a split.

    ``report`` is called after each.
    """
    solved = []

    for index in range(first, first + count):
        solved.append(solved_scene_of(split, index))
        report()

    return Shard.of(solved, split_of(split).frame)


def definition_of(split: str, first: int, count: int) -> str:
    """All that the content of a shard depends on, in one line."""
    # the versions, so that a shard of older formulas or another generator is not taken for it
    chosen = split_of(split)
    difficulty = asdict(chosen.difficulty)
    for name in ("rooms", "family", "other_sides", "access_points"):
        # shards of before there was such a field are as good as new ones
        if getattr(chosen.difficulty, name) == getattr(Difficulty, name):
            del difficulty[name]

    return json.dumps(
        {
            "format_version": 1,
            "generator_version": VERSION,
            "physics_version": PHYSICS_VERSION,
            "split": split,
            "number": chosen.number,
            "difficulty": difficulty,
            "first": first,
            "count": count,
            "frame": chosen.frame,
            "cell_size": CELL_SIZE,
        }
    )


def _names() -> list[str]:
    return [each.name for each in fields(Shard)]


def _padded(
    array: NDArray[np.float64], frame: tuple[int, int], value: float
) -> NDArray[np.float64]:
    over = [(0, whole - part) for whole, part in zip(frame, array.shape, strict=True)]
    return np.pad(array, over, constant_values=value)


if __name__ == "__main__":
    _which = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    sys.stdout.buffer.write(build_shard(*_which).to_bytes(definition_of(*_which)))
