"""`source`, and what it is filled with: images, lines and polygons, as Bokeh takes them."""

from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource
from numpy.typing import NDArray

from irs_gym.grid import Grid

Rings = list[list[list[float]]]  # of one polygon: the outer one first, then the holes


def source(*columns: str) -> Any:
    """An empty source with these columns."""
    return ColumnDataSource({name: [] for name in columns})


def fill(old: Any, data: dict[str, Any]) -> None:
    """Put columns into a source that `source` made, unless it holds the same already."""
    if any(not _is_same(old.data[name], data[name]) for name in data):
        old.data = data


def _is_same(old: Any, new: Any) -> bool:
    if isinstance(old, np.ndarray) or isinstance(new, np.ndarray):
        return np.array_equal(old, new)
    return bool(old == new)


def image(values: NDArray[Any], grid: Grid) -> dict[str, list[Any]]:
    """Values ``(X, Y)`` as an image over the floor, whose rows run along x, from below."""
    x, y = grid.origin
    return {
        "image": [np.ascontiguousarray(values.T)],
        "x": [x],
        "y": [y],
        "dw": [grid.upper[0] - x],
        "dh": [grid.upper[1] - y],
    }


def line(cells: NDArray[Any], grid: Grid) -> dict[str, Any]:
    """The line through the centres of cells ``(D, 2)``."""
    return {
        "x": grid.origin[0] + (cells[:, 0] + 0.5) * grid.cell_size,
        "y": grid.origin[1] + (cells[:, 1] + 0.5) * grid.cell_size,
    }


def rings(shape: Any) -> list[Rings]:
    """Polygons of a polygon or polygons of ``shapely``."""
    parts = getattr(shape, "geoms", [shape])
    return [
        [[list(point) for point in ring.coords] for ring in (part.exterior, *part.interiors)]
        for part in parts
    ]


def polygons(shapes: list[Any]) -> dict[str, Any]:
    """Shapes, each a list of polygons, each a list of rings, as Bokeh's ``multi_polygons``."""
    return {
        name: [
            [[[point[axis] for point in ring] for ring in part] for part in each] for each in shapes
        ]
        for axis, name in enumerate(("xs", "ys"))
    }


def shifted(shape: list[Rings], by: tuple[float, float]) -> list[Rings]:
    """Polygons as `rings` gives them, moved by so many metres."""
    return [[[[x + by[0], y + by[1]] for x, y in ring] for ring in part] for part in shape]
