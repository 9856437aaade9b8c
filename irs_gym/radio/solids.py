"""`Solids`: the floor that obstacles take, and what comes near it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.grid import Grid
from irs_gym.radio.geometry import TOUCH
from irs_gym.radio.scene import AnyObstacle, Scene
from irs_gym.radio.shapes import PolygonObstacle, PolygonRoom, RasterObstacle

OUTSIDE = -1  # among the numbers of obstacles, that of what lies around the room

_BLOCK = 2**16  # points or lines that are tested at a time: bounds memory
_MOST_CORNERS = 64  # of one area in the tree: larger ones are cut up
_FEW_CORNERS = 8  # and those of which are not worth it, though they fill little of their box
_OVERLAP = 1e-6  # metres, far more than `TOUCH`
_ASIDE = 1e-3  # metres, far more than that

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Solids:
    """Areas on the floor, without their borders.

    Attributes
    ----------
    areas
        ``shapely`` polygons, shape ``(n,)``, each smaller by `TOUCH` all around: what meets one
        reaches into it, and does not only touch it.
    owner
        Shape ``(n,)``: the number of the obstacle that each is part of, or `OUTSIDE` for what is of
        none or of two.
    """

    areas: NDArray[Any]
    owner: Ints

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree(self.areas)

    def met_by(self, shapes: NDArray[Any], metres: float) -> tuple[Bools, Ints]:
        """Which of the ``shapely`` points or lines ``(m,)`` come nearer to an area than so many
        metres, and the numbers of the obstacles that they come near to, sorted.
        """
        is_met = np.zeros(len(shapes), dtype=bool)
        owners: list[Ints] = []

        for first in range(0, len(shapes), _BLOCK):
            which, area = self._tree.query(
                shapes[first : first + _BLOCK], predicate="dwithin", distance=metres
            )
            is_met[first + which] = True
            owners.append(np.unique(self.owner[area]))

        return is_met, np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *owners]))


def solids_of(scene: Scene) -> Solids:
    """The obstacles of a scene, and what lies around its room."""
    areas = [_area_of(each) for each in scene.obstacles]
    room = scene.room
    inside = room.shape if isinstance(room, PolygonRoom) else shapely.box(*room.lower, *room.upper)

    return _solids([*areas, _around(inside)], [*range(len(areas)), OUTSIDE])


def solids_of_cells(free: Bools, grid: Grid) -> Solids:
    """The squares of all cells that are not free, as obstacle 0, and what lies around the grid."""
    inside = shapely.box(*grid.origin, *grid.upper)
    blocked = _squares(~free, grid.cell_size, grid.origin)
    return _solids([blocked, _around(inside)], [0, OUTSIDE])


def _area_of(obstacle: AnyObstacle) -> Any:
    """The floor that an obstacle takes, as a ``shapely`` area."""
    if isinstance(obstacle, PolygonObstacle):
        return obstacle.shape
    if isinstance(obstacle, RasterObstacle):
        return _squares(obstacle.is_filled, obstacle.cell_size, obstacle.origin)
    return shapely.box(*obstacle.lower[:2], *obstacle.upper[:2])


def _squares(is_filled: Bools, cell_size: float, origin: tuple[float, float]) -> Any:
    """The cells ``(X, Y)`` that are filled, as one area."""
    # joined in whole numbers, where the corners that they share are the same ones
    low = np.argwhere(is_filled)  # (n, 2)
    squares = shapely.box(*low.T, *(low + 1).T)
    return shapely.transform(
        shapely.coverage_union_all(squares), lambda corners: corners * cell_size + origin
    )


def overlooked(scene: Scene, owners: Ints) -> str:
    """What to say of the obstacles of a scene that are not among those owners; empty where all
    are.
    """
    missed = sorted(set(range(len(scene.obstacles))) - set(owners.tolist()))
    if not missed:
        return ""

    named = [
        f"obstacles[{n}] from {scene.obstacles[n].lower[:2]} to {scene.obstacles[n].upper[:2]}"
        for n in missed[:5]
    ]
    more = [f"{len(missed) - len(named)} more"] if len(missed) > len(named) else []

    return f"scene {scene.name!r}: no cell is blocked by {', '.join([*named, *more])}"


def centres_of(grid: Grid) -> NDArray[Any]:
    """The centres of all cells as ``shapely`` points, shape ``(X * Y,)``."""
    return np.asarray(shapely.points(grid.centres().reshape(-1, 2)))


def _around(inside: Any) -> Any:
    """What lies around a room: up to the box around it, and a ring of a metre more."""
    return shapely.difference(shapely.box(*inside.bounds).buffer(1.0, join_style="mitre"), inside)


def _solids(areas: list[Any], owners: list[int]) -> Solids:
    """Solids of areas with their borders; empty ones are left out."""
    cut = [_pieces(area) for area in areas]
    pieces = np.array([piece for each in cut for piece in each], dtype=object)  # (n,)
    owner = np.repeat(owners, [len(each) for each in cut])
    smaller = np.asarray(shapely.buffer(pieces, -TOUCH, join_style="mitre"))
    seams = shapely.buffer(_seams(pieces, smaller, owner), -TOUCH, join_style="mitre")

    return Solids(
        areas=np.concatenate([smaller, seams]),
        owner=np.concatenate([owner, np.full(len(seams), OUTSIDE)]),
    )


def _seams(pieces: NDArray[Any], smaller: NDArray[Any], owner: Ints) -> NDArray[Any]:
    """Unions of pieces of two obstacles side by side, so that there is no way between these."""
    one, other = shapely.STRtree(pieces).query(pieces, predicate="dwithin", distance=TOUCH)
    are_two = (one < other) & (owner[one] != owner[other])
    one = one[are_two]
    other = other[are_two]

    # between those that overlap there is none
    are_apart = ~shapely.intersects(smaller[one], smaller[other])

    first = pieces[one[are_apart]]
    second = pieces[other[are_apart]]

    # sides that are one but for the rounding of their corners become one
    both = shapely.union(first, second, grid_size=TOUCH / 10)
    low = np.maximum(shapely.bounds(first), shapely.bounds(second))[:, :2] - _ASIDE
    high = np.minimum(shapely.bounds(first), shapely.bounds(second))[:, 2:] + _ASIDE

    return np.asarray(shapely.intersection(both, shapely.box(*low.T, *high.T)))


def _pieces(area: Any) -> list[Any]:
    """An area cut up into small ones that overlap, so that they still do when each is made smaller;
    an index finds these sooner.
    """
    pieces = []
    waiting = [area]

    while waiting:
        part = waiting.pop()
        corners = shapely.get_num_coordinates(part)
        is_sparse = corners > _FEW_CORNERS and part.area < shapely.box(*part.bounds).area / 2
        if corners <= _MOST_CORNERS and not is_sparse:
            pieces.append(part)
            continue

        # across its longer side, in halves
        low = np.array(part.bounds[:2])
        high = np.array(part.bounds[2:])
        axis = int(np.argmax(high - low))
        middle = (low[axis] + high[axis]) / 2

        for start, end in ((low[axis], middle + _OVERLAP), (middle - _OVERLAP, high[axis])):
            low[axis] = start
            high[axis] = end
            half = shapely.intersection(part, shapely.box(*low, *high))
            waiting += shapely.get_parts(half).tolist()

    return pieces
