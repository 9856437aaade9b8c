"""`ContinuousTask`: what is asked of an environment whose robot goes anywhere on the floor, and
`build_continuous_maps`: all that it fixes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args

import numpy as np

from irs_gym.datasets.random_task import RandomTask, Worlds, build_worlds
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import Cell, Grid, checked_point
from irs_gym.mdp.budget import Budget, OnExhausted, checked_budget
from irs_gym.mdp.continuous_ends import check_scene
from irs_gym.mdp.continuous_maps import (
    ContinuousMaps,
    FieldKind,
    Point,
    check_reach,
)
from irs_gym.mdp.cost import CostKind
from irs_gym.mdp.task import (
    Constraint,
    Task,
    World,
    build_world,
    checked_fields,
    resolved,
)
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene, load_scenes

ContinuousObservation = Literal["dict", "flat"]

# Of one scene alone: a set of scenes says them itself.
_OF_ONE_SCENE = (
    "scene",
    "target_db",
    "cell_size",
    "irs_elements",
    "phase_bits",
    "quantiser",
    "array_model",
    "radio_map",
    "start",
    "goal",
)
_MOST = 1e6  # of metres, seconds and metres a second


@dataclass(frozen=True, kw_only=True)
class ContinuousTask:
    """What is asked of `IrsNavContinuous-v0`; each field is an argument of `gymnasium.make`. All
    have defaults.

    Raises ``ValueError`` where a value is out of its range; the message names the field.

    Examples
    --------
    >>> ContinuousTask(target_db=-63.0).speed
    1.0
    """

    field: FieldKind = "cells"
    """The gain at a point: that of its "cells", as in the paper, or the "exact" one of Lemma 1 at
    the point itself, with obstacles as they are.
    """
    speed: float = 1.0
    """Metres a second at most, the paper's V_max."""
    time_step: float = 0.5
    """Seconds of a step."""
    goal_radius: float = 0.25
    """Metres: the goal is the disc of that radius about the centre of its cell."""
    scene: str | Path | Scene | dict[str, Any] = Task.scene
    """A scene's name in the package, the path of a scene file, a scene, or its data as a dict."""
    target_db: float | None = Task.target_db
    """Lowest expected channel gain in dB that keeps the robot connected; None as the scene says."""
    cell_size: float = Task.cell_size
    """Edge of a cell in metres."""
    irs_elements: int | None = Task.irs_elements
    """Elements on each IRS panel; None as the scene says."""
    phase_bits: int | None = Task.phase_bits
    """Resolution of the phase shifters; None as the scene says."""
    quantiser: Quantiser = Task.quantiser
    """How continuous phases are rounded to `phase_bits`."""
    array_model: ArrayModel = Task.array_model
    """How the array of elements is modelled."""
    patch_radius: int = Task.patch_radius
    """Cells that the robot sees around itself in each direction."""
    observation: ContinuousObservation = "dict"
    """"dict", or the same packed as "flat"."""
    irs_phases: bool = Task.irs_phases
    """Whether the observation holds the phase shift of each sub-surface; never over many scenes."""
    constraint: Constraint = Task.constraint
    """What happens where a move leads below the target: the robot stops there, the episode ends, or
    it goes on at a cost, which may be paid out of a budget.
    """
    cost: CostKind = Task.cost
    """What a second in each cell costs under a budget; see `irs_gym.cost_map`."""
    budget: Budget | None = Task.budget
    """Total cost that an episode may come to, or a range (low, high) that each is drawn from.

    Needed with ``constraint="budget"``, and refused with any other.
    """
    on_exhausted: OnExhausted = Task.on_exhausted
    """What happens at a step that the budget cannot pay: it ends the episode as a failure, the
    episode continues and the cost is only counted, or the step is refused.
    """
    random_start: float = Task.random_start
    """Probability of a start drawn anywhere on the floor that leads to the goal; True is 1."""
    shaping: bool = Task.shaping
    """Whether the reward holds the potential-based term (minus the distance to the goal, as the
    crow flies).
    """
    goal_bonus: float = Task.goal_bonus
    """Reward at the goal, in metres."""
    radio_map: str | Path | RadioMap | dict[str, Any] | None = Task.radio_map
    """A map, its data as a dict, or the path of a saved one, in place of the scene's."""
    start: Point | None = None
    """Point (x, y) in metres, in place of the centre of the scene's start; needed with
    `radio_map`.
    """
    goal: Point | None = None
    """Point (x, y) in metres, in place of the centre of the scene's goal; needed with
    `radio_map`.
    """
    split: str | None = None
    """Which generated scenes, in place of one: one of `irs_gym.datasets.splits.SPLITS`."""
    num_scenes: int = 100
    """How many of the split's, from the first on."""
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None = None
    """A folder of scene files, scenes (or their data as dicts) or a pool, in place of one scene."""

    def __post_init__(self) -> None:
        for name in ("speed", "time_step", "goal_radius"):
            object.__setattr__(self, name, _checked_length(name, getattr(self, name)))
        for name, kind in (("field", FieldKind), ("observation", ContinuousObservation)):
            if getattr(self, name) not in get_args(kind):
                raise ValueError(f"{name}={getattr(self, name)!r} must be one of {get_args(kind)}")
        for name in ("start", "goal"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, checked_point(getattr(self, name), name))

        object.__setattr__(self, "budget", checked_budget(self.budget))
        if self.field == "exact":
            self._check_exact()

        if self.has_many_scenes:
            self._check_many()
            many = self.many_scenes  # checks the fields that it shares with others
            object.__setattr__(self, "scenes", many.scenes)
        else:
            one = self.one_scene()
            for name in ("scene", "radio_map"):
                object.__setattr__(self, name, getattr(one, name))

    @property
    def has_many_scenes(self) -> bool:
        """Whether each episode may be in another scene."""
        return self.split is not None or self.scenes is not None

    @cached_property
    def many_scenes(self) -> RandomTask:
        """The task of `IrsNavRandom-v0` in the same scenes."""
        where = (
            {"scenes": self.scenes}
            if self.scenes is not None
            else {
                "split": self.split,
                "num_scenes": self.num_scenes,
            }
        )
        return RandomTask(**where, **self._shared(RandomTask, {"split", "num_scenes", "scenes"}))

    def one_scene(self, **ends: Any) -> Task:
        """The task of `IrsNav-v0` in the same scene, between cells given as its ``start`` and
        ``goal``.
        """
        if self.radio_map is not None:
            for name in ("start", "goal"):
                if getattr(self, name) is None:
                    raise ValueError(f"{name} must be given as a point (x, y) along with radio_map")

            ends = {"start": (0, 0), "goal": (0, 0)} | ends  # checked later, with the map at hand

        return Task(**self._shared(Task, {"start", "goal"}), **ends)

    def _shared(self, kind: Any, without: set[str]) -> dict[str, Any]:
        own = {each.name for each in fields(self)} & {each.name for each in fields(kind)}
        return {name: getattr(self, name) for name in own - without}

    def _check_exact(self) -> None:
        if self.radio_map is not None:
            raise ValueError(
                "field='exact' cannot be given along with radio_map, which tells no gain between "
                "the centres of its cells"
            )
        if self.cost == "outage":
            raise ValueError(
                "cost='outage' cannot be given along with field='exact': only 'violation' and "
                "'deficit' can"
            )

    def _check_many(self) -> None:
        if self.split is not None and self.scenes is not None:
            raise ValueError("split cannot be given along with scenes, which takes its place")

        given = [
            name for name in _OF_ONE_SCENE if getattr(self, name) != getattr(ContinuousTask, name)
        ]
        if given:
            which = "split" if self.split is not None else "scenes"
            raise ValueError(
                f"{', '.join(given)} cannot be given along with {which}, whose scenes say it"
            )

    def __deepcopy__(self, memo: Any) -> "ContinuousTask":
        return self  # frozen, and so are its scenes


