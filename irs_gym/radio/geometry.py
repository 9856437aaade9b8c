"""`Boxes`: axis-aligned boxes, which points they hold and which lines of sight they cut;
`Segments`: lines of sight from many points to one.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Metres, and fraction of a segment: less overlap than this is a touch, not an intersection.
TOUCH = 1e-9

# Metres and radians by which a rectangle is widened before what cannot meet it is left out.
_NEAR = 1e-3
_ASIDE = 1e-5


@dataclass(frozen=True)
class Boxes:
    """Open boxes, given by their lower and upper corners, each of shape ``(B, 3)`` in metres."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Places:
    """Points on the floor ``(n, 2)`` in metres, at hand by their x."""

    points: NDArray[np.float64]

    @cached_property
    def _by_x(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        order = np.argsort(self.points[:, 0])
        return order, self.points[order, 0]

    def within(self, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.intp]:
        """Numbers of the points in a rectangle, its border included."""
        order, x = self._by_x
        first = np.searchsorted(x, lower[0], side="left")
        near = order[first : np.searchsorted(x, upper[0], side="right")]
        y = self.points[near, 1]

        return np.asarray(near[(y >= lower[1]) & (y <= upper[1])])


def is_in_footprint(points: NDArray[np.float64], boxes: Boxes) -> NDArray[np.bool_]:
    """Whether points ``(..., 2)`` in metres lie strictly inside the floor area of any box; shape
    ``(...)``.
    """
    places = Places(points.reshape(-1, 2))
    inside = np.zeros(len(places.points), dtype=bool)

    for low, high in zip(boxes.lower[:, :2], boxes.upper[:, :2], strict=True):
        near = places.within(low, high)
        here = places.points[near]
        inside[near] |= np.all((here > low + TOUCH) & (here < high - TOUCH), axis=-1)

    return inside.reshape(points.shape[:-1])


def is_line_of_sight(
    points: NDArray[np.float64], target: ArrayLike, boxes: Boxes
) -> NDArray[np.bool_]:
    """Whether the straight segments from ``points`` ``(..., 3)`` to one ``target`` ``(3,)`` miss
    every box.

    Slab method: a segment is blocked where its chord through an open box is longer than `TOUCH`
    times the segment. A ray that only grazes a face, an edge or a corner is not blocked. Returns
    shape ``(...)``.
    """
    segments = Segments.of(points, target)
    clear = np.ones(len(segments.start), dtype=bool)

    for low, high in zip(boxes.lower, boxes.upper, strict=True):
        near = segments.over(low[:2], high[:2])
        near = near[clear[near]]
        clear[near] = ~is_cut(segments, near, low, high)

    return clear.reshape(points.shape[:-1])


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight segments from points ``start`` ``(n, 3)`` to one point ``end`` ``(3,)``, in
    metres.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]

    @classmethod
    def of(cls, points: NDArray[np.float64], target: ArrayLike) -> "Segments":
        """Segments from points ``(..., 3)``, taken in a row."""
        return cls(points.reshape(-1, 3), np.asarray(target, dtype=np.float64))

    @cached_property
    def _way(self) -> NDArray[np.float64]:
        return self.end - self.start  # (n, 3)

    @cached_property
    def _by_angle(self) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """The segments in the order of their angles as seen from the end, and these angles."""
        angles = np.arctan2(-self._way[:, 1], -self._way[:, 0])  # (n,)
        order = np.argsort(angles)
        return order, angles[order]

    @cached_property
    def _length(self) -> NDArray[np.float64]:
        return np.hypot(self._way[:, 0], self._way[:, 1])  # (n,), on the floor

    def over(self, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.intp]:
        """Numbers of all segments that may pass over a rectangle of the floor, and of few others.

        From the end, the rectangle hides a range of angles and all that is behind it.
        """
        corners = np.array(
            [(lower[0], lower[1]), (upper[0], lower[1]), (upper[0], upper[1]), (lower[0], upper[1])]
        )
        apart = np.maximum(np.maximum(lower - self.end[:2], self.end[:2] - upper), 0.0)
        nearest = float(np.hypot(*apart))
        if nearest <= _NEAR:
            return np.arange(len(self.start))

        # the range of angles about that of the middle, less than half a turn
        middle = corners.mean(axis=0) - self.end[:2]
        ahead = float(np.arctan2(middle[1], middle[0]))
        seen = np.arctan2(*(corners - self.end[:2]).T[::-1]) - ahead
        aside = np.mod(seen + np.pi, 2 * np.pi) - np.pi  # (4,)
        begin = ahead + float(aside.min()) - _ASIDE
        end = ahead + float(aside.max()) + _ASIDE

        order, angles = self._by_angle
        pieces = [
            order[slice(*np.searchsorted(angles, (begin + turn, end + turn)))]
            for turn in (-2 * np.pi, 0.0, 2 * np.pi)
        ]
        near = np.concatenate(pieces)

        return near[self._length[near] >= nearest - _NEAR]

    def clipped(
        self, height: float
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """What lies between the floor and a height: the numbers of m segments, and the two ends of
        these parts of them on the floor, each ``(m, 2)``.
        """
        near, far = _slab(self.start[:, 2], self._way[:, 2], TOUCH, height - TOUCH)
        enter = np.maximum(near, 0.0)
        leave = np.minimum(far, 1.0)
        which = np.flatnonzero(leave - enter > TOUCH)
        start = self.start[which, :2]
        way = self._way[which, :2]

        return which, start + enter[which, None] * way, start + leave[which, None] * way


def is_cut(
    segments: Segments,
    which: NDArray[np.intp],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether an open box with the corners ``low`` and ``high`` ``(3,)`` is in the way of each of
    these segments; shape ``(m,)``.
    """
    start = segments.start[which]
    return _chord(start, segments.end - start, low + TOUCH, high - TOUCH) > TOUCH


def _chord(
    start: NDArray[np.float64],
    direction: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Fraction of each segment inside one box, at most 0 where it misses the box.

    The box is where three slabs overlap, one an axis. On the segment start + t direction, t from 0
    to 1, each slab is entered at one t and left at another; the segment is in the box from the last
    entry to the first exit.
    """
    enter = np.zeros(start.shape[:-1])
    leave = np.ones(start.shape[:-1])

    for axis in range(3):
        near, far = _slab(start[..., axis], direction[..., axis], low[axis], high[axis])
        enter = np.maximum(enter, near)
        leave = np.minimum(leave, far)

    return leave - enter


def _slab(
    origin: NDArray[np.float64], slope: NDArray[np.float64], low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where lines origin + t slope enter and leave what is between two planes."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low = (low - origin) / slope
        to_high = (high - origin) / slope

    # A segment parallel to a slab lies in it for its whole length or not at all.
    parallel = slope == 0.0
    within = (origin > low) & (origin < high)
    near = np.where(parallel, np.where(within, -np.inf, np.inf), np.minimum(to_low, to_high))
    far = np.where(parallel, np.where(within, np.inf, -np.inf), np.maximum(to_low, to_high))

    return near, far
