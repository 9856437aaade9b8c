"""`GainBounds`: the expected channel gain over whole rectangles of the floor, from below and from
above.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import diric

from irs_gym.bounds.shadows import Shadows, shadows_of
from irs_gym.radio.irs import Cascade, Hardware, channel
from irs_gym.radio.path_loss import MultiWall, formulas_of
from irs_gym.radio.scene import Scene
from irs_gym.radio.shapes import PolygonRoom
from irs_gym.units import Floats, db_to_linear

_GROWN = 1e-7  # metres that a rectangle is wider than asked: what lies on its border is in it
_ROUNDING = 1e-10  # relative, of a gain
_MOST_PANELS = 8  # 2 ** 9 cases of lines of sight

Bools = NDArray[np.bool_]
Interval = tuple[Floats, Floats]  # (n,) each: at least, at most


@dataclass(frozen=True, eq=False)
class LinkBounds:
    """A Rician link to all points of n rectangles, with a line of sight and without."""

    distance_m: Interval
    is_possible: tuple[Bools, Bools]  # without, with
    amplitude: tuple[Interval, Interval]  # of its line-of-sight part
    scattered_power: tuple[Interval, Interval]
    rician_factor: tuple[float, float]


@dataclass(frozen=True, eq=False)
class GainBounds:
    """Bounds of the gain of Lemma 1 in a scene, the panels built as asked.

    Examples
    --------
    >>> from irs_gym import load_scene
    >>> bounds = GainBounds(load_scene("paper"), Hardware())
    >>> least, most = bounds.over(np.array([[-9.8, 0.2, -9.7, 0.3]]))
    >>> (10 * np.log10([least[0], most[0]])).round(2)  # about where the gain is -59.51
    array([-59.56, -59.46])
    """

    scene: Scene
    hardware: Hardware

    def __post_init__(self) -> None:
        scene = self.scene
        hardware = self.hardware
        if isinstance(scene.room, PolygonRoom):
            raise ValueError("room: bounds are known for rectangles, not for polygons")
        if isinstance(scene.path_loss, MultiWall) and scene.obstacles:
            raise ValueError("path_loss: bounds are not known where walls are counted")
        if hardware.array_model == "spherical" and scene.irs_panels:
            raise ValueError(
                "array_model='spherical' has no bounds: 'far_field' and 'coherent' have"
            )
        if hardware.levels is not None and hardware.quantiser == "as_printed":
            raise ValueError("quantiser='as_printed' has no bounds: 'nearest' and 'optimal' have")
        if len(scene.irs_panels) > _MOST_PANELS:
            raise ValueError(
                f"irs_panels: there are {len(scene.irs_panels)}, and bounds are known for up to "
                f"{_MOST_PANELS}"
            )

    @cached_property
    def _shadows(self) -> dict[tuple[float, float, float], Shadows]:
        """Shadows for each access point and panel."""
        scene = self.scene
        corners = np.array([scene.room.lower, scene.room.upper])
        ends = [each.position for each in scene.access_points]
        ends += [each.position for each in scene.irs_panels]
        shadows = {}

        for end in ends:
            reach = float(np.hypot(*np.abs(corners - end[:2]).max(axis=0)))
            shadows[end] = shadows_of(scene.floor, np.array(end), scene.antenna_height, reach)

        return shadows

    @cached_property
    def _cascades(self) -> list[tuple[Cascade, ...]]:
        """Of each access point, what is known of its panels without the robot."""
        # anywhere will do, as the links of the robot are left aside
        x, y = self.scene.start
        anywhere = np.array([[x, y, self.scene.antenna_height]])
        return [channel(self.scene, each, anywhere).cascades for each in self.scene.access_points]

    def over(self, cells: Floats) -> Interval:
        """Linear gains that no point of each rectangle ``(x_low, y_low, x_high, y_high)`` in
        metres, shape ``(n, 4)``, falls below, and that none exceeds; ``(n,)`` each.

        They tend to the gain as rectangles shrink, where all of one sees an antenna, or none of it;
        with b-bit phases they do not, but leave cos(pi / L) of the reflected amplitude open.
        """
        robots = [self._link(cells, each.position) for each in self.scene.irs_panels]
        least = np.zeros(len(cells))
        most = np.zeros(len(cells))

        # the access point that serves a point best
        for access_point, cascades in zip(self.scene.access_points, self._cascades, strict=True):
            direct = self._link(cells, access_point.position)
            parts = [
                self._cascade(cells, cascade, robot)
                for cascade, robot in zip(cascades, robots, strict=True)
            ]
            low, high = _gain(direct, robots, parts)
            least = np.maximum(least, low)
            most = np.maximum(most, high)

        return least * (1 - _ROUNDING), most * (1 + _ROUNDING)

    def _link(self, cells: Floats, end: tuple[float, float, float]) -> LinkBounds:
        """Path loss is a monotone function of the distance, with and without line of sight."""
        scene = self.scene
        distance = _distances(cells, end, scene.antenna_height)
        is_seen, is_hidden = self._shadows[end].sight(cells)

        with_sight, without_sight = formulas_of(scene.path_loss)
        losses = np.array(
            [
                [formula.loss_db(each, scene.carrier_ghz) for each in distance]
                for formula in (with_sight, *without_sight)
            ]
        )  # (formulas, 2, n)
        low = losses.min(axis=1)
        high = losses.max(axis=1)
        # no passive link has a loss below 0: the model knows no point that is so near
        blocked = _gains(low.max(axis=0), high.max(axis=0))
        clear = _gains(low[0], high[0])

        rician = float(db_to_linear(scene.rician_factor_db))
        zero = np.zeros(len(cells))
        amplitude = (
            np.sqrt(clear[0] / (rician + 1) * rician),
            np.sqrt(clear[1] / (rician + 1) * rician),
        )

        return LinkBounds(
            distance_m=distance,
            is_possible=(is_hidden, is_seen),
            amplitude=((zero, zero), amplitude),
            scattered_power=(blocked, (clear[0] / (rician + 1), clear[1] / (rician + 1))),
            rician_factor=(0.0, rician),
        )

    def _cascade(
        self, cells: Floats, cascade: Cascade, robot: LinkBounds
    ) -> tuple[tuple[Interval, Interval], tuple[Interval, Interval]]:
        """Of a panel, the amplitude that all its sub-surfaces reflect, and its part of tau: each
        without and with a line of sight to the robot.
        """
        panel = cascade.panel
        ap = cascade.ap_link
        low, high = self._kernel(cells, cascade, robot)
        levels = self.hardware.levels
        # nearest phases are off by pi / L at most, and the best ones lose no more
        kept = 1.0 if levels is None else max(0.0, float(np.cos(np.pi / levels)))
        each = float(ap.los_amplitude) * panel.subsurfaces
        amplitude = tuple(
            (kept * each * least * low, each * most * high) for least, most in robot.amplitude
        )

        scattered = tuple(
            (factor * least, factor * most)
            for (least, most), rician in zip(
                robot.scattered_power, robot.rician_factor, strict=True
            )
            for factor in [
                float(ap.scattered_power)
                * (rician + float(ap.rician_factor) + 1.0)
                * panel.elements
            ]
        )

        return amplitude, scattered  # type: ignore[return-value]  # two of each

    def _kernel(self, cells: Floats, cascade: Cascade, robot: LinkBounds) -> Interval:
        """Amplitude of a sub-surface's sum over its elements."""
        panel = cascade.panel
        counts = panel.elements_per_subsurface
        if self.hardware.array_model == "coherent":
            both = np.full(len(cells), float(np.prod(counts)))
            return both, both

        # (u_IM + u_IA).e along the wall and along z
        direction = cascade.ap_link.direction
        step = cascade.wavenumber * cascade.pitch_m
        height = self.scene.antenna_height - panel.position[2]
        along = _cosines(cells, panel.position, panel.along_wall, height)
        up = _sorted(height / robot.distance_m[0], height / robot.distance_m[1])
        offsets = (float(direction @ panel.along_wall), float(direction[2]))
        low = np.ones(len(cells))
        high = np.ones(len(cells))

        for (least, most), offset, count in zip((along, up), offsets, counts, strict=True):
            kernel = _dirichlet(step * (least + offset), step * (most + offset), count)
            low = low * kernel[0]
            high = high * kernel[1]

        return low, high


