"""`read_geojson`: the floor plan that polygons of a GeoJSON file are."""

import json
from dataclasses import dataclass
from math import cos, radians
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import ValidationError

from irs_gym.files import as_path, read_file
from irs_gym.radio.readers.floor_plan import CEILING, FloorPlan, checked_height, ends_of, plan_of
from irs_gym.radio.scene import in_one_line
from irs_gym.radio.shapes import PolygonObstacle

_FILE_BYTES = 2**24
_MOST_OBSTACLES = 10_000  # of a scene
_EARTH_M = 6_371_008.8  # mean radius (IUGG)
_LARGEST = 1e7  # metres
_KINDS = ("Polygon", "MultiPolygon")
_DRAFT_CELLS = 200  # along the longer side, of the raster that start and goal are sought on

Unit = Literal["m", "deg"]


def read_geojson(path: str | Path, unit: Unit = "m", height: float = CEILING) -> FloorPlan:
    """Floor plan of polygons: RFC 7946, or the same with metres in place of degrees.

    A polygon whose properties hold ``"room": true`` is the room; where there is none, it is the
    rectangle around all. Every other one is an obstacle, as high as its property ``"height"`` says
    in metres; whatever is no polygon is refused.

    Parameters
    ----------
    path
        Of the file.
    unit
        Of the coordinates: ``"m"``, x to the right and y upwards, or ``"deg"``, longitude and
        latitude, which are laid flat around the least of each (x to the east, y to the north).
    height
        Of the ceiling, and of obstacles that say none, in metres.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    ValueError
        Where it is no such file, or damaged: a polygon that crosses itself, say; the message names
        file and feature.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> hall = [[[0, 0], [8, 0], [8, 5], [0, 0]]]
    >>> geometry = {"type": "Polygon", "coordinates": hall}
    >>> feature = {"type": "Feature", "properties": {"room": True}, "geometry": geometry}
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "hall.geojson"
    ...     _ = file.write_text(json.dumps(feature))
    ...     len(read_geojson(file).data["room"]["polygon"])
    4
    """
    place = as_path(path, "path")
    if unit not in ("m", "deg"):
        raise ValueError(f"unit={unit!r} must be 'm' or 'deg'")
    height = checked_height(height)

    try:
        polygons = _polygons(_parsed(place), unit)
        rooms = [each for each in polygons if each.is_room]
        if len(rooms) > 1:
            raise ValueError(f"{rooms[1].where} is a second room, after {rooms[0].where}")

        others = [each for each in polygons if not each.is_room]
        if len(others) > _MOST_OBSTACLES:
            raise ValueError(f"{len(others)} obstacles are more than {_MOST_OBSTACLES}")

        obstacles = [_obstacle(each, height) for each in others]
        shapes = [each.shape for each in obstacles]
        room = (
            _obstacle(rooms[0], height).shape
            if rooms
            else shapely.box(*shapely.total_bounds(shapes).tolist())
        )
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from None

    return plan_of(
        place.stem,
        room,
        [each.model_dump(mode="json") for each in obstacles],
        height,
        **_ends(room, shapes),
    )


@dataclass(frozen=True)
class _Polygon:
    """A polygon of the file, its rings in metres."""

    where: str
    properties: dict[str, Any]
    rings: list[list[list[float]]]

    @property
    def is_room(self) -> bool:
        return self.properties.get("room") is True


def _parsed(path: Path) -> Any:
    def refused(word: str) -> None:
        raise ValueError(f"{word} is no number of JSON")

    try:
        return json.loads(read_file(path, _FILE_BYTES).decode(), parse_constant=refused)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"it is no JSON file: {error}") from None


def _polygons(data: Any, unit: Unit) -> list[_Polygon]:
    """All polygons of the file, one or more."""
    if not isinstance(data, dict) or data.get("type") not in ("FeatureCollection", "Feature"):
        raise ValueError('its type must be "FeatureCollection" or "Feature"')

    features: Any = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list) or not features:
        raise ValueError("features must be a list of one or more")

    found: list[tuple[str, dict[str, Any], list[NDArray[np.float64]]]] = []
    for n, feature in enumerate(features):
        where = f"features[{n}]"
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        if not isinstance(geometry, dict) or geometry.get("type") not in _KINDS:
            raise ValueError(f"{where}.geometry must be one of {_KINDS}")

        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise ValueError(f"{where}.properties must be an object")

        given = geometry.get("coordinates")
        parts: Any = [given] if geometry["type"] == "Polygon" else given
        if not isinstance(parts, list) or not parts:
            raise ValueError(f"{where}.geometry.coordinates must be a list of rings")
        found += [(where, properties, _rings(where, part)) for part in parts]

    return _in_metres(found, unit)


def _rings(where: str, part: Any) -> list[NDArray[np.float64]]:
    """The rings of one polygon as they are, each ``(n, 2)``: the outline, then holes."""
    wrong = ValueError(
        f"{where}.geometry.coordinates must be rings of four positions [x, y] or more"
    )
    if not isinstance(part, list) or not part:
        raise wrong

    rings = []
    for ring in part:
        if not isinstance(ring, list) or len(ring) < 4 or not all(map(_is_position, ring)):
            raise wrong
        rings.append(np.array([position[:2] for position in ring], dtype=np.float64))

    return rings


def _is_position(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) in (2, 3)
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in value)
        and all(abs(each) <= _LARGEST for each in value)
    )


def _in_metres(
    found: list[tuple[str, dict[str, Any], list[NDArray[np.float64]]]], unit: Unit
) -> list[_Polygon]:
    """The polygons with their corners in metres."""
    scale = np.ones(2)
    origin = np.zeros(2)
    if unit == "deg":
        corners = np.concatenate([ring for _, _, rings in found for ring in rings])
        if (np.abs(corners) > (180.0, 90.0)).any():
            raise ValueError("longitudes go to 180 degrees and latitudes to 90: unit='m' otherwise")
        origin = corners.min(axis=0)
        scale = _EARTH_M * np.radians([cos(radians(origin[1])), 1.0])

    return [
        _Polygon(where, properties, [((ring - origin) * scale).tolist() for ring in rings])
        for where, properties, rings in found
    ]


def _obstacle(polygon: _Polygon, height: float) -> PolygonObstacle:
    """The polygon as a part of a scene; a ``ValueError`` names it where it can be none."""
    try:
        return PolygonObstacle.model_validate(
            {
                "polygon": polygon.rings[0],
                "holes": polygon.rings[1:],
                "height": polygon.properties.get("height", height),
            }
        )
    except ValidationError as error:
        raise ValueError(f"{polygon.where}: {in_one_line(error)}") from None


def _ends(room: Any, obstacles: list[Any]) -> dict[str, list[float]]:
    """Start and goal of a plan of polygons, sought on a raster."""
    lower = np.array(room.bounds[:2])
    sides = np.array(room.bounds[2:]) - lower
    cell_size = float(sides.max()) / _DRAFT_CELLS
    columns, rows = np.maximum(1, np.floor(sides / cell_size)).astype(int).tolist()
    x, y = np.meshgrid(
        lower[0] + (np.arange(columns) + 0.5) * cell_size,
        lower[1] + (np.arange(rows) + 0.5) * cell_size,
        indexing="ij",
    )  # (X, Y) each
    floor = shapely.difference(room, shapely.union_all(obstacles))
    shapely.prepare(floor)

    return ends_of(shapely.contains_xy(floor, x, y), cell_size, (float(lower[0]), float(lower[1])))
