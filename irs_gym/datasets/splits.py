"""`SPLITS`: the sets of generated scenes that agents are trained and tested on."""

import json
import re
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from importlib import resources
from typing import Any

import numpy as np

from irs_gym.datasets.generator import DIFFICULTIES, VERSION, Difficulty, draw_solved_scene
from irs_gym.datasets.solved_scene import SolvedScene
from irs_gym.radio.scene import Scene

TRAINING = 1000  # numbers from here on, and 0, are those of sets to learn on
_DIGITS = 8  # of a scene's SHA-256 that are kept of the frozen sets
_SHARE = re.compile(r"([1-9][0-9]?)\*(.+)")  # of a turn, in the name of joined sets


@dataclass(frozen=True, kw_only=True)
class Split:
    """A set of generated scenes."""

    number: int
    """Where its seeds begin: scene n is drawn from the seed (generator version, number, n)."""
    size: int
    """Scenes that there are."""
    difficulty: Difficulty = DIFFICULTIES["default"]
    """What they are drawn from."""
    frame: tuple[int, int] = (40, 40)
    """Cells (X, Y) of all maps, whatever their room."""

    @property
    def is_frozen(self) -> bool:
        """Whether it never changes within a version of the environment: scores are of such sets."""
        return 0 < self.number < TRAINING


# Kinds of factories beside the usual, each with a frozen set, "ood-maze", and one to learn on,
# "train-maze". In the first six walls alone decide, and detours are from 1.2 to 6.
FAMILIES: dict[str, Difficulty] = {
    # a spanning tree of corridors of 0.5 to 1.5 m, with some ways around
    "maze": Difficulty(family="maze", boxes=(0, 0), panels=("none",)),
    # 6 to 14 rooms
    "doors": Difficulty(family="doors", boxes=(0, 2)),
    # one wall that winds inwards
    "spiral": Difficulty(family="spiral", boxes=(0, 0), panels=("none",)),
    # walls across the room, with a door at one end and the other in turn
    "zigzag": Difficulty(family="zigzag", boxes=(0, 0), panels=("none",)),
    # walls in the shape of a U, in which the robot starts
    "trap": Difficulty(family="trap", boxes=(0, 3), panels=("usual", "none")),
    # a warehouse: racks with aisles, some of which are closed
    "racks": Difficulty(family="racks", sides=(16.0, 20.0), boxes=(0, 0)),
    # long and narrow: 26 to 32 m by 10 to 14 m
    "hall": Difficulty(
        sides=(26.0, 32.0), other_sides=(10.0, 14.0), boxes=(4, 14), panels=("usual", "none")
    ),
    # 2 to 4 access points
    "aps": Difficulty(access_points=(2, 4), panels=("usual", "none")),
}
_FRAMES = {"hall": (64, 64)}


def _family_splits(prefix: str, first: int, size: int) -> dict[str, Split]:
    """A split of each family, numbered from the first on."""
    return {
        f"{prefix}-{name}": Split(
            number=first + n, size=size, difficulty=each, frame=_FRAMES.get(name, Split.frame)
        )
        for n, (name, each) in enumerate(FAMILIES.items())
    }


SPLITS = {
    "train": Split(number=0, size=1_000_000),
    "val": Split(number=1, size=1000),
    "test": Split(number=2, size=1000),
    # more boxes than in any training scene
    "ood-clutter": Split(number=3, size=1000, difficulty=Difficulty(boxes=(13, 24))),
    # no panel, two, or one with fewer or more elements than any training scene's
    "ood-irs": Split(
        number=4, size=1000, difficulty=Difficulty(panels=("none", "two", "small", "large"))
    ),
    # twice the sides, and as many boxes for the area
    "ood-size": Split(
        number=5,
        size=1000,
        difficulty=Difficulty(sides=(28.0, 40.0), boxes=(12, 48)),
        frame=(80, 80),
    ),
    # walls with doors, and little else in the way
    "ood-rooms": Split(number=6, size=1000, difficulty=Difficulty(rooms=(4, 10), boxes=(0, 4))),
    **_family_splits("ood", first=7, size=1000),
    **_family_splits("train", first=TRAINING + 7, size=1_000_000),
}


