"""`Task`: what is asked of an environment, `ResolvedTask`: with nothing left open, and `World`: all
that it fixes once and for all.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property, lru_cache
from hashlib import blake2b
from inspect import Parameter, signature
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, Grid, Motion, as_cell, checked_cell_size
from irs_gym.mdp.budget import Budget, OnExhausted, checked_budget, payable, range_of
from irs_gym.mdp.cost import CostKind, cost_map
from irs_gym.mdp.robot import PAPER_ROBOT, Collision, Robot
from irs_gym.memory import check_memory, freeze
from irs_gym.radio.irs import ArrayModel, Hardware, Quantiser
from irs_gym.radio.radio_map import (
    RadioMap,
    RadioModel,
    as_scene,
    build_map_and_shifts,
)
from irs_gym.radio.scene import TARGET_DB, Scene

_CELL_BYTES = 1000  # for each cell: map, rules, graph and tables of an environment, at the most
_LARGEST = 1e9  # of decibels and rewards
_SHIFT_BYTES = 12  # for each of its phase shifts

_Init = TypeVar("_Init", bound=Callable[..., None])

Constraint = Literal["refuse", "terminate", "allow", "budget"]
Observation = Literal["dict", "flat", "map", "masked", "cell"]
_CHOICES = {
    "observation": Observation,
    "constraint": Constraint,
    "cost": CostKind,
    "on_exhausted": OnExhausted,
}


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What the robot sees, may do and is rewarded for, whatever the radio; see the fields of
    `Task`.

    Raises ``ValueError`` where a value is out of its range; the message names the field.
    """

    patch_radius: int
    observation: Observation
    irs_phases: bool
    constraint: Constraint
    cost: CostKind
    budget: Budget | None
    on_exhausted: OnExhausted
    random_start: float
    shaping: bool
    goal_bonus: float
    corner_cutting: bool
    robot_radius: float
    collision: Collision

    def __post_init__(self) -> None:
        _ = self.robot  # checks these
        _check_number("goal_bonus", self.goal_bonus)
        if self.goal_bonus < 0:
            raise ValueError(f"goal_bonus={self.goal_bonus} must not be negative")
        check_random_start(self.random_start)
        if not is_integer(self.patch_radius) or not 0 <= self.patch_radius <= 100:
            raise ValueError(f"patch_radius={self.patch_radius!r} must be an integer from 0 to 100")

        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in get_args(choices):
                raise ValueError(f"{name}={value!r} must be one of {get_args(choices)}")

        for name in ("irs_phases", "shaping"):
            value = getattr(self, name)
            if not isinstance(value, bool | np.bool_):
                raise ValueError(f"{name}={value!r} must be True or False")

        self._check_budget()

    @classmethod
    def of(cls, task: Any) -> "Rules":
        """Those that a task asks for; what is none of its fields is as in `Task` by default."""
        names = [each.name for each in fields(cls)]
        own: dict[str, Any] = {
            name: getattr(task, name, getattr(Task, name, None)) for name in names
        }
        return cls(**own)

    @cached_property
    def robot(self) -> Robot:
        """How wide it is, and how it moves."""
        return Robot(
            corner_cutting=self.corner_cutting,
            robot_radius=self.robot_radius,
            collision=self.collision,
        )

    @property
    def least_budget(self) -> float | None:
        """The least budget of an episode; None where there is none."""
        return None if self.budget is None else range_of(self.budget)[0]

    def _check_budget(self) -> None:
        if self.constraint != "budget":
            defaults = {"cost": "violation", "budget": None, "on_exhausted": "terminate"}
            given = [name for name, default in defaults.items() if getattr(self, name) != default]
            if given:
                raise ValueError(
                    f"{', '.join(given)} needs constraint='budget', not {self.constraint!r}"
                )
        elif self.budget is None:
            raise ValueError("budget=None must be given along with constraint='budget'")
        elif self.observation == "cell":
            raise ValueError(
                "observation='cell' cannot tell the budget that is left: "
                "constraint='budget' needs another one"
            )


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is asked of `IrsNav-v0`; each field is an argument of `gymnasium.make`. All have
    defaults.

    Raises ``ValueError`` where a value is out of its range; the message names the field.

    Examples
    --------
    >>> Task(target_db=-63.0).rules.goal_bonus
    10.0
    """

    scene: str | Path | Scene | dict[str, Any] = "paper"
    """A scene's name in the package, the path of a scene file, a scene, or its data as a dict."""
    target_db: float | None = None
    """Lowest expected channel gain in dB that keeps the robot connected; None as the scene says
    (-61.8 in "paper").
    """
    cell_size: float = 0.5
    """Edge of a cell in metres; it must divide the room."""
    irs_elements: int | None = None
    """Elements on each IRS panel, the paper's M; 0 for no IRS; None as the scene says (1,200 in
    "paper").
    """
    phase_bits: int | None = None
    """Resolution of the phase shifters; None as the scene says (continuous in "paper")."""
    quantiser: Quantiser = "nearest"
    """How continuous phases are rounded to `phase_bits`: to the "nearest" level, "as_printed" (the
    letter of the paper's eq. (20)), or to the "optimal" levels, exactly.
    """
    array_model: ArrayModel = "far_field"
    """How the array of elements is modelled; see `irs_gym.radio.irs.Hardware`."""
    patch_radius: int = 5
    """Cells that the robot sees around itself in each direction."""
    observation: Observation = "dict"
    """"dict", the same packed as "flat", that beside the action mask as "masked", the whole "map",
    or the "cell".
    """
    irs_phases: bool = True
    """Whether the observation holds the phase shift of each sub-surface."""
    constraint: Constraint = "refuse"
    """What happens at a cell below the target: the move is refused, ends the episode, is allowed
    at a cost, or is paid for out of a budget.
    """
    cost: CostKind = "violation"
    """What a cell costs under a budget: 1 below the target, the "deficit" in dB, or the probability
    of "outage"; see `irs_gym.cost_map`.
    """
    budget: Budget | None = None
    """Total cost that an episode may come to, or a range (low, high) that each is drawn from.

    Needed with ``constraint="budget"``, and refused with any other.
    """
    on_exhausted: OnExhausted = "terminate"
    """What happens at a step that the budget cannot pay: it ends the episode as a failure, the
    episode continues and the cost is only counted, or the step is refused.
    """
    random_start: float = False
    """Probability of a start drawn among the cells from which the goal can be reached; True is 1.
    """
    shaping: bool = True
    """Whether the reward holds the potential-based term (minus the octile distance to the goal)."""
    goal_bonus: float = 10.0
    """Reward at the goal, in metres."""
    corner_cutting: bool = PAPER_ROBOT.corner_cutting
    """Whether a diagonal move asks for its destination alone; otherwise it needs both cells beside
    it.
    """
    robot_radius: float = PAPER_ROBOT.robot_radius
    """Metres: cells whose centre is nearer than that to an obstacle or a wall cannot be entered."""
    collision: Collision = PAPER_ROBOT.collision
    """Where obstacles count: at the "centre" of a cell alone, or wherever the robot's "body" meets
    one on a move.
    """
    radio_map: str | Path | RadioMap | dict[str, Any] | None = None
    """A map, its data as a dict, or the path of a saved one, in place of the scene's."""
    start: Cell | None = None
    """Cell (i, j) in place of the scene's start; needed with `radio_map`."""
    goal: Cell | None = None
    """Cell (i, j) in place of the scene's goal; needed with `radio_map`."""

    def __post_init__(self) -> None:
        if isinstance(self.scene, Mapping):
            object.__setattr__(self, "scene", _read_scene(self.scene))

        if isinstance(self.radio_map, Mapping):
            object.__setattr__(self, "radio_map", _read_map(self.radio_map))

        _ = Hardware(self.phase_bits, self.quantiser, self.array_model)  # checks these
        checked_cell_size(self.cell_size)
        if self.irs_elements is not None and not is_integer(self.irs_elements):
            raise ValueError(
                f"irs_elements={self.irs_elements!r} must be a whole number of elements, or None"
            )
        if self.target_db is not None:
            _check_number("target_db", self.target_db)

        object.__setattr__(self, "budget", checked_budget(self.budget))
        _ = self.rules  # checks the fields that are the robot's

        for name in ("start", "goal"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_cell(getattr(self, name), name))

        if self.radio_map is not None:
            self._check_foreign_map()

    @cached_property
    def rules(self) -> Rules:
        """The part that is the robot's."""
        return Rules.of(self)

    def _check_foreign_map(self) -> None:
        _given_end("start", self.start)
        _given_end("goal", self.goal)
        defaults = {each.name: each.default for each in fields(Task)}
        radio = [each.name for each in fields(RadioModel)]
        given = [name for name in radio if getattr(self, name) != defaults[name]]
        if given:
            raise ValueError(
                f"{', '.join(given)} cannot be given along with radio_map, which fixes the map"
            )


