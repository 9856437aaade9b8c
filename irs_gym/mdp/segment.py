"""`walk`: how far a straight segment stays in the closed cells of a map, exactly; `walk_many`: of
many segments at once.

Points are in cells from the map's lower left corner, so that borders of cells are whole numbers and
a robot that stops at one stands on it without any rounding.
"""

from math import floor, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Cells: a point this near to a border is put on it. What it travels for that is counted.
SNAP = 1e-10
# Kinds of cells: with an obstacle or off the map, without one but not to be entered, to be entered.
OBSTACLE, BELOW, OPEN = range(3)
# Cells: a segment that misses a corner of cells by no more than this passes through it.
_TOUCH = 1e-11


class Walk(NamedTuple):
    """How far a robot has come on a segment."""

    share: float  # of the segment that it has travelled, from 0 to 1
    x: float  # where it is
    y: float
    blocked: int  # kind of the cell that was in the way; -1 where none was
    paid: float  # integral of the rates over the share


class Walks(NamedTuple):
    """How far n robots have come on segments: a `Walk` with arrays."""

    share: Floats  # (n,)
    at: Floats  # (2, n): x and y
    blocked: NDArray[np.integer[Any]]  # (n,)
    paid: Floats  # (n,)


def padded(cells: NDArray[Any], fill: Any) -> NDArray[Any]:
    """Maps ``(..., X, Y)`` with a border of one cell around each, ``(..., X + 2, Y + 2)``."""
    *maps, columns, rows = cells.shape
    bordered = np.full((*maps, columns + 2, rows + 2), fill, dtype=cells.dtype)
    bordered[..., 1:-1, 1:-1] = cells

    return bordered


def snapped(value: float) -> float:
    """The coordinate, put on a border that it is as near to as `SNAP`.

    Examples
    --------
    >>> snapped(2.9999999999999), snapped(2.9)
    (3.0, 2.9)
    """
    nearest = floor(value + 0.5)
    return float(nearest) if abs(value - nearest) <= SNAP else value


def snapped_many(values: Floats) -> Floats:
    """`snapped` of an array."""
    nearest = np.floor(values + 0.5)
    return np.where(np.abs(values - nearest) <= SNAP, nearest, values)


def walk(
    kinds: bytes,
    rate: list[float] | None,
    width: int,
    start: tuple[float, float],
    end: tuple[float, float],
    until: float = 1.0,
) -> Walk:
    """How far a robot comes that goes straight ahead as long as it is in an open cell.

    Cells are closed: along a border, one open cell of the two beside it is enough, and so the robot
    passes where open cells touch at a corner. Cells are visited as by Amanatides and Woo (1987).

    Parameters
    ----------
    kinds
        Of the cells of a padded map, flat; see `padded`.
    rate
        What a unit of the segment costs in each of these; None: nothing.
    width
        Rows of the padded map.
    start, end
        Snapped points, not the same, the first of them in an open cell.
    until
        Share of the segment to go at most.

    Examples
    --------
    >>> kinds = padded(np.array([[OPEN, OPEN], [BELOW, OPEN]], dtype=np.uint8), OBSTACLE)
    >>> walk(kinds.tobytes(), None, 4, (0.5, 0.5), (1.5, 0.5))[:4]
    (0.5, 1.0, 0.5, 1)
    >>> walk(kinds.tobytes(), None, 4, (0.5, 0.5), (1.5, 1.5))[:4]  # two cells that touch
    (1.0, 1.5, 1.5, -1)
    """
    u, v = start
    du = end[0] - u
    dv = end[1] - v
    i, step_i, next_u, t_u = _entered(u, du)
    j, step_j, next_v, t_v = _entered(v, dv)
    least = min(abs(du), abs(dv))
    cell = (i + 1) * width + j + 1
    # along a border, the other cell beside it
    aside = -width * (du == 0.0 and i == u) - (dv == 0.0 and j == v)
    on_u = on_v = False  # whether the robot is on a border that it has just come to
    paid = 0.0
    t = 0.0

    while (kind := max(kinds[cell], kinds[cell + aside])) == OPEN:
        first = t_u if t_u < t_v else t_v
        ahead = first if first < until else until
        if rate is not None:
            paid += (ahead - t) * _lower_rate(kinds, rate, cell, cell + aside)

        t = ahead
        if first >= until:
            # rounding leads nobody out of the cell
            x = end[0] if until == 1.0 else u + until * du
            y = end[1] if until == 1.0 else v + until * dv
            x = x if du == 0.0 else min(max(x, i), i + 1.0)
            y = y if dv == 0.0 else min(max(y, j), j + 1.0)
            return Walk(t, x, y, -1, paid)

        # into the next cell, over a border or two at once
        is_corner = abs(t_u - t_v) * least <= _TOUCH if least else False
        on_u = is_corner or t_u < t_v
        on_v = is_corner or not on_u
        if on_u:
            i += step_i
            cell += step_i * width
            next_u += step_i
            t_u = (next_u - u) / du
        if on_v:
            j += step_j
            cell += step_j
            next_v += step_j
            t_v = (next_v - v) / dv

    # on the border of the last open cell
    x = float(next_u - step_i) if on_u else snapped(u + t * du)
    y = float(next_v - step_j) if on_v else snapped(v + t * dv)
    return Walk(t, x, y, kind, paid)


