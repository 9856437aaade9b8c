"""`certified_bounds`: how short a continuous path can be that keeps the gain at or above the
target everywhere, between two lengths that are proved.
"""

from dataclasses import dataclass
from math import inf, isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from irs_gym.bounds.gain_bounds import GainBounds
from irs_gym.bounds.taut_path import TautPath, shortest_in
from irs_gym.grid import checked_cell_size, checked_point
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.shortest_path import highest_feasible_target
from irs_gym.radio.fading import checked_threshold
from irs_gym.radio.geometry import TOUCH
from irs_gym.radio.irs import ArrayModel, Quantiser
from irs_gym.radio.radio_map import LINK_BYTES, RadioModel, serve
from irs_gym.radio.scene import Scene
from irs_gym.units import Floats, db_to_linear, linear_to_db

SURE = (
    1  # states of cells: the whole cell meets the target, nothing of it does, or neither is known
)
UNDECIDED = 0
INFEASIBLE = -1

_FINEST = 1e-5  # metres: smallest edge of a cell
_MOST_CELLS = 10**8
_CELL_BYTES = 2000  # for each cell: a rectangle, joined with the others
_BAND = 2.0  # so many edges away from the shortest path that may be, cells are cut
_DEPTH = 4.5  # those a quarter as large as the largest at the same time
_OPEN = 1e-7  # metres by which what may be feasible is grown
_CLOSED = TOUCH / 8  # and what is feasible, twice: less than the model tells from a touch
_ROUNDING = 1e-9  # relative, of a length

States = NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class Bounds:
    """Proved bounds of the shortest continuous path, in metres.

    Attributes
    ----------
    lower
        No feasible path is shorter.
    upper
        Length of ``path``; inf where none was found.
    path
        float64, shape ``(D, 2)``, read-only: corners in metres, from start to goal, of a path that
        is feasible all along.
    cells
        float64, shape ``(n, 4)``, read-only: the rectangles that it was proved on, as ``(x_low,
        y_low, x_high, y_high)``; those in obstacles are left out.
    states
        int8, shape ``(n,)``, read-only: 1 where the whole cell meets the target, -1 where nothing
        of it does, 0 where neither was asked or told.

    Examples
    --------
    >>> bounds = Bounds(9.9, 10.0, np.zeros((2, 2)), np.zeros((1, 4)), np.ones(1, dtype=np.int8))
    >>> round(bounds.gap, 3)
    0.01
    """

    lower: float
    upper: float
    path: Floats
    cells: Floats
    states: States

    def __post_init__(self) -> None:
        freeze(self.path, self.cells, self.states)

    @property
    def gap(self) -> float:
        """(upper - lower) / upper: how much shorter than ``path`` a path could be, at most."""
        return 1.0 if self.upper == inf else (self.upper - self.lower) / self.upper


def certified_bounds(
    scene: Scene | str | Path = "paper",
    target_db: float | None = None,
    tolerance: float = 1e-3,
    *,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    irs_elements: int | None = None,
    phase_bits: int | None = None,
    quantiser: Quantiser = "nearest",
    array_model: ArrayModel = "far_field",
    cell_size: float = 0.5,
    most_cells: int = 50_000,
) -> Bounds:
    """Lower and upper bound of the shortest path of any shape along which the expected channel gain
    is at or above the target at every point: the paper's problem before it lays a grid.

    The floor is cut into cells. The gain is bounded over each as a whole (`irs_gym.bounds`), which
    proves it feasible, infeasible, or neither. No feasible path is shorter than the shortest one
    through cells that are not infeasible; the shortest one through those that are feasible is one.
    Cells that are undecided near the former are cut in four, until the two lengths agree.

    Obstacles are closed to the path, their sides are not. There is no way between two that touch.

    Parameters
    ----------
    scene
        A scene, its name in the package, or the path of a scene file.
    target_db
        The lowest expected gain; None: as the scene says.
    tolerance
        What (upper - lower) / upper is to be, at most; from 1e-6 to 1.
    start, goal
        Points (x, y) in metres; None: those of the scene.
    irs_elements, phase_bits, quantiser, array_model
        As in `irs_gym.build_radio_map`. Bounds over b-bit phases stay apart, so the tolerance need
        not be met: see `Bounds.gap`.
    cell_size
        Edge in metres of the largest cells.
    most_cells
        Cells that the floor is cut into, at most. Where the tolerance is not met then, or cells are
        as small as 0.01 mm, the bounds are what they are: see `Bounds.gap`.

    Raises
    ------
    FileNotFoundError
        Where there is no such scene.
    ValueError
        Where there is no such path: the message names the highest target at which one is known.
        Where start or goal lies in an obstacle, outside the room, or below the target; where an
        argument is out of its range, or has no bounds (``array_model="spherical"``, rooms that are
        polygons, walls that are counted).

    Examples
    --------
    >>> bounds = certified_bounds("paper", target_db=-64.0, tolerance=0.01)
    >>> bool(bounds.lower <= 20.4925 <= bounds.upper), bounds.gap <= 0.01
    (True, True)
    """
    model = RadioModel.of(scene, cell_size, irs_elements, phase_bits, quantiser, array_model)
    scene = model.built_scene
    target = scene.target_db if target_db is None else checked_threshold(target_db, "target_db")
    tolerance = _checked_tolerance(tolerance)
    cell_size = checked_cell_size(cell_size)
    most_cells = _checked_cells(most_cells)
    gains = GainBounds(scene, model.hardware)
    ends = np.array(
        [
            _checked_end(scene, scene.start if start is None else start, "start"),
            _checked_end(scene, scene.goal if goal is None else goal, "goal"),
        ]
    )
    if np.array_equal(*ends):
        raise ValueError(f"goal={tuple(ends[1].tolist())} must differ from start")
    _check_gain_at_ends(model, ends, target)

    search = _Search(scene, gains, float(db_to_linear(target)), ends)
    search.add(_first_cells(scene, cell_size).reshape(-1, 4))

    lower = float(np.hypot(*(ends[1] - ends[0]))) * (1 - _ROUNDING)
    best = TautPath(inf, np.zeros((0, 2)))
    while True:
        optimistic = search.shortest(UNDECIDED, best.length)
        if optimistic.length == best.length == inf:
            raise ValueError(_infeasible(gains, ends, target, cell_size))
        lower = max(lower, optimistic.length * (1 - _ROUNDING))

        sure = search.shortest(SURE, best.length)
        best = min(best, sure, key=lambda path: path.length)
        upper = best.length * (1 + _ROUNDING)
        lower = min(lower, upper)
        is_met = upper < inf and upper - lower <= tolerance * upper
        if is_met or not search.refine(optimistic, most_cells):
            break

    if upper == inf:
        unknown = f"{len(search.cells)} cells do not tell whether there is one"
        raise ValueError(f"{_infeasible(gains, ends, target, cell_size)}; {unknown}")

    return Bounds(lower, upper, best.points, search.cells, search.states)


