"""`SmallFamily`: rooms so few and so small that the best policy without knowing which one it is in
can be computed; all there are of a kind, or some that are drawn.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from irs_gym.datasets.generator import Difficulty, draw_solved_scene
from irs_gym.datasets.layouts.families import FamilyName, draw_layout
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import Cell, Grid
from irs_gym.mdp.packing import MARGIN_SCALE_DB
from irs_gym.oracle.shortest_path import distance_to_go, highest_feasible_target
from irs_gym.radio.geometry import Boxes, is_in_footprint
from irs_gym.radio.scene import Room

CELL_SIZE = 0.5  # metres
LAYOUT_SIDE = 6.0  # metres: of the rooms that layouts of the generator are drawn in
RADIO_SIDE = 6.0  # metres: of the rooms of the generator
OPEN_DOOR = 0.6  # probability
OPEN_AISLE = 0.5  # probability
CLOSED_CELLS = 0.35  # share, of scattered ones
# Drawn where the mouth of a trap, its bottom and its arms are, in cells of a room of 12 x 12.
TRAPS = ((2, 4), (7, 9), (1, 2, 3, 4), (7, 8, 9, 10))

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SmallFamily:
    """S rooms with one start and one goal, and how likely each is.

    Attributes
    ----------
    words
        What they are.
    feasible
        bool, shape ``(S, X, Y)``.
    weights
        float64, shape ``(S,)``: probabilities.
    start, goal
        Cells.
    """

    words: str
    feasible: Bools
    weights: Floats
    start: Cell
    goal: Cell

    def __len__(self) -> int:
        return len(self.feasible)


Maps = Iterable[tuple[Bools, float]]
"""Rooms ``(X, Y)``, each with a number in proportion to how likely it is."""


def listed_families() -> dict[str, SmallFamily]:
    """Families of which all scenes are there, so that to know the list is to know the
    distribution.
    """
    return {
        "door": _family("a wall with one door, anywhere", _doors((12, 12), (6,)), (0, 5), (11, 5)),
        "two doors": _family(
            "two walls, each with one door", _doors((12, 10), (4, 7)), (0, 5), (11, 5)
        ),
        "three doors": _family(
            "three walls, each with one door", _doors((12, 8), (3, 6, 9)), (0, 4), (11, 4)
        ),
        "rooms": _family(
            f"3 x 3 rooms; each of the 12 doors between them is open with probability {OPEN_DOOR}",
            _rooms(),
            (1, 1),
            (9, 9),
        ),
        "maze": _family(
            "all spanning trees of 3 x 3 places, with corridors of 1 m",
            _mazes((3, 3)),
            (0, 0),
            (7, 7),
        ),
        "large maze": _family(
            "all spanning trees of 3 x 4 places", _mazes((3, 4)), (0, 0), (7, 10)
        ),
        "aisles": _family(
            "five aisles; pallets close each, but for the first, "
            f"with probability {1 - OPEN_AISLE}, anywhere",
            _aisles(),
            (0, 6),
            (11, 6),
        ),
        "traps": _family(
            "a U of any size that opens towards the start, with a hole in its bottom or none",
            _traps(),
            (0, 6),
            (11, 6),
        ),
    }


def drawn_families(count: int) -> dict[str, SmallFamily]:
    """Families of which there are so many draws, but for equal ones and those whose goal cannot be
    reached; fewer are the first of more.
    """
    corners = ((0, 0), (11, 11))
    generators = [np.random.default_rng((0, n)) for n in range(3)]

    return {
        "layouts": _family(
            "walls of the generator's six families in rooms of 6 m",
            _layouts(generators[0], count),
            *corners,
        ),
        "scattered": _family(
            f"each cell closed with probability {CLOSED_CELLS}",
            _scattered(generators[1], count),
            *corners,
        ),
        "radio": _family(
            "factories of 6 m of the generator, at targets up to 0.5 dB below the highest",
            _radio(generators[2], count),
            *corners,
        ),
    }


def scene_set(family: SmallFamily) -> SceneSet:
    """The rooms as scenes without a panel: feasible cells lie so far above the target, and others
    so far below, that margins tell nothing more.
    """
    count = len(family)
    to_go = [distance_to_go(each, family.goal, CELL_SIZE) for each in family.feasible]

    return SceneSet(
        scenes=(),
        names=tuple(f"small-{n}" for n in range(count)),
        target_db=np.zeros(count),
        gain_db=np.where(family.feasible, MARGIN_SCALE_DB, -MARGIN_SCALE_DB),
        distance_to_go=np.stack(to_go),
        irs=np.full((count, 3), -1.0, dtype=np.float32),
        start=np.tile(np.array(family.start), (count, 1)),
        goal=np.tile(np.array(family.goal), (count, 1)),
        cell_size=CELL_SIZE,
    )


def _family(words: str, maps: Maps, start: Cell, goal: Cell) -> SmallFamily:
    """The different ones of the rooms whose goal can be reached."""
    weight: dict[bytes, float] = {}
    shape = (0, 0)

    for feasible, likely in maps:
        shape = (feasible.shape[0], feasible.shape[1])
        weight[feasible.tobytes()] = weight.get(feasible.tobytes(), 0.0) + likely

    each = [np.frombuffer(room, dtype=bool).reshape(shape) for room in weight]
    can_reach = [_connects(feasible, start, goal) for feasible in each]
    feasible = np.stack(each)[can_reach]
    weights = np.array(list(weight.values()))[can_reach]

    return SmallFamily(words, feasible, weights / weights.sum(), start, goal)


def _connects(feasible: Bools, start: Cell, goal: Cell) -> bool:
    return bool(
        feasible[start]
        and feasible[goal]
        and np.isfinite(distance_to_go(feasible, goal, CELL_SIZE)[start])
    )


# --- all that there are ---------------------------------------------------------------------------


def _doors(shape: tuple[int, int], walls: tuple[int, ...]) -> Maps:
    """Walls across the room, each with a door of one cell."""
    for doors in product(range(shape[1]), repeat=len(walls)):
        feasible = np.ones(shape, dtype=bool)
        for wall, door in zip(walls, doors, strict=True):
            feasible[wall] = False
            feasible[wall, door] = True
        yield feasible, 1.0


def _rooms() -> Maps:
    """3 x 3 rooms of 3 x 3 cells, with doors in the middle of walls."""
    closed = np.ones((11, 11), dtype=bool)
    closed[[3, 7]] = False
    closed[:, [3, 7]] = False
    doors = [(wall, middle) for wall in (3, 7) for middle in (1, 5, 9)]
    doors += [(middle, wall) for wall, middle in doors]

    for is_open in product((True, False), repeat=len(doors)):
        feasible = closed.copy()
        for door, state in zip(doors, is_open, strict=True):
            feasible[door] = state
        yield feasible, OPEN_DOOR ** sum(is_open) * (1 - OPEN_DOOR) ** (12 - sum(is_open))


def _mazes(places: tuple[int, int]) -> Maps:
    """Corridors of two cells between walls of one."""
    number = np.arange(places[0] * places[1]).reshape(places)
    links = [*zip(number[:-1].ravel().tolist(), number[1:].ravel().tolist(), strict=True)]
    links += zip(number[:, :-1].ravel().tolist(), number[:, 1:].ravel().tolist(), strict=True)
    shape = (3 * places[0] - 1, 3 * places[1] - 1)
    walls = np.zeros(shape, dtype=bool)
    for i, j in np.ndindex(places):
        walls[3 * i : 3 * i + 2, 3 * j : 3 * j + 2] = True

    for tree in combinations(links, number.size - 1):
        ends = np.array(tree).T  # (2, N - 1)
        graph = coo_array((np.ones(len(tree)), ends), shape=(number.size, number.size))
        if connected_components(graph, directed=False)[0] > 1:
            continue

        feasible = walls.copy()
        for low, high in tree:
            (i, j), (i_high, j_high) = divmod(low, places[1]), divmod(high, places[1])
            feasible[3 * i : 3 * i_high + 2, 3 * j : 3 * j_high + 2] = True
        yield feasible, 1.0


def _aisles() -> Maps:
    """Racks along x with aisles of one cell between two halls; the first is never closed."""
    racks = np.ones((12, 9), dtype=bool)
    racks[2:10, 1::2] = False
    places = (3, 6, 9)

    for pallets in product((None, *places), repeat=4):
        feasible = racks.copy()
        likely = 1.0
        for aisle, pallet in zip((2, 4, 6, 8), pallets, strict=True):
            if pallet is None:
                likely *= OPEN_AISLE
            else:
                feasible[pallet, aisle] = False
                likely *= (1 - OPEN_AISLE) / len(places)
        yield feasible, likely


def _traps() -> Maps:
    """Walls in the shape of a U between start and goal."""
    for mouth, bottom, low, high in product(*TRAPS):
        for hole in (None, (low + high) // 2):
            feasible = np.ones((12, 12), dtype=bool)
            feasible[mouth : bottom + 1, [low, high]] = False
            feasible[bottom, low : high + 1] = False
            if hole is not None:
                feasible[bottom, hole] = True
            yield feasible, 1.0


# --- drawn ----------------------------------------------------------------------------------------


def _layouts(rng: np.random.Generator, count: int) -> Maps:
    """Walls of the generator's families, each as often."""
    half = LAYOUT_SIDE / 2
    room = Room(x_min=-half, x_max=half, y_min=-half, y_max=half, height=4.0)
    grid = Grid.tile(room.lower, room.upper, CELL_SIZE)
    names = get_args(FamilyName)

    for n in range(count):
        obstacles = draw_layout(rng, names[n % len(names)], room, CELL_SIZE).obstacles
        corners = [[getattr(box, end) for box in obstacles] for end in ("lower", "upper")]
        boxes = Boxes(*(np.array(each).reshape(-1, 3) for each in corners))
        yield ~is_in_footprint(grid.centres(), boxes), 1.0


def _scattered(rng: np.random.Generator, count: int) -> Maps:
    """Cells closed at random, but for start and goal."""
    for _ in range(count):
        feasible = rng.random((12, 12)) >= CLOSED_CELLS
        feasible[0, 0] = feasible[-1, -1] = True
        yield feasible, 1.0


def _radio(rng: np.random.Generator, count: int) -> Maps:
    """Maps of generated factories at a target up to the highest from corner to corner."""
    level = Difficulty(sides=(RADIO_SIDE, RADIO_SIDE), boxes=(1, 3), detour_share=0.0)
    for _ in range(count):
        gain_db = draw_solved_scene(rng, level).radio_map.gain_db
        highest = highest_feasible_target(gain_db, (0, 0), (11, 11))
        if np.isfinite(highest):
            # as hard as it can be: half a decibel below the highest target
            yield gain_db >= highest - rng.random() / 2, 1.0
