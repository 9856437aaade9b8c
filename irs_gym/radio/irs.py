"""The IRS: cascaded channels of its sub-surfaces, their phase shifts, and the expected channel gain
they give.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import diric

from irs_gym.radio.propagation import Link, link
from irs_gym.radio.scene import AccessPoint, IrsPanel, Scene
from irs_gym.units import Floats, wavelength_m

# Of the formulas in `geometry`, `propagation` and this module. Whoever changes a gain or a phase
# shift of any scene by more than rounding raises it: maps that were cached before are then built
# anew.
PHYSICS_VERSION = 1

Complexes = NDArray[np.complex128]
Quantiser = Literal["nearest", "as_printed", "optimal"]
ArrayModel = Literal["far_field", "coherent", "spherical"]


@dataclass(frozen=True)
class Hardware:
    """What the phase shifters can do, and how the array is modelled.

    Attributes
    ----------
    phase_bits
        Resolution b of the phase shifters, L = 2**b levels; None for continuous phases.
    quantiser
        ``"nearest"`` level on the circle; ``"as_printed"``: nearest on [0, 2 pi) without the wrap,
        the letter of the paper's eq. (20); ``"optimal"``: the levels of the largest channel gain.
        Without effect for continuous phases.
    array_model
        ``"far_field"``: plane waves over the whole panel; ``"coherent"``: all elements of a
        sub-surface share the phase of its centre; ``"spherical"``: exact element distances.
    """

    phase_bits: int | None = None
    quantiser: Quantiser = "nearest"
    array_model: ArrayModel = "far_field"

    def __post_init__(self) -> None:
        bits = self.phase_bits
        if bits is not None and (
            isinstance(bits, bool) or not isinstance(bits, int | np.integer) or not 1 <= bits <= 16
        ):
            raise ValueError(
                f"phase_bits={bits!r} must be an integer from 1 to 16, "
                "or None for continuous phases"
            )

        for field, names in (("quantiser", Quantiser), ("array_model", ArrayModel)):
            value = getattr(self, field)
            if not isinstance(value, str) or value not in get_args(names):
                raise ValueError(f"{field}={value!r} must be one of {get_args(names)}")

    @property
    def levels(self) -> int | None:
        """Number of phase levels L; None for continuous phases."""
        return None if self.phase_bits is None else 2**self.phase_bits


# --- the array: unit-amplitude cascaded channels summed over the elements of each sub-surface -----


def element_offsets(count: int, pitch_m: float) -> Floats:
    """Places of ``count`` elements along one axis, symmetric about the centre: (i - (n-1)/2) pitch,
    in metres.
    """
    return np.asarray((np.arange(count) - (count - 1) / 2) * pitch_m)


@dataclass(frozen=True)
class Cascade:
    """The AP-IRS-robot link of one panel, from one access point to n robot positions."""

    panel: IrsPanel
    ap_link: Link  # AP as seen from the panel's centre, shapes () and (3,)
    robot_link: Link  # robot positions as seen from the panel's centre, shapes (n,) and (n, 3)
    wavenumber: float  # k = 2 pi / wavelength, rad/m

    @property
    def amplitude(self) -> Floats:
        """Amplitude of the line-of-sight part of one element's cascaded channel, shape ``(n,)``."""
        return self.robot_link.los_amplitude * self.ap_link.los_amplitude

    @property
    def scattered_power(self) -> Floats:
        """The panel's part of tau in Lemma 1: eta_AI eta_IM (K_IM + K_AI + 1) M, shape ``(n,)``."""
        ap = self.ap_link
        robot = self.robot_link
        moments = robot.rician_factor + ap.rician_factor + 1.0

        return ap.scattered_power * robot.scattered_power * moments * self.panel.elements

    @property
    def pitch_m(self) -> float:
        """Distance between neighbouring elements."""
        return self.panel.pitch_wavelengths * 2 * np.pi / self.wavenumber

    def phase_steps(self) -> tuple[Floats, Floats]:
        """Phase from one element to the next along the wall and along z, each ``(n,)``: k pitch
        (u_IM + u_IA).e.
        """
        both = self.robot_link.direction + self.ap_link.direction  # (n, 3)
        step = self.wavenumber * self.pitch_m
        return step * (both @ self.panel.along_wall), step * both[:, 2]


