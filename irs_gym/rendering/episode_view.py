"""`view_of`: the `View` of an episode; `RENDERERS`: what each render mode makes of it."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from irs_gym.grid import Cell, Grid
from irs_gym.mdp.dynamics import oracle_path
from irs_gym.mdp.task import World
from irs_gym.radio.scene import Scene
from irs_gym.rendering import View, draw_frame, text_frame

MOST_OUTLINED = 10_000  # cells of a raster: the outline of a larger one would be a thicket

RENDERERS: dict[str, Callable[..., Any]] = {
    "rgb_array": draw_frame,
    "ansi": text_frame,
}


@lru_cache(maxsize=32)
def view_of(world: World, start: Cell, goal: Cell, budget: float | None = None) -> View:
    """What a picture shows besides the robot's path; kept, so that it is drawn once."""
    radio_map = world.radio_map
    grid = room_grid(world.scene, radio_map.grid)
    return View(
        gain_db=radio_map.gain_db[: grid.shape[0], : grid.shape[1]],
        target_db=world.target_db,
        grid=grid,
        start=start,
        goal=goal,
        free=radio_map.free[: grid.shape[0], : grid.shape[1]],
        oracle_cells=oracle_path(world, start, goal, budget).cells,
        is_square=world.to_go is not None,  # one of many, of rooms of any size
        **drawn_of(world.scene),
    )


def room_grid(scene: Scene | None, frame: Grid) -> Grid:
    """The cells of a scene's own room, of a frame that may hold larger ones too."""
    if scene is None:
        return frame

    own = scene.grid(frame.cell_size)
    is_inside = own.origin == frame.origin and bool(np.less_equal(own.shape, frame.shape).all())

    return own if is_inside else frame


def drawn_of(scene: Scene | None) -> dict[str, Any]:
    """What a `View` shows of a scene: access points, panels and outlines; nothing of none."""
    return {
        "access_points": tuple(each.position[:2] for each in scene.access_points) if scene else (),
        "irs_panels": tuple(each.position[:2] for each in scene.irs_panels) if scene else (),
        "outlines": scene.floor.outlines(MOST_OUTLINED)
        if scene and scene.format_version > 1
        else (),
        "panel_angles": tuple(
            None if isinstance(each.wall, str) else each.wall
            for each in (scene.irs_panels if scene else ())
        ),
    }
