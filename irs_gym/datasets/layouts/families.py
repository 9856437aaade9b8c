"""`FAMILIES`: kinds of factories whose walls decide the way, each drawn at random on cells."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from irs_gym.datasets.layouts.floor_plan import DOOR, THICKNESS, draw_walls
from irs_gym.radio.scene import Obstacle, Room

Bools = NDArray[np.bool_]
FamilyName = Literal["maze", "doors", "spiral", "zigzag", "trap", "racks"]

ROOMS = (6, 14)  # of "doors"
MAZE_CORRIDOR = (1, 3)  # cells: least and greatest width
MOST_LOOPS = 0.15  # greatest share of a maze's inner walls that are left out, for ways around
SPIRAL_CORRIDOR = (2, 4)  # cells
ZIGZAG_CORRIDOR = (2, 6)  # cells
TRAPS = (1, 3)
TRAP_SIDE = (8, 18)  # cells: of a U, outside
TRAP_TRIES = 40  # places tried for a U
RACK_DEPTH = 2  # cells
RACK_HEIGHT_DM = (20, 40)  # tenths of a metre
AISLE = (2, 4)  # cells
CROSS_AISLES = (1, 2)
BLOCKED_AISLE = 0.2  # probability that a pallet closes a stretch of an aisle


@dataclass(frozen=True, eq=False)
class Layout:
    """What stands in a room, and where a robot may start.

    Attributes
    ----------
    obstacles
        Boxes.
    starts
        bool, shape ``(X, Y)``: cells that the task may start in; None for all.
    """

    obstacles: tuple[Obstacle, ...]
    starts: Bools | None = None


def draw_layout(
    rng: np.random.Generator, family: FamilyName, room: Room, cell_size: float
) -> Layout:
    """The walls of a family, drawn for a room.

    Walls stand on lines of cell centres and take one row of cells each, as those of
    `irs_gym.datasets.layouts.floor_plan.draw_walls`.
    """
    return FAMILIES[family](rng, room, cell_size)


# --- the families ---------------------------------------------------------------------------------


def _maze(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """A spanning tree of corridors of one width, with some walls left out."""
    shape = _shape(room, cell_size)
    width = _whole(rng, *MAZE_CORRIDOR)
    pitch = width + 1
    # The last corridor is as wide as what is left.
    nodes = ((shape[0] + 1) // pitch, (shape[1] + 1) // pitch)
    number = np.arange(nodes[0] * nodes[1]).reshape(nodes)
    ends = np.concatenate(
        [
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
        ]
    )  # (E, 2)

    # Kruskal's tree of random weights, and some edges more.
    weights = 1.0 - rng.random(len(ends))
    graph = coo_array((weights, ends.T), shape=(number.size, number.size))
    tree = minimum_spanning_tree(graph.tocsr()).tocoo()
    kept = np.stack([tree.row, tree.col], axis=1)  # (N - 1, 2)
    is_open = np.isin(_code(ends, number.size), _code(kept, number.size))
    is_open |= rng.random(len(ends)) < rng.random() * MOST_LOOPS

    # All lines of the lattice are walls, but for the openings.
    is_wall = np.zeros(shape, dtype=bool)
    lines = tuple(np.arange(1, each) * pitch - 1 for each in nodes)
    is_wall[lines[0]] = True
    is_wall[:, lines[1]] = True
    for low, high in ends[is_open].tolist():
        # Both nodes and what is between them, as the higher lies above the lower or right of it.
        where = tuple(
            slice(
                _span(lines[axis], shape[axis], first)[0], _span(lines[axis], shape[axis], last)[1]
            )
            for axis, (first, last) in enumerate(
                zip(divmod(low, nodes[1]), divmod(high, nodes[1]), strict=True)
            )
        )
        is_wall[where] = False

    return Layout(_boxes(is_wall, room, cell_size))


def _doors(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """Rooms with doors."""
    return Layout(draw_walls(rng, room, _whole(rng, *ROOMS), cell_size))


def _spiral(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """One wall that winds inwards from the room's."""
    turned = _turned(rng, _shape(room, cell_size))
    is_wall = np.zeros(turned.shape, dtype=bool)
    width = _whole(rng, *SPIRAL_CORRIDOR)
    # The cells that the wall's next corners lie on: below, right, above, left.
    low_y = width
    high_x = turned.shape[0] - 1 - width
    high_y = turned.shape[1] - 1 - width
    low_x = width
    begin = 0

    while high_x - begin > width and high_y - low_y > width:
        is_wall[begin : high_x + 1, low_y] = True
        is_wall[high_x, low_y : high_y + 1] = True
        low_y += width + 1
        if high_x - low_x <= width or high_y - low_y < width:
            break

        is_wall[low_x : high_x + 1, high_y] = True
        is_wall[low_x, low_y : high_y + 1] = True
        begin = low_x
        low_x += width + 1
        high_x -= width + 1
        high_y -= width + 1

    return Layout(_boxes(turned.back(is_wall), room, cell_size))