def _plane_wave(cascade: Cascade, kernel: Floats) -> Complexes:
    """Sub-surface sums where each is its centre's plane-wave phase times a real ``kernel`` (n,)."""
    panel = cascade.panel
    along, up = cascade.phase_steps()  # of one element; sub-surfaces are several elements apart
    per_column, per_row = panel.elements_per_subsurface

    # The phase of a plane wave is linear in the place on the panel, so it splits into a factor for
    # the column and one for the row: C + R exponentials in place of C R.
    columns = np.exp(1j * along[:, None] * element_offsets(panel.columns, per_column))  # (n, C)
    rows = np.exp(1j * up[:, None] * element_offsets(panel.rows, per_row))  # (n, R)

    # What all have in common: the way over the panel's centre, exp(-j k (d_IM + d_AI)).
    travelled = cascade.robot_link.distance_m + cascade.ap_link.distance_m  # (n,)
    common = kernel * np.exp(-1j * cascade.wavenumber * travelled)  # (n,)
    sums = columns[:, :, None] * (common[:, None] * rows)[:, None, :]  # (n, C, R)

    return np.asarray(sums.reshape(len(travelled), -1))


def _far_field_kernel(cascade: Cascade) -> Floats:
    """Sum over a sub-surface's elements relative to its centre: one Dirichlet kernel along each
    axis, ``(n,)``.
    """
    steps = cascade.phase_steps()
    counts = cascade.panel.elements_per_subsurface
    # sum over the offsets e of exp(j step e) = sin(n step / 2) / sin(step / 2) = n diric(step, n)
    kernels = [n * diric(step, n) for step, n in zip(steps, counts, strict=True)]

    return np.asarray(np.prod(kernels, axis=0))


def _coherent_kernel(cascade: Cascade) -> Floats:
    """The number of a sub-surface's elements, which all add up in phase, ``(n,)``."""
    elements = float(np.prod(cascade.panel.elements_per_subsurface))
    return np.full(cascade.robot_link.distance_m.shape, elements)


def _spherical(cascade: Cascade) -> Complexes:
    """Sub-surface sums with the exact distance of every element to both ends."""
    panel = cascade.panel
    pitch = cascade.pitch_m
    columns = panel.columns
    rows = panel.rows
    per_column, per_row = panel.elements_per_subsurface

    # offsets of all M elements from the panel's centre, in metres
    along = element_offsets(columns * per_column, pitch)[:, None, None] * panel.along_wall
    up = element_offsets(rows * per_row, pitch)[None, :, None] * np.array([0.0, 0.0, 1.0])
    elements = (along + up).reshape(-1, 3)  # (M, 3)

    # AP to element to robot, each element with a phase of its own
    travelled = _distances(cascade.robot_link, elements) + _distances(cascade.ap_link, elements)
    waves = np.exp(-1j * cascade.wavenumber * travelled)  # (n, M)

    # each sub-surface is a rectangle of per_column x per_row neighbouring elements
    waves = waves.reshape(-1, columns, per_column, rows, per_row)
    sums = waves.sum(axis=(2, 4))  # (n, C, R)

    return np.asarray(sums.reshape(len(sums), -1))


def _distances(ends: Link, elements: Floats) -> Floats:
    """Distances from ends ``(...)`` to element offsets ``(M, 3)`` about the panel's centre, shape
    ``(..., M)``.
    """
    # |p - e|^2 = |p|^2 - 2 p.e + |e|^2: no array of ends x elements x 3
    p_squared = ends.distance_m[..., None] ** 2  # (..., 1)
    p_e = (ends.direction * ends.distance_m[..., None]) @ elements.T  # (..., M)
    e_squared = np.einsum("mk,mk->m", elements, elements)  # (M,)

    return np.asarray(np.sqrt(p_squared - 2 * p_e + e_squared))


_ARRAYS: dict[str, Callable[[Cascade], Complexes]] = {
    "far_field": lambda cascade: _plane_wave(cascade, _far_field_kernel(cascade)),
    "coherent": lambda cascade: _plane_wave(cascade, _coherent_kernel(cascade)),
    "spherical": _spherical,
}
_MAGNITUDES: dict[str, Callable[[Cascade], Floats]] = {
    # Plane waves: all sub-surfaces have the same magnitude, so their sum needs no array of
    # positions x sub-surfaces.
    "far_field": lambda cascade: cascade.panel.subsurfaces * np.abs(_far_field_kernel(cascade)),
    "coherent": lambda cascade: cascade.panel.subsurfaces * _coherent_kernel(cascade),
    "spherical": lambda cascade: np.abs(_spherical(cascade)).sum(axis=1),
}