class TaskArguments(TypedDict, total=False):
    """The fields of `Task` as keyword arguments, for type checkers and editors."""

    scene: str | Path | Scene | dict[str, Any]
    target_db: float | None
    cell_size: float
    irs_elements: int | None
    phase_bits: int | None
    quantiser: Quantiser
    array_model: ArrayModel
    patch_radius: int
    observation: Observation
    irs_phases: bool
    constraint: Constraint
    cost: CostKind
    budget: Budget | None
    on_exhausted: OnExhausted
    random_start: float
    shaping: bool
    goal_bonus: float
    corner_cutting: bool
    robot_radius: float
    collision: Collision
    radio_map: str | Path | RadioMap | dict[str, Any] | None
    start: Cell | None
    goal: Cell | None


def task_of(arguments: Mapping[str, Any], owner: str = "Task") -> Task:
    """Task of the keyword arguments of ``owner``; a ``TypeError`` lists the known names for an
    unknown one.
    """
    return Task(**checked_fields(Task, arguments, owner))


def checked_fields(kind: type[Any], arguments: Mapping[str, Any], owner: str) -> Mapping[str, Any]:
    """The arguments of the class ``owner``, if all are fields of a dataclass.

    A ``TypeError`` lists the fields for an argument that is none, after the words with which Python
    itself refuses one: TorchRL looks for these, and makes the environment without the argument.
    """
    known = [each.name for each in fields(kind)]
    unknown = [name for name in arguments if name not in known]
    if unknown:
        refused = "; ".join(
            f"{owner}.__init__() got an unexpected keyword argument {name!r}" for name in unknown
        )
        raise TypeError(f"{refused}: the arguments are {', '.join(known)} and render_mode")

    return arguments


