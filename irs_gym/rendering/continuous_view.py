"""`continuous_picture`: the picture of an episode anywhere on the floor."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.continuous_ends import ContinuousEnds, oracle_points
from irs_gym.mdp.continuous_maps import ContinuousMaps
from irs_gym.rendering.background import background_of
from irs_gym.rendering.episode_view import RENDERERS, drawn_of
from irs_gym.rendering.view import View


def continuous_picture(
    mode: str, maps: ContinuousMaps, ends: ContinuousEnds, path: NDArray[np.float64]
) -> Any:
    """What a render mode makes of the points ``(T, 2)`` of an episode, in cells."""
    return RENDERERS[mode](_view_of(maps, ends), path - 0.5)


def point_at(
    maps: ContinuousMaps, ends: ContinuousEnds, pixel: tuple[float, float]
) -> NDArray[np.float64]:
    """The point (x, y) in metres that a pixel of the picture shows."""
    return background_of(_view_of(maps, ends)).layout.points(pixel)


@lru_cache(maxsize=32)
def _view_of(maps: ContinuousMaps, ends: ContinuousEnds) -> View:
    """What does not change within an episode; kept, so that it is drawn once.

    Cells are counted by their centres, half a cell from their corners.
    """
    world = maps.world(ends.scene)
    return View(
        gain_db=maps.gain_db[ends.scene],
        target_db=world.target_db,
        grid=maps.grid(ends.scene),
        start=(ends.start[0] - 0.5, ends.start[1] - 0.5),
        goal=(ends.goal[0] - 0.5, ends.goal[1] - 0.5),
        goal_radius=maps.radius,
        free=maps.free[ends.scene],
        oracle_cells=oracle_points(maps, ends) - 0.5,
        **drawn_of(world.scene),
    )
