"""`generate_scene`: factories drawn at random, each with a task that can be solved."""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, dist, floor
from numbers import Real
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.layouts.families import FamilyName, Layout, draw_layout
from irs_gym.datasets.layouts.floor_plan import draw_walls
from irs_gym.datasets.solved_scene import SolvedScene, radio_map_of
from irs_gym.grid import Cell, Grid, as_cell, checked_point, octile_distance
from irs_gym.mdp.robot import PAPER_ROBOT, Collision, Fit, Robot
from irs_gym.oracle.shortest_path import distance_to_go, highest_feasible_target, largest_component
from irs_gym.radio.fields import Point3, Wall
from irs_gym.radio.geometry import TOUCH, Boxes, is_in_footprint
from irs_gym.radio.scene import AccessPoint, IrsPanel, Obstacle, Room, Scene, load_scene
from irs_gym.radio.shapes import PolygonRoom
from irs_gym.units import wavelength_m

# Of what is drawn from a seed, and of its map. Whoever changes either makes other scenes of all
# seeds, and raises it.
VERSION = 1

CELL_SIZE = 0.5  # metres: of the map that makes a scene feasible
RASTER = 0.25  # metres: edges of boxes
LONGEST = 200.0  # metres: the greatest side of a room
MOST_BOXES = 1000
MOST_ROOMS = 100
FACTORIES = 10_000  # drawn before a difficulty is given up
TRIES = 12  # tasks tried in one factory, whose map costs more than they
LEAST_FLOOR = 0.4  # of the room: the largest piece of floor that a robot can drive on
LEAST_RANGE_DB = 0.5  # from the loosest to the highest feasible target
MOST_ACCESS_POINTS = 16
LEAST_APART = 1.0  # metres: from one of several access points to a panel
# Of the families, where walls alone decide:
DETOURS = (1.2, 6.0)  # least and greatest detour
NEAR_DETOUR = 0.1  # share by which a detour may differ from the one that was drawn
SLACK_DB = 3.0  # most that the target lies below the gain of the worst cell
WALLS: tuple[Wall, ...] = ("x_min", "x_max", "y_min", "y_max")

Range = tuple[int, int]  # both ends included
Panels = Literal["usual", "none", "two", "small", "large"]
_ELEMENTS: dict[Panels, tuple[Range, ...]] = {  # of each panel
    "usual": ((400, 2400),),
    "none": (),
    "two": ((400, 2400), (400, 2400)),
    "small": ((20, 200),),
    "large": ((4000, 8000),),
}


@dataclass(frozen=True, kw_only=True)
class Difficulty:
    """What scenes are drawn from. Raises ``ValueError`` where a value is out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> small = Difficulty(sides=(8.0, 10.0), boxes=(1, 2), detour_share=0.0)
    >>> len(generate_scene(np.random.default_rng(1), small).obstacles) in (1, 2)
    True
    """

    sides: tuple[float, float] = (14.0, 20.0)
    """Least and greatest side of the room in metres."""
    boxes: Range = (3, 12)
    """Least and greatest number of boxes."""
    panels: tuple[Panels, ...] = ("usual",)
    """Kinds of IRS, each as likely."""
    detour: float = 1.05
    """Oracle distance over octile distance that a scene with a detour is above."""
    detour_share: float = 0.6
    """Probability that a scene is drawn until it has a detour; the others are as they come, some
    with one, too.
    """
    rooms: Range | None = None
    """Least and greatest number of rooms that walls with doors divide the floor into, on top of the
    boxes; None: no walls.
    """
    family: FamilyName | None = None
    """Walls that decide the way, on top of the boxes: a target below the gain of every cell, and a
    detour drawn between 1.2 and 6, or what the walls allow; ``detour`` and ``detour_share`` are not
    asked. None: none.
    """
    other_sides: tuple[float, float] | None = None
    """Least and greatest length in metres of two opposite sides, whichever, where they are not
    ``sides`` as well: of a hall.
    """
    access_points: Range = (1, 1)
    """Least and greatest number of access points, each on a wall."""

    def __post_init__(self) -> None:
        self._check_sides("sides")
        if self.other_sides is not None:
            self._check_sides("other_sides")

        self._check_range("boxes", 0, MOST_BOXES, "boxes")
        self._check_range("access_points", 1, MOST_ACCESS_POINTS, "access points")
        if self.rooms is not None:
            self._check_range("rooms", 1, MOST_ROOMS, "rooms")

        if self.family is not None and self.family not in get_args(FamilyName):
            raise ValueError(f"family={self.family!r} must be one of {get_args(FamilyName)}")
        if (
            not isinstance(self.panels, tuple)
            or not self.panels
            or not all(each in (*_ELEMENTS,) for each in self.panels)
        ):
            raise ValueError(f"panels={self.panels} must hold some of {tuple(_ELEMENTS)}")

        for name in ("detour", "detour_share"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Real):
                raise ValueError(f"{name}={value!r} must be a number")

        if not 1.0 <= self.detour <= 1.5:
            raise ValueError(
                f"detour={self.detour} must lie from 1 to 1.5: few scenes have longer ones"
            )
        if not 0.0 <= self.detour_share <= 1.0:
            raise ValueError(f"detour_share={self.detour_share} must be a probability from 0 to 1")

    def _check_sides(self, name: str) -> None:
        sides = getattr(self, name)
        low, high = checked_point(sides, name)
        if not 4.0 <= low <= high <= LONGEST:
            raise ValueError(f"{name}={sides} must rise, from 4 m to {LONGEST} m at most")

    def _check_range(self, name: str, low: int, high: int, what: str) -> None:
        given = getattr(self, name)
        least, most = as_cell(
            given, name, f"two integers, the least and the greatest number of {what}"
        )
        if not low <= least <= most <= high:
            raise ValueError(f"{name}={given} must rise, from {low} to {high} at most")