# --- phase shifts ---------------------------------------------------------------------------------


def continuous_phases(direct: Complexes, reflected: Complexes) -> Floats:
    """Optimal continuous phase shifts, eq. (14): angle(h) - angle(w_n), in [0, 2 pi), shape ``(n,
    N)``.

    ``direct`` h has shape ``(n,)``, ``reflected`` w ``(n, N)``. The angle of 0 is 0: a blocked
    panel's sub-surfaces all hold the phase of h, and where h = 0 the reference phase is 0.
    """
    return np.mod(_angle(direct)[:, None] - _angle(reflected), 2 * np.pi)


def _angle(channels: Complexes) -> Floats:
    """Phase of each channel in (-pi, pi], 0 for one that is 0, whatever the signs of its zeros."""
    return np.where(channels == 0, 0.0, np.angle(channels))


def nearest_phases(direct: Complexes, reflected: Complexes, levels: int) -> Floats:
    """Level nearest to `continuous_phases` on the circle (eq. (20) with the circular distance)."""
    delta = 2 * np.pi / levels
    level = np.rint(continuous_phases(direct, reflected) / delta)  # (n, N), from 0 to L
    return np.asarray(np.mod(level, levels) * delta)  # level L is level 0


def as_printed_phases(direct: Complexes, reflected: Complexes, levels: int) -> Floats:
    """Level nearest to `continuous_phases` on [0, 2 pi) without the wrap: eq. (20) as printed."""
    delta = 2 * np.pi / levels
    level = np.rint(continuous_phases(direct, reflected) / delta)  # (n, N), from 0 to L
    return np.minimum(level, levels - 1) * delta  # level L is none, so level L - 1 is nearest


def optimal_phases(direct: Complexes, reflected: Complexes, levels: int) -> Floats:
    """Levels that maximise abs(h + sum_n w_n exp(j theta_n)) exactly, in O(N log N) a position.

    If the phase mu of the optimal total were known, each sub-surface would hold the level that
    turns its w_n nearest to mu. At the optimum mu lies within delta/2 of the phase of h. As mu
    sweeps over that interval, of width delta, every sub-surface moves up by one level exactly once,
    so one of N + 1 settings is optimal (arXiv 2211.04704, 2211.04167).
    """
    delta = 2 * np.pi / levels

    # The sweep begins at mu = angle(h) - delta/2, where sub-surface n would need the phase shift
    # mu - angle(w_n). It holds the level nearest to that, counted without the modulo for now.
    start = _angle(direct)[:, None] - delta / 2 - _angle(reflected)  # (n, N)
    step = np.rint(start / delta)  # (n, N)

    # Once mu has gone so far that the needed phase shift is half-way to the next level, the
    # sub-surface switches to that.
    switch = (step + 0.5) * delta - start  # (n, N), between 0 and delta

    # The total at the beginning, and after each switch in the order in which they come. A switch
    # turns its sub-surface's part by delta, which changes the total by part (exp(j delta) - 1).
    first = reflected * np.exp(1j * delta * step)  # (n, N)
    order = np.argsort(switch, axis=1)  # (n, N): the sub-surface of the k-th switch
    change = np.take_along_axis(first, order, axis=1) * (np.exp(1j * delta) - 1)
    changes = np.pad(np.cumsum(change, axis=1), ((0, 0), (1, 0)))  # (n, N + 1): after k switches
    total = (direct + first.sum(axis=1))[:, None] + changes

    # The best setting: all sub-surfaces whose switch came before the largest total are one level
    # up.
    switches = np.argmax(np.abs(total), axis=1)  # (n,)
    place = np.argsort(order, axis=1)  # (n, N): which switch each sub-surface's is
    has_switched = place < switches[:, None]

    # A sub-surface that reflects nothing is optimal at any level: it holds the one nearest to eq.
    # (14), the middle of the sweep.
    chosen = np.where(reflected == 0, np.rint(start / delta + 0.5), step + has_switched)

    return np.asarray(np.mod(chosen, levels) * delta)


