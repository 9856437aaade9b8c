"""How many configurations a task needs: `fewest_configurations`, and a codebook that covers it,
`cover_codebook`.
"""

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, Motion, as_cell
from irs_gym.mdp.robot import Collision, Robot
from irs_gym.memory import freeze
from irs_gym.oracle.joint import checked_target
from irs_gym.oracle.shortest_path import shortest_path
from irs_gym.oracle.switch_front import SwitchFront, switch_front
from irs_gym.radio.codebook import (
    Codebook,
    checked_size,
    codebook_gain_db,
    focused_codebook,
)
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import RadioModel, build_map_and_shifts
from irs_gym.radio.scene import Scene


@dataclass(frozen=True, eq=False)
class FewestConfigurations:
    """What a panel that switches seldom costs, against one that follows the robot.

    Attributes
    ----------
    target_db
        The lowest gain that the robot may have.
    following
        Metres of the shortest path where the phases follow the robot, cell by cell and at no cost:
        the paper's optimum.
    front
        Least metres over the number of switches, of all configurations focused on a free cell.
    cells
        int64, shape ``(K, 2)``: the cell that each of these configurations is focused on.

    Examples
    --------
    >>> table = fewest_configurations("paper", -61.8, cell_size=1.0)
    >>> round(table.following, 3), table.front.switches.tolist()
    (21.485, [0, 1, 2])
    """

    target_db: float
    following: float
    front: SwitchFront
    cells: NDArray[np.int64]

    def __post_init__(self) -> None:
        freeze(self.cells)


def fewest_configurations(
    scene: Scene | str | FilePath,
    target_db: float,
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
    start: Cell | None = None,
    goal: Cell | None = None,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    collision: Collision = "centre",
) -> FewestConfigurations:
    """The shortest path with 0, 1, 2 ... switches of the panel, exactly, with the best
    configurations of all free cells to choose from. The first configuration is free.

    The last point of the front has the metres of the paper's path where one configuration serves
    both ends of each of its moves. Where none does they may be more, as the panel switches in
    place; and with rounded phases less, as another cell's may suit a cell better than its own.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    target_db
        The lowest gain that the robot may have.
    cell_size, irs_elements, phase_bits, quantiser, array_model
        As for `irs_gym.build_radio_map`.
    start, goal
        Cells (i, j); None: those of the scene.
    corner_cutting, robot_radius, collision
        The robot that drives, see `irs_gym.Robot`; cells that it can be in are free.

    Raises
    ------
    ValueError
        Where no path meets the target, with any number of switches (the message names the highest
        target at which one does), or an argument is out of its range.

    Examples
    --------
    >>> table = fewest_configurations("paper", -61.0, cell_size=1.0)
    >>> table.front.distances.round(3).tolist(), len(table.cells)
    ([25.142], 320)
    """
    target_db = checked_target(target_db)
    robot = Robot(corner_cutting=corner_cutting, robot_radius=robot_radius, collision=collision)
    radio = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    radio_map, motion = robot.fit(build_map_and_shifts(radio, needs_shifts=False)[0], radio.scene)
    ends = ends_of(radio, robot, radio_map.free, start, goal)

    found = _focused(radio, target_db, *ends, radio_map.free, motion)
    path = shortest_path(radio_map.feasible(target_db), *ends, radio.grid.cell_size, **motion)
    # where the robot may switch, it may follow: what the front reaches, the map does
    following = np.inf if path is None else path.distance

    return FewestConfigurations(target_db, following, found.front, found.cells)


def cover_codebook(
    scene: Scene | str | FilePath,
    size: int,
    target_db: float,
    cell_size: float = 0.5,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
    start: Cell | None = None,
    goal: Cell | None = None,
    *,
    corner_cutting: bool = True,
    robot_radius: float = 0.0,
    collision: Collision = "centre",
) -> Codebook:
    """Codebook of ``size`` configurations, chosen among those focused on a free cell so that a best
    path survives.

    First come the configurations of the best path that `switch_front` finds, where that takes no
    more than ``size``: then the choice is exact, and no codebook of focused configurations has a
    shorter path. Otherwise those of the shortest path that takes no more. Then those of the other
    points of the front, as long as there is room: with all of them, no switch cost makes another
    choice better. The rest covers the feasible cells greedily: each configuration serves the most
    of the cells that are served least so far. That is all there is where even the fewest switches
    take more than ``size``. The codebook's ``design`` says which it was.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    size
        K, the number of configurations.
    target_db
        The lowest gain that the robot may have.
    cell_size, irs_elements, phase_bits, quantiser, array_model
        As for `irs_gym.build_radio_map`.
    start, goal
        Cells (i, j); None: those of the scene.
    corner_cutting, robot_radius, collision
        The robot that drives, see `irs_gym.Robot`; cells that it can be in are free.

    Raises
    ------
    ValueError
        As `fewest_configurations`; where ``size`` is not positive, or more than there are free
        cells.

    Examples
    --------
    >>> codebook = cover_codebook("paper", 4, -61.0, cell_size=1.0)
    >>> codebook.size, codebook.design
    (4, 'cover: exact, the best path of 25.142 m in 1 switches')
    """
    size = checked_size(size)
    target_db = checked_target(target_db)
    robot = Robot(corner_cutting=corner_cutting, robot_radius=robot_radius, collision=collision)
    radio = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    free, motion = robot.room_in(radio.free, radio.grid, radio.scene)
    ends = ends_of(radio, robot, free, start, goal)

    return cover_of(radio, size, target_db, *ends, free, motion)