def _gain(
    direct: LinkBounds,
    robots: list[LinkBounds],
    parts: list[tuple[tuple[Interval, Interval], tuple[Interval, Interval]]],
) -> Interval:
    """(abs(h) + sum_p norm1(w_p))^2 + tau, eqs. (13) and (15), over all lines of sight that are
    possible in each rectangle.
    """
    least = np.full(len(direct.distance_m[0]), np.inf)
    most = np.zeros(len(least))

    for sight, *sights in product((0, 1), repeat=1 + len(robots)):
        is_possible = direct.is_possible[sight].copy()
        amplitude = list(direct.amplitude[sight])
        power = list(direct.scattered_power[sight])

        for state, robot, (reflected, scattered) in zip(sights, robots, parts, strict=True):
            is_possible &= robot.is_possible[state]
            for end in (0, 1):
                amplitude[end] = amplitude[end] + reflected[state][end]
                power[end] = power[end] + scattered[state][end]

        low = amplitude[0] ** 2 + power[0]
        high = amplitude[1] ** 2 + power[1]
        least = np.where(is_possible, np.minimum(least, low), least)
        most = np.where(is_possible, np.maximum(most, high), most)

    return least, most


def _sorted(first: Floats, second: Floats) -> Interval:
    """The two in order, element by element."""
    return np.minimum(first, second), np.maximum(first, second)