def shows_fields(kind: type[Any]) -> Callable[[_Init], _Init]:
    """Decorator of an ``__init__(..., **arguments)`` that takes the fields of a dataclass.

    `inspect.signature` and `help` then show each field with its type and default, which are written
    in the dataclass alone.

    Examples
    --------
    >>> class Robot:
    ...     @shows_fields(Rules)
    ...     def __init__(self, name: str, **arguments: Any) -> None: ...
    >>> list(signature(Robot).parameters)[:3]
    ['name', 'patch_radius', 'observation']
    """

    def shown(init: _Init) -> _Init:
        own = signature(init)
        kept = [each for each in own.parameters.values() if each.kind != Parameter.VAR_KEYWORD]
        taken = [
            Parameter(
                each.name,
                Parameter.KEYWORD_ONLY,
                default=Parameter.empty if each.default is MISSING else each.default,
                annotation=each.type,
            )
            for each in fields(kind)
        ]
        init.__signature__ = own.replace(parameters=[*kept, *taken])  # type: ignore[attr-defined]

        return init

    return shown


@dataclass(frozen=True)
class ForeignMap:
    """What the radio is where no scene says it: a map from elsewhere, and where the robot goes."""

    radio_map: RadioMap
    start: Cell
    goal: Cell


@dataclass(frozen=True)
class ResolvedTask:
    """A task of which nothing is left open, in its two parts: what the radio is, what the robot
    does.
    """

    arguments: Task
    """The task itself, with all that it left to the scene written in."""
    radio: RadioModel | ForeignMap = field(compare=False)  # of the arguments, as are the others
    target_db: float = field(compare=False)

    @property
    def rules(self) -> Rules:
        """The part that is the robot's."""
        return self.arguments.rules


