"""`draw_frame`: one frame of an episode as a picture."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.rendering import primitives
from irs_gym.rendering.background import ROBOT, background_of, trace
from irs_gym.rendering.view import View, nearest_cells


def draw_frame(
    view: View, path: ArrayLike, switches: ArrayLike = (), gain_db: float | None = None
) -> NDArray[np.uint8]:
    """One frame: the view's background, the robot with its path, and its margin over the target.

    Parameters
    ----------
    view
        What does not change within the episode; its background is drawn at the first frame.
    path
        Shape ``(T, 2)``, T >= 1: the cells visited so far. The robot is on the last one.
    switches
        Shape ``(n, 2)``: the cells where it has switched the panel.
    gain_db
        The gain where the robot is; by default, that of its cell.

    Returns
    -------
    A fresh uint8 array of shape ``(H, W, 3)``; the longer of H and W is ``view.size``.

    Raises
    ------
    ValueError
        Where ``path`` is not of that shape or leaves the grid.
    """
    from PIL import ImageDraw

    cells = view.checked_path(path, "path")
    background = background_of(view)
    layout = background.layout
    frame = background.image.copy()

    # the path, then the robot over it
    corners = layout.cell_pixels(_corners(cells))  # (n, 2)
    if len(corners) > 1:
        trace(frame, corners, layout.em)

    for cell in np.reshape(switches, (-1, 2)):
        primitives.mark(frame, primitives.CROSS, layout.cell_pixels(cell), layout.em, ROBOT)

    primitives.mark(frame, primitives.DISC, corners[-1], layout.em, ROBOT)

    here = tuple(nearest_cells(view.grid, cells[-1:])[0])
    margin_db = (view.gain_db[here] if gain_db is None else gain_db) - view.target_db
    margin = f"margin {margin_db:+.2f} dB"
    ImageDraw.Draw(frame).text(
        background.margin_at, margin, primitives.BLACK, primitives.font(layout.em), anchor="ls"
    )

    picture = np.array(frame)
    return _squared(picture, view.size) if view.is_square else picture


def _squared(picture: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """The picture in the middle of a white one of that size."""
    height, width, _ = picture.shape
    over = [((size - each) // 2, size - each - (size - each) // 2) for each in (height, width)]
    return np.pad(picture, [*over, (0, 0)], constant_values=255)


def _corners(cells: NDArray[Any]) -> NDArray[Any]:
    """The ends of a path ``(T, 2)`` and the cells where it changes direction, repeated cells left
    out.
    """
    cells = cells[np.append(np.diff(cells, axis=0).any(axis=1), True)]
    moves = np.diff(cells, axis=0)  # (T - 1, 2)
    is_corner = np.ones(len(cells), dtype=bool)
    is_corner[1:-1] = (moves[1:] != moves[:-1]).any(axis=1)

    return cells[is_corner]
