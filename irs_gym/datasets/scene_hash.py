"""`scene_hash`: what a scene and its images in mirrors share; `symmetries`: those eight images."""

import json
from hashlib import sha256
from itertools import product
from typing import Any

from irs_gym.radio.fields import Point2, Wall
from irs_gym.radio.scene import Obstacle, Room, Scene
from irs_gym.radio.shapes import PolygonObstacle, PolygonRoom, RasterObstacle

DECIMALS = 6  # of metres and all other numbers: scenes that differ by less count as equal


def symmetries(scene: Scene) -> tuple[Scene, ...]:
    """The scene's images under the symmetries of the square, about the centre of its room.

    In the order of ``itertools.product((False, True), repeat=3)`` over transposed, then mirrored in
    x, mirrored in y: the scene itself comes first. Radio map and optimum of an image are the images
    of the scene's, so long as its start and goal do not lie on the border of two cells, which
    belongs to the upper one in every image.
    """
    return tuple(_image(scene, *how) for how in product((False, True), repeat=3))


def scene_hash(scene: Scene) -> str:
    """SHA-256 of what a scene is, whatever its name, wherever its room lies and however it is
    turned or mirrored.

    Equal for all of `symmetries`, for any order of boxes, access points and panels, and for nothing
    else.
    """
    # of the eight images' texts the first in the order of the alphabet, the same for all of them
    texts = (json.dumps(_canonical(image), sort_keys=True) for image in symmetries(scene))
    return sha256(min(texts).encode()).hexdigest()


def _centre(room: Room | PolygonRoom) -> Point2:
    return (room.x_min + room.x_max) / 2, (room.y_min + room.y_max) / 2


def _image(scene: Scene, is_transposed: bool, is_mirrored_x: bool, is_mirrored_y: bool) -> Scene:
    if not (is_transposed or is_mirrored_x or is_mirrored_y):
        return scene

    room = scene.room
    centre_x, centre_y = _centre(room)

    def moved(point: Any) -> Any:
        """The image of a point; a height stays."""
        x = point[0] - centre_x
        y = point[1] - centre_y
        if is_transposed:
            x, y = y, x

        return (
            centre_x + (-x if is_mirrored_x else x),
            centre_y + (-y if is_mirrored_y else y),
            *point[2:],
        )

    def turned(size: Any) -> Any:
        return (size[1], size[0], size[2]) if is_transposed else size

    def renamed(wall: Wall | float) -> Any:
        if not isinstance(wall, str):
            angle = 90.0 - wall if is_transposed else wall
            return (-angle if is_mirrored_x != is_mirrored_y else angle) % 180.0

        axis, end = wall.split("_")
        axis = {"x": "y", "y": "x"}[axis] if is_transposed else axis
        is_mirrored = is_mirrored_x if axis == "x" else is_mirrored_y
        return f"{axis}_{ {'min': 'max', 'max': 'min'}[end] if is_mirrored else end }"

    def corners_of(part: Any) -> Any:
        """Lower and upper corner of the image of what has both: mirrored, one may be the other."""
        corners = [moved(part.lower[:2]), moved(part.upper[:2])]
        return tuple(zip(*(sorted(values) for values in zip(*corners, strict=True)), strict=True))

    def placed(part: Any) -> Any:
        """The image of an obstacle or a room."""
        if isinstance(part, Obstacle):
            update = {"center": moved(part.center), "size": turned(part.size)}
        elif isinstance(part, PolygonObstacle | PolygonRoom):
            polygon, *holes = (
                tuple(moved(point) for point in ring) for ring in (part.polygon, *part.holes)
            )
            update = {"polygon": polygon, "holes": tuple(holes)}
        elif isinstance(part, RasterObstacle):
            cells = part.is_filled.T if is_transposed else part.is_filled
            steps = (
                slice(None, None, -1 if is_mirrored_x else 1),
                slice(None, None, -1 if is_mirrored_y else 1),
            )
            return RasterObstacle.from_array(
                cells[steps], part.cell_size, corners_of(part)[0], part.height
            )
        else:
            lower, upper = corners_of(part)
            update = dict(zip(("x_min", "y_min", "x_max", "y_max"), (*lower, *upper), strict=True))

        return part.model_copy(update=update)

    return scene.model_copy(
        update={
            "room": placed(room),
            "obstacles": tuple(placed(each) for each in scene.obstacles),
            "access_points": tuple(
                each.model_copy(update={"position": moved(each.position)})
                for each in scene.access_points
            ),
            "irs_panels": tuple(
                each.model_copy(
                    update={"position": moved(each.position), "wall": renamed(each.wall)}
                )
                for each in scene.irs_panels
            ),
            "start": moved(scene.start),
            "goal": moved(scene.goal),
        }
    )


def _canonical(scene: Scene) -> Any:
    """The scene as plain lists and rounded numbers, its room's centre at the origin, its parts in a
    fixed order.
    """
    centre = _centre(scene.room)
    data = scene.model_dump(exclude={"name", "format_version"})
    if isinstance(scene.room, Room):
        data["room"] = (
            scene.room.x_max - scene.room.x_min,
            scene.room.y_max - scene.room.y_min,
            scene.room.height,
        )
    else:
        data["room"] = _part(centre, data["room"])

    for parts in ("obstacles", "access_points", "irs_panels"):
        data[parts] = [_part(centre, part) for part in data[parts]]

    data["start"] = _from(centre, scene.start)
    data["goal"] = _from(centre, scene.goal)
    data = _rounded(data)

    # in an order that depends on nothing but what the parts are
    for parts in ("obstacles", "access_points", "irs_panels"):
        data[parts].sort(key=lambda part: json.dumps(part, sort_keys=True))

    return data


def _part(centre: Point2, part: dict[str, Any]) -> dict[str, Any]:
    """A part with its place counted from the room's centre, and what may be written in several ways
    in one of them.
    """
    for place in ("center", "position", "origin"):
        if place in part:
            part = {**part, place: _from(centre, part[place])}
    if "polygon" in part:
        rings = [
            _ring([_from(centre, point) for point in ring])
            for ring in (part["polygon"], *part["holes"])
        ]
        part = {**part, "polygon": rings[0], "holes": sorted(rings[1:])}
    if isinstance(part.get("wall"), float):
        part = {**part, "wall": round(part["wall"] % 180.0, DECIMALS) % 180.0}

    return part


def _ring(ring: list[Any]) -> list[Any]:
    """The corners of a ring once each, from the least on, and the way round that comes first."""
    corners = _rounded(ring)
    corners = corners[:-1] if corners[0] == corners[-1] else corners
    ways = []

    for way in (corners, corners[::-1]):
        first = way.index(min(way))
        ways.append(way[first:] + way[:first])

    return min(ways)


def _from(centre: Point2, point: Any) -> Any:
    return point[0] - centre[0], point[1] - centre[1], *point[2:]


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    # no -0.0 beside 0.0
    return round(value, DECIMALS) + 0.0 if isinstance(value, float) else value
