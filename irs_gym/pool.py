"""`Pool`: many scenes with their radio maps and distances to go, stacked in arrays of one shape."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.scene import Scene
from irs_gym.solved import Solved, solve
from irs_gym.task import irs_settings


@dataclass(frozen=True, eq=False)
class Pool:
    """S scenes with their maps; maps smaller than the frame (X, Y) are padded with blocked cells at their upper ends.

    Attributes
    ----------
    scenes
        The scenes; those of a split are read anew from their text whenever they are asked for.
    names
        A name for each.
    target_db
        float64, shape ``(S,)``: the scenes' targets.
    gain_db
        float64, shape ``(S, X, Y)``: expected channel gains; -inf in obstacles and outside of the room.
    distance_to_go
        float64, shape ``(S, X, Y)``: metres to the scene's own goal over feasible cells; +inf where it cannot be
        reached.
    irs
        float32, shape ``(S, 3)``: see `irs_gym.task.irs_settings`.
    start, goal
        int64, shape ``(S, 2)``: cells (i, j).
    cell_size
        Edge of a cell in metres.
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

    def __post_init__(self) -> None:
        for array in (self.target_db, self.gain_db, self.distance_to_go, self.irs, self.start, self.goal):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def shape(self) -> tuple[int, int]:
        """The frame (X, Y)."""
        return self.gain_db.shape[1], self.gain_db.shape[2]

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Cells that a robot can enter, whatever the target: shape ``(S, X, Y)``."""
        return _read_only(np.isfinite(self.gain_db))

    @cached_property
    def feasible(self) -> NDArray[np.bool_]:
        """Free cells at or above their scene's target, shape ``(S, X, Y)``."""
        return _read_only(self.free & (self.gain_db >= self.target_db[:, None, None]))

    @cached_property
    def oracle_distance(self) -> NDArray[np.float64]:
        """Length in metres of the shortest feasible path from each scene's start, shape ``(S,)``."""
        return _read_only(self.distance_to_go[np.arange(len(self)), self.start[:, 0], self.start[:, 1]])


def pool_of(
    scenes: Sequence[Scene],
    names: Sequence[str] | None = None,
    *,
    cell_size: float = 0.5,
    frame: tuple[int, int] | None = None,
) -> Pool:
    """Pool of given scenes.

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

    Raises
    ------
    ValueError
        Where there is no scene, a scene is larger than the frame, or one is infeasible; the message names the scene
        and, where there is one, its highest feasible target.
    """
    if not scenes:
        raise ValueError("scenes is empty: a pool needs one or more")
    names = tuple(scene.name for scene in scenes) if names is None else tuple(names)
    if len(names) != len(scenes):
        raise ValueError(f"names has {len(names)} entries for {len(scenes)} scenes: one for each is needed")
    solved = [_solve(scene, name, cell_size) for scene, name in zip(scenes, names, strict=True)]
    shapes = np.array([each.radio_map.grid.shape for each in solved])
    frame = (int(shapes[:, 0].max()), int(shapes[:, 1].max())) if frame is None else frame
    too_large = np.flatnonzero((shapes > frame).any(axis=1))
    if len(too_large):
        first = too_large[0]
        raise ValueError(
            f"scene {names[first]!r} has {tuple(shapes[first].tolist())} cells: frame={frame} is too small"
        )
    return Pool(
        scenes=tuple(scenes),
        names=names,
        target_db=np.array([scene.target_db for scene in scenes]),
        gain_db=np.stack([_padded(each.radio_map.gain_db, frame, -np.inf) for each in solved]),
        distance_to_go=np.stack([_padded(each.distance_to_go, frame, np.inf) for each in solved]),
        irs=np.array([irs_settings(scene, scene.phase_bits) for scene in scenes], dtype=np.float32),
        start=np.array([each.start for each in solved], dtype=np.int64),
        goal=np.array([each.goal for each in solved], dtype=np.int64),
        cell_size=cell_size,
    )


def _solve(scene: Scene, name: str, cell_size: float) -> Solved:
    try:
        return solve(scene, cell_size)
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from None


def _padded(array: NDArray[np.float64], frame: tuple[int, int], value: float) -> NDArray[np.float64]:
    over = [(0, whole - part) for whole, part in zip(frame, array.shape, strict=True)]
    return np.pad(array, over, constant_values=value)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
