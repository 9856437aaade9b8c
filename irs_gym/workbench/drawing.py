"""`Drawing`: all that the workbench shows of a scene, computed in one pass."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.oracle.shortest_path import Path, shortest_path
from irs_gym.oracle.trade_off import TradeOff, trade_off
from irs_gym.radio.radio_map import RadioMap, RadioModel, build_map_and_shifts
from irs_gym.radio.scene import Scene
from irs_gym.radio.solids import centres_of, overlooked, solids_of

CELL_SIZE = 0.5  # metres, that of the environments by default
MOST_CELLS = 40_000  # of a map that is drawn anew at each move of the hand

# What no radio map depends on; of these, the trade-off depends on the ends.
_ENDS = ("start", "goal")
_OTHERS = ("name", "target_db", "format_version")


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """What is drawn of a scene.

    Attributes
    ----------
    scene
        The scene, without its panels where the IRS is off.
    radio_map
        Gains ``(X, Y)`` in dB, at `CELL_SIZE`.
    trade_off
        Shortest distance over the target.
    missed
        What to say of obstacles that hold the centre of no cell; empty where there are none.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> drawing = draw(load_scene("paper"))
    >>> round(drawing.path.distance, 3), round(drawing.highest_target_db, 3)
    (23.228, -59.511)
    """

    scene: Scene
    radio_map: RadioMap
    trade_off: TradeOff
    missed: str

    @property
    def start(self) -> Cell:
        """Cell of the scene's start."""
        return self.radio_map.grid.cell_of(self.scene.start)

    @property
    def goal(self) -> Cell:
        """Cell of the scene's goal."""
        return self.radio_map.grid.cell_of(self.scene.goal)

    @cached_property
    def feasible(self) -> NDArray[np.bool_]:
        """Cells at or above the scene's target, shape ``(X, Y)``."""
        return self.radio_map.feasible(self.scene.target_db)

    @cached_property
    def path(self) -> Path | None:
        """The shortest path over feasible cells; None where there is none."""
        return shortest_path(self.feasible, self.start, self.goal, CELL_SIZE)

    @property
    def highest_target_db(self) -> float:
        """The highest target at which start and goal are connected; -inf where they never are."""
        return float(self.trade_off.targets_db[-1]) if len(self.trade_off.targets_db) else -np.inf


def draw(scene: Scene, before: Drawing | None = None) -> Drawing:
    """What is drawn of a scene; of what was drawn before, all is kept that is still true.

    Raises
    ------
    ValueError
        Where half-metre cells do not tile its room, it has more of them than `MOST_CELLS`, or the
        map cannot be computed.
    """
    grid = scene.grid(CELL_SIZE)
    if grid.shape[0] * grid.shape[1] > MOST_CELLS:
        raise ValueError(
            f"room: {grid.shape[0]} x {grid.shape[1]} cells of {CELL_SIZE} m are more than the "
            f"{MOST_CELLS} that the workbench draws"
        )

    has_same_map = before is not None and _same(scene, before.scene, but=(*_ENDS, *_OTHERS))
    if before is not None and has_same_map and _same(scene, before.scene, but=_OTHERS):
        return replace(before, scene=scene)

    if before is not None and has_same_map:
        radio_map = before.radio_map
        missed = before.missed
    else:
        model = RadioModel.of(scene, CELL_SIZE, None, None, "nearest", "far_field")
        radio_map, _ = build_map_and_shifts(model, needs_shifts=False)
        _, blocking = solids_of(scene).met_by(centres_of(grid), 0.0)
        missed = overlooked(scene, blocking)

    start = grid.cell_of(scene.start)
    goal = grid.cell_of(scene.goal)
    steps = trade_off(radio_map.gain_db, start, goal, CELL_SIZE)

    return Drawing(scene=scene, radio_map=radio_map, trade_off=steps, missed=missed)


def _same(one: Scene, other: Scene, but: tuple[str, ...]) -> bool:
    """Whether two scenes differ in no other field."""
    names: Any = set(Scene.model_fields) - set(but)
    return all(getattr(one, name) == getattr(other, name) for name in names)