def _entered(value: float, delta: float) -> tuple[int, int, int, float]:
    """Along one axis: the cell that a robot goes into, the step from one to the next, the border
    ahead, and the share of the segment at which it is crossed.
    """
    cell = floor(value)
    if delta > 0.0:
        return cell, 1, cell + 1, (cell + 1 - value) / delta
    if delta == 0.0:
        return cell, 0, cell, inf
    if cell == value:
        cell -= 1

    return cell, -1, cell, (cell - value) / delta


def _lower_rate(kinds: bytes, rate: list[float], cell: int, beside: int) -> float:
    """The rate in a cell and, along a border, the one beside it: the lower one of those that are
    open.
    """
    if kinds[cell] != OPEN:
        return rate[beside]
    if kinds[beside] != OPEN:
        return rate[cell]

    return min(rate[cell], rate[beside])


def walk_many(
    kinds: NDArray[np.uint8],
    rate: Floats | None,
    width: int,
    maps: Ints | int,
    start: Floats,
    end: Floats,
    until: Floats,
) -> Walks:
    """`walk` of n robots, number for number the same.

    Parameters
    ----------
    kinds, rate
        Of many padded maps, one behind the other, flat.
    width
        Rows of a padded map.
    maps
        Shape ``(n,)``: where that of each robot begins.
    start, end
        Shape ``(2, n)``.
    until
        Shape ``(n,)``.
    """
    delta = end - start
    walkers = _Walkers.of(width, maps, start, delta, until)
    count = len(until)
    share = until.copy()
    blocked = np.full(count, -1)
    paid = np.zeros(count)
    are_whole = bool((until == 1.0).all())
    at = end.copy() if are_whole else np.where(until == 1.0, end, start + until * delta)
    are_along = bool(walkers.aside.any())  # some borders

    while True:
        beside = cells = walkers.flat.astype(np.int64)
        kind = kinds.take(cells)
        if are_along:
            beside = cells - walkers.aside.astype(np.int64)
            kind = np.maximum(kind, kinds.take(beside))

        first = np.minimum(walkers.rows[4], walkers.rows[5])
        is_open = kind == OPEN
        is_there = is_open & (first >= walkers.until)

        if not is_open.all():
            stopped = walkers.of_some(np.flatnonzero(~is_open))
            who = stopped.robot
            share[who] = stopped.t
            blocked[who] = kind[~is_open]
            at[:, who] = stopped.on_border()

        if rate is not None:
            ahead = np.minimum(first, walkers.until)
            spent = (ahead - walkers.t) * _lower_rates(kinds, rate, cells, beside)
            paid[walkers.robot] += np.where(is_open, spent, 0.0)

        # whole segments end where they are asked to: on a border, or further from it than rounding
        if not are_whole:
            there = walkers.of_some(np.flatnonzero(is_there & (walkers.until < 1.0)))
            at[:, there.robot] = there.within_cell(at[:, there.robot])

        going = np.flatnonzero(is_open & ~is_there)
        if not going.size:
            return Walks(share, at, blocked, paid)

        walkers = walkers.of_some(going)
        walkers.step_on(first[going])


