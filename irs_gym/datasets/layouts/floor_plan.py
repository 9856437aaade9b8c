"""`draw_walls`: thin walls with doors, drawn at random, that divide a floor into rooms."""

from dataclasses import dataclass

import numpy as np

from irs_gym.grid import Cell
from irs_gym.radio.scene import Obstacle, Room

THICKNESS = 0.2  # metres
LEAST_SIDE = 5  # cells of a room
DOOR = (2, 3)  # cells: least and greatest width
SECOND_DOOR = 0.3  # probability that a wall has another door, so that there are ways around
TRIES = 20  # places tried for a wall


@dataclass(frozen=True)
class _Area:
    """Cells from ``low`` to before ``high`` that no wall divides."""

    low: Cell
    high: Cell

    @property
    def sides(self) -> tuple[int, int]:
        """Cells along x and y."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]


def draw_walls(
    rng: np.random.Generator, room: Room, rooms: int, cell_size: float
) -> tuple[Obstacle, ...]:
    """Walls from floor to ceiling that divide a room into so many, or fewer where no more fit.

    A wall stands on a line of cell centres, so that it takes one row of cells, and has one door or
    two, each two or three cells wide. All rooms are connected: each wall divides one of them, and
    none ends in a door.
    """
    columns = round((room.x_max - room.x_min) / cell_size)
    rows = round((room.y_max - room.y_min) / cell_size)
    waiting = [_Area((0, 0), (columns, rows))]
    undivided = 0
    doors: set[Cell] = set()
    walls: list[Obstacle] = []

    # the largest is divided, until there are enough
    while waiting and len(waiting) + undivided < rooms:
        area = max(waiting, key=lambda each: each.sides[0] * each.sides[1])
        waiting.remove(area)
        axis = int(area.sides[1] > area.sides[0])  # the longer side is cut
        at = _place(rng, area, axis, doors)
        if at is None:
            undivided += 1
            continue

        gaps = _draw_doors(rng, area, axis)
        doors |= {_cell(axis, at, along) for gap in gaps for along in range(*gap)}
        walls += _pieces(room, area, axis, at, gaps, cell_size)
        waiting += _halves(area, axis, at)

    return tuple(walls)


def _place(rng: np.random.Generator, area: _Area, axis: int, doors: set[Cell]) -> int | None:
    """The column (or row) of cells that a wall takes, with a room on either side and no door at its
    ends; None where none was found.
    """
    low = area.low[axis] + LEAST_SIDE
    high = area.high[axis] - LEAST_SIDE - 1
    if low > high:
        return None

    for _ in range(TRIES):
        at = int(rng.integers(low, high, endpoint=True))
        ends = (area.low[1 - axis] - 1, area.high[1 - axis])
        if not any(_cell(axis, at, end) in doors for end in ends):
            return at

    return None


def _draw_doors(rng: np.random.Generator, area: _Area, axis: int) -> list[tuple[int, int]]:
    """One door or two in a wall across the axis: from which cell to before which, in order."""
    low = area.low[1 - axis]
    high = area.high[1 - axis]
    gaps: list[tuple[int, int]] = []

    for _ in range(1 + int(rng.random() < SECOND_DOOR)):
        width = int(rng.integers(*DOOR, endpoint=True))
        first = int(rng.integers(low, high - width, endpoint=True))
        # a second one that meets the first would leave no wall between them
        if all(first > after or first + width < begin for begin, after in gaps):
            gaps.append((first, first + width))

    return sorted(gaps)


def _pieces(
    room: Room,
    area: _Area,
    axis: int,
    at: int,
    gaps: list[tuple[int, int]],
    cell_size: float,
) -> list[Obstacle]:
    """What stands of a wall between its doors, as boxes."""
    across = (room.x_min, room.y_min)[axis] + (at + 0.5) * cell_size
    origin = (room.x_min, room.y_min)[1 - axis]
    begins = [area.low[1 - axis], *(after for _, after in gaps)]
    ends = [*(first for first, _ in gaps), area.high[1 - axis]]
    pieces = []

    for begin, end in zip(begins, ends, strict=True):
        if begin == end:
            continue

        middle = origin + (begin + end) / 2 * cell_size
        length = (end - begin) * cell_size
        center = (across, middle) if axis == 0 else (middle, across)
        size = (THICKNESS, length) if axis == 0 else (length, THICKNESS)
        pieces.append(Obstacle(center=center, size=(*size, room.height)))

    return pieces


def _halves(area: _Area, axis: int, at: int) -> list[_Area]:
    """What is on either side of a wall."""
    below = list(area.high)
    above = list(area.low)
    below[axis] = at
    above[axis] = at + 1

    return [_Area(area.low, (below[0], below[1])), _Area((above[0], above[1]), area.high)]


def _cell(axis: int, at: int, along: int) -> Cell:
    return (at, along) if axis == 0 else (along, at)
