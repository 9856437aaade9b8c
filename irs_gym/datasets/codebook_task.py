"""`CodebookTask`: what is asked of an environment whose robot switches the panel's configuration,
and `build_codebook_maps`: all that it fixes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from math import floor
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.scene_set import SceneSet, check_scenes, chosen_scenes
from irs_gym.grid import Cell, Motion, cells_at
from irs_gym.mdp.codebook_packing import CodebookObservation, CodebookPacking
from irs_gym.mdp.codebook_rules import CodebookMaps, check_maps_memory, choose_ends
from irs_gym.mdp.configurations import cover_of, ends_of
from irs_gym.mdp.dynamics import check_bonus
from irs_gym.mdp.robot import Collision
from irs_gym.mdp.task import (
    Rules,
    Task,
    checked_fields,
    irs_settings,
    is_integer,
    resolved,
)
from irs_gym.oracle.joint import (
    checked_switch_cost,
    highest_joint_target,
    joint_distance_to_go,
)
from irs_gym.radio.codebook import Codebook, codebook_gain_db, dft_codebook, focused_codebook
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import RadioModel
from irs_gym.radio.scene import Scene, load_scenes

CodebookKind = Literal["cover", "focused", "dft"]
CodebookConstraint = Literal["refuse", "terminate", "allow"]
MOST_CONFIGURATIONS = 65_536


@dataclass(frozen=True, kw_only=True)
class CodebookTask:
    """What is asked of `IrsNavCodebook-v0`; each field is an argument of `gymnasium.make`. All have
    defaults.

    Raises ``ValueError`` where a value is out of its range; the message names the field.

    Examples
    --------
    >>> CodebookTask(codebook=("dft", 4)).rules.goal_bonus
    10.0
    """

    codebook: Codebook | str | Path | dict[str, Any] | tuple[CodebookKind, int] = ("cover", 8)
    """A `Codebook`, its data as a dict, the path of a saved one, or a design and a size: "cover",
    chosen so that a best path survives; "focused" on cells spread over the floor; or "dft" beams.
    """
    switch_cost: float = 0.5
    """Metres that a switch costs: the robot's speed x the time that the panel takes."""
    scene: str | Path | Scene | dict[str, Any] = Task.scene
    """A scene's name in the package, the path of a scene file, a scene, or its data as a dict."""
    target_db: float | None = Task.target_db
    """Lowest expected channel gain in dB that keeps the robot connected; None as the scene says.
    """
    cell_size: float = Task.cell_size
    """Edge of a cell in metres."""
    irs_elements: int | None = Task.irs_elements
    """Elements on each IRS panel; None as the scene says."""
    phase_bits: int | None = Task.phase_bits
    """Resolution of the phase shifters that a design is made for; None as the scene says."""
    quantiser: Quantiser = Task.quantiser
    """How continuous phases are rounded to `phase_bits`."""
    array_model: ArrayModel = Task.array_model
    """How the array of elements is modelled."""
    patch_radius: int = Task.patch_radius
    """Cells that the robot sees around itself in each direction."""
    observation: CodebookObservation = "dict"
    """"dict", the same packed as "flat", that beside the action mask as "masked", or the number of
    configuration and "cell".
    """
    irs_phases: bool = False
    """Whether the observation holds the phase shift of each sub-surface, which follow from the
    configuration; never over many scenes.
    """
    constraint: CodebookConstraint = "refuse"
    """What happens below the target: the move or switch is refused, ends the episode, or is allowed
    at a cost.
    """
    random_start: float = Task.random_start
    """Probability of a start drawn among the cells from which the goal can be reached, and then
    among the configurations that lead there from it; True is 1.
    """
    shaping: bool = Task.shaping
    """Whether the reward holds the potential-based term (minus the octile distance to the goal)."""
    goal_bonus: float = Task.goal_bonus
    """Reward at the goal, in metres."""
    corner_cutting: bool = Task.corner_cutting
    """Whether a diagonal move asks for its destination alone; otherwise it needs both cells beside
    it, under the present configuration.
    """
    robot_radius: float = Task.robot_radius
    """Metres: cells whose centre is nearer than that to an obstacle or a wall cannot be entered."""
    collision: Collision = Task.collision
    """Where obstacles count: at the "centre" of a cell alone, or wherever the robot's "body" meets
    one on a move. Scenes of a split that such a robot cannot solve are left out, with a warning.
    """
    start: Cell | None = Task.start
    """Cell (i, j) in place of the scene's start."""
    goal: Cell | None = Task.goal
    """Cell (i, j) in place of the scene's goal."""
    split: str | None = None
    """Which generated scenes, in place of one: one of `irs_gym.datasets.splits.SPLITS`."""
    num_scenes: int = 100
    """How many of the split's, from the first on."""
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None = None
    """A folder of scene files, scenes (or their data as dicts) or a pool, in place of one scene."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "codebook", _read_codebook(self.codebook))
        object.__setattr__(self, "switch_cost", checked_switch_cost(self.switch_cost))

        if self.has_many_scenes:
            check_scenes(self)
            if self.is_made:
                raise ValueError("codebook must be a design and a size where there are many scenes")
        else:
            one = self.one_scene  # checks the fields that it shares with others
            for name in ("scene", "start", "goal"):
                object.__setattr__(self, name, getattr(one, name))

        if self.is_made and (self.phase_bits is not None or self.quantiser != Task.quantiser):
            raise ValueError(
                "phase_bits and quantiser cannot be given along with a codebook that is made: it "
                "holds its phases"
            )

        if self.constraint not in get_args(CodebookConstraint):
            raise ValueError(
                f"constraint={self.constraint!r} must be one of {get_args(CodebookConstraint)}"
            )

        # refuses other kinds of observation
        CodebookPacking(self.rules.observation, 1, 3, (1, 1), 1)

    @property
    def has_many_scenes(self) -> bool:
        """Whether each episode may be in another scene."""
        return self.split is not None or self.scenes is not None

    @property
    def is_made(self) -> bool:
        """Whether the codebook is there already, and not to be designed."""
        return not isinstance(self.codebook, tuple)

    @cached_property
    def rules(self) -> Rules:
        """The part that is the robot's."""
        rules = Rules.of(self)
        return replace(rules, irs_phases=False) if self.has_many_scenes else rules

    @cached_property
    def one_scene(self) -> Task:
        """The task of `IrsNav-v0` in the same scene, with phases that follow the robot."""
        own = {each.name for each in fields(self)} & {each.name for each in fields(Task)}
        return Task(**{name: getattr(self, name) for name in own})

    def __deepcopy__(self, memo: Any) -> "CodebookTask":
        return self  # frozen, and so are its scenes


