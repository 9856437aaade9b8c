"""`Prisms`: upright prisms over polygons, which points they hold, and how often they cut lines of
sight.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.radio.geometry import TOUCH, Places, Segments
from irs_gym.units import Floats

Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Prisms:
    """Open prisms that stand on the floor.

    Attributes
    ----------
    polygons
        ``shapely`` areas.
    heights
        Of each, in metres.
    """

    polygons: Sequence[Any]
    heights: Sequence[float]

    @cached_property
    def _insides(self) -> NDArray[Any]:
        """The polygons without what is less than `TOUCH` from their sides, which only grazes."""
        insides = shapely.buffer(np.array(self.polygons, dtype=object), -TOUCH, join_style="mitre")
        shapely.prepare(insides)
        return np.asarray(insides)

    @cached_property
    def _is_convex(self) -> NDArray[np.bool_]:
        """Whether no line cuts a polygon twice."""
        hulls = shapely.convex_hull(self._insides)
        return np.asarray(shapely.area(hulls) <= shapely.area(self._insides) * (1 + 1e-12))

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points ``(..., 2)`` in metres lie strictly inside any; shape ``(...)``."""
        places = Places(points.reshape(-1, 2))
        inside = np.zeros(len(places.points), dtype=bool)

        for each, bounds in zip(self._insides, shapely.bounds(self._insides), strict=True):
            near = places.within(bounds[:2], bounds[2:])
            inside[near] |= shapely.intersects_xy(each, *places.points[near].T)

        return inside.reshape(points.shape[:-1])

    def crossings(
        self, n: int, segments: Segments, which: NDArray[np.intp], *, at_most_one: bool
    ) -> Counts:
        """How often each of m segments runs through the prism of that number, shape ``(m,)``; or
        whether it does, where one time is as good as many.
        """
        counts = np.zeros(len(which), dtype=np.int64)
        numbers, low, high = Segments(segments.start[which], segments.end).clipped(self.heights[n])
        lines = shapely.linestrings(np.stack([low, high], axis=1))  # (k, 2, 2)
        is_hit = shapely.intersects(self._insides[n], lines)
        counts[numbers] = is_hit
        if at_most_one or self._is_convex[n]:
            return counts

        pieces = shapely.intersection(self._insides[n], lines[is_hit])
        counts[numbers[is_hit]] = shapely.get_num_geometries(pieces)

        return counts
