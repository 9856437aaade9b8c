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
    walkers = _Walkers.of(width, maps, start, end - start, until)
    count = len(until)
    share = until.copy()
    blocked = np.full(count, -1)
    paid = np.zeros(count)
    at = end if (until == 1.0).all() else np.where(until == 1.0, end, start + until * walkers.delta)
    at = at.copy() if at is end else at

    while walkers.robot.size:
        kind = walkers.kinds(kinds)
        first = walkers.cross.min(axis=0)
        ahead = np.minimum(first, walkers.until)
        is_open = kind == OPEN
        is_there = is_open & (first >= walkers.until)

        if not is_open.all():
            stopped = np.flatnonzero(~is_open)
            who = walkers.robot[stopped]
            share[who] = walkers.t[stopped]
            blocked[who] = kind[stopped]
            at[:, who] = walkers.of_some(stopped).on_border()

        if rate is not None:
            spent = (ahead - walkers.t) * walkers.lower_rates(kinds, rate)
            paid[walkers.robot] += np.where(is_open, spent, 0.0)

        there = np.flatnonzero(is_there)
        who = walkers.robot[there]
        at[:, who] = walkers.of_some(there).within_cell(at[:, who])

        going = np.flatnonzero(is_open & ~is_there)
        walkers = walkers.of_some(going).stepped(first[going])

    return Walks(share, at, blocked, paid)


class _Walkers(NamedTuple):
    """Robots that are still on their way; arrays ``(2, n)`` along x and y, or ``(n,)``."""

    width: int
    robot: Ints  # (n,), their numbers
    start: Floats  # (2, n)
    delta: Floats  # (2, n)
    until: Floats  # (n,)
    t: Floats  # (n,): shares that they have travelled
    cell: Ints  # (2, n)
    step: Ints  # (2, n): from one cell to the next
    border: Ints  # (2, n): ahead
    cross: Floats  # (2, n): shares at which they are crossed
    flat: Ints  # (n,): padded cells
    beside: Ints  # (n,): along a border, those beside them; else the same
    is_on: NDArray[np.bool_]  # (2, n): whether they are on borders that they have just come to

    @classmethod
    def of(
        cls, width: int, maps: Ints | int, start: Floats, delta: Floats, until: Floats
    ) -> "_Walkers":
        """Robots that set out."""
        is_up = delta > 0.0
        is_down = delta < 0.0
        floors = np.floor(start)
        is_integer = floors == start
        cell = floors.astype(np.int64)
        cell -= is_down & is_integer
        border = cell + is_up
        cross = np.full(start.shape, inf)
        np.divide(border - start, delta, out=cross, where=is_up | is_down)

        flat = maps + (cell[0] + 1) * width + cell[1] + 1
        is_along = is_integer & (delta == 0.0)
        beside = flat - is_along[0] * width - is_along[1]
        step = is_up.astype(np.int64) - is_down
        count = start.shape[1]

        return cls(
            width=width,
            robot=np.arange(count),
            start=start,
            delta=delta,
            until=until,
            t=np.zeros(count),
            cell=cell,
            step=step,
            border=border,
            cross=cross,
            flat=flat,
            beside=beside,
            is_on=np.zeros(start.shape, dtype=bool),
        )

    def of_some(self, chosen: Ints) -> "_Walkers":
        """The same of some robots."""
        return _Walkers(self.width, *(each.take(chosen, axis=-1) for each in self[1:]))  # type: ignore[arg-type]

    def kinds(self, kinds: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Kinds of the cells that they go into, ``(n,)``."""
        return np.maximum(kinds.take(self.flat), kinds.take(self.beside))

    def lower_rates(self, kinds: NDArray[np.uint8], rate: Floats) -> Floats:
        """Rates in their cells, ``(n,)``; see `_lower_rate`."""
        here, beside = (
            np.where(kinds.take(each) == OPEN, rate.take(each), inf)
            for each in (self.flat, self.beside)
        )
        lower = np.minimum(here, beside)

        return np.where(np.isfinite(lower), lower, 0.0)

    def on_border(self) -> Floats:
        """Points ``(2, n)`` on the borders that they have come to."""
        return np.where(
            self.is_on,
            self.border - self.step,
            snapped_many(self.start + self.t * self.delta),
        )

    def within_cell(self, at: Floats) -> Floats:
        """Points ``(2, n)``, kept within the cells where they move."""
        within = np.minimum(np.maximum(at, self.cell), self.cell + 1.0)
        return np.where(self.delta == 0.0, at, within)

    def stepped(self, first: Floats) -> "_Walkers":
        """In the next cell each, over a border or two at once, which they cross at ``first``."""
        least = np.abs(self.delta).min(axis=0)
        with np.errstate(invalid="ignore"):  # along an axis, there is none of the other to cross
            is_corner = (np.abs(self.cross[0] - self.cross[1]) * least <= _TOUCH) & (least > 0.0)

        on_x = is_corner | (self.cross[0] < self.cross[1])
        is_on = np.stack([on_x, is_corner | ~on_x])
        over = self.step * is_on
        border = self.border + over
        cross = self.cross.copy()
        np.divide(border - self.start, self.delta, out=cross, where=is_on)
        change = over[0] * self.width + over[1]

        return self._replace(
            t=first,
            cell=self.cell + over,
            border=border,
            cross=cross,
            flat=self.flat + change,
            beside=self.beside + change,
            is_on=is_on,
        )
