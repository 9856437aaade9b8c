"""Primitives on a Pillow image: lines, shapes and type with soft edges.

Points are in px from the image's upper left corner.

Pillow is imported by the first stroke, so that importing this module costs nothing.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL import Image, ImageFont

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

BLACK = (26, 26, 30)
WHITE = (255, 255, 255)
SAMPLES = 3  # along each side of a pixel

# Shapes about (0, 0), in units of the type's height.
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
DISC = 0.42 * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=-1)
DIAMOND = 0.8 * np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])
SQUARE = 0.6 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
TRIANGLE = 0.8 * np.array([(0.0, -0.9), (0.9, 0.7), (-0.9, 0.7)])
BAR = np.array([(-1.6, -0.3), (1.6, -0.3), (1.6, 0.3), (-1.6, 0.3)])
# two bars across each other: an eighth of its corners, and the same turned three times
_ARM = [(0.3, 0.0), (1.0, 0.7), (0.7, 1.0)]
_TURNS = ((1, 0, 0, 1), (0, -1, 1, 0), (-1, 0, 0, -1), (0, 1, -1, 0))
CROSS = 0.6 * np.array([(a * x + b * y, c * x + d * y) for a, b, c, d in _TURNS for x, y in _ARM])
SWATCH = np.array([(-1.2, -0.5), (1.2, -0.5), (1.2, 0.5), (-1.2, 0.5)])


def fill(image: Image.Image, corners: Floats, colour: Colour) -> None:
    """Fill the polygon with these corners ``(n, 2)``."""
    _print(image, corners, colour, 0.0)


def stroke(image: Image.Image, points: Floats, colour: Colour, width: float) -> None:
    """Draw the polyline through ``points`` ``(n, 2)``, ``width`` px wide."""
    _print(image, points, colour, width)


def mark(image: Image.Image, shape: Floats, at: Floats, em: float, colour: Colour = WHITE) -> None:
    """Draw one of the shapes above at a point, with a dark rim, for type of height ``em``."""
    corners = at + shape * em
    fill(image, corners, colour)
    stroke(image, np.concatenate([corners, corners[:2]]), BLACK, max(1.0, 0.12 * em))


def dash(image: Image.Image, points: Floats, em: float) -> None:
    """Draw a polyline in white dashes with dark rims, which no background hides."""
    # way from the polyline's first point to each of its points, (n,)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])

    def piece(begin: float, end: float) -> Floats:
        # the two ends, and all corners between them
        stops = np.array([begin, *along[(along > begin) & (along < end)], end])
        return np.stack([np.interp(stops, along, axis) for axis in points.T], axis=-1)

    rim = 0.11 * em
    for begin in np.arange(0.0, along[-1] - 2 * rim, 1.5 * em):
        end = min(begin + 1.1 * em, along[-1])
        stroke(image, piece(begin, end), BLACK, 0.56 * em + 2 * rim)
        stroke(image, piece(begin + rim, end - rim), WHITE, 0.56 * em)


def paste(image: Image.Image, pixels: Floats, corner: tuple[int, int]) -> None:
    """Put pixels ``(H, W, 3)`` with their upper left one at ``corner``."""
    from PIL import Image as images

    image.paste(images.fromarray(np.rint(pixels).astype(np.uint8)), corner)


def write_upright(image: Image.Image, words: str, centre: tuple[float, float], em: int) -> None:
    """Write bottom to top about a centre."""
    from PIL import Image as images
    from PIL import ImageDraw

    line = images.new("L", (round(font(em).getlength(words)) + 2, 2 * em))
    ImageDraw.Draw(line).text((1, em), words, 255, font(em), anchor="lm")
    line = line.transpose(images.Transpose.ROTATE_90)
    image.paste(
        BLACK, (round(centre[0] - line.width / 2), round(centre[1] - line.height / 2)), line
    )


@lru_cache
def font(em: int) -> ImageFont.FreeTypeFont:
    """The typeface that comes with Pillow, ``em`` px high."""
    from PIL import ImageFont

    face = ImageFont.load_default(size=em)
    if not isinstance(face, ImageFont.FreeTypeFont):
        raise ImportError("rendering needs a Pillow built with FreeType, as its wheels on PyPI are")

    return face


def _print(image: Image.Image, points: Floats, colour: Colour, width: float) -> None:
    """Lay a polygon (``width`` 0) or a polyline on the image through a mask of finer samples."""
    from PIL import Image as images
    from PIL import ImageDraw

    # Only the pixels that the shape may touch: a mask SAMPLES times as fine, then averaged.
    corner = np.floor(points.min(axis=0) - width / 2 - 1).astype(int)
    columns, rows = np.ceil(points.max(axis=0) + width / 2 + 1).astype(int) - corner
    mask = images.new("L", (columns * SAMPLES, rows * SAMPLES))
    pen = ImageDraw.Draw(mask)
    # Pillow counts from the middle of a pixel, we from its corner: hence the half sample.
    places = ((points - corner) * SAMPLES - 0.5).ravel().tolist()
    if width:
        pen.line(places, 255, max(1, round(width * SAMPLES)), joint="curve")
    else:
        pen.polygon(places, 255)

    image.paste(colour, (int(corner[0]), int(corner[1])), mask.reduce(SAMPLES))
