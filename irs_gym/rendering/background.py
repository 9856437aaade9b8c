"""`background_of`: all that the frames of an episode share, drawn once for each `View`."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.rendering import primitives
from irs_gym.rendering.layout import Layout, round_steps, rows_from_top
from irs_gym.rendering.primitives import Floats
from irs_gym.rendering.view import View

if TYPE_CHECKING:
    from PIL import Image

# Perceptually uniform and rising in lightness, so that it reads in grey too: nine anchors of
# viridis. Its darkest ninth is left out, so that obstacles are darker than any gain.
COLOUR_MAP = np.array(
    [
        (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142), (31, 158, 137),
        (53, 183, 121), (110, 206, 88), (181, 222, 43), (253, 231, 37),
    ],
    dtype=np.float64,
)  # fmt: skip
OBSTACLE = (20, 20, 24)
OUTLINE = (190, 190, 196)
ROBOT = (255, 140, 0)


class Background:
    """The map with all that stays, its `Layout`, and where the margin is written.

    Attributes
    ----------
    image
        Pillow's image, never drawn on again.
    layout
        Where things lie in it.
    margin_at
        Left end of the margin's baseline, in px.
    """

    def __init__(self, view: View) -> None:
        from PIL import Image, ImageDraw

        # The legend decides how much room is left for the map, so it comes first.
        entries = _entries(view)
        self.layout = layout = Layout.fit(view.grid, view.size, [label for label, _ in entries])
        self.image = image = Image.new("RGB", layout.size, primitives.WHITE)
        pen = ImageDraw.Draw(image)
        em = layout.em
        font = primitives.font(layout.em)

        # from the back to the front: what is drawn later lies over what was drawn before
        _paint_map(image, view, layout)
        for outline in view.outlines:
            primitives.stroke(image, layout.pixels(outline), OUTLINE, max(1.0, 0.12 * em))
        _paint_axes(image, layout)
        _paint_colour_bar(image, view, layout)
        _paint_stations(image, view, layout)
        if len(view.oracle_cells) > 1:
            primitives.dash(image, layout.cell_pixels(view.oracle_cells), em)

        for cell in () if view.oracle_switches is None else view.oracle_switches:
            primitives.mark(image, primitives.CROSS, layout.cell_pixels(cell), em)

        if view.goal_radius:
            turn = np.linspace(0.0, 2 * np.pi, 65)
            around = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * view.goal_radius
            rim = layout.cell_pixels(np.asarray(view.goal) + around)
            primitives.stroke(image, rim, primitives.BLACK, 0.3 * em)
            primitives.stroke(image, rim, primitives.WHITE, 0.14 * em)

        primitives.mark(image, primitives.DIAMOND, layout.cell_pixels(view.start), em)
        primitives.mark(image, primitives.SQUARE, layout.cell_pixels(view.goal), em)

        for (label, sample), (x, y) in zip(entries, layout.legend, strict=True):
            sample(image, np.array([x + 1.4 * em, y]), em)
            pen.text((x + 3.0 * em, y), label, primitives.BLACK, font, anchor="lm")

        label = f"{view.label}   " if view.label else ""
        title = f"{label}target {view.target_db:.2f} dB"
        pen.text((layout.left, 1.5 * em), title, primitives.BLACK, font, anchor="ls")
        self.margin_at = (layout.left + font.getlength(title) + 1.5 * em, 1.5 * em)


# As many as `irs_gym.rendering.episode_view.view_of` keeps views: each has its background at hand.
@lru_cache(maxsize=32)
def background_of(view: View) -> Background:
    """The background of a view, drawn when it is first asked for; views are equal to themselves
    alone.
    """
    return Background(view)


Sample = Callable[["Image.Image", Floats, int], None]


def _entries(view: View) -> list[tuple[str, Sample]]:
    """The legend: a label, and how to draw its sample about a point, for all that the picture
    holds.
    """
    ends = np.array([(-1.2, 0.0), (1.2, 0.0)])

    def obstacle(image: Image.Image, at: Floats, em: int) -> None:
        primitives.fill(image, at + primitives.SWATCH * em, OBSTACLE)

    def below(image: Image.Image, at: Floats, em: int) -> None:
        width = round(2.4 * em)
        height = em
        pixels = _hatched(np.full((height, width, 3), COLOUR_MAP[3]), np.ones((height, width)), em)
        primitives.paste(image, pixels, (round(at[0] - width / 2), round(at[1] - height / 2)))

    entries: list[tuple[bool, str, Sample]] = [
        (True, "start", lambda image, at, em: primitives.mark(image, primitives.DIAMOND, at, em)),
        (True, "goal", lambda image, at, em: primitives.mark(image, primitives.SQUARE, at, em)),
        (
            True,
            "robot",
            lambda image, at, em: primitives.mark(image, primitives.DISC, at, em, ROBOT),
        ),
        (True, "robot path", lambda image, at, em: trace(image, at + ends * em, em)),
        (
            len(view.oracle_cells) > 1,
            "oracle path",
            lambda image, at, em: primitives.dash(image, at + ends * em, em),
        ),
        (
            view.oracle_switches is not None,
            "robot's switch",
            lambda image, at, em: primitives.mark(image, primitives.CROSS, at, em, ROBOT),
        ),
        (
            view.oracle_switches is not None,
            "oracle's switch",
            lambda image, at, em: primitives.mark(image, primitives.CROSS, at, em),
        ),
        (bool(view.is_obstacle.any()), "obstacle", obstacle),
        (bool(view.is_below.any()), "below target", below),
    ]

    return [(label, sample) for is_shown, label, sample in entries if is_shown]


def trace(image: Image.Image, points: Floats, em: int) -> None:
    """Draw the robot's path through ``points`` ``(T, 2)``, narrow enough to show the oracle's
    dashes under it.
    """
    primitives.stroke(image, points, primitives.BLACK, 0.40 * em)
    primitives.stroke(image, points, ROBOT, 0.24 * em)


def _paint_map(image: Image.Image, view: View, layout: Layout) -> None:
    """The gain in colour, pale and hatched below the target, and the obstacles."""
    from PIL import Image as images

    # no colour is read off the -inf of an obstacle, which has its own
    gain_db = np.where(view.is_obstacle, 0.0, view.gain_db)  # (X, Y)
    colours = np.where(view.is_obstacle[..., None], OBSTACLE, _colours(view, gain_db))

    def enlarged(cells: NDArray[Any]) -> Floats:
        # BOX averages over a pixel, so the edges of cells are soft where pixels straddle them
        rows = images.fromarray(np.ascontiguousarray(rows_from_top(cells), dtype=np.uint8))
        return np.asarray(rows.resize(layout.map_size, images.Resampling.BOX), dtype=np.float64)

    pixels = _hatched(enlarged(colours), enlarged(view.is_below * 255) / 255, layout.em)
    primitives.paste(image, pixels, (layout.left, layout.top))


def _colours(view: View, gain_db: Floats) -> Floats:
    """Colours ``(..., 3)`` of gains in dB, from the map's least to its greatest."""
    anchors = np.linspace(*_gain_range(view), len(COLOUR_MAP))
    return np.stack([np.interp(gain_db, anchors, channel) for channel in COLOUR_MAP.T], axis=-1)