def resolved(task: Task) -> ResolvedTask:
    """The task with its scene or map read, and with all that it left to the scene: a target and a
    resolution.

    A map from elsewhere says no target: that of the paper is taken.

    Raises
    ------
    FileNotFoundError
        Where the scene or map file does not exist.
    ValueError
        Where it is damaged.

    Examples
    --------
    >>> resolved(Task(scene="paper")).target_db
    -61.8
    """
    if task.radio_map is not None:
        radio_map = _read_map(task.radio_map)
        target_db = float(TARGET_DB if task.target_db is None else task.target_db)

        return ResolvedTask(
            arguments=replace(task, radio_map=radio_map, target_db=target_db),
            radio=ForeignMap(
                radio_map, _given_end("start", task.start), _given_end("goal", task.goal)
            ),
            target_db=target_db,
        )

    scene = _read_scene(task.scene)
    target_db = float(scene.target_db if task.target_db is None else task.target_db)
    radio = RadioModel.of(
        scene,
        task.cell_size,
        task.irs_elements,
        task.phase_bits,
        task.quantiser,
        task.array_model,
    )

    return ResolvedTask(
        arguments=replace(task, scene=scene, target_db=target_db, phase_bits=radio.phase_bits),
        radio=radio,
        target_db=target_db,
    )


def _read_scene(scene: str | Path | Scene | Mapping[str, Any]) -> Scene:
    return Scene.from_data(scene) if isinstance(scene, Mapping) else as_scene(scene)


def _read_map(radio_map: str | Path | RadioMap | Mapping[str, Any]) -> RadioMap:
    if isinstance(radio_map, RadioMap):
        return radio_map
    return (
        RadioMap.from_data(radio_map)
        if isinstance(radio_map, Mapping)
        else RadioMap.load(radio_map)
    )


def _given_end(name: str, cell: Cell | None) -> Cell:
    """The start or goal of a robot on a map from elsewhere, which says none."""
    if cell is None:
        raise ValueError(f"{name} must be given as a cell (i, j) along with radio_map")

    return cell


@dataclass(frozen=True, eq=False)
class World:
    """A task with its map: arrays that never change, shared by all environments of that task."""

    task: Task  # with all that it left to the scene written in
    target_db: float
    """Lowest expected channel gain that keeps the robot connected."""
    scene: Scene | None  # with the elements that the task asks for
    radio_map: RadioMap
    start: Cell
    goal: Cell
    feasible: NDArray[np.bool_]  # (X, Y)
    irs: NDArray[np.float32] = field(repr=False)
    """What the observation tells of the IRS in each cell, ``(X, Y, 3 + N)``, in [-1, 1]."""
    source: tuple[Callable[..., "World"], tuple[Any, ...]] = field(repr=False)
    """A call that gives it again."""
    to_go: NDArray[np.float64] | None = field(default=None, repr=False)
    """Metres to its own goal over feasible cells where known, ``(X, Y)``."""
    cost: NDArray[np.float64] | None = field(default=None, repr=False)
    """What each cell costs, ``(X, Y)``, under a budget."""
    passable: NDArray[np.bool_] | None = field(default=None, repr=False)
    """The moves that the robot's body can make, ``(X, Y, 8)``; None: all."""

    def __post_init__(self) -> None:
        freeze(self.feasible, self.irs, self.to_go, self.cost, self.passable)

    @property
    def rules(self) -> Rules:
        """What the robot sees, may do and is rewarded for."""
        return self.task.rules

    @property
    def motion(self) -> Motion:
        """What is asked of a move besides a free cell: arguments of `irs_gym.grid.legal_moves`."""
        return {"corner_cutting": self.rules.robot.corner_cutting, "passable": self.passable}

    @cached_property
    def fingerprint(self) -> bytes:
        """8 bytes that tell maps and rules apart; what is observed, and where episodes begin and
        end, is no part.
        """
        rules = self.rules
        said: tuple[Any, ...] = (
            rules.constraint,
            bool(rules.shaping),
            float(rules.goal_bonus),
            self.target_db,
        )
        if rules.robot != PAPER_ROBOT:  # who is not mentioned
            said = (*said, repr(rules.robot))

        grid = self.radio_map.grid
        content = repr((grid.shape, float(grid.cell_size), said)).encode()
        content += self.radio_map.gain_db.tobytes()
        if self.cost is not None:
            content += rules.on_exhausted.encode() + self.cost.tobytes()

        return blake2b(content, digest_size=8).digest()

    def __reduce__(self) -> Any:
        # A copy is the same world: rebuilt from its source in another process, shared in this one.
        return self.source


