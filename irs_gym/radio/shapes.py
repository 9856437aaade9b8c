"""Parts of a scene file that may have any shape: obstacles and rooms as polygons, obstacles as
rasters.
"""

from functools import lru_cache
from typing import Annotated, Any, Self

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from irs_gym.radio.fields import CellSize, Length, Part, Point2, Point3
from irs_gym.radio.geometry import TOUCH

MOST_CORNERS = 10_000  # of one ring
MOST_RASTER_CELLS = 2**24
BLOCKED = "#"
FREE = "."


def _simple(ring: tuple[Point2, ...]) -> tuple[Point2, ...]:
    """The ring, if its sides meet nowhere but at its corners, and it has an area."""
    polygon = shapely.Polygon(ring)
    if not shapely.is_valid(polygon):
        raise ValueError(f"it crosses or touches itself: {shapely.is_valid_reason(polygon)}")
    if not polygon.area > 0:
        raise ValueError("it has no area")

    return ring


# Corners in order, either way round; the first may come again at the end.
Ring = Annotated[
    tuple[Point2, ...], Field(min_length=3, max_length=MOST_CORNERS), AfterValidator(_simple)
]


class _Outline(Part):
    """A polygon with a height in metres, and perhaps with holes."""

    polygon: Ring
    holes: Annotated[tuple[Ring, ...], Field(max_length=1000)] = ()
    height: Length

    @model_validator(mode="after")
    def _has_holes_inside(self) -> Self:
        if not shapely.is_valid(self.shape):
            raise ValueError(
                "holes must lie inside polygon, and apart from each other: "
                f"{shapely.is_valid_reason(self.shape)}"
            )
        return self

    @property
    def shape(self) -> Any:
        """The floor that it takes, as a ``shapely.Polygon``."""
        return _area(self.polygon, self.holes)


# Not a property that the part keeps: a copy with another polygon would keep it as well.
@lru_cache(maxsize=1024)
def _area(polygon: tuple[Point2, ...], holes: tuple[tuple[Point2, ...], ...]) -> Any:
    return shapely.Polygon(polygon, holes)


class PolygonObstacle(_Outline):
    """An upright prism on the floor that robots cannot enter and that blocks line of sight: a wall
    at any angle, a round table.
    """

    @property
    def lower(self) -> Point3:
        """Lower corner in metres of the box around it."""
        x, y, _, _ = self.shape.bounds
        return x, y, 0.0

    @property
    def upper(self) -> Point3:
        """Upper corner in metres of the box around it."""
        _, _, x, y = self.shape.bounds
        return x, y, self.height


class RasterObstacle(Part):
    """Square cells of one height, drawn as on a map: ``rows`` of ``#`` (blocked) and ``.`` (free),
    the first at the largest y.
    """

    origin: Point2  # its lower left corner
    cell_size: CellSize
    rows: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_RASTER_CELLS)]
    height: Length

    @model_validator(mode="after")
    def _is_a_map(self) -> Self:
        width = len(self.rows[0])
        if not 1 <= width * len(self.rows) <= MOST_RASTER_CELLS:
            raise ValueError(
                f"rows make {width} x {len(self.rows)} cells, not from 1 to {MOST_RASTER_CELLS}"
            )

        for n, row in enumerate(self.rows):
            if len(row) != width:
                raise ValueError(f"rows[{n}] has {len(row)} cells, the first one {width}")
            strange = row.strip(BLOCKED + FREE)
            if strange or row.count(BLOCKED) + row.count(FREE) != width:
                raise ValueError(f"rows[{n}] must be made of {BLOCKED!r} and {FREE!r} alone")

        return self

    @classmethod
    def from_array(
        cls, is_filled: NDArray[np.bool_], cell_size: float, origin: Point2, height: float
    ) -> "RasterObstacle":
        """Raster of the blocked cells ``(X, Y)``, ``[i, j]`` with i along x.

        Examples
        --------
        >>> RasterObstacle.from_array(np.array([[True, False]]), 0.5, (0.0, 0.0), 2.0).rows
        ('.', '#')
        """
        letters = np.where(is_filled.T[::-1], BLOCKED, FREE)  # (Y, X), from the top
        rows = tuple("".join(row) for row in letters.tolist())
        return cls(origin=origin, cell_size=cell_size, rows=rows, height=height)

    @property
    def lower(self) -> Point3:
        """Lower corner in metres."""
        return *self.origin, 0.0

    @property
    def upper(self) -> Point3:
        """Upper corner in metres."""
        x, y = self.origin
        return (
            x + len(self.rows[0]) * self.cell_size,
            y + len(self.rows) * self.cell_size,
            self.height,
        )

    @property
    def is_filled(self) -> NDArray[np.bool_]:
        """The blocked cells, shape ``(X, Y)``."""
        letters = np.frombuffer("".join(self.rows).encode(), dtype="S1")
        from_top = (letters == BLOCKED.encode()).reshape(len(self.rows), -1)  # (Y, X)

        return np.ascontiguousarray(from_top[::-1].T)


class PolygonRoom(_Outline):
    """A floor of any shape under a level ceiling, in metres; the floor is at z = 0. What is
    outside is solid.
    """

    @property
    def x_min(self) -> float:
        """The least x of the floor."""
        return float(self.shape.bounds[0])

    @property
    def y_min(self) -> float:
        """The least y of the floor."""
        return float(self.shape.bounds[1])

    @property
    def x_max(self) -> float:
        """The greatest x of the floor."""
        return float(self.shape.bounds[2])

    @property
    def y_max(self) -> float:
        """The greatest y of the floor."""
        return float(self.shape.bounds[3])

    @property
    def lower(self) -> Point2:
        """Lower left corner of the rectangle around the floor."""
        return self.x_min, self.y_min

    @property
    def upper(self) -> Point2:
        """Upper right corner of the rectangle around the floor."""
        return self.x_max, self.y_max

    def holds(self, point: Point2 | Point3) -> bool:
        """Whether a point lies in the room, its walls included."""
        height = point[2] if len(point) == 3 else 0.0  # on the floor where none is given
        is_above_floor = -TOUCH <= height <= self.height + TOUCH
        return is_above_floor and self.shape.distance(shapely.Point(point[:2])) <= TOUCH