class ContinuousTaskArguments(TypedDict, total=False):
    """The fields of `ContinuousTask` as keyword arguments, for type checkers and editors."""

    field: FieldKind
    speed: float
    time_step: float
    goal_radius: float
    scene: str | Path | Scene | dict[str, Any]
    target_db: float | None
    cell_size: float
    irs_elements: int | None
    phase_bits: int | None
    quantiser: Quantiser
    array_model: ArrayModel
    patch_radius: int
    observation: ContinuousObservation
    irs_phases: bool
    constraint: Constraint
    cost: CostKind
    budget: Budget | None
    on_exhausted: OnExhausted
    random_start: float
    shaping: bool
    goal_bonus: float
    radio_map: str | Path | RadioMap | dict[str, Any] | None
    start: Point | None
    goal: Point | None
    split: str | None
    num_scenes: int
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None


def continuous_task_of(
    arguments: Mapping[str, Any], owner: str = "ContinuousTask"
) -> ContinuousTask:
    """Task of the keyword arguments of ``owner``; a ``TypeError`` lists the known names for an
    unknown one.
    """
    return ContinuousTask(**checked_fields(ContinuousTask, arguments, owner))


def build_continuous_maps(task: ContinuousTask) -> ContinuousMaps:
    """Scenes and maps of a task; equal tasks share them.

    Raises
    ------
    FileNotFoundError
        Where a scene or map file does not exist.
    ValueError
        Where a scene, a map or an argument is at fault, a time step leads further than the robot
        sees, start and goal cannot be joined (the message gives the highest feasible target), or
        the goal's bonus is too small.
    """
    maps = _of_many(task) if task.has_many_scenes else _of_one(task)
    check_reach(maps)

    return maps