def split_of(name: str) -> Split:
    """A split by its name; a ``ValueError`` lists all for an unknown one.

    Sets to learn on may be joined, "train+train-maze": scenes are those of each in turn, of
    "2*train+train-maze" two of the first and then one of the second.
    """
    members = members_of(name)
    unknown = [each for each in members if not isinstance(each, str) or each not in SPLITS]
    if unknown:
        raise ValueError(f"split={unknown[0]!r} must be one of {tuple(SPLITS)}")

    each = {member: SPLITS[member] for member in members}
    if len(members) == 1:
        return each[members[0]]
    if len(each) == 1 or any(one.is_frozen for one in each.values()):
        raise ValueError(f"split={name!r} must join different sets to learn on")

    columns, rows = zip(*(one.frame for one in each.values()), strict=True)
    turns = min(one.size // members.count(member) for member, one in each.items())
    size = len(members) * turns

    return Split(number=0, size=size, frame=(max(columns), max(rows)))


def members_of(name: str) -> tuple[str, ...]:
    """The names of the splits that are joined, each as often as a turn has scenes of it, in order;
    one alone is its own.
    """
    if not isinstance(name, str):
        return (name,)

    members: list[str] = []
    for part in name.split("+"):
        found = _SHARE.fullmatch(part)
        times, member = found.groups() if found else (1, part)
        members += [member] * int(times)

    return tuple(members)


def all_but(family: str) -> str:
    """The sets to learn on without that of a family, joined: what to learn from where the family
    itself is what is scored.

    Raises ``ValueError`` where there is no such family.
    """
    if family not in FAMILIES:
        raise ValueError(f"family={family!r} must be one of {tuple(FAMILIES)}")
    return "+".join(["train", *(f"train-{name}" for name in FAMILIES if name != family)])


def scene_of(split: str, index: int) -> Scene:
    """A scene of a split by its number, from 0; raises ``ValueError`` where there is none."""
    return solved_scene_of(split, index).scene


def solved_scene_of(split: str, index: int) -> SolvedScene:
    """The scene of `scene_of` with its map and distances to go."""
    chosen = split_of(split)
    if not 0 <= index < chosen.size:
        raise ValueError(
            f"index={index} must be a number from 0 to {chosen.size - 1}: "
            f"{split!r} has no more scenes"
        )

    members = members_of(split)
    if len(members) > 1:
        turn, place = divmod(index, len(members))
        member = members[place]
        own = turn * members.count(member) + members[:place].count(member)
        return solved_scene_of(member, own)

    # a seed of its own for each scene, so that any one can be drawn without those before it
    rng = np.random.default_rng((VERSION, chosen.number, index))
    solved = draw_solved_scene(rng, chosen.difficulty)
    scene = solved.scene.model_copy(update={"name": f"{split}-{index}"})

    return SolvedScene(scene, solved.radio_map, solved.distance_to_go)


def check_frozen(split: str, texts: list[bytes]) -> None:
    """Refuse scenes, as JSON from the first on, that are not those of a frozen split.

    Raises
    ------
    RuntimeError
        Where a scene is another: scores on it could not be compared.
    """
    if not split_of(split).is_frozen:
        return

    for index, (wanted, text) in enumerate(zip(frozen()[split].scenes, texts, strict=False)):
        if digest(text) != wanted:
            raise RuntimeError(
                f"scene {split}-{index} is not the one that was frozen, drawn with NumPy "
                f"{np.__version__}: scores on it could not be compared with others. "
                "Install a version of NumPy from the time of this release"
            )


@dataclass(frozen=True)
class Frozen:
    """What is kept of a frozen split."""

    sha256: str  # of the JSON of all its scenes, one a line
    scenes: tuple[str, ...]  # the start of each one's own SHA-256


def digest(text: bytes) -> str:
    """The start of the SHA-256 of a scene's JSON."""
    return sha256(text).hexdigest()[:_DIGITS]


@lru_cache(maxsize=1)
def frozen() -> dict[str, Frozen]:
    """What is kept of each frozen split; ``python -m irs_gym.datasets.verify_splits`` holds it
    against the scenes.
    """
    record: dict[str, Any] = json.loads(
        resources.files("irs_gym.datasets").joinpath("splits.json").read_bytes()
    )
    kept = {}

    for name, entry in record["splits"].items():
        digits = "".join(entry["scenes"])
        scenes = tuple(digits[n : n + _DIGITS] for n in range(0, len(digits), _DIGITS))
        kept[name] = Frozen(entry["sha256"], scenes)

    return kept
