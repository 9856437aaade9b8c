"""`SceneSet`: many scenes with their radio maps and distances to go, in arrays of one shape."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.build_shards import build_shards
from irs_gym.datasets.cache import cache_folder
from irs_gym.datasets.generator import CELL_SIZE
from irs_gym.datasets.shard import Shard
from irs_gym.datasets.solved_scene import SolvedScene, solve
from irs_gym.datasets.splits import check_frozen, members_of, split_of
from irs_gym.grid import Grid, Motion, as_cell
from irs_gym.mdp.robot import PAPER_ROBOT, Robot
from irs_gym.mdp.task import is_integer
from irs_gym.memory import check_memory, freeze, frozen
from irs_gym.oracle.shortest_path import distance_to_go
from irs_gym.radio.fading import RicianFading
from irs_gym.radio.radio_map import RadioMap, build_radio_map
from irs_gym.radio.scene import Scene

FRAME_SIDE = 40  # cells: sides of the frames that policies see maps in are multiples of this

# For each cell of each scene, at the most: maps, rules, and shards before they are joined.
_CELL_BYTES = 50

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


@dataclass(frozen=True, eq=False)
class SceneSet:
    """S scenes with their maps; maps smaller than the frame (X, Y) are padded with blocked cells at
    their upper ends.

    Attributes
    ----------
    scenes
        The scenes; those of a split are read anew from their text whenever they are asked for.
    names
        A name for each.
    target_db
        float64, shape ``(S,)``: the scenes' targets.
    gain_db
        float64, shape ``(S, X, Y)``: expected channel gains; -inf in obstacles and outside of the
        room.
    distance_to_go
        float64, shape ``(S, X, Y)``: metres to the scene's own goal over feasible cells; +inf where
        it cannot be reached.
    irs
        float32, shape ``(S, 3)``: see `irs_gym.mdp.task.irs_settings`.
    start, goal
        int64, shape ``(S, 2)``: cells (i, j).
    cell_size
        Edge of a cell in metres.
    robot
        Whose cells and distances they are.
    moves
        uint8, shape ``(S, X, Y)``: the moves that its body can make, a bit each; None: all.
    """

    scenes: Sequence[Scene]
    names: tuple[str, ...]
    target_db: NDArray[np.float64]
    gain_db: NDArray[np.float64]
    distance_to_go: NDArray[np.float64]
    irs: NDArray[np.float32]
    start: NDArray[np.int64]
    goal: NDArray[np.int64]
    cell_size: float
    robot: Robot = PAPER_ROBOT
    moves: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        freeze(self.target_db, self.gain_db, self.distance_to_go, self.irs, self.start, self.goal)
        freeze(self.moves)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def shape(self) -> tuple[int, int]:
        """The frame (X, Y)."""
        return self.gain_db.shape[1], self.gain_db.shape[2]

    @cached_property
    def own_shapes(self) -> NDArray[np.int64]:
        """Cells along x and y of each scene's own room, ``(S, 2)``; the frame's where the scenes
        are not there.
        """
        if len(self.scenes) != len(self):
            return np.tile(np.array(self.shape, dtype=np.int64), (len(self), 1))

        shapes = [scene.grid(self.cell_size).shape for scene in self.scenes]
        return np.array(shapes, dtype=np.int64).reshape(len(self), 2)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Cells that a robot can enter, whatever the target: shape ``(S, X, Y)``."""
        return frozen(np.isfinite(self.gain_db))

    @cached_property
    def feasible(self) -> NDArray[np.bool_]:
        """Free cells at or above their scene's target, shape ``(S, X, Y)``."""
        return frozen(self.free & (self.gain_db >= self.target_db[:, None, None]))

    @cached_property
    def fading(self) -> RicianFading:
        """How the gains of all cells fade, of arrays ``(S, X, Y)``; made anew of the scenes, about
        a minute for 10,000.

        Raises ``ValueError`` where the scenes are not there.
        """
        if len(self.scenes) != len(self):
            raise ValueError(f"{len(self)} maps without their scenes tell no fading")

        los_gain = np.zeros(self.gain_db.shape)
        scattered_gain = np.zeros(self.gain_db.shape)

        for n, scene in enumerate(self.scenes):
            radio_map = build_radio_map(scene, self.cell_size)
            own: Any = radio_map.fading  # of a scene, it is Rician
            columns, rows = radio_map.grid.shape
            los_gain[n, :columns, :rows] = own.los_gain
            scattered_gain[n, :columns, :rows] = own.scattered_gain

        return RicianFading(los_gain, scattered_gain)

    @cached_property
    def oracle_distance(self) -> NDArray[np.float64]:
        """Length in metres of the shortest feasible path from each start, shape ``(S,)``."""
        return frozen(self.distance_to_go[np.arange(len(self)), self.start[:, 0], self.start[:, 1]])

    def motion(self, scenes: Any) -> Motion:
        """What else is asked of a move in scenes of those numbers: arguments of
        `irs_gym.grid.legal_moves`.
        """
        passable = None
        if self.moves is not None:
            bits = np.unpackbits(self.moves[scenes][..., None], axis=-1, bitorder="little")
            passable = bits.astype(bool)

        return {"corner_cutting": self.robot.corner_cutting, "passable": passable}

    def by_frame(self) -> list[tuple[NDArray[np.int64], "SceneSet"]]:
        """The scenes in groups, each in the frame of `frame_of` its own rooms: numbers ``(n,)`` of
        scenes, and the set of these.

        What a policy sees of a scene so depends on nothing but the scene, whatever others are in
        the set. Where the scenes are not there, all stay in the frame that they are in.
        """
        if len(self.scenes) != len(self):
            return [(np.arange(len(self)), self)]

        frames = np.array([frame_of((x, y)) for x, y in self.own_shapes.tolist()])  # (S, 2)
        different = np.unique(frames, axis=0)
        if len(different) == 1 and tuple(different[0].tolist()) == self.shape:
            return [(np.arange(len(self)), self)]

        groups = []
        for frame in different:
            numbers = np.flatnonzero((frames == frame).all(axis=1))
            groups.append((numbers, _framed(self, numbers, (int(frame[0]), int(frame[1])))))

        return groups

    def for_robot(self, robot: Robot) -> "SceneSet":
        """The scenes for another robot than the paper's, without those that it cannot solve.

        Warns
        -----
        UserWarning
            Where scenes are left out, with their number, or where it would drive through an
            obstacle.

        Raises
        ------
        ValueError
            Where these are the scenes of yet another robot, or none is left.
        """
        if robot == self.robot:
            return self
        if self.robot != PAPER_ROBOT:
            raise ValueError(f"scenes are those of {self.robot}, not of {robot}")

        return _for_robot(self, robot)


