"""`codebook_picture`: the picture of an episode whose robot also switches the panel."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.codebook_rules import CodebookMaps, Ends, switch_cells
from irs_gym.mdp.path_history import cells_of
from irs_gym.oracle.joint import JointPath
from irs_gym.rendering.episode_view import RENDERERS, drawn_of
from irs_gym.rendering.view import View


def codebook_picture(
    mode: str, maps: CodebookMaps, ends: Ends, oracle: JointPath, states: NDArray[np.int64]
) -> Any:
    """What a render mode makes of the states ``(T,)`` of an episode: the map of the last one's
    configuration, and where the robot and the oracle have switched.
    """
    view = _view_of(maps, ends, oracle, int(states[-1]) // maps.size)
    return RENDERERS[mode](view, cells_of(states, maps.shape), switch_cells(states, maps))


@lru_cache(maxsize=32)
def _view_of(maps: CodebookMaps, ends: Ends, oracle: JointPath, configuration: int) -> View:
    """What does not change while the panel holds a configuration; kept, so that it is drawn
    once.
    """
    scene = maps.scenes[ends.scene]
    return View(
        gain_db=maps.gain_db[ends.scene, configuration],
        target_db=float(maps.target_db[ends.scene]),
        grid=maps.grid(ends.scene),
        start=ends.start,
        goal=ends.goal,
        free=maps.free[ends.scene],
        oracle_cells=oracle.cells,
        oracle_switches=oracle.switch_cells,
        label=f"configuration {configuration} of {maps.configurations}",
        **drawn_of(scene),
    )