class _Search:
    """The cells as far as they have been cut."""

    def __init__(self, scene: Scene, gains: GainBounds, target: float, ends: Floats) -> None:
        self.gains = gains
        self.target = target
        self.ends = ends
        self.cells = np.zeros((0, 4))
        self.states = np.zeros(0, dtype=np.int8)
        self.room = shapely.box(*scene.room.lower, *scene.room.upper)
        self.obstacles = np.array(scene.floor.footprints, dtype=object)
        self.tests = 1 + len(self.obstacles)
        self.slanted = [
            each for each in self.obstacles if not shapely.equals(each, shapely.envelope(each))
        ]
        self.tree = shapely.STRtree(shapely.buffer(self.obstacles, TOUCH / 2, join_style="mitre"))

    def add(self, cells: Floats) -> None:
        """Take in cells ``(n, 4)``, but for those in obstacles."""
        links = 1 + len(self.gains.scene.irs_panels)
        count = len(self.cells) + len(cells)
        check_memory(
            f"tolerance: {count} cells",
            count * _CELL_BYTES,
            len(cells) * links * self.tests * LINK_BYTES,
        )
        is_blocked = np.zeros(len(cells), dtype=bool)
        is_blocked[self.tree.query(shapely.box(*cells.T), predicate="within")[0]] = True
        cells = cells[~is_blocked]
        least, most = self.gains.over(cells)
        states = np.where(
            least >= self.target, SURE, np.where(most < self.target, INFEASIBLE, UNDECIDED)
        )
        self.cells = np.concatenate([self.cells, cells])
        self.states = np.concatenate([self.states, states.astype(np.int8)])

    def shortest(self, state: int, longest: float) -> TautPath:
        """The shortest path through cells of this state or a surer one, if it is not longer than
        a path that is known.
        """
        cells = self.cells[self.states >= state]
        # whatever comes by another cell is longer
        nearest = [
            np.hypot(*np.maximum(np.maximum(cells[:, :2] - end, end - cells[:, 2:]), 0.0).T)
            for end in self.ends
        ]
        cells = cells[nearest[0] + nearest[1] <= longest * (1 + _ROUNDING)]
        grown = _CLOSED if state == SURE else _OPEN
        area = shapely.union_all(shapely.box(*cells.T))
        for each in self.slanted:
            area = area.difference(shapely.buffer(each, -2 * grown, join_style="mitre"))

        return shortest_in(area, self.ends[0], self.ends[1], grown)

    def refine(self, path: TautPath, most_cells: int) -> bool:
        """Cut undecided cells near a path in four, of those the largest; whether that was done."""
        undecided = np.flatnonzero(self.states == UNDECIDED)
        sizes = (self.cells[undecided, 2:] - self.cells[undecided, :2]).max(axis=1)
        boxes = shapely.box(*self.cells[undecided].T)
        line = shapely.linestrings(path.points)
        apart = shapely.distance(boxes, line)
        is_near = (apart <= _BAND * sizes) & (sizes > _FINEST)
        if not is_near.any():
            return False

        is_near &= sizes > sizes[is_near].max() / _DEPTH
        chosen = undecided[is_near]
        if len(self.cells) + 3 * len(chosen) > most_cells:
            return False

        parents = self.cells[chosen]
        self.cells = np.delete(self.cells, chosen, axis=0)
        self.states = np.delete(self.states, chosen)
        self.add(_quarters(parents))

        return True