def _zigzag(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """Walls across the room with a door at one end and the other in turn."""
    turned = _turned(rng, _shape(room, cell_size))
    is_wall = np.zeros(turned.shape, dtype=bool)
    at = _whole(rng, *ZIGZAG_CORRIDOR)
    is_low = True

    while at < turned.shape[0] - ZIGZAG_CORRIDOR[0]:
        door = _whole(rng, *DOOR)
        is_wall[at, door:] = is_low
        is_wall[at, : turned.shape[1] - door] |= not is_low
        is_low = not is_low
        at += 1 + _whole(rng, *ZIGZAG_CORRIDOR)

    return Layout(_boxes(turned.back(is_wall), room, cell_size))


def _trap(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """Walls in the shape of a U, in which the robot starts."""
    shape = _shape(room, cell_size)
    is_wall = np.zeros(shape, dtype=bool)
    is_inside = np.zeros(shape, dtype=bool)
    is_taken = np.zeros(shape, dtype=bool)  # with two cells around, for a way between
    waiting = _whole(rng, *TRAPS)

    for _ in range(TRAP_TRIES):
        side = (_whole(rng, *TRAP_SIDE), _whole(rng, *TRAP_SIDE))
        highest = [shape[axis] - side[axis] - 2 for axis in (0, 1)]
        low = [_whole(rng, 2, max(2, each)) for each in highest]
        where = tuple(slice(low[axis], low[axis] + side[axis]) for axis in (0, 1))
        opening = _whole(rng, 0, 3)
        if min(highest) < 2 or is_taken[where].any():
            continue

        # The open side keeps its corners, in which the sides beside it end.
        walls = np.ones(side, dtype=bool)
        walls[1:-1, 1:-1] = False
        is_inside[where] = ~walls
        end = -(opening % 2)  # 0, the first line, or -1, the last
        walls[(end, slice(1, -1)) if opening < 2 else (slice(1, -1), end)] = False
        is_wall[where] = walls

        is_taken[tuple(slice(max(0, each.start - 2), each.stop + 2) for each in where)] = True
        waiting -= 1
        if not waiting:
            break

    return Layout(_boxes(is_wall, room, cell_size), is_inside)


def _racks(rng: np.random.Generator, room: Room, cell_size: float) -> Layout:
    """Rows of racks with aisles between them, cross aisles, and pallets that close some aisles."""
    turned = _turned(rng, _shape(room, cell_size))
    columns, rows = turned.shape
    height = _whole(rng, *RACK_HEIGHT_DM) / 10

    # Where racks are along x: between the cross aisles, from wall to wall or not.
    gaps = sorted(
        _whole(rng, columns // 4, 3 * columns // 4) for _ in range(_whole(rng, *CROSS_AISLES))
    )
    edges = [0 if rng.random() < 0.7 else AISLE[0]]
    for gap in gaps:
        edges += [gap, gap + _whole(rng, *DOOR)]
    edges.append(columns if rng.random() < 0.7 else columns - AISLE[0])
    stretches = [(edges[n], edges[n + 1]) for n in range(0, len(edges), 2)]
    stretches = [each for each in stretches if each[1] - each[0] >= RACK_DEPTH]

    boxes: list[tuple[int, int, int, int]] = []  # first and end along x and y, in cells
    at = _whole(rng, *AISLE)
    while at + RACK_DEPTH + AISLE[0] <= rows:
        aisle = _whole(rng, *AISLE)
        for first, end in stretches:
            boxes.append((first, end, at, at + RACK_DEPTH))
            place = _whole(rng, first, end - 1)
            top = min(at + RACK_DEPTH + aisle, rows)
            if rng.random() < BLOCKED_AISLE:
                boxes.append((place, place + 1, at + RACK_DEPTH, top))
        at += RACK_DEPTH + aisle

    is_filled = [turned.back(_block(turned.shape, each)) for each in boxes]
    return Layout(tuple(_solid(each, room, cell_size, height) for each in is_filled))


FAMILIES: dict[FamilyName, Callable[[np.random.Generator, Room, float], Layout]] = {
    "maze": _maze,
    "doors": _doors,
    "spiral": _spiral,
    "zigzag": _zigzag,
    "trap": _trap,
    "racks": _racks,
}


# --- cells ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Turned:
    """A map that is drawn one way, and turned into one of eight."""

    shape: tuple[int, int]  # as drawn
    is_transposed: bool
    is_mirrored: tuple[bool, bool]

    def back(self, cells: Bools) -> Bools:
        """The cells ``(X, Y)`` of the room, of those drawn."""
        steps = tuple(slice(None, None, -1 if each else 1) for each in self.is_mirrored)
        mirrored = cells[steps]
        return mirrored.T if self.is_transposed else mirrored


def _turned(rng: np.random.Generator, shape: tuple[int, int]) -> _Turned:
    is_transposed = rng.random() < 0.5
    is_mirrored = (rng.random() < 0.5, rng.random() < 0.5)
    return _Turned(shape[::-1] if is_transposed else shape, is_transposed, is_mirrored)


def _shape(room: Room, cell_size: float) -> tuple[int, int]:
    columns = round((room.x_max - room.x_min) / cell_size)
    rows = round((room.y_max - room.y_min) / cell_size)
    return columns, rows


def _span(lines: NDArray[np.int64], cells: int, at: int) -> tuple[int, int]:
    """The cells between a lattice's lines, first and end, of a node's number along one axis."""
    first = 0 if at == 0 else int(lines[at - 1]) + 1
    end = cells if at == len(lines) else int(lines[at])
    return first, end


def _code(ends: NDArray[np.int64], nodes: int) -> NDArray[np.int64]:
    """A number for each edge ``(E, 2)``, whichever end comes first."""
    return np.asarray(ends.min(axis=1).astype(np.int64) * nodes + ends.max(axis=1))


def _block(shape: tuple[int, int], box: tuple[int, int, int, int]) -> Bools:
    cells = np.zeros(shape, dtype=bool)
    cells[box[0] : box[1], box[2] : box[3]] = True
    return cells


# --- from cells to boxes --------------------------------------------------------------------------


def _boxes(is_wall: Bools, room: Room, cell_size: float) -> tuple[Obstacle, ...]:
    """Thin walls from floor to ceiling along all rows and columns of two wall cells or more."""
    along_x = _runs(is_wall)
    along_y = _runs(is_wall.T)
    lower = np.array(room.lower)
    boxes = []

    for axis, runs, others in ((0, along_x, along_y), (1, along_y, along_x)):
        # Where a wall ends in another, it ends in the middle of its cell, as that one is there.
        crossed = {(line, at) for line, first, end in others for at in range(first, end)}
        for line, first, end in runs:
            begins, stops = first * cell_size, end * cell_size
            inner = (cell_size - THICKNESS) / 2
            begins += inner if (first, line) in crossed else 0.0
            stops -= inner if (end - 1, line) in crossed else 0.0
            middle = np.array([(begins + stops) / 2, (line + 0.5) * cell_size])
            size = np.array([stops - begins, THICKNESS])
            boxes.append(_box(lower + middle[:: 1 - 2 * axis], size[:: 1 - 2 * axis], room.height))

    return tuple(boxes)


def _runs(is_wall: Bools) -> list[tuple[int, int, int]]:
    """Wall cells in a row along the first axis, two or more: their line, first and end."""
    found = []
    for line, cells in enumerate(is_wall.T):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], cells, [False]]).astype(int)))
        for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if end - first >= 2:
                found.append((line, first, end))

    return found


def _solid(is_filled: Bools, room: Room, cell_size: float, height: float) -> Obstacle:
    """The box that fills a rectangle of cells."""
    cells = np.argwhere(is_filled)
    low = cells.min(axis=0) * cell_size
    high = (cells.max(axis=0) + 1) * cell_size
    return _box(np.array(room.lower) + (low + high) / 2, high - low, height)


def _box(center: NDArray[np.float64], size: NDArray[np.float64], height: float) -> Obstacle:
    x, y = np.round(center, 4).tolist()
    width, depth = np.round(size, 4).tolist()
    return Obstacle(center=(x, y), size=(width, depth, height))


def _whole(rng: np.random.Generator, low: int, high: int) -> int:
    return int(rng.integers(low, high, endpoint=True))
