"""`ContinuousTask`: what is asked of an environment whose robot goes anywhere on the floor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args

import numpy as np

from irs_gym.datasets.scene_set import SceneSet, check_scenes
from irs_gym.grid import checked_point
from irs_gym.mdp.budget import Budget, OnExhausted, checked_budget
from irs_gym.mdp.continuous_maps import FieldKind, OnRefused, Point
from irs_gym.mdp.cost import CostKind
from irs_gym.mdp.task import Constraint, Rules, Task, checked_fields
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene

ContinuousObservation = Literal["dict", "flat"]

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
    on_refused: OnRefused = "stop"
    """Where a move leaves the robot that meets an obstacle, or is refused below the target: "stop"
    on the border, or "stay" where it was, as in `IrsNav-v0`. To learn, "stay" is easier: nobody
    ends up on a border that the next move leads into again.
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
        choices = {
            "field": FieldKind,
            "observation": ContinuousObservation,
            "on_refused": OnRefused,
        }
        for name, kind in choices.items():
            if getattr(self, name) not in get_args(kind):
                raise ValueError(f"{name}={getattr(self, name)!r} must be one of {get_args(kind)}")
        for name in ("start", "goal"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, checked_point(getattr(self, name), name))

        object.__setattr__(self, "budget", checked_budget(self.budget))
        if self.field == "exact":
            self._check_exact()

        if self.has_many_scenes:
            check_scenes(self)
        else:
            one = self.one_scene()
            for name in ("scene", "radio_map"):
                object.__setattr__(self, name, getattr(one, name))

        _ = self.rules  # checks the fields that are the robot's

    @property
    def has_many_scenes(self) -> bool:
        """Whether each episode may be in another scene."""
        return self.split is not None or self.scenes is not None

    @cached_property
    def rules(self) -> Rules:
        """The part that is the robot's."""
        rules = Rules.of(self)
        return replace(rules, irs_phases=False) if self.has_many_scenes else rules

    def one_scene(self, **ends: Any) -> Task:
        """The task of `IrsNav-v0` in the same scene, between cells given as its ``start`` and
        ``goal``.
        """
        if self.radio_map is not None:
            for name in ("start", "goal"):
                if getattr(self, name) is None:
                    raise ValueError(f"{name} must be given as a point (x, y) along with radio_map")

            ends = {"start": (0, 0), "goal": (0, 0)} | ends  # checked later, with the map at hand

        return Task(**self.shared(Task, {"start", "goal"}), **ends)

    def shared(self, kind: Any, without: set[str]) -> dict[str, Any]:
        """The fields that another dataclass has as well, without some of them."""
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
    on_refused: OnRefused
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


def _checked_length(name: str, value: Any) -> float:
    is_number = isinstance(value, Real) and not isinstance(value, bool | np.bool_)
    if not is_number or not 0 < value <= _MOST:
        raise ValueError(f"{name}={value!r} must be a number above 0 and up to {_MOST:g}")
    return float(value)
