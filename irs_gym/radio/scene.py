"""`Scene`: the factory as data (room, obstacles, antennas, task), validated, loaded and saved."""

import json
from collections.abc import Mapping
from functools import lru_cache
from importlib import resources
from math import ceil
from numbers import Integral
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from irs_gym.files import as_path, read_file, write_file
from irs_gym.grid import Grid, checked_cell_size
from irs_gym.radio.fields import (
    Count,
    Decibels,
    Degrees,
    Frequency,
    Length,
    Metres,
    Part,
    PhaseBits,
    Pitch,
    Point2,
    Point3,
    Wall,
)
from irs_gym.radio.geometry import TOUCH, Boxes
from irs_gym.radio.obstacles.floor import Floor
from irs_gym.radio.obstacles.prisms import Prisms
from irs_gym.radio.obstacles.raster import Raster
from irs_gym.radio.path_loss import PathLoss, PathLossModel, formulas_of
from irs_gym.radio.shapes import PolygonObstacle, PolygonRoom, RasterObstacle

TARGET_DB = -61.8  # the paper's, where nothing else is said
MOST_ELEMENTS = 10**12  # of a panel
_FILE_BYTES = 2**24  # of a scene file; that of a factory has a few thousand
_MOST_LISTED = 10  # mistakes of one file


class Room(Part):
    """The rectangular floor and the ceiling, in metres; the floor is at z = 0."""

    x_min: Metres
    x_max: Metres
    y_min: Metres
    y_max: Metres
    height: Length

    @property
    def lower(self) -> Point2:
        """Lower left corner of the floor."""
        return self.x_min, self.y_min

    @property
    def upper(self) -> Point2:
        """Upper right corner of the floor."""
        return self.x_max, self.y_max

    @model_validator(mode="after")
    def _has_an_area(self) -> Self:
        if not (self.x_max > self.x_min and self.y_max > self.y_min):
            raise ValueError("x_max must be greater than x_min, and y_max than y_min")
        return self

    def holds(self, point: Point2 | Point3) -> bool:
        """Whether a point lies in the room, its walls included."""
        height = point[2] if len(point) == 3 else 0.0  # on the floor where none is given
        # a box flush with a wall may end a rounding error behind it
        over = (
            self.x_min - point[0],
            point[0] - self.x_max,
            self.y_min - point[1],
            point[1] - self.y_max,
        )
        return max(*over, -height, height - self.height) <= TOUCH


class Obstacle(Part):
    """A box on the floor that robots cannot enter and that blocks line of sight."""

    center: Point2  # of its footprint
    size: tuple[Length, Length, Length]  # along x, along y, height

    @property
    def lower(self) -> Point3:
        """Lower corner in metres."""
        return self.center[0] - self.size[0] / 2, self.center[1] - self.size[1] / 2, 0.0

    @property
    def upper(self) -> Point3:
        """Upper corner in metres."""
        return self.center[0] + self.size[0] / 2, self.center[1] + self.size[1] / 2, self.size[2]


class AccessPoint(Part):
    """A single-antenna access point."""

    position: Point3


def _kind_of_wall(value: Any) -> str:
    """Which kind of wall a value is meant to be: an angle where it is a number."""
    return "<angle>" if isinstance(value, int | float) else "<name>"


