"""`PAGE_SETS`: the sets of scenes on the page of unseen scenes, by their names."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eval.unseen.scores import HARD, PAPER_TARGETS_DB, detours, paper_scene_set
from irs_gym.datasets.generator import CELL_SIZE, Difficulty, draw_solved_scene
from irs_gym.datasets.scene_set import SceneSet, build_scene_set, scene_set_of, solved_scene_set
from irs_gym.datasets.solved_scene import radio_map_of
from irs_gym.datasets.splits import FAMILIES, SPLITS
from irs_gym.radio.scene import AccessPoint, Obstacle, Room, Scene, load_scene

Track = Literal["map", "local"]
SCENES = 1000  # of a frozen set
LARGE_SCENES = 20
DRAWN_ANEW = {"test": 2000, "ood-clutter": 3000}  # where frozen sets tell no small differences
ANEW_SEED = 200  # and the split's number: of scenes drawn anew
WALL_DETOURS = tuple(range(8, 161, 8))  # metres: of the ways around single walls
_LARGE_FRAME = (160, 160)
_WALL_ROOM = (12.0, 80.0)  # metres, of a single wall
_HEIGHT = 5.0  # metres, of that room and wall
_SLACK_DB = 1.0  # that a target which excludes no cell lies below the worst of them


@dataclass(frozen=True, kw_only=True)
class PageSet:
    """A set of scenes that no policy of the page has learned on.

    Attributes
    ----------
    what
        What kind of scenes it has, in words.
    build
        Its first scenes, so many.
    most
        How many there are.
    """

    what: str
    build: Callable[[int], SceneSet]
    most: int = SCENES


@dataclass(frozen=True, eq=False)
class SetFacts:
    """What a page needs of a set of scenes without its maps; arrays of shape ``(S,)``.

    Attributes
    ----------
    checksum
        SHA-256 of all that a policy's episodes depend on.
    shape
        Cells (X, Y) of the largest map's frame.
    oracle_distance, target_db
        Of each scene.
    is_hard
        Whether its detour is above `HARD`.
    """

    checksum: str
    shape: tuple[int, int]
    oracle_distance: NDArray[np.float64]
    target_db: NDArray[np.float64]
    is_hard: NDArray[np.bool_]

    @classmethod
    def of(cls, pool: SceneSet) -> "SetFacts":
        """Of a set."""
        return cls(
            checksum=checksum_of(pool),
            shape=pool.shape,
            oracle_distance=pool.oracle_distance,
            target_db=pool.target_db,
            is_hard=detours(pool) > HARD,
        )

    def __len__(self) -> int:
        return len(self.oracle_distance)


def checksum_of(pool: SceneSet) -> str:
    """SHA-256 of names, maps, targets, starts and goals of a set."""
    digest = sha256(repr((pool.names, pool.shape, pool.cell_size)).encode())
    arrays = (pool.gain_db, pool.distance_to_go, pool.target_db, pool.irs, pool.start, pool.goal)
    for each in arrays:
        digest.update(np.ascontiguousarray(each).data)

    return digest.hexdigest()


# --- sets that are no split -----------------------------------------------------------------------


def anew(split: str, scenes: int) -> SceneSet:
    """Scenes of the kind of a split, from other seeds."""
    chosen = SPLITS[split]
    return _drawn(
        f"{split}-anew", ANEW_SEED + chosen.number, chosen.difficulty, chosen.frame, scenes
    )


def large_scene_set(scenes: int) -> SceneSet:
    """Scenes of four times the usual sides, with as many boxes for the area: maps of 112 to 160
    cells a side.
    """
    level = Difficulty(sides=(56.0, 80.0), boxes=(48, 192))
    return _drawn("large", 160, level, _LARGE_FRAME, scenes)


def large_maze_set(scenes: int) -> SceneSet:
    """Mazes of four times the usual sides, with corridors as wide as in the others."""
    level = Difficulty(family="maze", sides=(56.0, 80.0), boxes=(0, 0), panels=("none",))
    return _drawn("large-maze", 161, level, _LARGE_FRAME, scenes)


def _drawn(
    name: str, seed: int, level: Difficulty, frame: tuple[int, int], scenes: int
) -> SceneSet:
    drawn = [draw_solved_scene(np.random.default_rng([seed, n]), level) for n in range(scenes)]
    return solved_scene_set(drawn, tuple(f"{name}-{n}" for n in range(scenes)), frame)


def wall_scene_set(scenes: int) -> SceneSet:
    """Single walls of one row of cells in a hall, with start and goal on their two sides, and ways
    around of `WALL_DETOURS`. They end on either side and start on either, in turn, so that no order
    in which moves are tried knows the way.
    """
    ways = WALL_DETOURS[:scenes]
    return scene_set_of(
        [wall_scene(each, n % 2 == 1, n // 2 % 2 == 1) for n, each in enumerate(ways)],
        [f"wall-{each}" for each in ways],
    )


def wall_scene(way_m: float, is_mirrored: bool = False, is_reversed: bool = False) -> Scene:
    """A wall that leaves one row of cells free at its end, and a way around it of that length.

    The target excludes no cell: the wall alone decides. Mirrored, the wall ends on the other side;
    reversed, start and goal are exchanged.
    """
    half_x, half_y = (side / 2 for side in _WALL_ROOM)
    end = half_y - CELL_SIZE
    # past the end by half a cell, across two cells, and back
    beside = end + CELL_SIZE / 2 - (way_m - 2 * CELL_SIZE) / 2
    side = -1.0 if is_mirrored else 1.0
    ends = [(-CELL_SIZE / 2, side * beside), (3 * CELL_SIZE / 2, side * beside)]
    start, goal = reversed(ends) if is_reversed else ends
    paper = load_scene("paper")

    scene = Scene(
        name=f"wall-{way_m:g}",
        room=Room(x_min=-half_x, x_max=half_x, y_min=-half_y, y_max=half_y, height=_HEIGHT),
        obstacles=(
            Obstacle(
                center=(CELL_SIZE / 2, side * (end - half_y) / 2),
                size=(CELL_SIZE, end + half_y, _HEIGHT),
            ),
        ),
        access_points=(AccessPoint(position=(0.0, side * half_y, _HEIGHT - 1.0)),),
        irs_panels=(),
        antenna_height=paper.antenna_height,
        start=start,
        goal=goal,
        carrier_ghz=paper.carrier_ghz,
        rician_factor_db=paper.rician_factor_db,
        path_loss=paper.path_loss,
    )
    gain_db = radio_map_of(scene, CELL_SIZE).gain_db  # (X, Y)
    worst = float(gain_db[np.isfinite(gain_db)].min())

    return scene.model_copy(update={"target_db": round(worst - _SLACK_DB, 2)})


# --- all of them ----------------------------------------------------------------------------------

_FAMILIES = {
    "maze": "a tree of corridors with some ways around",
    "doors": "6 to 14 rooms with doors",
    "spiral": "one wall that winds inwards",
    "zigzag": "walls across the room, with a door at one end and the other in turn",
    "trap": "walls in the shape of a U, in which the robot starts",
    "racks": "a warehouse: racks with aisles, of which pallets close some",
    "hall": "26 to 32 m by 10 to 14 m, with boxes",
    "aps": "2 to 4 access points",
}
_USUAL = {
    "test": "the usual factories, as in the split `train`",
    "ood-clutter": "13 to 24 boxes, more than in any usual factory",
    "ood-irs": "no panel, two, or one with fewer or more elements than any usual factory's",
    "ood-size": "twice the sides, and as many boxes for the area",
    "ood-rooms": "walls with doors: 4 to 10 rooms, and 4 boxes at most",
}


def _split(name: str, what: str) -> PageSet:
    return PageSet(what=what, build=partial(build_scene_set, name))


PAGE_SETS: Mapping[str, PageSet] = {
    **{name: _split(name, what) for name, what in _USUAL.items()},
    **{f"ood-{name}": _split(f"ood-{name}", _FAMILIES[name]) for name in FAMILIES},
    **{
        f"{name}-anew": PageSet(
            what=f"of the kind of {name}, from other seeds",
            build=partial(anew, name),
            most=size,
        )
        for name, size in DRAWN_ANEW.items()
    },
    "160x160": PageSet(
        what="four times the sides, and as many boxes for the area",
        build=large_scene_set,
        most=LARGE_SCENES,
    ),
    "160x160-maze": PageSet(
        what="mazes of four times the sides",
        build=large_maze_set,
        most=LARGE_SCENES,
    ),
    "walls": PageSet(
        what="one wall, and a way around it of 8, 16, ... 160 m",
        build=wall_scene_set,
        most=len(WALL_DETOURS),
    ),
    "paper": PageSet(
        what="the paper's scene at five targets",
        build=lambda _: paper_scene_set(),
        most=len(PAPER_TARGETS_DB),
    ),
}


@lru_cache(maxsize=1)  # several policies in turn play the same
def page_scene_set(name: str, scenes: int) -> SceneSet:
    """The first scenes of a set."""
    return PAGE_SETS[name].build(scenes)


def scenes_of(name: str, scenes: int) -> int:
    """How many scenes of a set are played where so many are asked for."""
    return min(scenes, PAGE_SETS[name].most)