class CodebookTaskArguments(TypedDict, total=False):
    """The fields of `CodebookTask` as keyword arguments, for type checkers and editors."""

    codebook: Codebook | str | Path | dict[str, Any] | tuple[CodebookKind, int]
    switch_cost: float
    scene: str | Path | Scene | dict[str, Any]
    target_db: float | None
    cell_size: float
    irs_elements: int | None
    phase_bits: int | None
    quantiser: Quantiser
    array_model: ArrayModel
    patch_radius: int
    observation: CodebookObservation
    irs_phases: bool
    constraint: CodebookConstraint
    random_start: float
    shaping: bool
    goal_bonus: float
    corner_cutting: bool
    robot_radius: float
    collision: Collision
    start: Cell | None
    goal: Cell | None
    split: str | None
    num_scenes: int
    scenes: str | Path | Sequence[Scene | Mapping[str, Any]] | SceneSet | None


def codebook_task_of(arguments: Mapping[str, Any], owner: str = "CodebookTask") -> CodebookTask:
    """Task of the keyword arguments of ``owner``; a ``TypeError`` lists the known names for an
    unknown one.
    """
    return CodebookTask(**checked_fields(CodebookTask, arguments, owner))


def build_codebook_maps(task: CodebookTask) -> CodebookMaps:
    """Scenes and maps of a task; equal tasks share them.

    Raises
    ------
    FileNotFoundError
        Where a scene or codebook file does not exist.
    ValueError
        Where a scene, the codebook or an argument is at fault, no feasible path joins start and
        goal (the message gives the highest feasible target), or the goal's bonus is too small.
    """
    if isinstance(task.codebook, str | Path):
        task = replace(task, codebook=Codebook.load(task.codebook))
    if isinstance(task.scenes, str | Path):
        task = replace(task, scenes=load_scenes(task.scenes))
    if not task.has_many_scenes:
        task = replace(task, scene=resolved(task.one_scene).arguments.scene)

    return _build(task)