_QUANTISERS: dict[str, Callable[[Complexes, Complexes, int], Floats]] = {
    "nearest": nearest_phases,
    "as_printed": as_printed_phases,
    "optimal": optimal_phases,
}


# --- expected gain --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Channel:
    """All that reaches n robot positions from one access point."""

    direct: Link
    direct_phase: Floats  # (n,)
    cascades: tuple[Cascade, ...]

    @property
    def direct_los(self) -> Complexes:
        """h of Lemma 1, shape ``(n,)``: sqrt(eta_AM K_AM) exp(-j k d_AM)."""
        return np.asarray(self.direct.los_amplitude * np.exp(1j * self.direct_phase))

    def reflected_los(self, array_model: ArrayModel) -> Complexes:
        """w of eq. (7), shape ``(n, N)``: sub-surfaces of all panels, panel after panel, column
        after column.
        """
        sums = [c.amplitude[:, None] * _ARRAYS[array_model](c) for c in self.cascades]
        if not sums:
            return np.zeros((len(self.direct_phase), 0), dtype=complex)

        return np.concatenate(sums, axis=1)

    def scattered_power(self) -> Floats:
        """Tau of Lemma 1, shape ``(n,)``."""
        return self.direct.scattered_power + sum(c.scattered_power for c in self.cascades)

    def phase_shifts(self, hardware: Hardware) -> Floats:
        """Phase shifts of all sub-surfaces in [0, 2 pi), shape ``(n, N)``."""
        return _phase_shifts(self.direct_los, self.reflected_los(hardware.array_model), hardware)

    def expected_gain(self, hardware: Hardware) -> Floats:
        """E[abs(c)^2] for the chosen phase shifts, linear, shape ``(n,)``.

        Lemma 1 as corrected by Appendix A, for any number of panels p whose scattered parts are
        independent:

            lambda = abs(h + sum_p w_p^T theta_p)^2 + tau,
            tau    = eta_AM + sum_p eta_AI,p eta_IM,p (K_IM,p + K_AI,p + 1) M_p.

        Continuous phases attain the upper bound (eq. 13), abs(h) + sum_p norm1(w_p) (eq. 15).
        """
        if hardware.levels is not None:
            return self.gain_and_shifts(hardware)[0]

        sums = [c.amplitude * _MAGNITUDES[hardware.array_model](c) for c in self.cascades]
        magnitude = self.direct.los_amplitude + sum(sums)

        return np.asarray(magnitude**2 + self.scattered_power())

    def gain_and_shifts(self, hardware: Hardware) -> tuple[Floats, Floats]:
        """`expected_gain` and `phase_shifts`, the channel of each sub-surface computed once."""
        direct = self.direct_los  # (n,)
        reflected = [self.reflected_los(hardware.array_model)]  # one array, (n, N)
        shifts = _phase_shifts(direct, reflected[0], hardware)  # (n, N)
        if hardware.levels is None:
            return self.expected_gain(hardware), shifts

        # Taken out of the list, a large array is multiplied in place. That rounds another way than
        # a product in new memory does, by a last digit, and the maps of frozen scenes are kept.
        turned = reflected.pop() * np.exp(1j * shifts)  # (n, N)
        magnitude = np.abs(direct + turned.sum(axis=1))  # (n,)

        return np.asarray(magnitude**2 + self.scattered_power()), shifts


def _phase_shifts(direct: Complexes, reflected: Complexes, hardware: Hardware) -> Floats:
    """Phase shifts ``(n, N)`` that the hardware holds for the channels ``(n,)`` and ``(n, N)``."""
    if hardware.levels is None:
        return continuous_phases(direct, reflected)

    return _QUANTISERS[hardware.quantiser](direct, reflected, hardware.levels)


def channel(scene: Scene, access_point: AccessPoint, positions: Floats) -> Channel:
    """Channel from one access point to robot ``positions`` ``(n, 3)`` in metres."""
    wavenumber = 2 * np.pi / wavelength_m(scene.carrier_ghz)  # k
    direct = link(scene, positions, access_point.position)
    cascades = tuple(
        Cascade(
            panel,
            ap_link=link(scene, np.asarray(access_point.position), panel.position),
            robot_link=link(scene, positions, panel.position),
            wavenumber=wavenumber,
        )
        for panel in scene.irs_panels
    )

    return Channel(direct, -wavenumber * direct.distance_m, cascades)
