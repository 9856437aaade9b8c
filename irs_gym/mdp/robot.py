"""`Robot`: how wide a robot is, and what its body leaves it of a map."""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args
from warnings import warn

import numpy as np
import shapely
from numpy.typing import NDArray

from irs_gym.grid import MOVES, Cell, Grid, Motion, checked_radius, neighbours
from irs_gym.memory import freeze
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene
from irs_gym.radio.solids import Solids, centres_of, overlooked, solids_of, solids_of_cells

Collision = Literal["centre", "body"]

_POINT_BYTES = 300  # for each cell of a map whose centres are tested


class Fit(NamedTuple):
    """What a map leaves a robot.

    Attributes
    ----------
    radio_map
        With ``free`` where the robot can be.
    motion
        Arguments of `irs_gym.shortest_path` and all others that ask which moves are allowed.
    """

    radio_map: RadioMap
    motion: Motion


@dataclass(frozen=True, kw_only=True)
class Robot:
    """How wide a robot is, and how it moves. Raises ``ValueError`` where a value is out of its
    range.

    Attributes
    ----------
    corner_cutting
        Whether a diagonal move asks for its destination alone, as in the paper. Otherwise it needs
        both cells beside it.
    robot_radius
        Metres: cells whose centre is nearer than that to an obstacle or a wall cannot be entered.
    collision
        ``"centre"``, the paper's rule: obstacles count where they hold the centre of a cell, or are
        too near to it. ``"body"``: a move is refused as well where the robot's disc, swept along
        it, meets an obstacle.

    Examples
    --------
    >>> import irs_gym
    >>> scene = irs_gym.load_scene("paper")
    >>> robot = Robot(corner_cutting=False, robot_radius=0.3, collision="body")
    >>> radio_map, motion = robot.fit(irs_gym.build_radio_map(scene), scene)
    >>> path = irs_gym.shortest_path(
    ...     radio_map.feasible(-61.8), (0, 20), (39, 20), cell_size=0.5, **motion
    ... )
    """

    corner_cutting: bool = True
    robot_radius: float = 0.0
    collision: Collision = "centre"

    def __post_init__(self) -> None:
        if not isinstance(self.corner_cutting, bool | np.bool_):
            raise ValueError(f"corner_cutting={self.corner_cutting!r} must be True or False")
        object.__setattr__(self, "corner_cutting", bool(self.corner_cutting))
        object.__setattr__(self, "robot_radius", checked_radius(self.robot_radius))

        if not isinstance(self.collision, str) or self.collision not in get_args(Collision):
            raise ValueError(f"collision={self.collision!r} must be one of {get_args(Collision)}")

    @property
    def is_point(self) -> bool:
        """Whether obstacles count at the centres of cells alone, as in the paper."""
        return self.robot_radius == 0 and self.collision == "centre"

    def fit(self, radio_map: RadioMap, scene: Scene | None = None) -> Fit:
        """The map with the cells that the robot can be in, and the moves that it can make there.

        Parameters
        ----------
        radio_map
            Of the scene, by the paper's rule.
        scene
            Whose obstacles and walls are asked, whatever the cells. None: all squares of cells that
            are not free, and the edge of the map.

        Warns
        -----
        UserWarning
            Where an obstacle of the scene blocks no cell, nor any move where these are tested: the
            robot would drive through it. It is named.
        """
        free, motion = self.room_in(radio_map.free, radio_map.grid, scene)
        return Fit(replace(radio_map, free=free) if self.robot_radius else radio_map, motion)

    def room_in(
        self, free: NDArray[np.bool_], grid: Grid, scene: Scene | None = None
    ) -> tuple[NDArray[np.bool_], Motion]:
        """What `fit` leaves the robot of the free cells ``(X, Y)`` of a scene, whatever the gains,
        and its moves.
        """
        if self.is_point and scene is None:
            return free, {"corner_cutting": self.corner_cutting, "passable": None}

        grid.check_memory(_POINT_BYTES, "the robot on a map")
        solids = solids_of_cells(free, grid) if scene is None else solids_of(scene)

        # cells, whose centres may be nowhere near an obstacle
        is_near, owners = solids.met_by(centres_of(grid), self.robot_radius)
        if self.robot_radius:
            free = free & ~is_near.reshape(grid.shape)

        # moves between them
        passable = None
        if self.collision == "body":
            passable, by_move = _passable(solids, grid, free, self.robot_radius)
            owners = np.union1d(owners, by_move)

        missed = "" if scene is None else overlooked(scene, owners)
        if missed:
            warn(f"{missed}: with collision={self.collision!r}, robots drive through", stacklevel=3)

        return free, {"corner_cutting": self.corner_cutting, "passable": passable}

    def check_cell(self, name: str, cell: Cell, free: NDArray[np.bool_]) -> None:
        """Refuse a cell off the map ``(X, Y)`` or where it cannot be; the ``ValueError`` names
        it.
        """
        if not (0 <= cell[0] < free.shape[0] and 0 <= cell[1] < free.shape[1]):
            raise ValueError(f"{name}={cell} lies off the map of {free.shape} cells")
        if not free[cell]:
            radius = self.robot_radius
            near = f", or nearer than robot_radius={radius} m to one or a wall" if radius else ""
            raise ValueError(f"{name}={cell} lies in an obstacle{near}")


PAPER_ROBOT = Robot()
"""A point that cuts corners and asks for the centres of cells alone."""


def _passable(
    solids: Solids, grid: Grid, free: NDArray[np.bool_], robot_radius: float
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Moves between free cells on which the robot's disc meets nothing, ``(X, Y, 8)``, and the
    numbers of the obstacles that it meets on the others.

    A disc that is swept along a line meets what is nearer to the line than its radius.
    """
    passable = np.ones((*grid.shape, len(MOVES)), dtype=bool)
    centres = grid.centres()
    owners: list[NDArray[np.int64]] = []

    # half of the moves: those back are as free
    for move in range(len(MOVES) // 2):
        is_open = free & neighbours(free, False)[..., move]
        first = np.argwhere(is_open)  # (m, 2)
        second = first + MOVES[move]
        ends = np.stack([centres[first[:, 0], first[:, 1]], centres[second[:, 0], second[:, 1]]], 1)
        is_met, its = solids.met_by(np.asarray(shapely.linestrings(ends)), robot_radius)

        passable[first[is_met, 0], first[is_met, 1], move] = False
        passable[second[is_met, 0], second[is_met, 1], move + 4] = False
        owners.append(its)

    freeze(passable)

    return passable, np.unique(np.concatenate(owners))