@lru_cache(maxsize=4)
def _build(task: CodebookTask) -> CodebookMaps:
    maps = _of_many(task) if task.has_many_scenes else _of_one(task)

    for scene in range(len(maps)):
        ends = choose_ends(maps, scene, {"start": maps.own_start(scene)}, np.random.default_rng)
        try:
            check_bonus(
                maps.rules,
                float(maps.to_go[(scene, ends.configuration, *ends.start)]),
                maps.start[scene] - maps.goal[scene],
                maps.cell_size,
            )
        except ValueError as error:
            raise ValueError(f"scene {maps.names[scene]!r}: {error}") from None

    return maps


def _of_one(task: CodebookTask) -> CodebookMaps:
    whole = resolved(task.one_scene)
    radio = whole.radio
    assert isinstance(radio, RadioModel)
    scene = radio.built_scene
    grid = radio.grid
    size = task.codebook[1] if isinstance(task.codebook, tuple) else task.codebook.size  # type: ignore[union-attr]
    check_maps_memory(1, size, grid.shape, f"codebook, cell_size={task.cell_size}")

    robot = task.rules.robot
    free, motion = robot.room_in(radio.free, grid, scene)
    start, goal = ends_of(radio, robot, free, task.start, task.goal)
    if isinstance(task.codebook, tuple):
        codebook = design(task.codebook, radio, whole.target_db, start, goal, free, motion)
    else:
        codebook = task.codebook  # type: ignore[assignment]

    gain_db = codebook_gain_db(scene, codebook, task.cell_size, None, task.array_model)
    gain_db[:, ~free] = -np.inf  # (K, X, Y)
    shifts = codebook.phase_shifts if task.rules.irs_phases else codebook.phase_shifts[:, :0]

    return CodebookMaps(
        rules=task.rules,
        switch_cost=task.switch_cost,
        names=(scene.name,),
        scenes=(scene,),
        target_db=np.array([whole.target_db]),
        gain_db=gain_db[None],
        to_go=_to_go(gain_db, whole.target_db, goal, task, motion)[None],
        irs=_told(scene, radio.phase_bits, shifts)[None],
        start=np.array([start]),
        goal=np.array([goal]),
        cell_size=float(task.cell_size),
        source=(build_codebook_maps, (task,)),
        passable=None if motion["passable"] is None else motion["passable"][None],
    )


def _of_many(task: CodebookTask) -> CodebookMaps:
    """Scenes on one frame, each with a codebook of its own, and with its own target or, where no
    joint path holds that, the highest one that some does.
    """
    pool = chosen_scenes(task.split, task.num_scenes, task.scenes, task.rules.robot)
    assert isinstance(task.codebook, tuple)
    kind, size = task.codebook
    check_maps_memory(len(pool), size, pool.shape, f"codebook={task.codebook}, num_scenes")
    gain_db = np.full((len(pool), size, *pool.shape), -np.inf)
    to_go = np.full_like(gain_db, np.inf)
    target_db = pool.target_db.copy()
    irs = []

    for n, scene in enumerate(pool.scenes):
        start, goal = (_cell(each[n]) for each in (pool.start, pool.goal))
        radio = RadioModel.of(scene, pool.cell_size, None, None, "nearest", "far_field")
        columns, rows = radio.grid.shape  # of its own room, in a corner of the frame
        free = pool.free[n, :columns, :rows]
        motion = pool.motion(n)
        if motion["passable"] is not None:
            motion["passable"] = motion["passable"][:columns, :rows]

        try:
            codebook = design((kind, size), radio, float(target_db[n]), start, goal, free, motion)
            gains = codebook_gain_db(scene, codebook, pool.cell_size)  # (K, its own X, Y)
        except ValueError as error:
            raise ValueError(f"scene {pool.names[n]!r}: {error}") from None

        gains[:, ~free] = -np.inf
        highest = highest_joint_target(gains, start, goal, **motion)
        # rounded down, so that it is one that can be told
        target_db[n] = min(target_db[n], floor(highest * 1e4) / 1e4)
        gain_db[n, :, :columns, :rows] = gains
        left = _to_go(gains, float(target_db[n]), goal, task, motion)
        to_go[n, :, :columns, :rows] = left
        irs.append(_told(scene, scene.phase_bits, codebook.phase_shifts[:, :0]))

    return CodebookMaps(
        rules=task.rules,
        switch_cost=task.switch_cost,
        names=pool.names,
        scenes=tuple(pool.scenes),
        target_db=target_db,
        gain_db=gain_db,
        to_go=to_go,
        irs=np.stack(irs),
        start=pool.start,
        goal=pool.goal,
        cell_size=pool.cell_size,
        source=(build_codebook_maps, (task,)),
        passable=pool.motion(np.s_[:])["passable"],
    )


