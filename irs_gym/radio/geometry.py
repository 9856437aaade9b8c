"""`Boxes`: axis-aligned boxes, which points they hold and which lines of sight they cut."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Metres, and fraction of a segment: less overlap than this is a touch, not an intersection.
TOUCH = 1e-9


@dataclass(frozen=True)
class Boxes:
    """Open boxes, given by their lower and upper corners, each of shape ``(B, 3)`` in metres."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]


def is_in_footprint(points: NDArray[np.float64], boxes: Boxes) -> NDArray[np.bool_]:
    """Whether points ``(..., 2)`` in metres lie strictly inside the floor area of any box; shape
    ``(...)``.
    """
    inside = np.zeros(points.shape[:-1], dtype=bool)

    for low, high in zip(boxes.lower, boxes.upper, strict=True):
        inside |= np.all((points > low[:2] + TOUCH) & (points < high[:2] - TOUCH), axis=-1)

    return inside


def is_line_of_sight(
    points: NDArray[np.float64], target: ArrayLike, boxes: Boxes
) -> NDArray[np.bool_]:
    """Whether the straight segments from ``points`` ``(..., 3)`` to one ``target`` ``(3,)`` miss
    every box.

    Slab method: a segment is blocked where its chord through an open box is longer than `TOUCH`
    times the segment. A ray that only grazes a face, an edge or a corner is not blocked. Returns
    shape ``(...)``.
    """
    direction = np.asarray(target, dtype=np.float64) - points  # (..., 3)
    clear = np.ones(points.shape[:-1], dtype=bool)

    for low, high in zip(boxes.lower, boxes.upper, strict=True):
        clear &= _chord(points, direction, low + TOUCH, high - TOUCH) <= TOUCH

    return clear


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
        origin = start[..., axis]
        slope = direction[..., axis]

        with np.errstate(divide="ignore", invalid="ignore"):
            to_low = (low[axis] - origin) / slope
            to_high = (high[axis] - origin) / slope

        # A segment parallel to a slab lies in it for its whole length or not at all.
        parallel = slope == 0.0
        within = (origin > low[axis]) & (origin < high[axis])
        near = np.where(parallel, np.where(within, -np.inf, np.inf), np.minimum(to_low, to_high))
        far = np.where(parallel, np.where(within, np.inf, -np.inf), np.maximum(to_low, to_high))

        enter = np.maximum(enter, near)
        leave = np.minimum(leave, far)

    return leave - enter