DIFFICULTIES = {
    "easy": Difficulty(detour_share=0.0),
    "default": Difficulty(),
    "hard": Difficulty(detour=1.2, detour_share=1.0),
}


def generate_scene(
    rng: np.random.Generator,
    difficulty: str | Difficulty = "default",
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    collision: Collision = "centre",
) -> Scene:
    """A scene drawn at random, feasible at its own target.

    A room with boxes, an access point on one wall and an IRS on another, each of random size and
    place; start and goal at least half the room apart; a target between the loosest, which excludes
    no cell, and the highest feasible.

    Parameters
    ----------
    rng
        Equal states draw equal scenes.
    difficulty
        ``"easy"`` (tasks as they come: most need no detour), ``"default"`` (three of five are drawn
        until they need one above 5 %, and some of the others need one as they come: 717 of the
        1,000 test scenes do), ``"hard"`` (all need one above 20 %), or a `Difficulty`.
    corner_cutting, robot_radius, collision
        The robot whose task it is; see `irs_gym.Robot`.

    Raises
    ------
    ValueError
        Where there is no such difficulty, ``rng`` is no generator, or no scene of that difficulty
        was found.

    Examples
    --------
    >>> import numpy as np
    >>> scene = generate_scene(np.random.default_rng(1), "easy")
    >>> scene == generate_scene(np.random.default_rng(1), "easy")
    True
    """
    robot = Robot(corner_cutting=corner_cutting, robot_radius=robot_radius, collision=collision)
    return draw_solved_scene(rng, difficulty, robot).scene


def draw_solved_scene(
    rng: np.random.Generator,
    difficulty: str | Difficulty = "default",
    robot: Robot = PAPER_ROBOT,
) -> SolvedScene:
    """The scene of `generate_scene` with its map and distances to go."""
    if isinstance(difficulty, str):
        if difficulty not in DIFFICULTIES:
            raise ValueError(
                f"difficulty={difficulty!r} must be one of {tuple(DIFFICULTIES)}, or a Difficulty"
            )
        difficulty = DIFFICULTIES[difficulty]

    if not isinstance(rng, np.random.Generator) or not isinstance(difficulty, Difficulty):
        raise ValueError(
            f"rng={rng!r} must be a numpy.random.Generator, "
            f"difficulty={difficulty!r} a name or a Difficulty"
        )

    # decided before anything is rejected, so that the share is kept
    detour = difficulty.detour if rng.random() < difficulty.detour_share else 0.0
    # degenerate factories, and those without such a task, are drawn anew
    for _ in range(FACTORIES):
        drawn = _draw_factory(rng, difficulty)
        if drawn is None:
            continue

        scene, layout = drawn
        found = (
            _draw_task(rng, scene, detour, robot)
            if layout is None
            else _draw_walled_task(rng, scene, layout, robot)
        )
        if found is not None:
            return found

    raise ValueError(f"difficulty={difficulty}: none of {FACTORIES} factories has such a task")


