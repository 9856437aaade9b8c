"""Facts of fading: the closed form against series, limits and channels drawn element by element, and
what a map keeps of it.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import gammainc, gammaln, ndtr
from scipy.stats import ncx2
from test_radio_map import FACTORY, PAPER

from irs_gym import RadioMap, build_phase_shifts, build_radio_map, outage_probability
from irs_gym.radio.fading import MeasuredFading, RicianFading
from irs_gym.radio.irs import element_offsets
from irs_gym.radio.propagation import Link, link
from irs_gym.radio.scene import AccessPoint, Scene
from irs_gym.units import db_to_linear

INF, NAN = float("inf"), float("nan")


def outage(los: float, scattered: float, threshold: float) -> float:
    """Of one cell, from linear values."""
    fading = RicianFading(np.array([[los]]), np.array([[scattered]]))
    return float(fading.outage(10 * np.log10(threshold))[0, 0])


# --- the formula ----------------------------------------------------------------------------------


def series(x: float, noncentrality: float) -> float:
    """Poisson mixture of central chi-squares: all terms are positive, so that tails keep their digits."""
    j = np.arange(4000)
    half = noncentrality / 2
    weights = np.exp(-half + j * np.log(half) - gammaln(j + 1)) if half else 1.0 * (j == 0)
    return float((weights * gammainc(1 + j, x / 2)).sum())


@pytest.mark.parametrize("noncentrality", [0.0, 1e-9, 0.3, 2.0, 4.1, 50.0, 700.0])
def test_the_probability_has_its_digits_in_both_tails(noncentrality):
    places = np.sqrt(noncentrality) + np.array([-25, -12, -6, -2, -0.1, 0, 0.1, 1, 3, 6])
    for b in [1e-6, 0.01, 0.5, 1.99, 2.01, *places[places > 0]]:
        expected = series(b**2, noncentrality)
        assert outage(noncentrality / 2, 1.0, b**2 / 2) == pytest.approx(expected, rel=3e-12)
        assert outage(noncentrality / 2, 1.0, b**2 / 2) == pytest.approx(
            ncx2.cdf(b**2, 2, noncentrality), abs=1e-13
        )


def test_it_becomes_the_normal_distribution_of_an_amplitude_and_then_a_step():
    for ratio in (1e8, 1e14, 1e20):
        for z in (-3.0, -1.0, 0.0, 2.0):  # of a spread of sqrt(tau / 2)
            threshold_db = 10 * np.log10(ratio) + 20 * np.log10(1 + z * np.sqrt(0.5 / ratio))
            # as far as a threshold in dB can tell them apart
            amplitude = np.sqrt(2 * ratio) * (
                10 ** ((threshold_db - 10 * np.log10(ratio)) / 20) - 1
            )
            fading = RicianFading(np.array([[ratio]]), np.array([[1.0]]))
            near = 1 / np.sqrt(ratio) + 1e-14 * np.sqrt(ratio)
            assert fading.outage(threshold_db) == pytest.approx(ndtr(amplitude), abs=near)
    for scattered in (0.0, 1e-300, 1e-45):
        assert outage(1e-6, scattered, 1.0000001e-6) == 1.0
        assert outage(1e-6, scattered, 0.9999999e-6) == 0.0


def test_a_gain_at_the_threshold_is_no_outage_as_a_mean_at_the_target_is_feasible():
    assert RicianFading(np.ones((1, 1)), np.zeros((1, 1))).outage(0.0) == 0.0


def test_nothing_received_is_always_an_outage():
    fading = RicianFading(np.zeros((1, 2)), np.array([[0.0, 1e-9]]))
    assert fading.outage(-1e9).tolist() == [[1.0, 0.0]]
    assert fading.outage(1e9).tolist() == [[1.0, 1.0]]
    np.testing.assert_allclose(fading.outage(-100.0), [[1.0, -np.expm1(-0.1)]], rtol=1e-14)


@pytest.mark.parametrize("phase_bits", [None, 1])
def test_the_outage_rises_with_the_threshold_from_0_to_1(phase_bits):
    found = [
        outage_probability("paper", threshold, 1.0, phase_bits=phase_bits)
        for threshold in (-1e5, -120.0, -80.0, -65.0, -60.0, -50.0, 1e5)
    ]
    free = build_radio_map("paper", 1.0).free
    assert (found[0][free] == 0).all()
    assert (found[-1] == 1).all()
    for lower, higher in pairwise(found):
        assert (lower <= higher).all()
    assert all((each[~free] == 1).all() for each in found)


def test_the_mean_of_the_distribution_is_the_map():
    # E[|c|^2] is the integral of P(|c|^2 >= x), here over dB
    radio_map = build_radio_map(FACTORY, 0.4, phase_bits=1)
    thresholds = np.linspace(-140.0, -30.0, 1001)
    gains = db_to_linear(thresholds)
    over = np.stack([1 - radio_map.fading.outage(each) for each in thresholds])  # (T, X, Y)
    mean = np.trapezoid(over, gains, axis=0) + gains[0]
    free = radio_map.free
    np.testing.assert_allclose(10 * np.log10(mean[free]), radio_map.gain_db[free], atol=5e-3)


def test_many_maps_fade_as_each_does():
    fadings = [build_radio_map("paper", 1.0, bits).fading for bits in (0, 600, 1200)]
    together = RicianFading(
        np.stack([each.los_gain for each in fadings]),
        np.stack([each.scattered_gain for each in fadings]),
    )
    thresholds = np.array([-70.0, -62.0, -60.0])
    found = together.outage(thresholds[:, None, None])
    for n, each in enumerate(fadings):
        np.testing.assert_array_equal(found[n], each.outage(thresholds[n]))


# --- channels drawn element by element ------------------------------------------------------------


def rician(ends: Link, phases: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Draws ``(draws, M)`` of eqs. (1) to (3): fixed parts of given phases, CN(0, 1) scatter."""
    scatter = rng.standard_normal((draws, len(phases), 2)) @ np.array([1, 1j]) / np.sqrt(2)
    factor = np.sqrt(ends.rician_factor)
    return np.sqrt(ends.path_gain / (ends.rician_factor + 1)) * (
        factor * np.exp(1j * phases) + scatter
    )