class _Walkers(NamedTuple):
    """Robots that are still on their way, in one array, so that some are picked in one go: all are
    whole numbers or floats, and the former exact.
    """

    width: int
    rows: NDArray[Any]  # (17, n)

    @classmethod
    def of(
        cls, width: int, maps: Ints | int, start: Floats, delta: Floats, until: Floats
    ) -> "_Walkers":
        """Robots that set out."""
        rows = np.zeros((17, len(until)))
        own = cls(width, rows)
        own.start[:] = start
        own.delta[:] = delta
        rows[12] = until

        # see `_entered`
        is_up = delta > 0.0
        is_down = delta < 0.0
        floors = np.floor(start)
        is_whole = floors == start
        cell = floors - (is_down & is_whole)
        own.border[:] = cell + is_up
        own.over[:] = is_up
        own.over[:] -= is_down
        own.cross[:] = inf
        np.divide(own.border - start, delta, out=own.cross, where=is_up | is_down)

        rows[14] = maps + (cell[0] + 1) * width + cell[1] + 1
        is_along = is_whole & (delta == 0.0)
        rows[15] = is_along[0] * width + is_along[1]
        rows[16] = np.arange(len(until))

        return own

    @property
    def start(self) -> Floats:
        """Shape ``(2, n)``."""
        return np.asarray(self.rows[0:2])

    @property
    def delta(self) -> Floats:
        """Shape ``(2, n)``."""
        return np.asarray(self.rows[2:4])

    @property
    def cross(self) -> Floats:
        """Shares at which the borders ahead are crossed, ``(2, n)``."""
        return np.asarray(self.rows[4:6])

    @property
    def border(self) -> Floats:
        """The borders ahead, ``(2, n)``."""
        return np.asarray(self.rows[6:8])

    @property
    def over(self) -> Floats:
        """Steps from one cell to the next, ``(2, n)``."""
        return np.asarray(self.rows[8:10])

    @property
    def is_on(self) -> Floats:
        """1 where a robot is on a border that it has just come to, ``(2, n)``."""
        return np.asarray(self.rows[10:12])

    @property
    def until(self) -> Floats:
        """Shares of the segments to go at most, ``(n,)``."""
        return np.asarray(self.rows[12])

    @property
    def t(self) -> Floats:
        """Shares that have been travelled, ``(n,)``."""
        return np.asarray(self.rows[13])

    @property
    def flat(self) -> Floats:
        """Padded cells that the robots go into, ``(n,)``."""
        return np.asarray(self.rows[14])

    @property
    def aside(self) -> Floats:
        """How far before it the other cell along a border comes, ``(n,)``; 0 off borders."""
        return np.asarray(self.rows[15])

    @property
    def robot(self) -> Ints:
        """Numbers of the robots, ``(n,)``."""
        return np.asarray(self.rows[16].astype(np.int64))

    def of_some(self, chosen: Ints) -> "_Walkers":
        """Some of the robots, in memory of their own."""
        return _Walkers(self.width, self.rows.take(chosen, axis=1))

    def on_border(self) -> Floats:
        """Points ``(2, n)`` on the borders that they have come to."""
        between = snapped_many(self.start + self.t * self.delta)
        return np.where(self.is_on > 0.0, self.border - self.over, between)

    def within_cell(self, at: Floats) -> Floats:
        """Points ``(2, n)``, kept within the cells where they move."""
        cell = self.border - (self.over > 0.0)
        within = np.minimum(np.maximum(at, cell), cell + 1.0)
        return np.where(self.delta == 0.0, at, within)

    def step_on(self, first: Floats) -> None:
        """Go into the next cells, over a border or two at once, which are crossed at ``first``."""
        least = np.minimum(np.abs(self.rows[2]), np.abs(self.rows[3]))
        with np.errstate(invalid="ignore"):  # along an axis, there is none of the other to cross
            is_corner = (np.abs(self.cross[0] - self.cross[1]) * least <= _TOUCH) & (least > 0.0)

        is_on = np.empty(self.cross.shape, dtype=bool)
        np.logical_or(is_corner, self.cross[0] < self.cross[1], out=is_on[0])
        np.logical_or(is_corner, ~is_on[0], out=is_on[1])
        self.is_on[:] = is_on
        over = self.over * is_on
        self.border[:] += over
        np.divide(self.border - self.start, self.delta, out=self.cross, where=is_on)
        self.rows[13] = first
        self.rows[14] += over[0] * self.width + over[1]


def _lower_rates(kinds: NDArray[np.uint8], rate: Floats, cells: Ints, beside: Ints) -> Floats:
    """`_lower_rate` of many; 0 where neither cell is open."""
    here = np.where(kinds.take(cells) == OPEN, rate.take(cells), inf)
    there = np.where(kinds.take(beside) == OPEN, rate.take(beside), inf)
    lower = np.minimum(here, there)

    return np.where(np.isfinite(lower), lower, 0.0)