def least_distance(room: Room | PolygonRoom) -> float:
    """Metres that start and goal are apart at least, centre to centre: half the mean of the room's
    sides.
    """
    return (room.x_max - room.x_min + room.y_max - room.y_min) / 4


# --- the factory ----------------------------------------------------------------------------------


def _draw_factory(
    rng: np.random.Generator, level: Difficulty
) -> tuple[Scene, Layout | None] | None:
    """A factory with some start and goal in it, and the layout of its family; None for a
    degenerate one.
    """
    # Every draw below moves the generator on: their order is part of what a seed means. What is
    # drawn for some difficulties alone stands in a condition.
    half_x = _step(rng, *level.sides, 0.5) / 2
    half_y = _step(rng, *(level.other_sides or level.sides), 0.5) / 2
    if level.other_sides is not None and rng.random() < 0.5:
        half_x, half_y = half_y, half_x

    room = Room(
        x_min=-half_x, x_max=half_x, y_min=-half_y, y_max=half_y, height=_step(rng, 4.0, 8.0, 0.5)
    )
    obstacles = tuple(_draw_box(rng, room) for _ in range(_whole(rng, *level.boxes)))
    if level.rooms is not None:
        obstacles += draw_walls(rng, room, _whole(rng, *level.rooms), CELL_SIZE)

    layout = None
    if level.family is not None:
        layout = draw_layout(rng, level.family, room, CELL_SIZE)
        obstacles += layout.obstacles

    walls = _shuffled(rng, WALLS)
    access_points = [AccessPoint(position=_on_wall(rng, room, walls[0], 1.5, room.height - 0.5))]
    if level.access_points != (1, 1):
        for _ in range(_whole(rng, *level.access_points) - 1):
            position = _on_wall(rng, room, WALLS[_whole(rng, 0, 3)], 1.5, room.height - 0.5)
            access_points.append(AccessPoint(position=position))

    kinds = _ELEMENTS[level.panels[_whole(rng, 0, len(level.panels) - 1)]]
    panels = tuple(
        _draw_panel(rng, room, wall, each) for wall, each in zip(walls[1:], kinds, strict=False)
    )
    phase_bits = (None, 1, 2, 3)[_whole(rng, 0, 3)] if panels else None

    # Degenerate: too little floor, or an antenna behind a box. A panel counts by its lower edge.
    mounted = [
        *(each.position for each in access_points),
        *((*each.position[:2], each.position[2] - _half_height(each)) for each in panels),
    ]
    grid = Grid.tile(room.lower, room.upper, CELL_SIZE)
    floor_cells = _floor(grid, obstacles)
    if floor_cells.mean() < LEAST_FLOOR or any(_is_covered(point, obstacles) for point in mounted):
        return None

    # One of several may hang on the wall of a panel.
    if len(access_points) > 1 and any(
        dist(point.position, panel.position) < LEAST_APART
        for point in access_points
        for panel in panels
    ):
        return None

    ends = _draw_ends(rng, np.argwhere(floor_cells), least_distance(room) / CELL_SIZE)
    if ends is None:
        return None

    paper = _paper()

    scene = Scene(
        name="generated",
        room=room,
        obstacles=obstacles,
        access_points=tuple(access_points),
        irs_panels=panels,
        antenna_height=paper.antenna_height,
        start=grid.centre(ends[0]),
        goal=grid.centre(ends[1]),
        carrier_ghz=paper.carrier_ghz,
        rician_factor_db=paper.rician_factor_db,
        path_loss=paper.path_loss,
        phase_bits=phase_bits,
    )

    return scene, layout


def _draw_box(rng: np.random.Generator, room: Room) -> Obstacle:
    """A box with its edges on the raster; one in four stands at a wall."""
    sides = [
        _step(rng, 1.0, 6.0, RASTER),
        _step(rng, 0.75, 3.0, RASTER),
    ]  # one of 0.5 m may hold no cell
    width, depth = sides if rng.random() < 0.5 else sides[::-1]
    x = _step(rng, room.x_min, room.x_max - width, RASTER)
    y = _step(rng, room.y_min, room.y_max - depth, RASTER)
    if rng.random() < 0.25:
        wall = WALLS[_whole(rng, 0, 3)]
        x = {"x_min": room.x_min, "x_max": room.x_max - width}.get(wall, x)
        y = {"y_min": room.y_min, "y_max": room.y_max - depth}.get(wall, y)

    return Obstacle(
        center=(x + width / 2, y + depth / 2), size=(width, depth, _step(rng, 0.5, 3.0, 0.1))
    )