class IrsPanel(Part):
    """A reflecting surface on a wall: columns x rows of sub-surfaces, each of several elements.

    All elements of a sub-surface share one phase shift. Columns run along the wall, rows along z;
    the panel is centred on `position`.
    """

    position: Point3
    # on which wall of a rectangle, or the wall's angle against the x axis
    wall: Annotated[
        Annotated[Wall, Tag("<name>")] | Annotated[Degrees, Tag("<angle>")],
        Discriminator(_kind_of_wall),
    ]
    columns: Count
    rows: Count
    elements_per_subsurface: tuple[Count, Count]  # along the wall, along z
    pitch_wavelengths: Pitch  # between neighbouring elements, both ways

    @model_validator(mode="after")
    def _can_be_counted(self) -> Self:
        if self.elements > MOST_ELEMENTS:
            raise ValueError(
                f"columns, rows and elements_per_subsurface make {self.elements} elements, "
                "not at most 1e12"
            )
        return self

    @property
    def elements_per_row(self) -> int:
        """Elements in one row of sub-surfaces."""
        along, up = self.elements_per_subsurface
        return self.columns * along * up

    @property
    def elements(self) -> int:
        """Number of elements, the paper's M."""
        return self.rows * self.elements_per_row

    @property
    def subsurfaces(self) -> int:
        """Number of sub-surfaces, the paper's N."""
        return self.columns * self.rows

    @property
    def along_wall(self) -> NDArray[np.float64]:
        """Unit vector ``(3,)`` of the columns."""
        if isinstance(self.wall, str):
            return np.array([0.0, 1.0, 0.0] if self.wall.startswith("x") else [1.0, 0.0, 0.0])

        angle = np.radians(self.wall)
        return np.array([np.cos(angle), np.sin(angle), 0.0])


def _kind_of_obstacle(value: Any) -> str:
    """Which kind of obstacle a value is meant to be."""
    if isinstance(value, PolygonObstacle) or (isinstance(value, dict) and "polygon" in value):
        return "<polygon>"
    if isinstance(value, RasterObstacle) or (isinstance(value, dict) and "rows" in value):
        return "<raster>"
    return "<box>"


def _kind_of_room(value: Any) -> str:
    """Which kind of room a value is meant to be."""
    is_polygon = isinstance(value, PolygonRoom) or (isinstance(value, dict) and "polygon" in value)
    return "<polygon>" if is_polygon else "<rectangle>"


AnyObstacle = Annotated[
    Annotated[Obstacle, Tag("<box>")]
    | Annotated[PolygonObstacle, Tag("<polygon>")]
    | Annotated[RasterObstacle, Tag("<raster>")],
    Discriminator(_kind_of_obstacle),
]
AnyRoom = Annotated[
    Annotated[Room, Tag("<rectangle>")] | Annotated[PolygonRoom, Tag("<polygon>")],
    Discriminator(_kind_of_room),
]


