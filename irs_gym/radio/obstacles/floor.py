"""`Floor`: all that stands in the way of robots and of lines of sight."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from irs_gym.radio.geometry import Boxes, Segments, is_cut, is_in_footprint
from irs_gym.radio.obstacles.prisms import Prisms
from irs_gym.radio.obstacles.raster import Raster
from irs_gym.units import Floats

Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Floor:
    """The obstacles of a scene, and the outside of a room that is no rectangle.

    Attributes
    ----------
    boxes, prisms, rasters
        The obstacles, by kind.
    room
        The room's floor as a ``shapely.Polygon``; None for a rectangle, where nothing is outside.
    """

    boxes: Boxes
    prisms: Prisms
    rasters: Sequence[Raster]
    room: Any = None

    @cached_property
    def _outside(self) -> Prisms:
        """What is solid around the room, as far as a line of sight may come."""
        if self.room is None:
            return Prisms((), ())

        around = shapely.box(*shapely.bounds(self.room)).buffer(1.0, join_style="mitre")
        parts = shapely.get_parts(shapely.difference(around, self.room))

        return Prisms(parts, [np.inf] * len(parts))

    @property
    def tests(self) -> int:
        """How many boxes, prisms and columns of cells a segment is held against at most."""
        columns: list[int] = [min(raster.is_filled.shape) for raster in self.rasters]
        prisms = len(self.prisms.polygons) + len(self._outside.polygons)
        return len(self.boxes.lower) + prisms + sum(columns)

    @cached_property
    def footprints(self) -> tuple[Any, ...]:
        """The floor that each obstacle takes, as ``shapely`` areas: boxes, prisms, then rasters."""
        boxes = shapely.box(*self.boxes.lower[:, :2].T, *self.boxes.upper[:, :2].T)
        rasters = (raster.footprint for raster in self.rasters)

        return (*boxes, *self.prisms.polygons, *rasters)

    def outlines(self, most_cells: int) -> tuple[Floats, ...]:
        """The sides of all obstacles, and of a room that is a polygon, as closed lines ``(n, 2)``;
        those of rasters of so many blocked cells at most.
        """
        shapes = [self.room] if self.room is not None else []
        shapes += [*shapely.box(*self.boxes.lower[:, :2].T, *self.boxes.upper[:, :2].T)]
        shapes += self.prisms.polygons
        shapes += [
            raster.footprint for raster in self.rasters if raster.is_filled.sum() <= most_cells
        ]

        polygons = shapely.get_parts(shapes)
        rings = shapely.get_rings(polygons)

        return tuple(shapely.get_coordinates(ring) for ring in rings)

    def is_covered(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points ``(..., 2)`` in metres lie strictly inside an obstacle, or outside the
        room; shape ``(...)``.
        """
        covered = is_in_footprint(points, self.boxes)
        covered |= self.prisms.holds(points) | self._outside.holds(points)
        for raster in self.rasters:
            covered |= raster.holds(points)

        return covered

    def is_line_of_sight(self, points: Floats, target: ArrayLike) -> NDArray[np.bool_]:
        """Whether the straight segments from ``points`` ``(..., 3)`` to one ``target`` ``(3,)``
        meet no obstacle and do not leave the room; shape ``(...)``.

        A ray that only grazes a face, an edge or a corner is not blocked.
        """
        return np.asarray(self._crossings(points, target, at_most_one=True) == 0)

    def walls_crossed(self, points: Floats, target: ArrayLike) -> Counts:
        """How often the segments of `is_line_of_sight` run through an obstacle, or out of the room;
        shape ``(...)``.
        """
        return self._crossings(points, target, at_most_one=False)

    def _crossings(self, points: Floats, target: ArrayLike, *, at_most_one: bool) -> Counts:
        """Obstacles in the way of each segment; of segments that are known to be blocked no more
        are looked for where one is as good as many.
        """
        segments = Segments.of(points, target)
        counts = np.zeros(len(segments.start), dtype=np.int64)

        def near(lower: Floats, upper: Floats) -> NDArray[np.intp]:
            which = segments.over(lower[:2], upper[:2])
            return which[counts[which] == 0] if at_most_one else which

        for low, high in zip(self.boxes.lower, self.boxes.upper, strict=True):
            which = near(low, high)
            counts[which] += is_cut(segments, which, low, high)

        for prisms in (self.prisms, self._outside):
            for n, polygon in enumerate(prisms.polygons):
                bounds = shapely.bounds(polygon)
                which = near(bounds[:2], bounds[2:])
                counts[which] += prisms.crossings(n, segments, which, at_most_one=at_most_one)

        for raster in self.rasters:
            lower = np.array(raster.origin)
            which = near(lower, lower + raster.cell_size * np.array(raster.is_filled.shape))
            counts[which] += raster.crossings(
                Segments(segments.start[which], segments.end), at_most_one=at_most_one
            )

        return counts.reshape(points.shape[:-1])