def _gains(least_db: Floats, most_db: Floats) -> Interval:
    """Linear path gains between two losses."""
    return db_to_linear(-np.maximum(most_db, 0.0)), db_to_linear(-np.maximum(least_db, 0.0))


def _distances(cells: Floats, end: tuple[float, float, float], height: float) -> Interval:
    """3-D distances from an end to the nearest and the farthest point of each rectangle."""
    low = cells[:, :2] - _GROWN - end[:2]  # (n, 2)
    high = cells[:, 2:] + _GROWN - end[:2]
    nearest = np.maximum(np.maximum(low, -high), 0.0)
    farthest = np.maximum(np.abs(low), np.abs(high))
    rise = height - end[2]
    squares = [np.einsum("nk,nk->n", each, each) + rise**2 for each in (nearest, farthest)]

    # an antenna is a point, and of what is nearer than this the loss is below 0 all the same
    return np.sqrt(np.maximum(squares[0], _GROWN**2)), np.sqrt(squares[1])


def _cosines(
    cells: Floats, centre: tuple[float, float, float], along: Floats, height: float
) -> Interval:
    """Range of a / sqrt(a^2 + b^2 + h^2), a along the wall and b across: it rises with a, and where
    a > 0 falls as abs(b) rises.
    """
    low = cells[:, :2] - _GROWN - centre[:2]  # (n, 2)
    high = cells[:, 2:] + _GROWN - centre[:2]
    across = np.array([-along[1], along[0]])
    least, most = _projected(low, high, along[:2])
    aside = _projected(low, high, across)
    nearest = np.maximum(np.maximum(aside[0], -aside[1]), 0.0)
    farthest = np.maximum(np.abs(aside[0]), np.abs(aside[1]))

    def cosine(a: Floats, b: Floats) -> Floats:
        distance = np.sqrt(a**2 + b**2 + height**2)
        return np.asarray(a / np.maximum(distance, _GROWN))

    lowest = cosine(least, np.where(least > 0, farthest, nearest))
    highest = cosine(most, np.where(most > 0, nearest, farthest))

    # where the panel itself may be below, any direction is
    is_near = (nearest**2 + height**2 < _GROWN) & (least <= 0) & (most >= 0)
    return np.where(is_near, -1.0, lowest), np.where(is_near, 1.0, highest)


def _projected(low: Floats, high: Floats, along: Floats) -> Interval:
    """Range of p.along over rectangles with the corners ``(n, 2)``."""
    ends = np.stack([low * along, high * along])  # (2, n, 2)
    return ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1)


def _dirichlet(least: Floats, most: Floats, count: int) -> Interval:
    """Range of abs(sin(n x / 2) / sin(x / 2)) over intervals of x.

    It falls from n at 0 to 0 at 2 pi / n. Anywhere, its slope is at most the sum of the elements'
    offsets, n^2 / 4.
    """
    if count == 1:
        one = np.ones(len(least))
        return one, one

    middle = np.abs(count * diric((least + most) / 2, count))
    change = (most - least) / 2 * count**2 / 4
    low = np.maximum(middle - change, 0.0)
    high = np.minimum(middle + change, float(count))

    # in the main lobe, what is farther from 0 is less
    far = np.maximum(np.abs(least), np.abs(most))
    near = np.where(least * most <= 0, 0.0, np.minimum(np.abs(least), np.abs(most)))
    is_in_lobe = far <= 2 * np.pi / count
    low = np.where(is_in_lobe, np.maximum(low, np.abs(count * diric(far, count))), low)
    high = np.where(is_in_lobe, np.minimum(high, np.abs(count * diric(near, count))), high)

    return low * (1 - _ROUNDING), high * (1 + _ROUNDING)
