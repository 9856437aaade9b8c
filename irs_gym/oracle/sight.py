"""`Sight`: whether points of a map see each other over its closed feasible cells."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import SNAP
from irs_gym.memory import freeze

# In cells: what runs this near to a border runs along it, and what overlaps a cell by no more does
# not enter it. More than rounding, and far less than a line between corners can miss a corner by.
TOLERANCE = 1e-10

# (n, 2), in cells from the map's lower left corner
Points = NDArray[np.floating[Any]]


class Sight:
    """Judges the segments between points: they may run along borders of feasible cells, and pass
    between two that touch at a corner only.

    Parameters
    ----------
    feasible
        Shape ``(X, Y)``.
    corner_cutting
        Whether a segment may pass between two cells that touch at a corner only; it may begin and
        end there.

    Examples
    --------
    >>> sight = Sight(np.array([[True, False], [True, True]]))
    >>> ends = np.array([[1.5, 1.5], [1.4, 1.5]])
    >>> sight.between(np.array([[0.5, 0.5], [0.5, 0.5]]), ends).tolist()
    [True, False]
    """

    def __init__(self, feasible: NDArray[np.bool_], corner_cutting: bool = True) -> None:
        # a ring of infeasible cells lies around the map, flat, along either axis
        ring = np.pad(feasible, 1)  # (X + 2, Y + 2)
        self._cells = np.stack([ring.ravel(), ring.T.ravel()]).ravel()
        self._strides = np.array([ring.shape[1], ring.shape[0]])
        self._contacts = None if corner_cutting else corner_contacts(feasible)
        freeze(self._cells, self._strides, self._contacts)

    def cell_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """A feasible flat cell whose closed square holds each of the points ``(n, 2)``, ``(n,)``;
        -1 where there is none.
        """
        columns, rows = self._strides[::-1] - 2
        on_ring = np.clip(points, -0.5, (columns + 0.5, rows + 0.5))
        around = cells_around(on_ring)  # (n, 4, 2)
        is_feasible = self._cells[(around[..., 0] + 1) * (rows + 2) + around[..., 1] + 1]
        one = np.take_along_axis(around, is_feasible.argmax(axis=1)[:, None, None], axis=1)[:, 0]

        return np.where(is_feasible.any(axis=1), one[:, 0] * rows + one[:, 1], -1)

    def between(self, begins: Points, ends: Points) -> NDArray[np.bool_]:
        """Whether each of the segments ``(n, 2)`` to ``(n, 2)`` lies within the feasible cells,
        ``(n,)``.

        A segment is cut into pieces, one in each column of cells that it crosses, or in each row
        where it rises steeper than 45 degrees: a piece then enters two cells at the most.
        """
        apart = ends - begins
        is_steep = np.abs(apart[:, 1]) > np.abs(apart[:, 0])  # (n,)
        along = np.where(is_steep, begins[:, 1], begins[:, 0])
        across = np.where(is_steep, begins[:, 0], begins[:, 1])
        length = np.where(is_steep, apart[:, 1], apart[:, 0])
        width = np.where(is_steep, apart[:, 0], apart[:, 1])
        slope = np.divide(width, length, out=np.zeros(len(begins)), where=length != 0)

        # the pieces of all segments behind each other, (m,)
        low = np.minimum(along, along + length)
        high = np.maximum(along, along + length)
        first = np.floor(low + TOLERANCE).astype(np.int64)
        count = np.maximum(np.ceil(high - TOLERANCE).astype(np.int64) - first, 0)
        segment = np.repeat(np.arange(len(begins)), count)
        column = np.arange(len(segment)) + (first - np.cumsum(count) + count)[segment]

        # where they begin and end across, in order
        offset = (across - along * slope)[segment]
        tilt = slope[segment]
        enters = offset + tilt * np.maximum(column, low[segment])
        leaves = offset + tilt * np.minimum(column + 1, high[segment])
        lower = np.floor(np.minimum(enters, leaves) + TOLERANCE).astype(np.int64)
        upper = np.ceil(np.maximum(enters, leaves) - TOLERANCE).astype(np.int64) - 1

        # one along a border enters neither of the two cells beside it: it needs one of them
        turned = is_steep[segment].astype(np.int64)
        base = (column + 1) * self._strides[turned] + 1 + turned * (len(self._cells) // 2)
        one = self._cells[base + lower]
        other = self._cells[base + upper]
        is_free = np.where(upper < lower, one | other, one & other)

        is_seen = np.ones(len(begins), dtype=bool)
        is_seen[segment[~is_free]] = False
        if self._contacts is None:
            return is_seen

        # those that pass a contact on their way from one column to the next
        border = column + 1
        corner = np.rint(leaves).astype(np.int64)
        is_near = (np.abs(leaves - corner) <= TOLERANCE) & (border < high[segment] - TOLERANCE)
        x = np.where(turned, corner, border)[is_near]
        y = np.where(turned, border, corner)[is_near]
        is_seen[segment[is_near][self._contacts[x, y]]] = False

        return is_seen


def in_cells(
    points: NDArray[np.float64], cell_size: float, origin: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points in metres ``(..., 2)`` in cells from the map's lower left corner: on a border where
    they are next to it.
    """
    position = (points - origin) / cell_size
    border = np.rint(position)

    return np.where(np.abs(position - border) < SNAP, border, position)


def cells_around(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cells (i, j) whose closed squares hold points ``(n, 2)`` in cells, ``(n, 4, 2)``: four
    around a corner, else some of them several times; they may lie off the map.
    """
    ends = np.stack([np.floor(points), np.ceil(points) - 1], axis=1).astype(np.int64)  # (n, 2, 2)

    return np.stack([ends[:, (0, 0, 1, 1), 0], ends[:, (0, 1, 0, 1), 1]], axis=-1)


def blocked_around(feasible: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Whether each of the four cells around each corner (i, j) of cells is infeasible, as all are
    outside of the map: south-west, south-east, north-west, north-east, ``(X + 1, Y + 1)`` each.
    """
    blocked = np.pad(~feasible, 1, constant_values=True)
    return [blocked[:-1, :-1], blocked[1:, :-1], blocked[:-1, 1:], blocked[1:, 1:]]


def corner_contacts(feasible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where two feasible cells touch at a corner only, ``(X + 1, Y + 1)``."""
    south_west, south_east, north_west, north_east = blocked_around(feasible)
    is_rising = ~south_west & ~north_east & south_east & north_west
    is_falling = south_west & north_east & ~south_east & ~north_west

    return is_rising | is_falling
