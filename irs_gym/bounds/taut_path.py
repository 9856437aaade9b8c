"""`shortest_in`: the shortest path of any shape inside polygons, exactly."""

from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from math import hypot, inf
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irs_gym.memory import check_memory
from irs_gym.units import Floats

_SIGHT_BYTES = 200  # gone over for each pair of corners
_FLAT = 1e-12  # square metres of a triangle that is none

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TautPath:
    """A path of straight pieces: its length in metres, and its corners ``(D, 2)``; inf and none
    where there is no path.
    """

    length: float
    points: Floats


def shortest_in(area: Any, start: Floats, goal: Floats, grown: float) -> TautPath:
    """The shortest path from start to goal in an area, a ``shapely`` polygon or several.

    It bends at corners of the area only, and is the shortest in the graph of their lines of sight
    (Lozano-Perez and Wesley 1979), which leave the area by no more than ``grown`` metres.

    Parameters
    ----------
    area
        Neither end may lie outside.
    start, goal
        Points ``(2,)``.
    grown
        Metres, far less than any side, and far more than the rounding of coordinates.

    Examples
    --------
    >>> area = shapely.box(0, 0, 3, 3) - shapely.box(1, 0, 2, 2)  # around a box on the wall
    >>> path = shortest_in(area, np.array([0.0, 0.0]), np.array([3.0, 0.0]), 1e-9)
    >>> path.points.round(6).tolist(), round(path.length, 3)
    ([[0.0, 0.0], [1.0, 2.0], [2.0, 2.0], [3.0, 0.0]], 5.472)
    """
    nowhere = TautPath(inf, np.zeros((0, 2)))
    ends = shapely.points([start, goal])
    grown_area = shapely.buffer(area, grown, join_style="mitre")
    parts = [part for part in shapely.get_parts(grown_area) if shapely.intersects(part, ends).all()]
    if not parts:
        return nowhere

    outline = _Outline.of(parts[0], np.array([start, goal]))
    outline.cut_ears()
    corners, before, after = outline.bends()
    check_memory(
        f"tolerance: lines of sight between {len(corners)} corners",
        0,
        _SIGHT_BYTES * len(corners) ** 2,
    )
    sights = shapely.buffer(parts[0], grown, join_style="mitre")
    shapely.prepare(sights)

    points = np.concatenate([[start, goal], corners])  # (n, 2)
    no_side = np.full((2, 2), np.nan)  # the ends may be left and reached from anywhere
    return _search(
        points, np.concatenate([no_side, before]), np.concatenate([no_side, after]), sights
    )


