"""`Handle`: a part of a scene that a hand can hold, and the scene with that part changed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import dist
from typing import Any, Literal

import shapely

from irs_gym.radio.obstacles.raster import Raster
from irs_gym.radio.scene import AnyObstacle, Obstacle, Scene
from irs_gym.radio.shapes import PolygonObstacle, RasterObstacle

Kind = Literal["obstacles", "access_points", "irs_panels", "start", "goal"]
Point = tuple[float, float]
_LISTS = ("obstacles", "access_points", "irs_panels")
_DECIMALS = 6  # of metres: sums leave no 0.30000000000000004 in a file


@dataclass(frozen=True)
class Handle:
    """A part of a scene: the field that it stands in, and its place there.

    Examples
    --------
    >>> str(Handle("obstacles", 2)), str(Handle("start"))
    ('obstacles[2]', 'start')
    """

    kind: Kind
    number: int = 0

    def __str__(self) -> str:
        return f"{self.kind}[{self.number}]" if self.is_listed else self.kind

    @property
    def is_listed(self) -> bool:
        """Whether a scene may hold several of its kind."""
        return self.kind in _LISTS


def place_of(scene: Scene, handle: Handle) -> Point:
    """Where a part is, in metres: the middle of an obstacle's box."""
    if handle.kind == "obstacles":
        obstacle = scene.obstacles[handle.number]
        return (
            (obstacle.lower[0] + obstacle.upper[0]) / 2,
            (obstacle.lower[1] + obstacle.upper[1]) / 2,
        )
    if handle.kind == "access_points":
        return scene.access_points[handle.number].position[:2]
    if handle.kind == "irs_panels":
        return scene.irs_panels[handle.number].position[:2]

    return scene.start if handle.kind == "start" else scene.goal


def footprint_of(obstacle: AnyObstacle) -> Any:
    """The floor that an obstacle takes, as a polygon or polygons of ``shapely``."""
    if isinstance(obstacle, PolygonObstacle):
        return obstacle.shape
    if isinstance(obstacle, RasterObstacle):
        raster = Raster(obstacle.is_filled, obstacle.cell_size, obstacle.origin, obstacle.height)
        return raster.footprint

    return shapely.box(*obstacle.lower[:2], *obstacle.upper[:2])


def handle_at(scene: Scene, point: Point, reach: float) -> Handle | None:
    """What a hand takes hold of at a point: the nearest of ends, access points and panels within
    reach (metres), or else the smallest obstacle there.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> paper = load_scene("paper")
    >>> str(handle_at(paper, (0.2, 9.9), 0.5)), str(handle_at(paper, (4.0, 5.0), 0.5))
    ('access_points[0]', 'obstacles[4]')
    """
    small = [
        Handle("start"),
        Handle("goal"),
        *(Handle("access_points", n) for n in range(len(scene.access_points))),
        *(Handle("irs_panels", n) for n in range(len(scene.irs_panels))),
    ]
    apart = {handle: dist(place_of(scene, handle), point) for handle in small}
    nearest = min(small, key=apart.__getitem__)
    if apart[nearest] <= reach:
        return nearest

    around = [
        n
        for n, each in enumerate(scene.obstacles)
        if each.lower[0] <= point[0] <= each.upper[0] and each.lower[1] <= point[1] <= each.upper[1]
    ]
    areas = {n: footprint_of(scene.obstacles[n]) for n in around}
    held = [n for n, shape in areas.items() if shape.intersects(shapely.Point(point))]

    return Handle("obstacles", min(held, key=lambda n: areas[n].area)) if held else None


def moved(scene: Scene, handle: Handle, by: Point) -> Scene:
    """The scene with a part moved by so many metres; a panel that hangs on a wall of a rectangle
    goes to the nearest one.

    Raises ``ValueError``, which names the field, where the part cannot be there.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> moved(load_scene("paper"), Handle("obstacles", 4), (6.0, 0.0))
    Traceback (most recent call last):
    ValueError: obstacles[4] reaches from (7.0, 2.0, 0.0) to (11.0, 6.0, 1.3), outside the room
    """

    def shifted(point: Any) -> list[float]:
        x, y, *rest = point
        return [round(x + by[0], _DECIMALS), round(y + by[1], _DECIMALS), *rest]

    def move(part: dict[str, Any]) -> None:
        for name in ("center", "origin", "position"):
            if name in part:
                part[name] = shifted(part[name])
        if "polygon" in part:
            part["polygon"] = [shifted(corner) for corner in part["polygon"]]
            part["holes"] = [[shifted(corner) for corner in ring] for ring in part["holes"]]
        if isinstance(part.get("wall"), str):
            part["wall"], part["position"] = _on_nearest_wall(scene, part["position"])

    return _changed(scene, handle, shifted, move)


