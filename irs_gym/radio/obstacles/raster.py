"""`Raster`: blocked cells of one height, which points they hold, and how often they cut lines of
sight.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.memory import check_memory
from irs_gym.radio.geometry import TOUCH, Segments
from irs_gym.units import Floats

Counts = NDArray[np.int64]

_COLUMNS_BETWEEN = 8
_RUN_BYTES = 4000  # for each rectangle that is joined with others


@dataclass(frozen=True, eq=False)
class Raster:
    """The open area of blocked square cells and of the sides that they share, up to a height.

    Attributes
    ----------
    is_filled
        Bool, shape ``(X, Y)``, ``[i, j]`` with i along x: the blocked cells.
    cell_size
        Edge of a cell in metres.
    origin
        Lower left corner in metres.
    height
        In metres.
    """

    is_filled: NDArray[np.bool_]
    cell_size: float
    origin: tuple[float, float]
    height: float

    @property
    def touch(self) -> float:
        """`TOUCH` in cells."""
        return TOUCH / self.cell_size

    @cached_property
    def footprint(self) -> Any:
        """The blocked cells as one ``shapely`` area."""
        # cells in a row along y as one rectangle: (X, Y + 1) with 1 where one begins, -1 after it
        edges = np.diff(np.pad(self.is_filled.astype(np.int8), ((0, 0), (1, 1))), axis=1)
        first = np.argwhere(edges == 1)  # (n, 2)
        after = np.argwhere(edges == -1) + np.array([1, 0])  # (n, 2)
        columns, rows = self.is_filled.shape
        check_memory(f"rows: the outline of {columns} x {rows} cells", _RUN_BYTES * len(first))
        low = first * self.cell_size + self.origin
        high = after * self.cell_size + self.origin

        return shapely.union_all(shapely.box(*low.T, *high.T))

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points ``(..., 2)`` in metres lie strictly inside; shape ``(...)``."""
        places = ((points - self.origin) / self.cell_size).reshape(-1, 2)
        nearest = np.rint(places)
        is_on_line = np.abs(places - nearest) <= self.touch  # (n, 2)

        # on the line between two cells, both must be blocked; at a corner, all four
        upper = np.where(is_on_line, nearest, np.floor(places)).astype(np.int64)  # (n, 2)
        lower = upper - is_on_line
        inside = np.ones(len(places), dtype=bool)
        for i in (lower[:, 0], upper[:, 0]):
            for j in (lower[:, 1], upper[:, 1]):
                inside &= self._filled(i, j)

        return inside.reshape(points.shape[:-1])

    def _filled(self, i: Counts, j: Counts) -> NDArray[np.bool_]:
        """Whether cells are blocked; those outside are not."""
        columns, rows = self.is_filled.shape
        is_inside = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
        blocked = self.is_filled[i.clip(0, columns - 1), j.clip(0, rows - 1)]
        return np.asarray(is_inside & blocked)

    def crossings(self, segments: Segments, *, at_most_one: bool) -> Counts:
        """How often each of n segments runs through blocked cells, shape ``(n,)``; or any number
        above 0 where it does, where one time is as good as many.

        Column by column of cells: what a segment crosses of one is a run of cells from its lowest
        to its highest there.
        """
        counts = np.zeros(len(segments.start), dtype=np.int64)
        which, low, high = segments.clipped(self.height)
        ends = np.stack([low, high])  # (2, n, 2)
        cells = (ends - self.origin) / self.cell_size
        is_filled = self.is_filled

        # along the shorter side there are fewer columns
        if is_filled.shape[0] > is_filled.shape[1]:
            cells, is_filled = cells[..., ::-1], is_filled.T

        # the ends in the order of x
        order = np.argsort(cells[..., 0], axis=0)  # (2, n)
        first, last = np.take_along_axis(cells, order[..., None], axis=0)  # (n, 2) each
        is_upright = last[:, 0] - first[:, 0] <= 2 * self.touch
        lying = np.flatnonzero(~is_upright)
        upright = np.flatnonzero(is_upright)
        counts[which[lying]] = _lying(
            first[lying], last[lying], is_filled, self.touch, at_most_one=at_most_one
        )
        counts[which[upright]] = _upright(first[upright], last[upright], is_filled, self.touch)

        return counts


