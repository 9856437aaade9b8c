"""`RandomTask`: what is asked of an environment over many scenes, `Worlds`: all that it fixes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from operator import index
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.scene_set import SceneSet, chosen_scenes, read_scenes
from irs_gym.datasets.splits import split_of
from irs_gym.datasets.start_fronts import StartFronts
from irs_gym.grid import Grid
from irs_gym.mdp.budget import Budget, OnExhausted, checked_budget, payable
from irs_gym.mdp.cost import CostKind, cell_costs
from irs_gym.mdp.dynamics import check_task, potential
from irs_gym.mdp.robot import Collision
from irs_gym.mdp.task import (
    Constraint,
    Observation,
    Rules,
    Task,
    World,
    checked_fields,
    is_integer,
)
from irs_gym.memory import frozen
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene, load_scenes


@dataclass(frozen=True, kw_only=True)
class RandomTask:
    """What is asked of `IrsNavRandom-v0`; each field is an argument of `gymnasium.make`. All have
    defaults.

    Raises ``ValueError`` where a value is out of its range; the message names the field.

    Examples
    --------
    >>> RandomTask(num_scenes=3).rules.constraint
    'refuse'
    """

    split: str = "train"
    """Which generated scenes: one of `irs_gym.datasets.splits.SPLITS`, or sets to learn on joined
    (`irs_gym.datasets.splits.split_of`)."""
    num_scenes: int = 1000
    """How many of the split's, from the first on."""
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None = None
    """A folder of scene files, scenes (or their data as dicts) or a pool, in place of a split; a
    file's name is its scene's id."""
    observation: Observation = Task.observation
    """"dict", the same packed as "flat", that beside the action mask as "masked", the whole "map",
    or the "cell".
    """
    patch_radius: int = Task.patch_radius
    """Cells that the robot sees around itself in each direction."""
    constraint: Constraint = Task.constraint
    """What happens at a cell below the target: the move is refused, ends the episode, is allowed
    at a cost, or is paid for out of a budget.
    """
    cost: CostKind = Task.cost
    """What a cell costs under a budget; see `irs_gym.cost_map`."""
    budget: Budget | None = Task.budget
    """Total cost that an episode may come to, or a range (low, high) that each is drawn from.

    Needed with ``constraint="budget"``, and refused with any other.
    """
    on_exhausted: OnExhausted = Task.on_exhausted
    """What happens at a step that the budget cannot pay: it ends the episode as a failure, the
    episode continues and the cost is only counted, or the step is refused.
    """
    random_start: float = Task.random_start
    """Probability of a start drawn among the cells from which the goal can be reached; True is 1.
    """
    shaping: bool = Task.shaping
    """Whether the reward holds the potential-based term (minus the octile distance to the goal)."""
    goal_bonus: float = Task.goal_bonus
    """Reward at the goal, in metres."""
    corner_cutting: bool = Task.corner_cutting
    """Whether a diagonal move asks for its destination alone; otherwise it needs both cells beside
    it.
    """
    robot_radius: float = Task.robot_radius
    """Metres: cells whose centre is nearer than that to an obstacle or a wall cannot be entered."""
    collision: Collision = Task.collision
    """Where obstacles count: at the "centre" of a cell alone, or wherever the robot's "body" meets
    one on a move. Scenes of a split that such a robot cannot solve are left out, with a warning.
    """

    def __post_init__(self) -> None:
        object.__setattr__(self, "budget", checked_budget(self.budget))
        _ = self.rules  # checks the fields that are the robot's
        size = split_of(self.split).size
        if not is_integer(self.num_scenes) or not 1 <= self.num_scenes <= size:
            raise ValueError(
                f"num_scenes={self.num_scenes!r} must be a number from 1 to {size}, "
                f"the scenes of {self.split!r}"
            )
        if self.scenes is None:
            return

        given = [
            name
            for name in ("split", "num_scenes")
            if getattr(self, name) != getattr(RandomTask, name)
        ]
        if given:
            raise ValueError(
                f"{', '.join(given)} cannot be given along with scenes, "
                "which takes the place of a split"
            )

        if not isinstance(self.scenes, str | Path | SceneSet):
            object.__setattr__(self, "scenes", read_scenes(self.scenes))

    @cached_property
    def rules(self) -> Rules:
        """The robot's part of the task, the same in all scenes; it is told no phase shifts."""
        return replace(Rules.of(self), irs_phases=False)

    def __deepcopy__(self, memo: Any) -> "RandomTask":
        return self  # frozen, and so are its scenes


class RandomTaskArguments(TypedDict, total=False):
    """The fields of `RandomTask` as keyword arguments, for type checkers and editors."""

    split: str
    num_scenes: int
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None
    observation: Observation
    patch_radius: int
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


def random_task_of(arguments: Mapping[str, Any], owner: str = "RandomTask") -> RandomTask:
    """Task of the keyword arguments of ``owner``; a ``TypeError`` lists the known names for an
    unknown one.
    """
    return RandomTask(**checked_fields(RandomTask, arguments, owner))