def design(
    asked: tuple[CodebookKind, int],
    radio: RadioModel,
    target_db: float,
    start: Cell,
    goal: Cell,
    free: NDArray[np.bool_],
    motion: Motion,
) -> Codebook:
    """A codebook of that design and size for a scene, and a robot that can be in the free cells
    ``(X, Y)`` and makes such moves.
    """
    kind, size = asked
    scene = radio.built_scene
    hardware = (radio.phase_bits, radio.quantiser, radio.array_model)
    if kind == "dft":
        return dft_codebook(scene, size, None, radio.phase_bits, radio.quantiser)
    if kind == "cover":
        return cover_of(radio, size, target_db, start, goal, free, motion)

    cells = spread_cells(free, start, size)

    return focused_codebook(scene, cells, radio.cell_size, None, *hardware)


def spread_cells(free: NDArray[np.bool_], start: Cell, count: int) -> NDArray[np.int64]:
    """Free cells that are spread over the floor, ``(count, 2)``: from the start on, each time the
    one that is farthest from those before it (Gonzalez, 1985), the first of equals.

    Raises ``ValueError`` where there are fewer.

    Examples
    --------
    >>> spread_cells(np.ones((3, 5), dtype=bool), (0, 0), 3).tolist()
    [[0, 0], [2, 4], [0, 3]]
    """
    cells = cells_at(np.flatnonzero(free), free.shape)  # (n, 2)
    if count > len(cells):
        raise ValueError(f"codebook: {count} configurations cannot focus on {len(cells)} cells")

    chosen = [np.array(start)]
    nearest = np.full(len(cells), np.inf)  # squared, to the chosen ones
    while len(chosen) < count:
        nearest = np.minimum(nearest, ((cells - chosen[-1]) ** 2).sum(axis=1))
        chosen.append(cells[np.argmax(nearest)])

    return np.stack(chosen)


def _to_go(
    gain_db: NDArray[np.float64], target_db: float, goal: Cell, task: CodebookTask, motion: Motion
) -> NDArray[np.float64]:
    cell_size = task.cell_size
    return joint_distance_to_go(gain_db, target_db, goal, cell_size, task.switch_cost, **motion)


def _told(scene: Scene, phase_bits: int | None, shifts: NDArray[np.float64]) -> NDArray[np.float32]:
    """What an agent is told of the IRS under each configuration, ``(K, 3 + N)``, where pi is 0."""
    settings = irs_settings(scene, phase_bits).astype(np.float32)
    spread = np.broadcast_to(settings, (len(shifts), 3))
    held = np.mod(shifts, 2 * np.pi).astype(np.float32)

    return np.concatenate([spread, np.clip(held / np.float32(np.pi) - 1, -1, 1)], axis=-1)


def _cell(values: NDArray[np.int64]) -> Cell:
    i, j = values.tolist()
    return i, j


def _read_codebook(given: Any) -> Codebook | str | Path | tuple[CodebookKind, int]:
    """The codebook as it is asked for, checked but for the content of a file."""
    if isinstance(given, Codebook | str | Path):
        return given
    if isinstance(given, Mapping):
        return Codebook.from_data(given)

    try:
        kind, size = given
    except (TypeError, ValueError):
        kind = None
        size = None
    if (
        kind not in get_args(CodebookKind)
        or not is_integer(size)
        or not 1 <= size <= MOST_CONFIGURATIONS
    ):
        raise ValueError(
            f"codebook={given!r} must be a Codebook, its data as a dict, the path of a file, or "
            f"one of {get_args(CodebookKind)} with a size from 1 to {MOST_CONFIGURATIONS}"
        )

    return kind, int(size)
