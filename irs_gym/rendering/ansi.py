"""`text_frame`: one frame of an episode in plain characters."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import Grid
from irs_gym.rendering.layout import rows_from_top
from irs_gym.rendering.view import Point, View, nearest_cells


def text_frame(
    view: View, path: ArrayLike, switches: ArrayLike = (), gain_db: float | None = None
) -> str:
    """The same as `draw_frame` in plain characters: one a cell within a border, under a line of
    numbers and over a legend.

    Raises
    ------
    ValueError
        Where ``path`` is not of shape ``(T, 2)``, T >= 1, or leaves the grid.
    """
    grid = view.grid
    cells = nearest_cells(grid, view.checked_path(path, "path"))
    oracle = nearest_cells(grid, _filled(np.reshape(view.oracle_cells, (-1, 2))))
    ends = [nearest_cells(grid, np.array([each])) for each in (view.start, view.goal)]

    # The border leaves "+" in the corners.
    marks = np.full(np.add(view.grid.shape, 2), "+")  # (X + 2, Y + 2)
    marks[1:-1, [0, -1]] = "-"
    marks[[0, -1], 1:-1] = "|"
    marks[1:-1, 1:-1] = np.where(view.is_obstacle, "#", np.where(view.is_below, "~", "."))

    # Later marks lie over earlier ones.
    oracle_switches = () if view.oracle_switches is None else view.oracle_switches
    for mark, where in (
        ("o", oracle.astype(np.int64) + 1),
        ("*", cells + 1),
        ("x", np.reshape(oracle_switches, (-1, 2)).astype(np.int64) + 1),
        ("X", np.reshape(switches, (-1, 2)).astype(np.int64) + 1),
        ("S", ends[0] + 1),
        ("G", ends[1] + 1),
        ("A", _bordered_cells(view.grid, view.access_points)),
        ("I", _bordered_cells(view.grid, view.irs_panels)),
        ("R", cells[-1:] + 1),
    ):
        marks[where[:, 0], where[:, 1]] = mark

    gain_db = view.gain_db[tuple(cells[-1])] if gain_db is None else gain_db
    margin_db = gain_db - view.target_db

    label = f"{view.label}   " if view.label else ""
    legend = [] if view.oracle_switches is None else ["X robot's switch   x oracle's switch"]

    return "\n".join(
        [
            f"{label}target {view.target_db:.2f} dB   gain {gain_db:.2f} dB   "
            f"margin {margin_db:+.2f} dB",
            *("".join(row) for row in rows_from_top(marks)),
            "R robot   * robot path   o oracle path   S start   G goal   A access point   "
            "I IRS panel",
            ". feasible   ~ below target   # obstacle",
            *legend,
        ]
    )


def _filled(path: NDArray[Any]) -> NDArray[Any]:
    """A path ``(k, 2)`` of fractions of cells with points between, a quarter of a cell apart; one
    of cells as it is.
    """
    if path.dtype.kind != "f" or len(path) < 2:
        return path

    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.arange(0.0, along[-1], 0.25)

    return np.stack([np.interp(at, along, axis) for axis in path.T], axis=-1)


def _bordered_cells(grid: Grid, points: tuple[Point, ...]) -> NDArray[np.int64]:
    """Cells ``(n, 2)`` of points in metres, counted from 1; 0 and X + 1 or Y + 1 where a point is
    on a wall.
    """
    inside = (np.reshape(points, (-1, 2)) - grid.origin) / grid.cell_size
    cells = np.where(inside <= 1e-9, 0.0, np.floor(inside + 1e-9) + 1.0)
    return np.clip(cells, 0, np.add(grid.shape, 1)).astype(np.int64)