def _lying(
    first: Floats, last: Floats, is_filled: NDArray[np.bool_], touch: float, *, at_most_one: bool
) -> Counts:
    """Runs of blocked cells on segments ``(n, 2)`` in cells, none along y."""
    counts = np.zeros(len(first), dtype=np.int64)
    which = np.argsort(first[:, 0])  # from here on in the order in which they begin
    first = first[which]
    last = last[which]

    for n, i in enumerate(np.flatnonzero(is_filled.any(axis=1))):
        # now and then, those that have ended are left out, and those that are known to be blocked
        if n % _COLUMNS_BETWEEN == 0:
            is_open = (last[:, 0] > i) & ~(at_most_one & (counts[which] > 0))
            which = which[is_open]
            first = first[is_open]
            last = last[is_open]

        begun = int(np.searchsorted(first[:, 0], i + 1))
        begin = np.maximum(first[:begun, 0], i)
        end = np.minimum(last[:begun, 0], i + 1)
        here = np.flatnonzero(end - begin > touch)
        if not len(here):
            continue

        # where the piece in this column begins and ends along y
        x, y = first[here].T
        along_x, along_y = (last[here] - first[here]).T
        at_begin = y + (begin[here] - x) / along_x * along_y
        at_end = y + (end[here] - x) / along_x * along_y
        column = is_filled[i]
        runs = _runs(column, np.minimum(at_begin, at_end), np.maximum(at_begin, at_end), touch)

        # a run that began in the column before is one with that
        if i > 0 and not at_most_one:
            is_across = (begin[here] == i) & (x < i - touch)
            runs -= is_across & _is_inside(column & is_filled[i - 1], at_begin, touch)

        counts[which[here]] += runs

    return counts


def _upright(first: Floats, last: Floats, is_filled: NDArray[np.bool_], touch: float) -> Counts:
    """Runs of blocked cells on segments ``(n, 2)`` in cells, all along y."""
    counts = np.zeros(len(first), dtype=np.int64)
    x = (first[:, 0] + last[:, 0]) / 2
    line = np.rint(x)
    is_on_line = np.abs(x - line) <= 2 * touch
    low = np.minimum(first[:, 1], last[:, 1])
    high = np.maximum(first[:, 1], last[:, 1])
    columns = is_filled.shape[0]

    # on a line between columns, only what is blocked on both sides counts
    places = np.where(is_on_line, line, np.floor(x) + 0.5)
    for place in np.unique(places):
        left = int(np.ceil(place)) - 1
        right = int(np.floor(place))
        if left < 0 or right >= columns:
            continue

        here = np.flatnonzero(places == place)
        counts[here] = _runs(is_filled[left] & is_filled[right], low[here], high[here], touch)

    return counts


def _runs(column: NDArray[np.bool_], low: Floats, high: Floats, touch: float) -> Counts:
    """Runs of blocked cells of one column on ways from ``low`` to ``high`` ``(n,)`` along it."""
    first = np.floor(low + touch).astype(np.int64).clip(0, None)
    last = (np.ceil(high - touch).astype(np.int64) - 1).clip(None, len(column) - 1)
    begins = np.cumsum(column & ~np.append(False, column[:-1]))  # of runs, up to each cell

    # a way that keeps to one line between cells has no cell of its own
    on_line = _is_inside(column, (low + high) / 2, touch)
    from_cell = first.clip(None, len(column) - 1)
    runs = column[from_cell] + begins[last.clip(0, None)] - begins[from_cell]
    is_along_line = np.floor(low + touch) > np.ceil(high - touch) - 1

    return np.where(is_along_line, on_line, np.where(first <= last, runs, 0))


def _is_inside(column: NDArray[np.bool_], at: Floats, touch: float) -> NDArray[np.bool_]:
    """Whether places ``(n,)`` along a column are strictly inside its blocked cells."""
    padded = np.pad(column, 1)  # nothing is blocked beyond either end
    line = np.rint(at)
    is_on_line = np.abs(at - line) <= 2 * touch
    upper = np.where(is_on_line, line, np.floor(at)).astype(np.int64)
    lower = upper - is_on_line
    last = len(padded) - 1

    return np.asarray(padded[(upper + 1).clip(0, last)] & padded[(lower + 1).clip(0, last)])