def drawn_gains(
    scene: Scene, ap: AccessPoint, robot: np.ndarray, shifts: np.ndarray, draws: int, seed: int
) -> np.ndarray:
    """abs(h + sum over panels and elements of r theta g)^2 at one place, shape ``(draws,)``."""
    rng = np.random.default_rng(seed)
    k = 2 * np.pi * scene.carrier_ghz * 1e9 / 299792458
    direct = link(scene, robot[None], ap.position)
    total = rician(direct, -k * direct.distance_m, draws, rng)[:, 0]
    first = 0

    for panel in scene.irs_panels:
        pitch = panel.pitch_wavelengths * 2 * np.pi / k
        per_column, per_row = panel.elements_per_subsurface
        along = element_offsets(panel.columns * per_column, pitch)
        up = element_offsets(panel.rows * per_row, pitch)
        places = np.stack(np.meshgrid(along, up, indexing="ij"), axis=-1)  # (columns, rows, 2)
        axes = np.array([panel.along_wall, [0.0, 0.0, 1.0]], dtype=float)
        elements = places.reshape(-1, 2) @ axes  # (M, 3)
        theta = shifts[first : first + panel.subsurfaces].reshape(panel.columns, panel.rows)
        theta = theta.repeat(per_column, axis=0).repeat(per_row, axis=1).ravel()  # (M,)
        first += panel.subsurfaces

        both = [link(scene, np.array(end)[None], panel.position) for end in (ap.position, robot)]
        sent, received = (
            rician(each, -k * (each.distance_m - elements @ each.direction[0]), draws, rng)
            for each in both
        )
        total = total + (sent * np.exp(1j * theta) * received).sum(axis=1)

    return np.abs(total) ** 2


def worst_deviation(
    scene: Scene, cell_size: float, cells: list, draws: int, **setting: object
) -> float:
    """How many standard errors the drawn shares lie off the closed form, over cells and thresholds."""
    radio_map = build_radio_map(scene, cell_size, **setting)
    shifts = build_phase_shifts(scene, cell_size, **setting)
    worst = 0.0

    for n, cell in enumerate(cells):
        robot = np.array([*radio_map.grid.centre(cell), scene.antenna_height])
        own = [
            build_radio_map(scene.model_copy(update={"access_points": (ap,)}), cell_size, **setting)
            for ap in scene.access_points
        ]
        serving = scene.access_points[int(np.argmax([each.gain_db[cell] for each in own]))]
        gains = drawn_gains(scene, serving, robot, shifts[cell], draws, seed=n)

        for threshold in radio_map.gain_db[cell] + np.arange(-12.0, 6.0, 2.0):
            exact = radio_map.fading.outage(threshold)[cell]
            share = np.mean(gains < db_to_linear(threshold))
            worst = max(worst, abs(share - exact) / np.sqrt(exact * (1 - exact) / draws))

    return worst


# line of sight to both, to the AP alone, to the panel alone, to neither
OF_EACH_KIND = [(5, 20), (3, 12), (20, 35), (20, 6)]


@pytest.mark.parametrize("setting", [{}, {"phase_bits": 1}], ids=["continuous", "1 bit"])
def test_the_papers_cells_fade_as_channels_drawn_element_by_element(setting):
    # 36 shares: the largest of as many normal deviations is beyond 4.5 once in 4,000 times
    assert worst_deviation(PAPER, 0.5, OF_EACH_KIND, 3000, **setting) < 4.5