def _draw_panel(rng: np.random.Generator, room: Room, wall: Wall, elements: Range) -> IrsPanel:
    """A panel of so many elements that fits between floor and ceiling."""
    pitch = _paper().irs_panels[0].pitch_wavelengths
    total = -1

    # drawn until the number of elements fits
    while not elements[0] <= total <= elements[1]:
        shape = _whole(rng, 2, 20), _whole(rng, 2, 10), _whole(rng, 1, 2), _whole(rng, 5, 20)
        total = shape[0] * shape[1] * shape[2] * shape[3]

    columns, rows, *each = shape
    panel = IrsPanel(
        position=(0.0, 0.0, 0.0),
        wall=wall,
        columns=columns,
        rows=rows,
        elements_per_subsurface=(each[0], each[1]),
        pitch_wavelengths=pitch,
    )

    # heights at which it fits, in tenths of a metre
    clearance = 0.2 + _half_height(panel)
    low = ceil(10 * max(1.5, clearance)) / 10
    high = floor(10 * (room.height - clearance)) / 10

    return panel.model_copy(update={"position": _on_wall(rng, room, wall, low, high)})


def _half_height(panel: IrsPanel) -> float:
    """Half the height of a panel in metres."""
    wavelength = wavelength_m(_paper().carrier_ghz)
    return panel.rows * panel.elements_per_subsurface[1] * panel.pitch_wavelengths * wavelength / 2


def _on_wall(rng: np.random.Generator, room: Room, wall: Wall, low: float, high: float) -> Point3:
    """A point on a wall, from ``low`` to ``high`` metres above the floor, half a metre from the
    corners at least.
    """
    z = _step(rng, low, high, 0.1)
    where = float(getattr(room, wall))
    if wall.startswith("x"):
        return where, _step(rng, room.y_min + 0.5, room.y_max - 0.5, 0.1), z

    return _step(rng, room.x_min + 0.5, room.x_max - 0.5, 0.1), where, z


def _is_covered(point: Point3, obstacles: tuple[Obstacle, ...]) -> bool:
    """Whether what is mounted at a point stands behind a box."""
    return any(
        all(
            low - TOUCH <= at <= high + TOUCH
            for at, low, high in zip(point, box.lower, box.upper, strict=True)
        )
        for box in obstacles
    )


def _floor(grid: Grid, obstacles: tuple[Obstacle, ...]) -> NDArray[np.bool_]:
    """The largest piece of floor that a robot can drive on, shape ``(X, Y)``."""
    boxes = Boxes(
        *(
            np.array([getattr(box, end) for box in obstacles]).reshape(-1, 3)
            for end in ("lower", "upper")
        )
    )
    return largest_component(~is_in_footprint(grid.centres(), boxes))


# --- the task -------------------------------------------------------------------------------------


def _room_left(factory: Scene, robot: Robot) -> tuple[Fit, NDArray[np.bool_]]:
    """What the factory leaves the robot, and the largest part of it that hangs together, ``(X,
    Y)``.
    """
    # its boxes all hold the centre of a cell, so that a point has nothing to ask of them
    fit = robot.fit(radio_map_of(factory, CELL_SIZE), None if robot.is_point else factory)
    return fit, largest_component(fit.radio_map.free, **fit.motion)