class Scene(Part):
    """A factory and the task in it. Lengths in metres, z = 0 on the floor.

    In format 1 room and obstacles are boxes along the axes. In format 2 obstacles may be polygons
    and rasters as well (`irs_gym.radio.shapes`), the room a polygon, a panel's wall an angle in
    degrees, and path loss a name or so many dB a wall (`irs_gym.radio.path_loss`).

    Any mistake raises a ``ValueError`` that names the field.

    Examples
    --------
    >>> scene = load_scene("paper")
    >>> len(scene.obstacles), scene.irs_panels[0].elements
    (5, 1200)
    >>> Scene.from_data({**scene.to_data(), "carrier_ghz": -2.0})
    Traceback (most recent call last):
    ValueError: scene: carrier_ghz: Input should be greater than 0 (got -2.0)
    """

    format_version: Literal[1, 2] = 1
    name: str
    room: AnyRoom
    obstacles: Annotated[tuple[AnyObstacle, ...], Field(max_length=10_000)]
    access_points: Annotated[tuple[AccessPoint, ...], Field(min_length=1, max_length=1000)]
    irs_panels: Annotated[tuple[IrsPanel, ...], Field(max_length=1000)]
    antenna_height: Length
    start: Point2
    goal: Point2
    carrier_ghz: Frequency
    rician_factor_db: Decibels
    path_loss: PathLossModel
    target_db: float = TARGET_DB  # lowest expected channel gain that keeps the robot connected
    # resolution of all panels' phase shifters; None for continuous phases
    phase_bits: PhaseBits | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        mistakes = [*self._too_new(), *self._misplaced_parts(), *self._misplaced_ends()]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    def _too_new(self) -> list[str]:
        """What to say of parts that a file of format 1 knows nothing of."""
        if self.format_version > 1:
            return []

        new = []
        if isinstance(self.room, PolygonRoom):
            new.append("room")
        new += [
            f"obstacles[{n}]"
            for n, each in enumerate(self.obstacles)
            if not isinstance(each, Obstacle)
        ]
        new += [
            f"irs_panels[{n}].wall={each.wall}"
            for n, each in enumerate(self.irs_panels)
            if not isinstance(each.wall, str)
        ]
        if not isinstance(self.path_loss, PathLoss):
            new.append(f"path_loss={self.path_loss!r}")

        return [f"{part} needs format_version 2" for part in new[:_MOST_LISTED]]

    def _misplaced_parts(self) -> list[str]:
        """What to say of boxes, access points and panels that are not where they can be."""
        room = self.room
        mistakes = []

        for n, is_inside in enumerate(_are_inside(room, self.obstacles)):
            if not is_inside:
                each = self.obstacles[n]
                mistakes.append(
                    f"obstacles[{n}] reaches from {each.lower} to {each.upper}, outside the room"
                )

        for n, point in enumerate(self.access_points):
            if not room.holds(point.position):
                mistakes.append(
                    f"access_points[{n}].position={point.position} lies outside the room"
                )

        for n, panel in enumerate(self.irs_panels):
            mistakes += self._off_the_wall(n, panel)
            mistakes += self._too_near(n, panel)

        if not self.antenna_height <= room.height:
            mistakes.append(
                f"antenna_height={self.antenna_height} exceeds the room's height {room.height}"
            )

        return mistakes

    def _off_the_wall(self, n: int, panel: IrsPanel) -> list[str]:
        """What to say of a panel that is not on its wall. One with an angle may hang anywhere in
        the room, on the face of an obstacle, say.
        """
        is_inside = self.room.holds(panel.position)
        if not isinstance(panel.wall, str):
            if is_inside and not self.floor.is_covered(np.array(panel.position[:2])):
                return []
            return [
                f"irs_panels[{n}].position={panel.position} must lie in the room, "
                "and not inside an obstacle"
            ]

        # a wall is named by the coordinate that is the same all along it: "x_min"
        where = panel.position["xy".index(panel.wall[0])]
        wall = getattr(self.room, panel.wall)
        if is_inside and abs(where - wall) <= TOUCH:
            return []

        return [
            f"irs_panels[{n}].position={panel.position} must lie on its wall, "
            f"{panel.wall[0]} = {wall}"
        ]

    def _too_near(self, n: int, panel: IrsPanel) -> list[str]:
        """What to say of a panel so near to an access point that path loss would be a gain."""
        apart = np.array([point.position for point in self.access_points]) - panel.position
        nearest = float(np.sqrt((apart**2).sum(axis=1)).min())
        if nearest <= TOUCH:
            return [f"irs_panels[{n}].position={panel.position} coincides with an access point"]

        loss_db = float(formulas_of(self.path_loss)[0].loss_db(nearest, self.carrier_ghz))
        if loss_db >= 0:
            return []

        return [
            f"irs_panels[{n}].position={panel.position} is {nearest:.3g} m from an access point: "
            f"path_loss there is {loss_db:.4g} dB, and no passive link has one below 0"
        ]

    def _misplaced_ends(self) -> list[str]:
        """What to say of a start and a goal where no robot can be, or that are one."""
        mistakes = []
        for field in ("start", "goal"):
            point = getattr(self, field)
            if not self.room.holds(point):
                mistakes.append(
                    f"{field}={point} lies outside the room {self.room.lower} to {self.room.upper}"
                )
            elif self.floor.is_covered(np.array(point)):
                mistakes.append(f"{field}={point} lies inside an obstacle")

        if self.start == self.goal:
            mistakes.append(f"goal={self.goal} must differ from start")

        return mistakes

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> "Scene":
        """Scene of what a scene file holds, as `to_data` gives it; a ``ValueError`` names each
        field at fault.
        """
        try:
            return cls.model_validate_json(json.dumps(dict(data)), strict=True)
        except ValidationError as error:
            raise ValueError(f"scene: {_in_one_line(error)}") from None
        except TypeError as error:
            raise ValueError(f"scene holds what JSON cannot: {error}") from None

    def to_data(self) -> dict[str, Any]:
        """What a scene file holds: numbers, strings, lists and dicts."""
        return self.model_dump(mode="json")

    @property
    def boxes(self) -> Boxes:
        """Those of the obstacles that are boxes, as arrays."""
        return self.floor.boxes

    @property
    def floor(self) -> Floor:
        """All that stands in the way of robots and of lines of sight."""
        return _floor_of(self.room, self.obstacles)

    def grid(self, cell_size: float) -> Grid:
        """Grid over the floor; raises ``ValueError`` where ``cell_size`` (metres) does not divide
        the room.

        One over a polygon reaches as far beyond its greatest x and y as whole cells do.
        """
        if isinstance(self.room, Room):
            return Grid.tile(self.room.lower, self.room.upper, cell_size)

        cell_size = checked_cell_size(cell_size)
        sides = np.subtract(self.room.upper, self.room.lower)
        columns, rows = (max(1, ceil(side / cell_size - 1e-9)) for side in sides.tolist())

        return Grid((columns, rows), cell_size, self.room.lower)

    def with_irs_elements(self, irs_elements: int | None) -> "Scene":
        """The scene with ``irs_elements`` elements on each panel: its rows grow or shrink.

        0 removes the panels (the paper's "without IRS"); None keeps them as they are.

        Raises
        ------
        ValueError
            Where the elements are no whole number or more than any panel has, do not fill whole
            rows of sub-surfaces, or the scene has no panel to put them on.
        """
        if irs_elements is None:
            return self
        if isinstance(irs_elements, bool) or not isinstance(irs_elements, Integral):
            raise ValueError(
                f"irs_elements={irs_elements!r} must be a whole number of elements, or None"
            )

        elements = int(irs_elements)
        if elements > MOST_ELEMENTS:
            raise ValueError(
                f"irs_elements={elements} is more than the {MOST_ELEMENTS} that a panel may have"
            )
        if elements == 0:
            return self.model_copy(update={"irs_panels": ()})
        if not self.irs_panels:
            raise ValueError(
                f"irs_elements={elements} needs an IRS panel, and scene {self.name!r} lists none"
            )

        panels = tuple(_with_elements(panel, elements) for panel in self.irs_panels)

        return self.model_copy(update={"irs_panels": panels})

    def save(self, path: str | Path) -> None:
        """Write the scene as JSON, atomically."""
        write_file(Path(path), (self.model_dump_json(indent=2) + "\n").encode())