@dataclass(frozen=True, eq=False)
class Worlds:
    """A random task with its maps, shared by all environments of that task."""

    task: RandomTask
    pool: SceneSet

    def __len__(self) -> int:
        return len(self.pool)

    @cached_property
    def cost(self) -> NDArray[np.float64]:
        """What each cell of each scene costs under a budget, ``(S, X, Y)``; inf in obstacles."""
        pool = self.pool
        target_db = pool.target_db[:, None, None]
        fading = pool.fading if self.task.cost == "outage" else None
        costs = cell_costs(pool.gain_db, pool.free, target_db, self.task.cost, fading)

        return frozen(payable(costs))

    @cached_property
    def start_fronts(self) -> StartFronts:
        """What the scenes' own starts have to pay under a budget, for which distance."""
        return StartFronts(len(self), self.world)

    def world(self, number: int) -> World:
        """World of one scene, on a map as large as the pool's frame."""
        return _world(self, number)

    def number_of(self, scene_id: Any) -> int:
        """Number of a scene from its name or number; a ``ValueError`` tells what there is."""
        return scene_number(self.pool.names, scene_id)

    def choose(self, scene_id: Any, rng: np.random.Generator) -> int:
        """Number of the scene of an episode: the one that is asked for, or one drawn, all equally
        likely.
        """
        return chosen_scene(self.pool.names, scene_id, rng)

    def __reduce__(self) -> Any:
        return build_worlds, (self.task,)


def scene_number(names: Sequence[str], scene_id: Any) -> int:
    """Number of a scene from its name or number; a ``ValueError`` tells what there is."""
    if isinstance(scene_id, str):
        if names.count(scene_id) == 1:
            return names.index(scene_id)
        if scene_id in names:
            raise ValueError(
                f"scene_id={scene_id!r} is the name of {names.count(scene_id)} scenes: "
                "give a number"
            )
    else:
        try:
            number = index(scene_id)
        except TypeError:
            number = -1

        if 0 <= number < len(names) and not isinstance(scene_id, bool):
            return number

    some = ", ".join(map(repr, names[:3])) + (f" ... {names[-1]!r}" if len(names) > 3 else "")
    raise ValueError(
        f"scene_id={scene_id!r} must be a name of a scene ({some}) "
        f"or a number from 0 to {len(names) - 1}"
    )


def chosen_scene(names: Sequence[str], scene_id: Any, rng: np.random.Generator) -> int:
    """Number of the scene of an episode; see `Worlds.choose`."""
    return int(rng.integers(len(names))) if scene_id is None else scene_number(names, scene_id)


def build_worlds(task: RandomTask) -> Worlds:
    """Worlds of a task; equal tasks share them.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder.
    ValueError
        Where there is no such split, a scene is at fault, or the goal's bonus is too small for one
        of them; the message names it.
    """
    if isinstance(task.scenes, str | Path):
        task = replace(task, scenes=load_scenes(task.scenes))

    return _build_worlds(task)


@lru_cache(maxsize=4)
def _build_worlds(task: RandomTask) -> Worlds:
    pool = chosen_scenes(task.split, task.num_scenes, task.scenes, task.rules.robot)
    worlds = Worlds(task, pool)
    for number in _hardest(worlds):
        try:
            check_task(worlds.world(number))
        except ValueError as error:
            raise ValueError(f"scene {pool.names[number]!r}: {error}") from None

    return worlds


def _hardest(worlds: Worlds) -> list[int]:
    """Numbers of the scenes that have to be checked: where they are in order, all are.

    Where giving up pays in none of the scenes, it does not in the one of the longest detour. At its
    own target, each has a path of no violation and no deficit; of outage, each has its own least.
    """
    if worlds.task.budget is not None and worlds.task.cost == "outage":
        return list(range(len(worlds)))

    pool = worlds.pool
    offsets = pool.start - pool.goal  # (S, 2) cells
    detour = pool.oracle_distance + potential(worlds.task.rules, offsets, pool.cell_size)  # (S,)

    return [int(np.argmax(detour))]


@lru_cache(maxsize=16)
def _world(worlds: Worlds, number: int) -> World:
    pool = worlds.pool
    scene = pool.scenes[number] if len(pool.scenes) else None
    grid = Grid(pool.shape, pool.cell_size, scene.room.lower if scene else (0.0, 0.0))
    target_db = float(pool.target_db[number])
    rules = {each.name: getattr(worlds.task.rules, each.name) for each in fields(Rules)}
    radio: dict[str, Any] = {"scene": scene, "phase_bits": scene.phase_bits} if scene else {}

    return World(
        task=Task(target_db=target_db, cell_size=pool.cell_size, **rules, **radio),
        target_db=target_db,
        scene=scene,
        radio_map=RadioMap(pool.gain_db[number], grid=grid),
        start=(int(pool.start[number, 0]), int(pool.start[number, 1])),
        goal=(int(pool.goal[number, 0]), int(pool.goal[number, 1])),
        feasible=pool.feasible[number],
        irs=np.broadcast_to(pool.irs[number], (*pool.shape, 3)),
        source=(_world, (worlds, number)),
        to_go=pool.distance_to_go[number],
        cost=None if worlds.task.budget is None else worlds.cost[number],
        passable=pool.motion(number)["passable"],
    )
