"""`Evidence`: means over drawn channels, with errors, that tell a formula from its rival."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from eval.paper.study import CONTINUOUS, Study
from irs_gym.radio.irs import (
    Cascade,
    Channel,
    Complexes,
    Hardware,
    as_printed_phases,
    channel,
    nearest_phases,
)
from irs_gym.radio.propagation import Link
from irs_gym.units import Floats, linear_to_db

BATCH = 500  # draws in work at a time


@dataclass(frozen=True, eq=False)
class Evidence:
    """What draws say about the value of a formula and about that of its rival.

    Attributes
    ----------
    subject
        What is estimated.
    ours, rival
        The value of the formula of this package, and of the paper's as it is printed; linear.
    effect_db
        How far the two put the gain of a cell apart at most, over the whole map.
    means, errors
        Running means of the draws and their standard errors, linear, shape ``(batches,)``.
    draws
        How many draws each is over, same shape.
    """

    subject: str
    ours: float
    rival: float
    effect_db: float
    means: Floats
    errors: Floats
    draws: NDArray[np.int64]

    @property
    def deviations(self) -> tuple[float, float]:
        """How many standard errors the last mean lies above our value, and above the rival's."""
        mean = float(self.means[-1])
        error = float(self.errors[-1])
        return (mean - self.ours) / error, (mean - self.rival) / error


def running_means(batches: Iterable[Floats]) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Means of batches of draws so far, their standard errors, and over how many draws they are."""
    samples = np.stack(list(batches))  # (batches, BATCH)
    count = samples.shape[1] * np.arange(1, len(samples) + 1)
    means = samples.sum(axis=1).cumsum() / count
    spread = (samples**2).sum(axis=1).cumsum() / count - means**2

    return means, np.sqrt(spread / count), count


# --- channels, drawn element by element -----------------------------------------------------------


def draw_channels(link: Link, los_phases: Floats, rng: np.random.Generator) -> Complexes:
    """Rician channels, eqs. (1) to (3), shape ``(BATCH, m)``: line of sight of the given phases,
    CN(0, 1) scatter.
    """
    scatter = rng.standard_normal((BATCH, 2 * len(los_phases))).view(np.complex128) / sqrt(2)
    return np.asarray(
        link.los_amplitude * np.exp(1j * los_phases) + np.sqrt(link.scattered_power) * scatter
    )


def draw_reflections(
    site: Channel, shifts: Floats, rng: np.random.Generator
) -> tuple[Complexes, complex]:
    """What reaches one robot position over all panels, shape ``(BATCH,)``, and its line-of-sight
    part.

    Each element has channels of its own, plane waves over its panel, so no sum of the closed form
    is used. ``shifts`` (N,) are the phase shifts of the sub-surfaces.
    """
    total = np.zeros(BATCH, dtype=complex)
    los = 0j
    first = 0

    for cascade in site.cascades:
        elements, subsurface = _elements(cascade)
        turned = np.exp(1j * shifts[first + subsurface])  # (M,)
        first += cascade.panel.subsurfaces

        # A plane wave reaches an element earlier by what it lies towards the other end.
        ends = _of_one(cascade.ap_link), _of_one(cascade.robot_link)
        phases = [
            -cascade.wavenumber * (end.distance_m - elements @ end.direction) for end in ends
        ]  # (M,) each
        sent, received = (
            draw_channels(end, phase, rng) for end, phase in zip(ends, phases, strict=True)
        )  # (BATCH, M) each
        total += (received * turned * sent).sum(axis=1)

        amplitude = float(ends[0].los_amplitude * ends[1].los_amplitude)
        los += amplitude * complex((np.exp(1j * (phases[0] + phases[1])) * turned).sum())

    return total, los


def _elements(cascade: Cascade) -> tuple[Floats, NDArray[np.int64]]:
    """Places (M, 3) of a panel's elements from its centre in metres, and the numbers (M,) of their
    sub-surfaces, of which the rows change first.
    """
    panel = cascade.panel
    pitch = cascade.pitch_m
    per_column, per_row = panel.elements_per_subsurface
    shape = (panel.columns, panel.rows, per_column, per_row)
    column, row, a, b = np.indices(shape).reshape(4, -1)

    along = (column * per_column + a - (panel.columns * per_column - 1) / 2) * pitch
    up = (row * per_row + b - (panel.rows * per_row - 1) / 2) * pitch
    places = along[:, None] * panel.along_wall + up[:, None] * np.array([0.0, 0.0, 1.0])

    return places, column * panel.rows + row


def draw_gains(site: Channel, shifts: Floats, rng: np.random.Generator) -> Floats:
    """Draws of abs(c)^2, eq. (4), at one robot position, shape ``(BATCH,)``."""
    direct = draw_channels(_of_one(site.direct), site.direct_phase, rng)[:, 0]
    return np.asarray(np.abs(direct + draw_reflections(site, shifts, rng)[0]) ** 2)


def draw_scatter(site: Channel, shifts: Floats, rng: np.random.Generator) -> Floats:
    """Draws of the power that reaches one robot position over the panels beside the line-of-sight
    part.
    """
    total, los = draw_reflections(site, shifts, rng)
    return np.asarray(np.abs(total - los) ** 2)


def _of_one(link: Link) -> Link:
    """The link of a single position, without the axis of positions."""
    numbers = {
        name: getattr(link, name).reshape(())
        for name in ("distance_m", "path_gain", "rician_factor")
    }
    return replace(link, direction=link.direction.reshape(3), **numbers)


# --- the paper's formulas that need a correction, each where it matters most ----------------------


def lemma_1(study: Study, draws: int, seed: int) -> Evidence:
    """Second term of Lemma 1: eta_AM (Appendix A), not eta_IM."""
    everywhere = _channels(study)
    gain = everywhere.expected_gain(Hardware())
    eta_am = everywhere.direct.scattered_power
    eta_im = everywhere.cascades[0].robot_link.scattered_power
    printed = gain - eta_am + eta_im

    return _compare(
        study,
        "gain, continuous phases",
        gain=gain,
        ours=gain,
        rival=printed,
        hardware=Hardware(),
        draw_batch=draw_gains,
        draws=draws,
        seed=[seed, 1],
    )


def tau(study: Study, draws: int, seed: int) -> Evidence:
    """The panel's part of tau: M elements (Appendix A), not N sub-surfaces."""
    everywhere = _channels(study)
    gain = everywhere.expected_gain(Hardware())
    cascade = everywhere.cascades[0]
    ours = cascade.scattered_power
    printed = ours * cascade.panel.subsurfaces / cascade.panel.elements

    return _compare(
        study,
        "scattered power over the panel",
        gain=gain,
        ours=ours,
        rival=printed,
        hardware=Hardware(),
        draw_batch=draw_scatter,
        draws=draws,
        seed=[seed, 2],
    )


