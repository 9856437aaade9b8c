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

from irs_gym.radio.geometry import TOUCH, Segments
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

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points ``(..., 2)`` in metres lie strictly inside any; shape ``(...)``."""
        inside = np.zeros(points.shape[:-1], dtype=bool)
        for each in self._insides:
            inside |= shapely.intersects_xy(each, points[..., 0], points[..., 1])

        return inside

    def crossings(self, n: int, segments: Segments, which: NDArray[np.intp]) -> Counts:
        """How often each of m segments runs through the prism of that number, shape ``(m,)``."""
        counts = np.zeros(len(which), dtype=np.int64)
        low, below, high = Segments(segments.start[which], segments.end).clipped(self.heights[n])
        lines = shapely.linestrings(np.stack([below, high], axis=1))  # (m, 2, 2)
        inside = self._insides[n]
        hit = np.flatnonzero(shapely.intersects(inside, lines))
        pieces = shapely.intersection(inside, lines[hit])
        counts[low[hit]] = np.maximum(1, shapely.get_num_geometries(pieces))

        return counts