def _of_one(task: ContinuousTask) -> ContinuousMaps:
    arguments = resolved(task.one_scene()).arguments  # with its scene or map read
    return _of_one_resolved(task, arguments)


@lru_cache(maxsize=8)
def _of_one_resolved(task: ContinuousTask, arguments: Task) -> ContinuousMaps:
    if isinstance(arguments.radio_map, RadioMap):
        grid = arguments.radio_map.grid
    else:
        assert isinstance(arguments.scene, Scene)
        grid = arguments.scene.grid(task.cell_size)

    given = {name: getattr(task, name) for name in ("start", "goal")}
    ends = {name: _cell_of(grid, name, at) for name, at in given.items() if at is not None}
    base = task.one_scene(**ends)
    world = build_world(base)
    maps = ContinuousMaps(
        rules=base.rules,
        field=task.field,
        speed=task.speed,
        time_step=task.time_step,
        goal_radius=task.goal_radius,
        names=(world.scene.name if world.scene else "radio_map",),
        world=_OneWorld(world),
        has_many_scenes=False,
        target_db=np.array([world.target_db]),
        gain_db=world.radio_map.gain_db[None],
        free=world.radio_map.free[None],
        feasible=world.feasible[None],
        cost=None if world.cost is None else world.cost[None],
        start=np.array([_within(grid, given["start"], world.start)]),
        goal=np.array([_within(grid, given["goal"], world.goal)]),
        irs=None,  # the world tells it
        cell_size=float(grid.cell_size),
        source=(build_continuous_maps, (task,)),
    )
    check_scene(maps, 0)

    return maps


@dataclass(frozen=True)
class _OneWorld:
    """The world of the only scene."""

    only: World

    def __call__(self, number: int) -> World:
        return self.only


def _of_many(task: ContinuousTask) -> ContinuousMaps:
    scenes = task.scenes
    if isinstance(scenes, str | Path):
        scenes = load_scenes(scenes)
        task = ContinuousTask(
            **{each.name: getattr(task, each.name) for each in fields(task)} | {"scenes": scenes}
        )

    return _of_many_read(task)


@lru_cache(maxsize=4)
def _of_many_read(task: ContinuousTask) -> ContinuousMaps:
    # What the checks of `IrsNavRandom-v0` say of budgets and bonuses is meant for its grid.
    own = task.many_scenes
    plain = {name: getattr(Task, name) for name in ("cost", "budget", "on_exhausted")}
    pool = build_worlds(replace(own, constraint="allow", **plain)).pool
    worlds = Worlds(own, pool)
    if task.field == "exact" and len(pool.scenes) != len(pool):
        raise ValueError("field='exact' needs scenes, and these are maps without them")

    return ContinuousMaps(
        rules=task.many_scenes.rules,
        field=task.field,
        speed=task.speed,
        time_step=task.time_step,
        goal_radius=task.goal_radius,
        names=pool.names,
        world=worlds.world,
        has_many_scenes=True,
        target_db=pool.target_db,
        gain_db=pool.gain_db,
        free=pool.free,
        feasible=pool.feasible,
        cost=None if worlds.task.budget is None else worlds.cost,
        start=np.add(pool.start, 0.5),
        goal=np.add(pool.goal, 0.5),
        irs=pool.irs,
        cell_size=pool.cell_size,
        source=(build_continuous_maps, (task,)),
    )


def _within(grid: Grid, point: Point | None, cell: Cell) -> Point:
    """A point in cells from the lower left corner: the given one, else the centre of the cell."""
    if point is None:
        return cell[0] + 0.5, cell[1] + 0.5

    x, y = ((value - low) / grid.cell_size for value, low in zip(point, grid.origin, strict=True))
    return x, y


def _cell_of(grid: Grid, name: str, point: Point) -> Cell:
    try:
        return grid.cell_of(point)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _checked_length(name: str, value: Any) -> float:
    is_number = isinstance(value, Real) and not isinstance(value, bool | np.bool_)
    if not is_number or not 0 < value <= _MOST:
        raise ValueError(f"{name}={value!r} must be a number above 0 and up to {_MOST:g}")
    return float(value)
