"""`SolvedScene`: a scene with its radio map and the distances to its goal."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, octile_distance
from irs_gym.mdp.robot import PAPER_ROBOT, Robot
from irs_gym.memory import freeze
from irs_gym.oracle.shortest_path import distance_to_go, infeasible
from irs_gym.radio.radio_map import RadioMap, RadioModel, build_map_and_shifts
from irs_gym.radio.scene import Scene


@dataclass(frozen=True, eq=False)
class SolvedScene:
    """A scene whose goal can be reached from its start at its own target."""

    scene: Scene
    radio_map: RadioMap
    # (X, Y), metres over feasible cells; +inf where the goal cannot be reached
    distance_to_go: NDArray[np.float64]
    passable: NDArray[np.bool_] | None = None  # (X, Y, 8), the moves that the robot's body can make

    def __post_init__(self) -> None:
        freeze(self.distance_to_go, self.passable)

    @property
    def start(self) -> Cell:
        """Cell of the scene's start."""
        return self.radio_map.grid.cell_of(self.scene.start)

    @property
    def goal(self) -> Cell:
        """Cell of the scene's goal."""
        return self.radio_map.grid.cell_of(self.scene.goal)

    @property
    def oracle_distance(self) -> float:
        """Length in metres of the shortest feasible path."""
        return float(self.distance_to_go[self.start])

    @property
    def detour(self) -> float:
        """The oracle's distance over the octile distance: 1 where nothing is in the way."""
        straight = (
            octile_distance(np.subtract(self.goal, self.start)) * self.radio_map.grid.cell_size
        )
        return self.oracle_distance / float(straight)


def solve(scene: Scene, cell_size: float = 0.5, robot: Robot = PAPER_ROBOT) -> SolvedScene:
    """Map and distances to go of a scene, for the paper's robot or another.

    Raises
    ------
    ValueError
        Where the cells do not fit the room, the ends lie in one cell, or the target is infeasible;
        the message then gives the highest that is feasible.
    """
    radio_map, motion = robot.fit(radio_map_of(scene, cell_size), scene)
    start = radio_map.grid.cell_of(scene.start)
    goal = radio_map.grid.cell_of(scene.goal)
    if start == goal:
        raise ValueError(
            f"start={scene.start} lies in the same cell as the goal {scene.goal}: {start}"
        )

    to_go = distance_to_go(radio_map.feasible(scene.target_db), goal, cell_size, **motion)
    if not np.isfinite(to_go[start]):
        raise ValueError(infeasible(radio_map.gain_db, start, goal, scene.target_db, **motion))

    return SolvedScene(scene, radio_map, to_go, motion["passable"])


def radio_map_of(scene: Scene, cell_size: float) -> RadioMap:
    """The map of `irs_gym.build_radio_map`, whose obstacles are looked at when it is fitted to a
    robot.
    """
    model = RadioModel.of(scene, cell_size, None, None, "nearest", "far_field")
    return build_map_and_shifts(model, needs_shifts=False)[0]
