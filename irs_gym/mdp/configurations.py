"""How many configurations a task needs: `fewest_configurations`, and a codebook that covers it,
`cover_codebook`.
"""

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, as_cell
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
from irs_gym.radio.radio_map import RadioMap, as_scene, build_radio_map
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
    radio = (cell_size, irs_elements, phase_bits, quantiser, array_model)
    candidates = _focused(as_scene(scene), checked_target(target_db), radio, start, goal)
    feasible = candidates.radio_map.feasible(target_db)
    path = shortest_path(feasible, candidates.start, candidates.goal, cell_size)
    # where the robot may switch, it may follow: what the front reaches, the map does
    following = np.inf if path is None else path.distance

    return FewestConfigurations(float(target_db), following, candidates.front, candidates.cells)


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
    radio = (cell_size, irs_elements, phase_bits, quantiser, array_model)
    built = as_scene(scene)
    candidates = _focused(built, target_db, radio, start, goal)
    if size > len(candidates.cells):
        raise ValueError(f"size={size} is more than the {len(candidates.cells)} free cells")

    # configurations in the order of each path, the best path first
    chosen: list[int] = []
    design = "cover: greedy, as no path takes so few configurations"
    best = candidates.front.paths[-1]
    for path in reversed(candidates.front.paths):
        used = list(dict.fromkeys([*chosen, *path.configurations.tolist()]))
        if len(used) > size:
            continue

        if not chosen:
            how = "exact, the best" if path is best else "the shortest"
            design = f"cover: {how} path of {path.distance:.3f} m in {path.switches} switches"
        chosen = used

    covers = (candidates.gain_db >= target_db).reshape(len(candidates.gain_db), -1)
    chosen += _greedy_cover(covers, chosen, size - len(chosen))
    shifts = candidates.codebook.phase_shifts[chosen]

    return Codebook(shifts, candidates.codebook.radio_hash, design)


class _Candidates(NamedTuple):
    """All configurations that are focused on a free cell, and what they can do."""

    cells: NDArray[np.int64]  # (K, 2)
    codebook: Codebook
    gain_db: NDArray[np.float64]  # (K, X, Y)
    radio_map: RadioMap
    start: Cell
    goal: Cell
    front: SwitchFront


def _focused(
    scene: Scene,
    target_db: float,
    radio: tuple[float, int | None, int | None, Quantiser, ArrayModel],
    start: Cell | None,
    goal: Cell | None,
) -> _Candidates:
    cell_size, irs_elements, _, _, array_model = radio
    grid = scene.grid(cell_size)
    start = grid.cell_of(scene.start) if start is None else as_cell(start, "start")
    goal = grid.cell_of(scene.goal) if goal is None else as_cell(goal, "goal")

    radio_map = build_radio_map(scene, *radio)
    cells = np.argwhere(radio_map.free)
    codebook = focused_codebook(scene, cells, *radio)
    gain_db = codebook_gain_db(scene, codebook, cell_size, irs_elements, array_model)
    front = switch_front(gain_db, target_db, start, goal, cell_size)

    return _Candidates(cells, codebook, gain_db, radio_map, start, goal, front)


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