# Scenes that differ in other fields share one; a map asks for it once a block and antenna.
@lru_cache(maxsize=16)
def _floor_of(room: Room | PolygonRoom, obstacles: tuple[Any, ...]) -> Floor:
    """The obstacles by kind, and the outside of the room."""
    boxes = [each for each in obstacles if isinstance(each, Obstacle)]
    prisms = [each for each in obstacles if isinstance(each, PolygonObstacle)]
    rasters = tuple(
        Raster(each.is_filled, each.cell_size, each.origin, each.height)
        for each in obstacles
        if isinstance(each, RasterObstacle)
    )

    corners = [(box.lower, box.upper) for box in boxes]
    both = np.array(corners, dtype=np.float64).reshape(-1, 2, 3)  # (B, 2, 3), B may be 0

    return Floor(
        boxes=Boxes(both[:, 0], both[:, 1]),
        prisms=Prisms([each.shape for each in prisms], [each.height for each in prisms]),
        rasters=rasters,
        room=room.shape if isinstance(room, PolygonRoom) else None,
    )


def _are_inside(room: Room | PolygonRoom, obstacles: tuple[AnyObstacle, ...]) -> list[bool]:
    """Whether each obstacle lies in the room, or flush with its walls.

    Of a raster in a polygon, what is outside counts for nothing: it need only meet the room.
    """
    if isinstance(room, Room):
        return [room.holds(each.lower) and room.holds(each.upper) for each in obstacles]

    grown = room.shape.buffer(TOUCH, join_style="mitre")
    shapely.prepare(grown)
    fits = []

    for each in obstacles:
        shape = (
            each.shape
            if isinstance(each, PolygonObstacle)
            else shapely.box(*each.lower[:2], *each.upper[:2])
        )
        is_inside = (
            grown.intersects(shape) if isinstance(each, RasterObstacle) else grown.covers(shape)
        )
        fits.append(bool(is_inside) and each.upper[2] <= room.height + TOUCH)

    return fits