@pytest.mark.parametrize("quantiser", ["nearest", "as_printed", "optimal"])
def test_so_do_cells_of_several_access_points_and_panels_under_any_quantiser(quantiser):
    cells = [(1, 9), (8, 3), (13, 2), (19, 14)]
    assert worst_deviation(FACTORY, 0.4, cells, 4000, phase_bits=2, quantiser=quantiser) < 4.5


def test_draws_tell_another_scattered_power_from_it():
    radio_map = build_radio_map("paper")
    cell = OF_EACH_KIND[0]
    wrong = RicianFading(radio_map.fading.los_gain, radio_map.fading.scattered_gain * 1.4)
    threshold = radio_map.gain_db[cell] - 6.0
    exact = radio_map.fading.outage(threshold)[cell]
    assert wrong.outage(threshold)[cell] - exact > 4.5 * np.sqrt(exact * (1 - exact) / 3000)


# --- what a map keeps -----------------------------------------------------------------------------

MEASURED = MeasuredFading(np.array([-80.0, -70.0, -60.0]), np.full((2, 1, 3), 0.3))
KINDS = {
    "Rician": RicianFading(np.full((2, 1), 1e-7), np.full((2, 1), 3e-8)),
    "measured": MEASURED,
}


@pytest.mark.parametrize("fading", KINDS.values(), ids=KINDS)
def test_a_map_keeps_its_fading_in_files_and_data(fading, tmp_path):
    radio_map = RadioMap.from_array([[-60.0], [-61.0]], 0.5, fading=fading)
    radio_map.save(tmp_path / "map.npz", fading=True)
    for again in (
        RadioMap.load(tmp_path / "map.npz"),
        RadioMap.from_data(radio_map.to_data(fading=True)),
    ):
        for name, array in vars(fading).items():
            np.testing.assert_array_equal(getattr(again.fading, name), array)
            assert not getattr(again.fading, name).flags.writeable


def test_what_was_measured_is_kept_unasked_and_what_a_scene_tells_is_not(tmp_path):
    for name, fading in KINDS.items():
        radio_map = RadioMap.from_array([[-60.0], [-61.0]], 0.5, fading=fading)
        assert ("fading" in radio_map.to_data()) == (name == "measured")
        assert "fading" not in radio_map.to_data(fading=False)
        radio_map.save(tmp_path / "map.npz")
        assert (RadioMap.load(tmp_path / "map.npz").fading is None) == (name == "Rician")


@pytest.mark.parametrize(
    ("fading", "message"),
    [
        ({"los_gain": [[1.0]]}, "los_gain without scattered_gain tells no fading"),
        ({"levels_db": [1.0]}, "levels_db without shares"),
        ({"los_gain": [[1.0]], "scattered_gain": [[-1.0]]}, "scattered_gain holds a negative gain"),
        ({"los_gain": [[NAN]], "scattered_gain": [[1.0]]}, "los_gain must hold finite real"),
        ({"los_gain": [[1.0]], "scattered_gain": [[1.0], [2.0]]}, "los_gain has the shape"),
        ({"los_gain": [["a"]], "scattered_gain": [[1.0]]}, "los_gain must hold finite real"),
        ({"los_gain": [[1.0], [1, 2]], "scattered_gain": [[1.0]]}, "los_gain is no array"),
        ({"los_gain": [[1.0]] * 2, "scattered_gain": [[1.0]] * 2}, "fading has the shape"),
        ({"levels_db": [2.0, 1.0], "shares": [[[0.5, 0.5]]]}, "row of increasing numbers"),
        ({"levels_db": [1.0, 2.0], "shares": [[[0.5]]]}, r"must be \(X, Y, 2\)"),
        ({"levels_db": [1.0, 2.0], "shares": [[[0.5, 0.6]]]}, "add up to more than 1"),
        ({"levels_db": [1.0, 2.0], "shares": [[[-0.5, 0.6]]]}, "must not be negative"),
        (7, "radio_map: "),
        (None, "radio_map: "),
    ],
)
def test_fading_that_can_mean_nothing_is_refused(fading, message):
    data = RadioMap.from_array([[-60.0]], 0.5).to_data() | {"fading": fading}
    with pytest.raises(ValueError, match=message):
        RadioMap.from_data(data)


@pytest.mark.parametrize("threshold_db", [NAN, INF, None, "-60", True])
def test_a_threshold_that_is_no_number_is_refused_by_name(threshold_db):
    with pytest.raises(ValueError, match=r"^threshold_db=.* must be a finite number of dB"):
        outage_probability("paper", threshold_db)