def _gain_range(view: View) -> tuple[float, float]:
    """Least and greatest gain of the map in dB, at least 1 dB apart."""
    gains = view.gain_db[np.isfinite(view.gain_db)]
    low = float(gains.min())
    high = float(gains.max())
    widening = max(0.0, 1.0 - (high - low)) / 2

    return low - widening, high + widening


def _hatched(pixels: Floats, share: Floats, em: int) -> Floats:
    """Pixels ``(H, W, 3)`` made pale and hatched by the share ``(H, W)`` of each that lies below
    the target.
    """
    rows, columns = np.indices(share.shape)
    period = max(5, round(0.6 * em))
    # diagonals: rows + columns is the same all along one; 1 on a line, 0 between, soft at its rim
    line = np.clip(1.0 + em / 24 - np.abs((rows + columns) % period - period // 2), 0.0, 1.0)
    pale = pixels + (0.6 * share)[..., None] * (np.array(primitives.WHITE) - pixels)

    # 60 % of the way to white, and the lines 40 % of the way from there to black
    return np.asarray(pale + (0.4 * line * share)[..., None] * (np.array(primitives.BLACK) - pale))


def _paint_axes(image: Image.Image, layout: Layout) -> None:
    """The map's frame, ticks and labels in metres."""
    from PIL import ImageDraw

    pen = ImageDraw.Draw(image)
    em = layout.em
    font = primitives.font(layout.em)
    lower = layout.grid.origin
    upper = layout.grid.upper
    pen.rectangle(
        (layout.left - 1, layout.top - 1, layout.right, layout.bottom), outline=primitives.BLACK
    )

    for value in round_steps(lower[0], upper[0], layout.map_size[0] / (4 * em)):
        x = layout.pixels((value, lower[1]))[0]
        pen.line((x, layout.bottom, x, layout.bottom + 0.3 * em), primitives.BLACK)
        pen.text((x, layout.bottom + 0.45 * em), f"{value:g}", primitives.BLACK, font, anchor="ma")

    for value in round_steps(lower[1], upper[1], layout.map_size[1] / (3 * em)):
        y = layout.pixels((lower[0], value))[1]
        pen.line((layout.left - 0.3 * em, y, layout.left, y), primitives.BLACK)
        pen.text((layout.left - 0.5 * em, y), f"{value:g}", primitives.BLACK, font, anchor="rm")

    pen.text(
        ((layout.left + layout.right) / 2, layout.bottom + 1.7 * em),
        "x (m)",
        primitives.BLACK,
        font,
        anchor="ma",
    )
    primitives.write_upright(image, "y (m)", (0.8 * em, (layout.top + layout.bottom) / 2), em)


def _paint_colour_bar(image: Image.Image, view: View, layout: Layout) -> None:
    """The colour bar, hatched as the map is, with ticks in dB and the target's arrow."""
    from PIL import ImageDraw

    pen = ImageDraw.Draw(image)
    em = layout.em
    left, top, width, height = layout.bar
    low, high = _gain_range(view)
    gain_db = np.repeat(np.linspace(high, low, height, dtype=np.float64)[:, None], width, axis=1)
    primitives.paste(
        image,
        _hatched(_colours(view, gain_db), (gain_db < view.target_db).astype(np.float64), em),
        (left, top),
    )
    pen.rectangle((left - 1, top - 1, left + width, top + height), outline=primitives.BLACK)

    def level(value: float) -> float:
        return top + (high - value) / (high - low) * height

    for value in round_steps(low, high, height / (3 * em)):
        pen.line(
            (left + width, level(value), left + width + 0.3 * em, level(value)), primitives.BLACK
        )
        pen.text(
            (left + width + 0.5 * em, level(value)),
            f"{value:g}",
            primitives.BLACK,
            primitives.font(em),
            anchor="lm",
        )

    # the target: an arrow from the left, and a line across the bar
    if low <= view.target_db <= high:
        tip = np.array((left - 1.0, level(view.target_db)))
        primitives.fill(
            image, tip + np.array([(0.0, 0.0), (-0.7, -0.4), (-0.7, 0.4)]) * em, primitives.BLACK
        )
        primitives.stroke(
            image, tip + np.array([(0.0, 0.0), (width + 1.0, 0.0)]), primitives.BLACK, 0.14 * em
        )

    primitives.write_upright(
        image, "channel gain (dB)", (left + width + 3.9 * em, top + height / 2), em
    )


def _paint_stations(image: Image.Image, view: View, layout: Layout) -> None:
    """Access points as triangles and panels as bars on their wall, with their names beside them."""
    lower = np.array(layout.grid.origin)
    upper = np.array(layout.grid.upper)
    kinds = (
        ("AP", primitives.TRIANGLE, view.access_points),
        ("IRS", primitives.BAR, view.irs_panels),
    )

    angles = view.panel_angles or (None,) * len(view.irs_panels)

    for name, shape, points in kinds:
        for number, point in enumerate(np.clip(np.reshape(points, (-1, 2)), lower, upper), start=1):
            to_walls = np.concatenate([point - lower, upper - point])  # left, bottom, right, top
            angle = angles[number - 1] if shape is primitives.BAR else None
            # a panel's bar lies along the wall that is nearest: left and right ones run along y
            is_along_y = shape is primitives.BAR and int(np.argmin(to_walls)) % 2 == 0
            corners = shape[:, ::-1] if is_along_y else shape
            if angle is not None:
                corners = _turned(shape, angle)
            at = layout.pixels(point)
            primitives.mark(image, corners, at, layout.em)
            reach = (float(corners[:, 0].max()) + 0.35) * layout.em
            _write_name(image, name if len(points) == 1 else f"{name} {number}", at, reach, layout)


def _turned(corners: Floats, degrees: float) -> Floats:
    """Corners ``(n, 2)`` in px turned anticlockwise on the map, whose y runs down in px."""
    cosine = np.cos(np.radians(degrees))
    sine = np.sin(np.radians(degrees))
    return np.asarray(corners @ np.array([[cosine, -sine], [sine, cosine]]))


def _write_name(image: Image.Image, name: str, at: Floats, reach: float, layout: Layout) -> None:
    """A haloed name, ``reach`` px to the right of a point, or to its left at the map's end."""
    from PIL import ImageDraw

    em = layout.em
    is_last = at[0] + reach + primitives.font(em).getlength(name) > layout.bar[0] - em
    y = float(np.clip(at[1], layout.top + 0.7 * em, layout.bottom - 0.7 * em))
    ImageDraw.Draw(image).text(
        (at[0] - reach if is_last else at[0] + reach, y),
        name,
        primitives.BLACK,
        primitives.font(em),
        anchor="rm" if is_last else "lm",
        stroke_width=max(1, round(0.15 * em)),
        stroke_fill=primitives.WHITE,
    )