def _with_elements(panel: IrsPanel, elements: int) -> IrsPanel:
    """The panel with as many rows of sub-surfaces as hold so many elements in all."""
    step = panel.elements_per_row
    rows, rest = divmod(elements, step)
    if rest or rows < 1:
        below = max(rows, 0) * step
        above = (max(rows, 0) + 1) * step
        raise ValueError(
            f"irs_elements={elements} does not fill whole rows of sub-surfaces: a row of "
            f"{panel.columns} sub-surfaces of {step // panel.columns} elements takes {step}, "
            f"so {below} or {above} would fit"
        )

    return panel.model_copy(update={"rows": rows})


def scene_names() -> list[str]:
    """Names of the scenes in the package."""
    files = resources.files("irs_gym").joinpath("scenes").iterdir()
    return sorted(file.name.removesuffix(".json") for file in files if file.name.endswith(".json"))


def load_scene(source: str | Path) -> Scene:
    """Scene of the package by its name (``"paper"``), or from a JSON file by its path.

    Raises
    ------
    FileNotFoundError
        Where there is neither such a scene nor such a file.
    ValueError
        Where the file is not a valid scene; the message names each field at fault.

    Examples
    --------
    >>> load_scene("paper").room.height
    5.0
    """
    place = as_path(source, "scene")
    if source in scene_names():
        text = resources.files("irs_gym").joinpath("scenes", f"{source}.json").read_bytes()
    elif place.is_file():
        text = read_file(place, _FILE_BYTES)
    else:
        raise FileNotFoundError(
            f"scene={str(source)!r} is neither a file nor one of the scenes {scene_names()}"
        )

    try:
        return Scene.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise ValueError(f"scene {str(source)!r}: {_in_one_line(error)}") from None


def load_scenes(folder: str | Path) -> tuple[Scene, ...]:
    """The scene files of a folder in the order of their names, each a scene named by its file.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder.
    ValueError
        Where there is no scene file in it, or one is not a valid scene; the message names the file.
    """
    place = as_path(folder, "scenes")
    if not place.is_dir():
        raise FileNotFoundError(f"scenes={str(folder)!r} is no folder of scene files")

    files = sorted(place.glob("*.json"))
    if not files:
        raise ValueError(f"scenes={str(folder)!r} holds no scene file (*.json)")

    return tuple(load_scene(file).model_copy(update={"name": file.stem}) for file in files)


def _in_one_line(error: ValidationError) -> str:
    """What pydantic says of each mistake, with the field at fault: ``start[0]: ...; goal: ...``."""
    mistakes = []
    for mistake in error.errors(include_url=False)[:_MOST_LISTED]:
        field = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}"
            for part in mistake["loc"]
            if not str(part).startswith("<")  # which kind of part it was taken for
        ).lstrip(".")
        # what was given instead of a missing field, or to a check of all fields, is the whole part
        is_whole_part = mistake["type"] == "missing" or not field
        given = "" if is_whole_part else f" (got {_shortened(mistake['input'])})"
        said = mistake["msg"].removeprefix("Value error, ")
        mistakes.append(f"{field}: {said}{given}" if field else said)

    more = error.error_count() - len(mistakes)
    return "; ".join([*mistakes, f"and {more} more mistakes"] if more else mistakes)


def _shortened(value: Any) -> str:
    """A value as Python writes it, cut after 200 characters."""
    try:
        said = repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number of thousands of digits"

    return said if len(said) <= 200 else f"{said[:200]}..."
