"""`build_continuous_maps`: the scenes and maps of a `ContinuousTask`."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from irs_gym.datasets.continuous_task import ContinuousTask
from irs_gym.datasets.random_task import RandomTask, Worlds, build_worlds
from irs_gym.grid import Cell, Grid
from irs_gym.mdp.continuous_ends import check_scene
from irs_gym.mdp.continuous_maps import ContinuousMaps, Point, check_reach
from irs_gym.mdp.task import Task, World, build_world, resolved
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene, load_scenes


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
        on_refused=task.on_refused,
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
    own = _random_task(task)
    plain = {name: getattr(Task, name) for name in ("cost", "budget", "on_exhausted")}
    pool = build_worlds(replace(own, constraint="allow", **plain)).pool
    worlds = Worlds(own, pool)
    if task.field == "exact" and len(pool.scenes) != len(pool):
        raise ValueError("field='exact' needs scenes, and these are maps without them")

    return ContinuousMaps(
        rules=own.rules,
        field=task.field,
        speed=task.speed,
        time_step=task.time_step,
        goal_radius=task.goal_radius,
        on_refused=task.on_refused,
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


def _random_task(task: ContinuousTask) -> RandomTask:
    """The task of `IrsNavRandom-v0` in the same scenes."""
    where: dict[str, Any] = {"split": task.split, "num_scenes": task.num_scenes}
    if task.scenes is not None:
        where = {"scenes": task.scenes}

    return RandomTask(**where, **task.shared(RandomTask, {"split", "num_scenes", "scenes"}))