def build_world(task: Task) -> World:
    """World of a task; equal tasks share one.

    Raises
    ------
    FileNotFoundError
        Where a scene or map file does not exist.
    ValueError
        Where the scene, the map or an argument is at fault.
    """
    return _build_world(resolved(task))


@lru_cache(maxsize=16)
def _build_world(task: ResolvedTask) -> World:
    given = task.arguments
    radio = task.radio
    if isinstance(radio, ForeignMap):
        scene = None
        radio_map = radio.radio_map
        start = radio.start
        goal = radio.goal
        radio_map.grid.check_memory(_CELL_BYTES, "the tables of a map")
        settings = np.full(3, -1.0)  # as without IRS
        shifts = np.zeros((*radio_map.grid.shape, 0), dtype=np.float32)
    else:
        scene = radio.built_scene
        told = task.rules.irs_phases
        _check_world(radio.grid, scene if told else scene.with_irs_elements(0))
        radio_map, shifts = build_map_and_shifts(radio, needs_shifts=told)
        start = given.start or radio_map.grid.cell_of(scene.start)
        goal = given.goal or radio_map.grid.cell_of(scene.goal)
        settings = irs_settings(scene, radio.phase_bits)

    radio_map, motion = task.rules.robot.fit(radio_map, scene)

    return World(
        task=given,
        target_db=task.target_db,
        scene=scene,
        radio_map=radio_map,
        start=start,
        goal=goal,
        feasible=radio_map.feasible(task.target_db),
        irs=_irs_observation(settings, shifts),
        source=(build_world, (given,)),
        cost=world_costs(given.rules, radio_map, task.target_db),
        passable=motion["passable"],
    )


def world_costs(rules: Rules, radio_map: RadioMap, target_db: float) -> NDArray[np.float64] | None:
    """What each cell costs, ``(X, Y)``, where the rules hold a budget."""
    if rules.constraint != "budget":
        return None

    return payable(cost_map(radio_map, target_db, rules.cost))


def _irs_observation(
    settings: NDArray[np.float64], shifts: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The settings ``(3,)``, the same in each cell, and the shifts ``(X, Y, N)``, where pi is 0."""
    spread = np.broadcast_to(settings.astype(np.float32), (*shifts.shape[:2], 3))  # (X, Y, 3)
    return np.concatenate([spread, np.clip(shifts / np.float32(np.pi) - 1, -1, 1)], axis=-1)


def _check_world(grid: Grid, scene: Scene) -> None:
    """Refuse a world whose tables would take too much memory, before any of it is made."""
    grid.check_memory(_CELL_BYTES, "map and tables")
    cells = grid.shape[0] * grid.shape[1]
    shifts = sum(panel.subsurfaces for panel in scene.irs_panels)
    check_memory(
        f"irs_elements: {shifts} phase shifts in each of {cells} cells",
        _SHIFT_BYTES * cells * shifts,
    )


def irs_settings(scene: Scene, phase_bits: int | None) -> NDArray[np.float64]:
    """What an agent is told of the IRS, shape ``(3,)``, all -1 where there is none.

    Presence (-1 or 1), resolution (1 - 2/L, 1 if continuous) and size (1 - 2/(1 + M/1000), M of all
    panels).
    """
    elements = sum(panel.elements for panel in scene.irs_panels)
    if not elements:
        return np.full(3, -1.0)

    resolution = 1.0 if phase_bits is None else 1.0 - 2.0 / 2**phase_bits

    return np.array([1.0, resolution, 1.0 - 2.0 / (1.0 + elements / 1000.0)])


def check_random_start(value: Any) -> None:
    """Refuse what is no probability, nor a bool."""
    is_number = isinstance(value, Real | np.bool_)
    if not (is_number and 0 <= value <= 1):
        raise ValueError(f"random_start={value!r} must be a bool or a probability from 0 to 1")


def _check_number(name: str, value: Any) -> None:
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not (is_number and abs(value) <= _LARGEST):
        raise ValueError(f"{name}={value!r} must be a finite number, none beyond {_LARGEST}")


def is_integer(value: Any) -> bool:
    """Whether a value is a whole number, and no bool."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