def _draw_task(
    rng: np.random.Generator, factory: Scene, detour: float, robot: Robot
) -> SolvedScene | None:
    """The factory with a task for the robot whose detour is above the one given; None where none
    was found.
    """
    (radio_map, motion), floor_cells = _room_left(factory, robot)
    if not floor_cells.any():
        return None

    # the highest target that excludes no cell of the floor
    loosest = float(radio_map.gain_db[floor_cells].min())
    cells = np.argwhere(floor_cells)

    for _ in range(TRIES):
        ends = _draw_ends(rng, cells, least_distance(factory.room) / CELL_SIZE)
        if ends is None:
            continue

        highest = highest_feasible_target(radio_map.gain_db, *ends, **motion)
        if highest - loosest < LEAST_RANGE_DB:
            continue

        # between the loosest and the highest feasible one; rounded down, so that it stays feasible
        target_db = floor(100 * (loosest + rng.random() * (highest - loosest))) / 100
        start, goal = (radio_map.grid.centre(end) for end in ends)
        scene = factory.model_copy(update={"start": start, "goal": goal, "target_db": target_db})
        to_go = distance_to_go(radio_map.feasible(target_db), ends[1], CELL_SIZE, **motion)
        solved = SolvedScene(scene, radio_map, to_go, motion["passable"])
        if detour + 1e-9 < solved.detour < np.inf:  # whatever the rounding of sums
            return solved

    return None


def _draw_walled_task(
    rng: np.random.Generator, factory: Scene, layout: Layout, robot: Robot
) -> SolvedScene | None:
    """The factory with a task for the robot that walls alone decide, whose detour lies within
    `DETOURS`; None where none was found.
    """
    (radio_map, motion), floor_cells = _room_left(factory, robot)
    if not floor_cells.any():
        return None

    loosest = float(radio_map.gain_db[floor_cells].min())
    target_db = floor(100 * (loosest - rng.random() * SLACK_DB)) / 100
    is_feasible = radio_map.feasible(target_db)
    cells = np.argwhere(floor_cells)  # (n, 2)
    can_start = np.ones(len(cells), dtype=bool)
    if layout.starts is not None:
        can_start = layout.starts[tuple(cells.T)]

    # walls make the longest ways between what is near
    apart = least_distance(factory.room) / CELL_SIZE / 2

    for _ in range(TRIES):
        end = cells[_whole(rng, 0, len(cells) - 1)]
        goal = (int(end[0]), int(end[1]))
        to_go = distance_to_go(is_feasible, goal, CELL_SIZE, **motion)
        is_far = np.sum((cells - end) ** 2, axis=1) >= apart**2
        starts = cells[can_start & is_far]  # (m, 2)
        straight = octile_distance(end - starts) * CELL_SIZE
        detours = to_go[tuple(starts.T)] / straight  # (m,)
        within = (detours > DETOURS[0]) & (detours <= DETOURS[1])
        if not within.any():
            continue

        # one detour up to the longest is as likely as another, however many cells have it
        wanted = DETOURS[0] + rng.random() * (detours[within].max() - DETOURS[0])
        near = np.flatnonzero(within & (np.abs(detours - wanted) <= NEAR_DETOUR * wanted))
        if not len(near):
            continue

        start = starts[near[_whole(rng, 0, len(near) - 1)]]
        places = (
            radio_map.grid.centre((int(start[0]), int(start[1]))),
            radio_map.grid.centre(goal),
        )
        scene = factory.model_copy(
            update={"start": places[0], "goal": places[1], "target_db": target_db}
        )
        return SolvedScene(scene, radio_map, to_go, motion["passable"])

    return None


def _draw_ends(
    rng: np.random.Generator, cells: NDArray[np.int64], apart: float
) -> tuple[Cell, Cell] | None:
    """Two of the cells ``(n, 2)`` at least so many cells apart; None where there is none that far
    from the first.
    """
    start = cells[_whole(rng, 0, len(cells) - 1)]
    goals = cells[np.sum((cells - start) ** 2, axis=1) >= apart**2]
    if not len(goals):
        return None

    goal = goals[_whole(rng, 0, len(goals) - 1)]

    return (int(start[0]), int(start[1])), (int(goal[0]), int(goal[1]))


@lru_cache(maxsize=1)
def _paper() -> Scene:
    """Whose radio constants all scenes share."""
    return load_scene("paper")


# --- numbers --------------------------------------------------------------------------------------


def _whole(rng: np.random.Generator, low: int, high: int) -> int:
    return int(rng.integers(low, high, endpoint=True))


def _step(rng: np.random.Generator, low: float, high: float, step: float) -> float:
    """One of low, low + step ... up to high, without the dust of rounding."""
    return round(low + step * _whole(rng, 0, floor((high - low) / step + 1e-9)), 4)


def _shuffled(rng: np.random.Generator, walls: tuple[Wall, ...]) -> list[Wall]:
    return [walls[n] for n in np.argsort([rng.random() for _ in walls])]