def cover_of(
    radio: RadioModel,
    size: int,
    target_db: float,
    start: Cell,
    goal: Cell,
    free: NDArray[np.bool_],
    motion: Motion,
) -> Codebook:
    """The codebook of `cover_codebook` for a robot that can be in the free cells ``(X, Y)``, and
    for its moves.
    """
    found = _focused(radio, target_db, start, goal, free, motion)
    if size > len(found.cells):
        raise ValueError(f"size={size} is more than the {len(found.cells)} free cells")

    # configurations in the order of each path, the best path first
    chosen: list[int] = []
    design = "cover: greedy, as no path takes so few configurations"
    best = found.front.paths[-1]
    for path in reversed(found.front.paths):
        used = list(dict.fromkeys([*chosen, *path.configurations.tolist()]))
        if len(used) > size:
            continue

        if not chosen:
            how = "exact, the best" if path is best else "the shortest"
            design = f"cover: {how} path of {path.distance:.3f} m in {path.switches} switches"
        chosen = used

    covers = (found.gain_db >= target_db).reshape(len(found.gain_db), -1)
    chosen += _greedy_cover(covers, chosen, size - len(chosen))
    shifts = found.codebook.phase_shifts[chosen]

    return Codebook(shifts, found.codebook.radio_hash, design)


class _Candidates(NamedTuple):
    """All configurations that are focused on a free cell, and what they can do."""

    cells: NDArray[np.int64]  # (K, 2)
    codebook: Codebook
    gain_db: NDArray[np.float64]  # (K, X, Y), -inf where the robot cannot be
    front: SwitchFront


def _focused(
    radio: RadioModel,
    target_db: float,
    start: Cell,
    goal: Cell,
    free: NDArray[np.bool_],
    motion: Motion,
) -> _Candidates:
    hardware = (radio.phase_bits, radio.quantiser, radio.array_model)
    cell_size = radio.grid.cell_size
    cells = np.argwhere(free)
    codebook = focused_codebook(radio.scene, cells, cell_size, radio.irs_elements, *hardware)
    gain_db = codebook_gain_db(radio.built_scene, codebook, cell_size, None, radio.array_model)
    gain_db[:, ~free] = -np.inf
    front = switch_front(gain_db, target_db, start, goal, cell_size, **motion)

    return _Candidates(cells, codebook, gain_db, front)


def ends_of(
    radio: RadioModel,
    robot: Robot,
    free: NDArray[np.bool_],
    start: Cell | None,
    goal: Cell | None,
) -> tuple[Cell, Cell]:
    """Start and goal as given, else those of the scene; a ``ValueError`` where the robot cannot be
    there.
    """
    grid = radio.grid
    start = grid.cell_of(radio.scene.start) if start is None else as_cell(start, "start")
    goal = grid.cell_of(radio.scene.goal) if goal is None else as_cell(goal, "goal")
    robot.check_cell("start", start, free)
    robot.check_cell("goal", goal, free)

    return start, goal


def _greedy_cover(covers: NDArray[np.bool_], chosen: list[int], more: int) -> list[int]:
    """So many configurations beside those chosen, which cover the most of what is covered least.

    ``covers`` ``(K, X * Y)`` says which cells each serves.
    """
    times = np.count_nonzero(covers[chosen], axis=0)  # (X * Y,): how often each cell is covered
    is_left = np.ones(len(covers), dtype=bool)
    is_left[chosen] = False
    added: list[int] = []

    for _ in range(more):
        # the cells that are covered least, among those that some configuration left can cover
        within_reach = covers[is_left].any(axis=0)
        least = within_reach & (times == times[within_reach].min(initial=times.max(initial=0)))
        gained = np.where(is_left, np.count_nonzero(covers & least, axis=1), -1)
        best = int(np.argmax(gained))
        times = times + covers[best]
        is_left[best] = False
        added.append(best)

    return added