def quantiser(study: Study, draws: int, seed: int) -> Evidence:
    """1-bit phases: nearest on the circle, not on [0, 2 pi) as eq. (20) is printed."""
    wrapped = Hardware(1, "nearest")
    printed = Hardware(1, "as_printed")
    ours, rival = (_channels(study).expected_gain(each) for each in (wrapped, printed))

    return _compare(
        study,
        "gain, 1-bit phases",
        gain=ours,
        ours=ours,
        rival=rival,
        hardware=wrapped,
        draw_batch=draw_gains,
        draws=draws,
        seed=[seed, 3],
    )


def several_panels(study: Study, draws: int, seed: int) -> Evidence:
    """Lemma 1 over several panels, whose line-of-sight parts add coherently; the rival adds their
    powers.
    """
    everywhere = _channels(study)
    gain = everywhere.expected_gain(Hardware())
    panels = [
        replace(everywhere, cascades=(each,)).reflected_los("far_field")
        for each in everywhere.cascades
    ]
    powers = sum(np.abs(each).sum(axis=1) ** 2 for each in panels)
    rival = np.abs(everywhere.direct_los) ** 2 + powers + everywhere.scattered_power()

    return _compare(
        study,
        "gain, two panels",
        gain=gain,
        ours=gain,
        rival=rival,
        hardware=Hardware(),
        draw_batch=draw_gains,
        draws=draws,
        seed=[seed, 4],
    )


def _compare(
    study: Study,
    subject: str,
    *,
    gain: Floats,
    ours: Floats,
    rival: Floats,
    hardware: Hardware,
    draw_batch: Callable[[Channel, Floats, np.random.Generator], Floats],
    draws: int,
    seed: list[int],
) -> Evidence:
    """Evidence in the cell whose gain changes most if the rival's value (n,) takes the place of
    ours (n,) in it.
    """
    effect_db = np.abs(linear_to_db((gain - ours + rival) / gain))
    cell = int(np.argmax(effect_db))
    site = _channels(study, cell)
    rng = np.random.default_rng(seed)
    shifts = site.phase_shifts(hardware)[0]
    estimates = running_means(draw_batch(site, shifts, rng) for _ in range(-(-draws // BATCH)))

    return Evidence(
        subject, float(ours[cell]), float(rival[cell]), float(effect_db[cell]), *estimates
    )


def lost_amplitude_db(bits: int, draws: int, seed: int) -> tuple[float, float, float]:
    """Reflected amplitude in dB that eq. (20) loses without the wrap: mean over random phases, its
    error, exactly.

    The exact loss is that of the mean of exp(j (theta - theta*)) over uniform theta*: sin(delta/2)
    L / pi with the wrap; without it, the last level also serves the half step below 2 pi.
    """
    levels = 2**bits
    rng = np.random.default_rng([seed, 5, bits])
    delta = 2 * np.pi / levels
    reference = np.ones(1, dtype=np.complex128)  # of phase 0
    losses = []

    for _ in range(20):
        wanted = np.exp(-1j * rng.uniform(0, 2 * np.pi, (1, max(1, draws // 20))))
        kept = [
            np.abs(np.mean(wanted * np.exp(1j * rounded(reference, wanted, levels))))
            for rounded in (nearest_phases, as_printed_phases)
        ]
        losses.append(20 * np.log10(kept[0] / kept[1]))

    with_wrap = levels * np.sin(delta / 2) / np.pi
    last_level = (np.exp(1j * delta) - 1) / 1j
    without = np.abs((levels - 1) * 2 * np.sin(delta / 2) + last_level) / (2 * np.pi)
    error = np.std(losses, ddof=1) / sqrt(len(losses))

    return float(np.mean(losses)), float(error), float(20 * np.log10(with_wrap / without))


def _channels(study: Study, cell: int | None = None) -> Channel:
    """Channels from the first access point to all free cells, or to one of them by its number."""
    positions = study.antennas()[study.radio_map(CONTINUOUS).free]
    chosen = positions if cell is None else positions[cell : cell + 1]
    return channel(study.scene, study.scene.access_points[0], chosen)