def _on_nearest_wall(scene: Scene, position: list[float]) -> tuple[str, list[float]]:
    """The wall that is nearest to a position, and the point on it."""
    room = scene.room
    x = min(max(position[0], room.x_min), room.x_max)
    y = min(max(position[1], room.y_min), room.y_max)
    apart = {
        "x_min": x - room.x_min,
        "x_max": room.x_max - x,
        "y_min": y - room.y_min,
        "y_max": room.y_max - y,
    }
    wall = min(apart, key=apart.__getitem__)
    on_wall = [getattr(room, wall), y] if wall.startswith("x") else [x, getattr(room, wall)]

    return wall, [*on_wall, position[2]]


# --- numbers of a part ----------------------------------------------------------------------------

_XYZ = ("x", "y", "z")
_Numbers = dict[str, tuple[str, int | None]]  # label -> field, and which of its numbers


def numbers_of(scene: Scene, handle: Handle) -> dict[str, float]:
    """What can be typed in of a part, in metres, by its label.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> numbers_of(load_scene("paper"), Handle("obstacles", 0))
    {'x': -5.0, 'y': -5.0, 'size in x': 4.0, 'size in y': 4.0, 'height': 1.3}
    """
    if not handle.is_listed:
        return dict(zip(_XYZ, getattr(scene, handle.kind), strict=False))

    part = getattr(scene, handle.kind)[handle.number]
    found = {}
    for label, (name, n) in _labels(part).items():
        value = getattr(part, name)
        found[label] = value if n is None else value[n]

    return found


def edited(scene: Scene, handle: Handle, label: str, value: float) -> Scene:
    """The scene with one of the numbers of `numbers_of` replaced.

    Raises ``ValueError``, which names the field, where the scene cannot have it.
    """

    def in_point(point: Any) -> list[float]:
        place = _XYZ.index(label)
        return [value if n == place else each for n, each in enumerate(point)]

    def in_part(part: dict[str, Any]) -> None:
        name, n = _labels(getattr(scene, handle.kind)[handle.number])[label]
        part[name] = (
            value
            if n is None
            else [value if place == n else each for place, each in enumerate(part[name])]
        )

    return _changed(scene, handle, in_point, in_part)


def _labels(part: Any) -> _Numbers:
    """Labels of a part's numbers, with the field that each stands in and its place there."""
    if isinstance(part, Obstacle):
        sizes = ("size in x", "size in y", "height")
        return {
            **{label: ("center", n) for n, label in enumerate(_XYZ[:2])},
            **{label: ("size", n) for n, label in enumerate(sizes)},
        }
    if isinstance(part, PolygonObstacle):
        return {"height": ("height", None)}
    if isinstance(part, RasterObstacle):
        return {"x": ("origin", 0), "y": ("origin", 1), "height": ("height", None)}

    # a panel that hangs on a wall of a rectangle moves along it
    wall = getattr(part, "wall", None)
    fixed = wall[0] if isinstance(wall, str) else None

    return {label: ("position", n) for n, label in enumerate(_XYZ) if label != fixed}


# --- more and fewer parts -------------------------------------------------------------------------


def duplicated(scene: Scene, handle: Handle) -> tuple[Scene, Handle]:
    """The scene with a part twice, the second beside the first, and what holds the second.

    Raises ``ValueError`` where no place beside it will do; the message tells of the last.
    """
    if not handle.is_listed:
        raise ValueError(f"{handle} cannot be there twice")

    parts = getattr(scene, handle.kind)
    copy = Handle(handle.kind, len(parts))
    twice = scene.model_copy(update={handle.kind: (*parts, parts[handle.number])})
    why = ""

    for by in ((1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (2.0, 0.0), (-2.0, 0.0)):
        try:
            return moved(twice, copy, by), copy
        except ValueError as error:
            why = str(error)

    raise ValueError(why)


def without(scene: Scene, handle: Handle) -> Scene:
    """The scene without a part; ``ValueError`` where it needs that."""
    if not handle.is_listed:
        raise ValueError(f"{handle} is needed: it can be moved, not removed")

    data = scene.to_data()
    del data[handle.kind][handle.number]

    return checked_scene(data)


def checked_scene(data: Mapping[str, Any]) -> Scene:
    """The scene of such data; a ``ValueError`` names the field at fault first."""
    try:
        return Scene.from_data(data)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("scene: ")) from None


def _changed(
    scene: Scene,
    handle: Handle,
    of_point: Callable[[Any], list[float]],
    of_part: Callable[[dict[str, Any]], None],
) -> Scene:
    """The scene with one part changed: an end by one function, a part of a list by the other."""
    data = scene.to_data()
    if handle.is_listed:
        of_part(data[handle.kind][handle.number])
    else:
        data[handle.kind] = of_point(data[handle.kind])

    return checked_scene(data)
