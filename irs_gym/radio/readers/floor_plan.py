"""`FloorPlan`: a scene that lacks what no plan tells, its access points and its panels."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.ndimage import distance_transform_edt, label

from irs_gym.files import write_file
from irs_gym.grid import LARGEST
from irs_gym.radio.scene import Scene, in_one_line, load_scene
from irs_gym.radio.shapes import MOST_RASTER_CELLS, RasterObstacle

CEILING = 3.0  # metres, where nothing else is said
_CLEARANCE = 0.5  # metres
Point = tuple[float, float]


@dataclass(frozen=True)
class FloorPlan:
    """What a scene file holds, but for access points and panels.

    The room is a polygon, so that cells of any size fit it. Carrier, fading and path loss are the
    paper's, start and goal the lower left and the upper right end of the largest piece of floor;
    each is replaced by an argument of `scene`.

    Examples
    --------
    >>> is_blocked = np.zeros((4, 3), dtype=bool)
    >>> plan = plan_of_cells("hall", is_blocked, cell_size=2.0, origin=(0.0, 0.0))
    >>> plan.scene()
    Traceback (most recent call last):
    ValueError: scene: access_points: Field required; irs_panels: Field required
    >>> scene = plan.scene(access_points=[{"position": [4.0, 3.0, 2.5]}], irs_panels=[])
    >>> scene.room.upper
    (8.0, 6.0)
    """

    data: Mapping[str, Any]

    def scene(self, **parts: Any) -> Scene:
        """The scene of the plan, with fields of a scene file as arguments; a ``ValueError`` names
        each that is missing or wrong.
        """
        return Scene.from_data({**self.data, **parts})

    def save(self, path: str | Path) -> None:
        """Write what there is as JSON, atomically: a scene file to be completed."""
        write_file(Path(path), (json.dumps(self.data, indent=2) + "\n").encode())


def plan_of_cells(
    name: str,
    is_blocked: NDArray[np.bool_],
    cell_size: float,
    origin: Point,
    height: float = CEILING,
    **parts: Any,
) -> FloorPlan:
    """Plan of square cells.

    Parameters
    ----------
    name
        Of the scene.
    is_blocked
        Shape ``(X, Y)``, ``[i, j]`` with i along x.
    cell_size
        Edge of these cells in metres; those of an environment may be larger.
    origin
        Lower left corner in metres.
    height
        Of the ceiling and of all that is blocked, in metres.
    parts
        Further fields of a scene file.
    """
    check_cells(name, *is_blocked.shape)
    height = checked_height(height)
    try:
        raster = RasterObstacle.from_array(is_blocked, cell_size, origin, height)
    except ValidationError as error:
        raise ValueError(f"{name}: {in_one_line(error)}") from None

    x, y, _ = raster.upper
    obstacles = [raster.model_dump(mode="json")] if is_blocked.any() else []

    return plan_of(
        name,
        room=shapely.box(*origin, x, y),
        obstacles=obstacles,
        height=height,
        **{**ends_of(~is_blocked, cell_size, origin), **parts},
    )


def plan_of(
    name: str, room: Any, obstacles: list[dict[str, Any]], height: float, **parts: Any
) -> FloorPlan:
    """Plan of a room as a ``shapely.Polygon``, and obstacles as a scene file holds them."""
    paper = load_scene("paper").to_data()
    kept = ("antenna_height", "carrier_ghz", "rician_factor_db", "path_loss")
    outline = {
        "polygon": [list(corner) for corner in room.exterior.coords],
        "holes": [[list(corner) for corner in ring.coords] for ring in room.interiors],
        "height": height,
    }

    return FloorPlan(
        {
            "format_version": 2,
            "name": name,
            "room": outline,
            "obstacles": obstacles,
            **{field: paper[field] for field in kept},
            **parts,
        }
    )


def ends_of(free: NDArray[np.bool_], cell_size: float, origin: Point) -> dict[str, list[float]]:
    """Start and goal: the first and the last by x + y of the points in the largest piece of floor,
    as far from what is blocked as there is room for half a metre.

    Nothing where there are no two.
    """
    metres = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * cell_size  # (X, Y)
    is_clear = free & (metres >= min(_CLEARANCE, float(metres.max())))
    pieces, _ = label(is_clear)
    sizes = np.bincount(pieces.ravel())[1:]
    if not len(sizes) or sizes.max() < 2:
        return {}

    cells = np.argwhere(pieces == 1 + np.argmax(sizes))  # (n, 2)
    order = np.argsort(cells.sum(axis=1), kind="stable")
    start, goal = (cells[order[[0, -1]]] + 0.5) * cell_size + origin

    return {"start": start.tolist(), "goal": goal.tolist()}


def checked_height(height: Any) -> float:
    """A height in metres; a ``ValueError`` where it is none."""
    is_number = isinstance(height, Real) and not isinstance(height, bool)
    if not is_number or not 0 < height <= LARGEST:
        raise ValueError(f"height={height!r} must be a positive number of metres")

    return float(height)


def check_cells(name: str, columns: int, rows: int) -> None:
    """Refuse a plan of more cells than a scene file may hold; the ``ValueError`` names the file."""
    if not 1 <= columns * rows <= MOST_RASTER_CELLS:
        raise ValueError(f"{name}: {columns} x {rows} cells are not from 1 to {MOST_RASTER_CELLS}")