def _quarters(cells: Floats) -> Floats:
    """The four quarters of each rectangle ``(n, 4)``, shape ``(4 n, 4)``."""
    x0, y0, x1, y1 = cells.T
    x = (x0 + x1) / 2
    y = (y0 + y1) / 2
    quarters = [(x0, y0, x, y), (x, y0, x1, y), (x0, y, x, y1), (x, y, x1, y1)]
    return np.concatenate([np.stack(each, axis=1) for each in quarters])


def _first_cells(scene: Scene, cell_size: float) -> Floats:
    """Cells of that size at most, whose borders take in all sides of boxes; ``(X, Y, 4)``."""
    boxes = scene.floor.boxes
    lines = []
    for axis in (0, 1):
        ends = [scene.room.lower[axis], scene.room.upper[axis]]
        sides = np.unique(np.concatenate([ends, boxes.lower[:, axis], boxes.upper[:, axis]]))
        sides = sides[(sides >= ends[0]) & (sides <= ends[1])]
        sides = sides[np.append(np.diff(sides) > _OPEN, True)]
        pieces = np.ceil(np.diff(sides) / cell_size - 1e-9).astype(int)
        between = [
            np.linspace(low, high, count, endpoint=False)
            for low, high, count in zip(sides[:-1], sides[1:], pieces, strict=True)
        ]
        lines.append(np.concatenate([*between, sides[-1:]]))

    x, y = lines
    check_memory(f"cell_size={cell_size}: the cells", _CELL_BYTES * len(x) * len(y))
    low = np.stack(np.meshgrid(x[:-1], y[:-1], indexing="ij"), axis=-1)
    high = np.stack(np.meshgrid(x[1:], y[1:], indexing="ij"), axis=-1)

    return np.concatenate([low, high], axis=-1)


def _checked_tolerance(tolerance: Any) -> float:
    is_number = isinstance(tolerance, Real) and not isinstance(tolerance, bool | np.bool_)
    if not (is_number and 1e-6 <= tolerance <= 1):
        raise ValueError(f"tolerance={tolerance!r} must be a number from 1e-6 to 1")

    return float(tolerance)


def _checked_cells(most_cells: Any) -> int:
    is_number = isinstance(most_cells, Integral) and not isinstance(most_cells, bool)
    if not (is_number and 1 <= most_cells <= _MOST_CELLS):
        raise ValueError(
            f"most_cells={most_cells!r} must be a whole number from 1 to {_MOST_CELLS:,}"
        )

    return int(most_cells)


def _checked_end(scene: Scene, point: Any, name: str) -> tuple[float, float]:
    """A point of the free floor."""
    x, y = checked_point(point, name)
    if not scene.room.holds((x, y)):
        raise ValueError(
            f"{name}={(x, y)} lies outside the room {scene.room.lower} to {scene.room.upper}"
        )
    if scene.floor.is_covered(np.array([x, y])):
        raise ValueError(f"{name}={(x, y)} lies inside an obstacle")

    return x, y


def _check_gain_at_ends(model: RadioModel, ends: Floats, target_db: float) -> None:
    heights = np.full((2, 1), model.built_scene.antenna_height)
    positions = np.concatenate([ends, heights], axis=1)
    gains, _, _ = serve(model.built_scene, model.hardware, positions, needs_shifts=False)

    for name, end, gain_db in zip(("start", "goal"), ends, linear_to_db(gains), strict=True):
        if gain_db < target_db:
            raise ValueError(
                f"{name}={tuple(end.tolist())} has a gain of {gain_db:.3f} dB, "
                f"below target_db={target_db}"
            )


def _infeasible(gains: GainBounds, ends: Floats, target_db: float, cell_size: float) -> str:
    """What to say where no path is known, with the highest target at which one is."""
    cells = _first_cells(gains.scene, cell_size / 8)
    least, _ = gains.over(cells.reshape(-1, 4))
    gain_db = linear_to_db(least).reshape(cells.shape[:2])  # (X, Y)
    middles = (cells[..., :2] + cells[..., 2:]) / 2
    gain_db[gains.scene.floor.is_covered(middles)] = -inf

    start, goal = (_cell_of(cells, end) for end in ends)
    highest = highest_feasible_target(gain_db, start, goal)
    known = f"one is known up to {highest:.3f} dB" if isfinite(highest) else "none is known at any"

    return f"target_db={target_db}: no path from start to goal is known, and {known}"


def _cell_of(cells: Floats, point: Floats) -> tuple[int, int]:
    """The cell ``(i, j)`` of an array ``(X, Y, 4)`` that holds a point."""
    i = int(np.searchsorted(cells[:-1, 0, 2], point[0], side="right"))
    j = int(np.searchsorted(cells[0, :-1, 3], point[1], side="right"))
    return i, j
