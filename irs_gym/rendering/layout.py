"""`Layout`: where a picture's parts lie, and which way up.

+x runs right and +y runs up, in pictures and in text: `rows_from_top` turns maps, `Layout.pixels`
turns points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import Grid
from irs_gym.rendering import primitives
from irs_gym.rendering.primitives import Floats


def rows_from_top(cells: NDArray[Any]) -> NDArray[Any]:
    """A map ``(X, Y, ...)`` as rows ``(Y, X, ...)``: the largest y first, x to the right."""
    return np.swapaxes(cells, 0, 1)[::-1]


@dataclass(frozen=True)
class Layout:
    """Where things lie in a picture, in px from its upper left corner.

    Attributes
    ----------
    size
        Width and height of the picture.
    em
        Height of the type.
    left, top, map_size
        Upper left corner, width and height of the map.
    bar
        Upper left corner, width and height of the colour bar.
    legend
        Shape ``(n, 2)``: left ends of the legend's entries.
    """

    grid: Grid
    size: tuple[int, int]
    em: int
    left: int
    top: int
    map_size: tuple[int, int]
    bar: tuple[int, int, int, int]
    legend: Floats

    @classmethod
    def fit(cls, grid: Grid, size: int, labels: Sequence[str]) -> Layout:
        """The largest map in a picture whose longest side is ``size``; a deep room has its legend
        beside it.
        """
        # margins around the map, all in heights of the type
        em = max(9, round(size / 42))
        left = round(4.0 * em)
        top = round(2.4 * em)
        right = round(6.8 * em)
        foot = round(3.4 * em)

        # the legend: below the map in as many columns as fit, or in one column beside a deep one
        is_deep = grid.shape[1] > 1.6 * grid.shape[0]
        legend, legend_size = _legend(labels, em, 0.0 if is_deep else size)

        # the map: as large as the margins and the legend leave room for, its cells square
        taken = np.array([left + right, top + foot]) + legend_size * (is_deep, not is_deep)
        scale = float(np.min((size - taken) / grid.shape))
        map_size = max(1, int(scale * grid.shape[0])), max(1, int(scale * grid.shape[1]))
        # room for the colour bar and its label, however thin the map
        panel = np.maximum(map_size, 9 * em)

        # the picture: its longer side is as asked for, its other one even, for video
        whole = np.maximum(panel + taken, legend_size)
        width, height = (size if side == whole.max() else 2 * round(side / 2) for side in whole)

        # what lies around the map
        corner = (
            (width - legend_size[0], top)
            if is_deep
            else ((width - legend_size[0]) / 2, height - legend_size[1])
        )
        bar = left + int(panel[0]) + em, top, em, int(panel[1])
        map_top = top + (int(panel[1]) - map_size[1]) // 2

        return cls(grid, (width, height), em, left, map_top, map_size, bar, legend + corner)

    @property
    def right(self) -> int:
        """Right edge of the map."""
        return self.left + self.map_size[0]

    @property
    def bottom(self) -> int:
        """Bottom edge of the map."""
        return self.top + self.map_size[1]

    def pixels(self, points: ArrayLike) -> Floats:
        """Pixels ``(..., 2)`` of points in metres: +x runs right, +y up."""
        share = (np.asarray(points) - self.grid.origin) / np.subtract(
            self.grid.upper, self.grid.origin
        )
        return np.asarray((self.left, self.bottom) + share * self.map_size * (1, -1))

    def points(self, pixels: ArrayLike) -> Floats:
        """Points ``(..., 2)`` in metres of pixels: undoes `pixels`."""
        share = (np.asarray(pixels) - (self.left, self.bottom)) / (
            np.array(self.map_size) * (1, -1)
        )
        size = np.subtract(self.grid.upper, self.grid.origin)
        return np.asarray(self.grid.origin + share * size)

    def cell_pixels(self, cells: ArrayLike) -> Floats:
        """Pixels ``(..., 2)`` of the centres of cells."""
        return self.pixels(
            np.add(self.grid.origin, (np.asarray(cells) + 0.5) * self.grid.cell_size)
        )


def _legend(labels: Sequence[str], em: int, width: float) -> tuple[Floats, Floats]:
    """Left ends ``(n, 2)`` of the entries from the legend's corner, and its size; as many columns
    as fit.
    """
    lengths = [primitives.font(em).getlength(label) + 4.0 * em for label in labels]

    # column after column; from one row of all entries down to one column, the first that fits
    for columns in range(len(labels), 0, -1):
        deep = -(-len(labels) // columns)
        widths = [max(lengths[k : k + deep]) for k in range(0, len(labels), deep)]
        if sum(widths) <= width:
            break

    lefts = np.cumsum([0.0, *widths])
    places = [(lefts[k // deep], (k % deep + 0.5) * 1.8 * em) for k in range(len(labels))]

    return np.array(places), np.array([lefts[-1], (deep + 0.2) * 1.8 * em])


def round_steps(low: float, high: float, count: float) -> list[float]:
    """Round numbers from ``low`` to ``high``, about ``count`` of them: steps of 1, 2 or 5 times a
    power of ten.
    """
    least = (high - low) / max(1.0, count)
    power = 10.0 ** np.floor(np.log10(least))
    step = float(next(f * power for f in (1, 2, 5, 10) if f * power >= least * (1 - 1e-9)))

    return [
        k * step
        for k in range(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)
    ]
