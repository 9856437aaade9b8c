"""`Shadows`: where on the floor the obstacles hide an antenna, from within and from without."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.radio.geometry import TOUCH
from irs_gym.radio.obstacles.floor import Floor
from irs_gym.units import Floats

# An obstacle that is smaller by this all around hides no more than the radio model lets it hide,
# and one that is smaller by `TOUCH` / 2 no less: the model's own is smaller by `TOUCH`, and a chord
# through it counts from 1e-9 of the segment on.
_WITHIN = 1e-8  # of the reach, and as many metres as of 100
_NEAR = 1e-6  # metres: an antenna nearer to an obstacle than this may be hidden from anywhere
_GROWN = TOUCH / 4  # of a cell, against the rounding of what comes to lie on its border
_AROUND = 1e-8  # of a cell that lies in a shadow

Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Shadows:
    """The shadows of all obstacles at the height of the robot's antenna, for one end of its links.

    Attributes
    ----------
    inner
        ``shapely`` areas, each hidden as a whole by one obstacle.
    outer
        One area that holds all that is hidden.
    """

    inner: NDArray[Any]
    outer: Any

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree(self.inner)

    def sight(self, cells: Floats) -> tuple[Bools, Bools]:
        """Whether the end can be seen from somewhere in each of the rectangles ``(n, 4)``, and
        whether it is hidden from somewhere in it; shape ``(n,)`` each. One of them at least holds.
        """
        is_hidden = np.asarray(shapely.intersects(self.outer, _boxes(cells, _GROWN)))
        is_seen = np.ones(len(cells), dtype=bool)
        is_seen[self._tree.query(_boxes(cells, _AROUND), predicate="within")[0]] = False

        return is_seen, is_hidden


def shadows_of(floor: Floor, end: Floats, height: float, reach: float) -> Shadows:
    """Shadows of the obstacles of a floor.

    Parameters
    ----------
    end
        Antenna ``(3,)`` in metres.
    height
        Of the robot's antenna.
    reach
        Metres from the end to the farthest point of the floor.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> scene = load_scene("paper")  # an access point at (0, 10, 2), and a box below it
    >>> shadows = shadows_of(scene.floor, np.array([0.0, 10.0, 2.0]), 1.0, 25.0)
    >>> seen, hidden = shadows.sight(np.array([[-1.0, 8.0, 1.0, 9.0], [-0.5, -3.0, 0.5, -2.5]]))
    >>> seen.tolist(), hidden.tolist()
    ([True, False], [False, True])
    """
    heights = _heights(floor)
    within = _WITHIN * max(reach, 100.0)
    inner = []
    outer = []

    for footprint, top in zip(floor.footprints, heights, strict=True):
        smaller = shapely.buffer(footprint, -within, join_style="mitre")
        inner.append(_shadow(smaller, top - within, end, height, reach, unknown=False))
        smaller = shapely.buffer(footprint, -TOUCH / 2, join_style="mitre")
        outer.append(_shadow(smaller, top - TOUCH / 2, end, height, reach, unknown=True))

    union = shapely.union_all(outer)
    shapely.prepare(union)

    return Shadows(np.array(inner, dtype=object), union)


def _heights(floor: Floor) -> list[float]:
    """Heights of the obstacles in the order of `Floor.footprints`."""
    boxes = floor.boxes.upper[:, 2].tolist()
    return [*boxes, *floor.prisms.heights, *(raster.height for raster in floor.rasters)]


def _shadow(
    footprint: Any, top: float, end: Floats, height: float, reach: float, *, unknown: bool
) -> Any:
    """What a prism hides: the points p = e + t (b - e) for b in its footprint, where the segment
    from p to the end e comes over b below the prism's top.

    At b it has gone the share s of its way, t = 1 / (1 - s), and is as high as height + s (z_e -
    height): so the shares are an interval, the same for all points. Where the end is so near that
    the shadow cannot be told, it is nothing or, where ``unknown``, everything.
    """
    rise = float(end[2]) - height
    low = 0.0
    high = 1.0
    if rise > 0:
        high = min(1.0, (top - height) / rise)
    elif rise < 0:
        low = max(0.0, (height - top) / -rise)
    elif height >= top:
        return shapely.Polygon()
    if high <= low or shapely.is_empty(footprint):
        return shapely.Polygon()

    apart = float(shapely.distance(footprint, shapely.Point(end[:2])))
    farthest = (reach + 1) / apart if apart > 0 else np.inf
    nearer = 1 / (1 - low) if low < 1 else np.inf
    farther = min(1 / (1 - high) if high < 1 else np.inf, farthest)
    if nearer >= farthest:  # all beyond the floor
        return shapely.Polygon()
    if apart < _NEAR and farther * _NEAR > 1:
        return shapely.Point(end[:2]).buffer(2 * reach + 2) if unknown else shapely.Polygon()

    return _swept(footprint, end[:2], nearer, farther)


def _swept(area: Any, centre: Floats, least: float, most: float) -> Any:
    """All that an area covers while it is scaled about a point by all factors of an interval."""
    ends = [
        shapely.transform(area, lambda corners, t=factor: centre + t * (corners - centre))
        for factor in (least, most)
    ]
    hull = shapely.convex_hull(area)
    if shapely.area(hull) <= shapely.area(area) * (1 + 1e-12):  # then the whole is convex as well
        return shapely.convex_hull(shapely.GeometryCollection(ends))

    swept = []
    for ring in shapely.get_rings(shapely.get_parts(area)):
        corners = shapely.get_coordinates(ring) - centre  # (k, 2)
        sides = np.stack([corners[:-1], corners[1:]], axis=1)  # (k - 1, 2, 2)
        quads = np.concatenate([least * sides, most * sides[:, ::-1]], axis=1)  # (k - 1, 4, 2)
        swept += list(shapely.convex_hull(shapely.multipoints(quads + centre)))

    return shapely.union_all([*ends, *swept])


def _boxes(cells: Floats, grown: float) -> NDArray[Any]:
    """Rectangles ``(n, 4)`` as ``shapely`` areas, wider by so many metres all around."""
    return np.asarray(shapely.box(*(cells + grown * np.array([-1, -1, 1, 1])).T))