class _Outline:
    """The rings of a polygon as chains of corners, the area on their left."""

    def __init__(self, corners: Floats, after: Integers, ends: Floats) -> None:
        self.corners = corners  # (n, 2)
        self.after = after.tolist()
        self.before = np.argsort(after).tolist()  # after is a permutation
        self.ends = ends  # (2, 2)
        self.is_left = np.ones(len(corners), dtype=bool)

    @classmethod
    def of(cls, polygon: Any, ends: Floats) -> "_Outline":
        oriented = shapely.orient_polygons(polygon)
        corners = []
        after = []
        count = 0

        for ring in shapely.get_rings(oriented):
            own = shapely.get_coordinates(ring)[:-1]
            corners.append(own)
            after.append(count + np.roll(np.arange(len(own)), -1))
            count += len(own)

        return cls(np.concatenate(corners), np.concatenate(after), ends)

    def cut_ears(self) -> None:
        """Cut off triangles at corners that stick out, where these hold nothing.

        A path that enters such a triangle leaves it over the side that it was cut at, and is
        shorter along that: no shortest path between points outside changes.
        """
        tree = cKDTree(np.concatenate([self.corners, self.ends]))
        first = len(self.corners)  # from there on ends
        waiting = [(self._area(n), n) for n in range(len(self.corners))]
        heapify(waiting)

        while waiting:
            area, n = heappop(waiting)
            if not self.is_left[n] or area != self._area(n) or area < -_FLAT:
                continue

            before = self.before[n]
            after = self.after[n]
            if self.after[after] == before:  # a triangle is all that is left
                continue
            if area > _FLAT and self._is_filled(before, n, after, tree, first):
                continue

            self.is_left[n] = False
            self.after[before] = after
            self.before[after] = before
            for each in (before, after):
                heappush(waiting, (self._area(each), each))

    def _area(self, n: int) -> float:
        """Twice the area of the triangle at a corner; negative where the outline turns right."""
        (x, y), (x0, y0), (x1, y1) = (
            self.corners[n],
            self.corners[self.before[n]],
            self.corners[self.after[n]],
        )
        return float((x - x0) * (y1 - y) - (y - y0) * (x1 - x))

    def _is_filled(self, before: int, n: int, after: int, tree: Any, first: int) -> bool:
        """Whether a triangle has another corner, or an end, in it or on its border."""
        triangle = self.corners[[before, n, after]]
        low = triangle.min(axis=0)
        high = triangle.max(axis=0)
        radius = hypot(*(high - low)) / 2 * (1 + 1e-9)
        near = np.array(tree.query_ball_point((low + high) / 2, radius), dtype=np.int64)
        is_end = near >= first
        alive = near[is_end | self.is_left[np.minimum(near, first - 1)]]
        alive = alive[(alive != before) & (alive != n) & (alive != after)]
        points = tree.data[alive]  # (k, 2)
        is_in = np.ones(len(points), dtype=bool)

        for tail, head in ((0, 1), (1, 2), (2, 0)):
            way = triangle[head] - triangle[tail]
            to = points - triangle[tail]
            is_in &= way[0] * to[:, 1] - way[1] * to[:, 0] >= -_FLAT

        return bool(is_in.any())

    def bends(self) -> tuple[Floats, Floats, Floats]:
        """Corners where a path can bend, ``(n, 2)``, and those before and after them."""
        turns_right = [n for n in np.flatnonzero(self.is_left).tolist() if self._area(n) < 0]
        before = [self.before[n] for n in turns_right]
        after = [self.after[n] for n in turns_right]
        return self.corners[turns_right], self.corners[before], self.corners[after]


def _search(points: Floats, before: Floats, after: Floats, sights: Any) -> TautPath:
    """The shortest way from the first point to the second along lines of sight, by the A*
    algorithm.
    """
    to_goal = np.hypot(*(points - points[1]).T)  # (n,): never longer than the way to go
    reached = np.where(np.arange(len(points)) == 0, 0.0, inf)
    is_open = np.ones(len(points), dtype=bool)
    came_from = np.full(len(points), -1)

    while (here := int(np.argmin(np.where(is_open, reached + to_goal, inf)))) != 1:
        if not is_open[here] or np.isinf(reached[here]):
            return TautPath(inf, np.zeros((0, 2)))
        is_open[here] = False

        length = reached[here] + np.hypot(*(points - points[here]).T)  # (n,)
        is_shorter = is_open & (length < reached) & (length + to_goal < reached[1])
        is_taut = _is_tangent(points[here], points, before, after)
        is_taut &= _is_tangent(points, points[here], before[here], after[here])
        ahead = np.flatnonzero(is_shorter & is_taut)

        lines = np.stack(
            [np.broadcast_to(points[here], (len(ahead), 2)), points[ahead]], axis=1
        )  # (k, 2, 2)
        ahead = ahead[shapely.contains_properly(sights, shapely.linestrings(lines))]
        reached[ahead] = length[ahead]
        came_from[ahead] = here

    way = [1]
    while came_from[way[-1]] >= 0:
        way.append(int(came_from[way[-1]]))

    return TautPath(float(reached[1]), points[way[::-1]])


def _is_tangent(here: Floats, points: Floats, before: Floats, after: Floats) -> NDArray[np.bool_]:
    """Whether the line from ``here`` to each point leaves both neighbours of its corner on one
    side: a taut path bends only there. Ends, whose neighbours are NaN, are always reached so.
    """
    way = points - here
    sides = [way[..., 0] * to[..., 1] - way[..., 1] * to[..., 0]
             for to in (before - points, after - points)]  # fmt: skip
    is_cut = (np.minimum(*sides) < -_FLAT) & (np.maximum(*sides) > _FLAT)
    return np.asarray(~is_cut)