def frame_of(shape: tuple[int, int]) -> tuple[int, int]:
    """The frame that policies see a room of that shape (X, Y) in: its sides are rounded up to
    multiples of 40 cells, those of the frames that they learn in.
    """
    columns, rows = (max(1, -(-each // FRAME_SIDE)) * FRAME_SIDE for each in shape)
    return columns, rows


def read_scenes(scenes: Any) -> tuple[Scene, ...]:
    """Scenes, or their data as dicts, as scenes; a ``ValueError`` where they are none."""
    if not isinstance(scenes, Sequence) or not all(
        isinstance(each, Scene | Mapping) for each in scenes
    ):
        raise ValueError(
            f"scenes={scenes!r} must be a folder of scene files, a sequence of scenes, or a pool"
        )
    return tuple(each if isinstance(each, Scene) else Scene.from_data(each) for each in scenes)


def check_scenes(task: Any) -> None:
    """Refuse what a task of one scene or many cannot ask of many, by a ``ValueError`` that names
    it; ``scenes`` that are given are read.
    """
    if task.split is not None and task.scenes is not None:
        raise ValueError("split cannot be given along with scenes, which takes its place")

    defaults = {name: getattr(type(task), name, None) for name in _OF_ONE_SCENE}
    given = [name for name, usual in defaults.items() if getattr(task, name, None) != usual]
    if given:
        which = "split" if task.split is not None else "scenes"
        raise ValueError(
            f"{', '.join(given)} cannot be given along with {which}, whose scenes say it"
        )

    size = split_of(task.split or "train").size
    if not is_integer(task.num_scenes) or not 1 <= task.num_scenes <= size:
        raise ValueError(f"num_scenes={task.num_scenes!r} must be a number from 1 to {size}")

    if task.scenes is not None and not isinstance(task.scenes, str | Path | SceneSet):
        object.__setattr__(task, "scenes", read_scenes(task.scenes))


def scene_set_of(
    scenes: Sequence[Scene],
    names: Sequence[str] | None = None,
    *,
    cell_size: float = 0.5,
    frame: tuple[int, int] | None = None,
    robot: Robot = PAPER_ROBOT,
) -> SceneSet:
    """Scene set of given scenes.

    Parameters
    ----------
    scenes
        One or more, of any sizes.
    names
        A name for each; their own by default.
    cell_size
        Edge of a cell in metres.
    frame
        Cells (X, Y) of all maps; by default as large as the largest.
    robot
        Who has to solve them; the paper's by default.

    Raises
    ------
    ValueError
        Where there is no scene, a scene is larger than the frame, or one is infeasible; the message
        names the scene and, where there is one, its highest feasible target.
    """
    if not scenes:
        raise ValueError("scenes is empty: a scene set needs one or more")

    names = tuple(scene.name for scene in scenes) if names is None else tuple(names)
    if len(names) != len(scenes):
        raise ValueError(
            f"names has {len(names)} entries for {len(scenes)} scenes: one for each is needed"
        )

    # Shapes first, which cost nothing: a scene that is too large is refused before maps are built.
    shapes = np.array(
        [_shape(scene, name, cell_size) for scene, name in zip(scenes, names, strict=True)]
    )
    largest = (int(shapes[:, 0].max()), int(shapes[:, 1].max()))
    frame = largest if frame is None else as_cell(frame, "frame", "two numbers of cells (X, Y)")
    _check_memory(len(scenes), frame, f"cell_size={cell_size}, frame={frame}")
    too_large = np.flatnonzero((shapes > frame).any(axis=1))
    if len(too_large):
        name = names[too_large[0]]
        shape = tuple(shapes[too_large[0]].tolist())
        raise ValueError(f"scene {name!r} has {shape} cells: frame={frame} is too small")

    solved = [
        _solve(scene, name, cell_size, robot) for scene, name in zip(scenes, names, strict=True)
    ]
    return solved_scene_set(solved, names, frame, robot)


def solved_scene_set(
    solved: Sequence[SolvedScene],
    names: tuple[str, ...],
    frame: tuple[int, int],
    robot: Robot = PAPER_ROBOT,
) -> SceneSet:
    """Scene set of scenes that a robot has solved in cells of one size, each with its name, on maps
    that fit the frame.
    """
    scenes = tuple(each.scene for each in solved)
    cell_size = solved[0].radio_map.grid.cell_size
    pool = _scene_set(scenes, names, Shard.of(solved, frame), cell_size)

    return replace(pool, robot=robot, moves=_packed([each.passable for each in solved], frame))


def build_scene_set(
    split: str,
    num_scenes: int | None = None,
    *,
    jobs: int | None = None,
    progress: bool | None = None,
    cache: str | Path | None = None,
) -> SceneSet:
    """Scene set of the first scenes of a split: a smaller one is the beginning of a larger one.

    Scenes are built by the hundred, in several processes where there are more, and kept in a cache,
    from which they are read the next time; a damaged file there is built anew.

    Parameters
    ----------
    split
        See `irs_gym.datasets.splits.split_of`; sets to learn on may be joined by a plus.
    num_scenes
        Scenes from the first on; 1,000 by default.
    jobs
        Processes; by default as many as there are processors. 1: this one alone.
    progress
        Whether to show a progress bar on the standard error where it takes longer than a second; by
        default, where that is a terminal.
    cache
        Folder of the cache; by default ``IRS_GYM_CACHE``, else the user's folder for such files.

    Raises
    ------
    ValueError
        Where there is no such split, or it has fewer scenes.
    RuntimeError
        Where the split is frozen, and a scene of it comes out as another.
    """
    size = split_of(split).size
    count = min(1000, size) if num_scenes is None else num_scenes
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 1 <= count <= size:
        raise ValueError(
            f"num_scenes={num_scenes!r} must be a number from 1 to {size}, the scenes of {split!r}"
        )

    # refused here where it would not fit, before hours of building
    _check_memory(int(count), split_of(split).frame, f"num_scenes={count}")
    folder = cache_folder() if cache is None else Path(cache)
    members = members_of(split)
    if len(members) > 1:
        turns = np.resize(members, int(count))  # whose scene each is
        each = {
            member: build_scene_set(member, own, jobs=jobs, progress=progress, cache=cache)
            for member in dict.fromkeys(members)
            if (own := int((turns == member).sum()))
        }
        return _in_turn(each, turns, split_of(split).frame)

    shard = build_shards(split, int(count), jobs=jobs, progress=progress, folder=folder)
    texts = shard.texts.tolist()
    check_frozen(split, texts)

    return _scene_set(_Texts(texts), tuple(f"{split}-{n}" for n in range(count)), shard, CELL_SIZE)


def chosen_scenes(split: str | None, num_scenes: int, scenes: Any, robot: Robot) -> SceneSet:
    """The scenes given for a robot, else the first of a split without those that it cannot solve;
    see `SceneSet.for_robot`, and `scene_set_of` for what is raised.
    """
    if isinstance(scenes, SceneSet):
        return scenes.for_robot(robot)
    if scenes is not None:
        return scene_set_of(read_scenes(scenes), robot=robot)

    assert split is not None
    return build_scene_set(split, num_scenes).for_robot(robot)


def _for_robot(pool: SceneSet, robot: Robot) -> SceneSet:
    """The scenes of a set for the paper's robot, for another one."""
    gain_db = np.full_like(pool.gain_db, -np.inf)
    to_go = np.full_like(pool.distance_to_go, np.inf)
    passable: list[NDArray[np.bool_] | None] = []

    for n in range(len(pool)):
        # on a map of the scene's own size: its walls are not those of the frame
        scene = pool.scenes[n] if len(pool.scenes) and not robot.is_point else None
        grid = scene.grid(pool.cell_size) if scene else Grid(pool.shape, pool.cell_size, (0.0, 0.0))
        own = (n, slice(grid.shape[0]), slice(grid.shape[1]))
        radio_map, motion = robot.fit(RadioMap(pool.gain_db[own], grid=grid), scene)

        gain_db[own] = radio_map.gain_db
        goal = (int(pool.goal[n, 0]), int(pool.goal[n, 1]))
        feasible = radio_map.feasible(float(pool.target_db[n]))
        to_go[own] = distance_to_go(feasible, goal, pool.cell_size, **motion)
        passable.append(motion["passable"])

    fitted = replace(
        pool,
        gain_db=gain_db,
        distance_to_go=to_go,
        robot=robot,
        moves=_packed(passable, pool.shape),
    )

    return _without(fitted, np.isinf(fitted.oracle_distance))


def _in_turn(
    pools: Mapping[str, SceneSet], turns: NDArray[np.str_], frame: tuple[int, int]
) -> SceneSet:
    """The scenes of sets in one frame: of each in the order that they have there, and one set after
    the other as the turns have it.
    """
    each = [_framed(pool, np.arange(len(pool)), frame) for pool in pools.values()]
    places = np.concatenate([np.flatnonzero(turns == name) for name in pools])
    order = np.argsort(places).tolist()
    arrays = {
        name: np.concatenate([getattr(pool, name) for pool in each])[order]
        for name in ("target_db", "gain_db", "distance_to_go", "irs", "start", "goal")
    }
    scenes = [scene for pool in each for scene in pool.scenes]
    names = [name for pool in each for name in pool.names]

    return replace(
        each[0],
        scenes=[scenes[n] for n in order],
        names=tuple(names[n] for n in order),
        **arrays,
    )


def _framed(pool: SceneSet, numbers: NDArray[np.int64], frame: tuple[int, int]) -> SceneSet:
    """Some scenes of a set in a frame that holds them all."""
    over = [(0, max(0, whole - part)) for whole, part in zip(frame, pool.shape, strict=True)]
    own = (slice(None), slice(frame[0]), slice(frame[1]))

    def framed(maps: NDArray[Any], value: float) -> NDArray[Any]:
        return np.pad(maps[numbers][own], [(0, 0), *over], constant_values=value)

    return replace(
        pool,
        scenes=[pool.scenes[n] for n in numbers.tolist()],
        names=tuple(pool.names[n] for n in numbers.tolist()),
        target_db=pool.target_db[numbers],
        gain_db=framed(pool.gain_db, -np.inf),
        distance_to_go=framed(pool.distance_to_go, np.inf),
        irs=pool.irs[numbers],
        start=pool.start[numbers],
        goal=pool.goal[numbers],
        moves=None if pool.moves is None else framed(pool.moves, 0),
    )


def _without(pool: SceneSet, is_lost: NDArray[np.bool_]) -> SceneSet:
    """A scene set without the scenes that its robot cannot solve, ``(S,)``, of which it warns."""
    if not is_lost.any():
        return pool

    kept = np.flatnonzero(~is_lost)
    lost = [pool.names[n] for n in np.flatnonzero(is_lost).tolist()]
    named = ", ".join(lost[:5]) + (" ..." if len(lost) > 5 else "")
    said = f"{len(lost)} of {len(pool)} scenes cannot be solved by {pool.robot}: {named}"
    if not len(kept):
        raise ValueError(said)

    warn(f"{said}; they are left out", stacklevel=4)
    arrays = {
        each.name: getattr(pool, each.name)[kept]
        for each in fields(pool)
        if isinstance(getattr(pool, each.name), np.ndarray)
    }
    scenes = [pool.scenes[n] for n in kept.tolist()] if len(pool.scenes) else ()

    return replace(pool, scenes=scenes, names=tuple(pool.names[n] for n in kept), **arrays)


def _packed(
    passable: Sequence[NDArray[np.bool_] | None], frame: tuple[int, int]
) -> NDArray[np.uint8] | None:
    """The moves ``(X, Y, 8)`` of each scene as bits on maps of one shape; None where none says
    any.
    """
    if all(each is None for each in passable):
        return None

    moves = np.zeros((len(passable), *frame), dtype=np.uint8)
    for own, each in zip(moves, passable, strict=True):
        if each is not None:
            columns, rows, _ = each.shape
            own[:columns, :rows] = np.packbits(each, axis=-1, bitorder="little")[..., 0]

    return moves


class _Texts(Sequence[Scene]):
    """Scenes kept as JSON, each read whenever it is asked for."""

    def __init__(self, texts: list[bytes]) -> None:
        self._texts = texts

    def __len__(self) -> int:
        return len(self._texts)

    def __getitem__(self, which: Any) -> Any:
        if isinstance(which, slice):
            return _Texts(self._texts[which])
        return Scene.model_validate_json(self._texts[which], strict=True)


def _scene_set(
    scenes: Sequence[Scene], names: tuple[str, ...], shard: Shard, cell_size: float
) -> SceneSet:
    arrays = {
        each.name: getattr(shard, each.name) for each in fields(shard) if each.name != "texts"
    }
    return SceneSet(scenes=scenes, names=names, cell_size=cell_size, **arrays)


def _check_memory(count: int, frame: tuple[int, int], asked: str) -> None:
    size = float(count) * frame[0] * frame[1] * _CELL_BYTES
    check_memory(f"{asked}: {count} maps of {frame[0]} x {frame[1]} cells", size)


def _shape(scene: Scene, name: str, cell_size: float) -> tuple[int, int]:
    try:
        return scene.grid(cell_size).shape
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from None


def _solve(scene: Scene, name: str, cell_size: float, robot: Robot) -> SolvedScene:
    try:
        return solve(scene, cell_size, robot)
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from None
