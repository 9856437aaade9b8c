"""Facts of the IRS: Lemma 1 by Monte Carlo, optimal phase shifts by brute force, closed forms of
small panels.
"""

from cmath import exp
from dataclasses import dataclass
from itertools import product
from math import log10, pi, sqrt

import numpy as np
import pytest
from test_geometry import is_blocked

from irs_gym.radio.irs import (
    Hardware,
    as_printed_phases,
    continuous_phases,
    element_offsets,
    nearest_phases,
    optimal_phases,
)
from irs_gym.radio.radio_map import build_phase_shifts, build_radio_map
from irs_gym.radio.scene import Scene, load_scene

# screens stand where they hold no cell
pytestmark = pytest.mark.filterwarnings("ignore:.*no cell is blocked by")

PAPER = load_scene("paper")
HARDWARE = [
    Hardware(),
    *(
        Hardware(bits, quantiser)
        for bits in (1, 2)
        for quantiser in ("nearest", "as_printed", "optimal")
    ),
]


def panel(position, wall, columns=2, rows=2, elements=(1, 4), pitch=0.3):
    return {
        "position": position,
        "wall": wall,
        "columns": columns,
        "rows": rows,
        "elements_per_subsurface": elements,
        "pitch_wavelengths": pitch,
    }


def hall(**changes) -> Scene:
    """A room of 4 x 4 m whose path loss is so small that each term of Lemma 1 weighs."""
    scene = {
        **PAPER.model_dump(),
        "name": "hall",
        "room": {"x_min": 0, "x_max": 4, "y_min": 0, "y_max": 4, "height": 3},
        "obstacles": [],
        "access_points": [{"position": (1, 3.5, 2)}],
        "irs_panels": [panel((2, 0, 1.5), "y_min")],
        "start": (0, 0),
        "goal": (4, 4),
        "path_loss": {
            "line_of_sight": {"intercept_db": 5, "distance_slope_db": 20, "frequency_slope_db": 0},
            "non_line_of_sight": {
                "intercept_db": 12,
                "distance_slope_db": 24,
                "frequency_slope_db": 0,
            },
        },
    }
    return Scene.model_validate({**scene, **changes})


# one screen between the access point and the panel, one that also shades a corner of the room from
# both
BETWEEN = {"center": (1.5, 1.75), "size": (0.2, 0.2, 3)}
CORNER = {"center": (2.85, 1.9), "size": (0.1, 2.2, 3)}
HALLS = {
    "open": hall(),
    "panel behind a screen": hall(obstacles=[BETWEEN]),
    "corner behind a screen": hall(obstacles=[CORNER]),
    "two panels": hall(
        irs_panels=[panel((2, 0, 1.5), "y_min"), panel((4, 3, 1), "x_max", 3, 1, (2, 2))]
    ),
    "two panels and screens": hall(
        obstacles=[BETWEEN, CORNER],
        irs_panels=[panel((2, 0, 1.5), "y_min"), panel((0, 1.2, 2), "x_min", 1, 3, (3, 1))],
    ),
}

# --- Lemma 1 --------------------------------------------------------------------------------------


@dataclass
class Budget:
    """Path gain L, Rician factor K and eta of one link, from the paper's formulas."""

    gain: float
    factor: float

    @property
    def eta(self) -> float:
        return self.gain / (self.factor + 1)

    def draws(self, phases, count, rng):
        """Rician channels (count, m): unit-modulus line of sight with these phases, CN(0, 1)
        scatter.
        """
        scatter = rng.standard_normal((count, len(phases), 2)) @ np.array([1, 1j]) / sqrt(2)
        return sqrt(self.eta) * (sqrt(self.factor) * np.exp(1j * np.asarray(phases)) + scatter)


def budget(scene, start, end) -> Budget:
    blocked = any(is_blocked(start, end, box.lower, box.upper) for box in scene.obstacles)
    log_distance, log_frequency = (
        log10(np.linalg.norm(np.subtract(start, end))),
        log10(scene.carrier_ghz),
    )
    los, nlos = (
        c.intercept_db + c.distance_slope_db * log_distance + c.frequency_slope_db * log_frequency
        for c in (scene.path_loss.line_of_sight, scene.path_loss.non_line_of_sight)
    )
    loss_db, factor = (
        (max(los, nlos), 0.0) if blocked else (los, 10 ** (scene.rician_factor_db / 10))
    )
    return Budget(10 ** (-loss_db / 10), factor)


def offsets(panel):
    """Elements (M, 3) about the panel's centre, sub-surface after sub-surface, those column after
    column.
    """
    along, up = panel.elements_per_subsurface
    pitch = panel.pitch_wavelengths * 299_792_458 / 2e9
    axis = np.array([0, 1, 0]) if panel.wall[0] == "x" else np.array([1, 0, 0])
    places = [
        (
            column * along + a - (panel.columns * along - 1) / 2,
            row * up + b - (panel.rows * up - 1) / 2,
        )
        for column, row, a, b in product(
            range(panel.columns), range(panel.rows), range(along), range(up)
        )
    ]
    return np.array([pitch * (x * axis + z * np.array([0, 0, 1])) for x, z in places])


def monte_carlo(scene, robot, phase_shifts, count, rng):
    """Draws of abs(c)^2, eq. (4), at one robot position: direct link plus every element of every
    panel.
    """
    wavenumber = 2 * pi * 2e9 / 299_792_458
    (ap,) = [np.array(point.position) for point in scene.access_points]

    def phases(end, centre, elements):
        away = end - centre
        distance = np.linalg.norm(away)
        return -wavenumber * (distance - elements @ away / distance)

    total = budget(scene, robot, ap).draws([-wavenumber * np.linalg.norm(robot - ap)], count, rng)[
        :, 0
    ]
    first = 0
    for each in scene.irs_panels:
        centre, elements = np.array(each.position), offsets(each)
        received = budget(scene, robot, centre).draws(phases(robot, centre, elements), count, rng)
        sent = budget(scene, ap, centre).draws(phases(ap, centre, elements), count, rng)
        shifts = np.repeat(
            phase_shifts[first : first + each.subsurfaces], len(elements) // each.subsurfaces
        )
        total += (received * np.exp(1j * shifts) * sent).sum(axis=1)
        first += each.subsurfaces
    return np.abs(total) ** 2


def standard_errors(draws, expected) -> float:
    return (draws.mean() - expected) / (draws.std() / sqrt(len(draws)))


def at(scene, cell):
    return np.array([*scene.grid(1.0).centre(cell), scene.antenna_height])


@pytest.mark.parametrize("hardware", HARDWARE, ids=lambda h: f"{h.phase_bits} {h.quantiser}")
@pytest.mark.parametrize("name", HALLS)
def test_closed_form_gain_equals_the_monte_carlo_mean(name, hardware):
    scene, rng = HALLS[name], np.random.default_rng(1)
    setting = (scene, 1.0, None, hardware.phase_bits, hardware.quantiser)
    gain = 10 ** (build_radio_map(*setting).gain_db / 10)
    shifts = build_phase_shifts(*setting)
    for cell in np.ndindex(4, 4):
        draws = monte_carlo(scene, at(scene, cell), shifts[cell], 2500, rng)
        assert abs(standard_errors(draws, gain[cell])) < 4, cell


def test_the_halls_have_clear_and_blocked_links_of_every_kind():
    kinds = set()
    for scene in HALLS.values():
        for cell, each in product(np.ndindex(4, 4), scene.irs_panels):
            robot, ap = at(scene, cell), scene.access_points[0].position
            ends = [(robot, ap), (robot, each.position), (ap, each.position)]
            kinds.add(tuple(budget(scene, *pair).factor > 0 for pair in ends))
    assert len(kinds) == 8


@pytest.mark.parametrize("cell", [(1, 2), (3, 0)])
def test_lemma_1_as_printed_with_eta_of_the_panel_misses_the_mean(cell):
    scene = HALLS["open"]
    gain = 10 ** (build_radio_map(scene, 1.0).gain_db[cell] / 10)
    draws = monte_carlo(
        scene,
        at(scene, cell),
        build_phase_shifts(scene, 1.0)[cell],
        40_000,
        np.random.default_rng(2),
    )
    ap, panel = scene.access_points[0].position, scene.irs_panels[0].position
    printed = (
        gain - budget(scene, at(scene, cell), ap).eta + budget(scene, at(scene, cell), panel).eta
    )
    assert abs(standard_errors(draws, gain)) < 4
    assert abs(standard_errors(draws, printed)) > 8


@pytest.mark.parametrize(
    ("name", "cell"),
    [("open", (1, 0)), ("panel behind a screen", (2, 0)), ("corner behind a screen", (3, 1))],
)
def test_tau_as_printed_with_sub_surfaces_for_elements_misses_the_mean(name, cell):
    scene = HALLS[name]
    gain = 10 ** (build_radio_map(scene, 1.0).gain_db[cell] / 10)
    draws = monte_carlo(
        scene,
        at(scene, cell),
        build_phase_shifts(scene, 1.0)[cell],
        40_000,
        np.random.default_rng(3),
    )
    ap, (panel,) = scene.access_points[0].position, scene.irs_panels
    sent, received = (
        budget(scene, ap, panel.position),
        budget(scene, at(scene, cell), panel.position),
    )
    of_an_element = sent.eta * received.eta * (sent.factor + received.factor + 1)
    printed = gain - of_an_element * (panel.elements - panel.subsurfaces)
    assert abs(standard_errors(draws, gain)) < 4
    assert abs(standard_errors(draws, printed)) > 8


@pytest.mark.parametrize("cell", [(16, 32), (20, 1)], ids=["in sight of both", "near the panel"])
def test_lemma_1_holds_in_the_papers_factory(cell):
    robot, ap, panel = (
        (*PAPER.grid(0.5).centre(cell), 1.0),
        PAPER.access_points[0].position,
        (0.0, -10.0, 2.0),
    )
    gain = 10 ** (build_radio_map().gain_db[cell] / 10)
    draws = monte_carlo(
        PAPER, np.array(robot), build_phase_shifts()[cell], 3000, np.random.default_rng(4)
    )
    printed = gain - budget(PAPER, robot, ap).eta + budget(PAPER, robot, panel).eta
    assert abs(standard_errors(draws, gain)) < 4
    assert abs(standard_errors(draws, printed)) > 8


# --- closed forms of small panels -----------------------------------------------------------------


@pytest.mark.parametrize(
    "obstacles", [[], [BETWEEN], [CORNER]], ids=["open", "screen between", "screen at a corner"]
)
def test_a_single_element_adds_its_amplitude_and_scatter(obstacles):
    scene = hall(obstacles=obstacles, irs_panels=[panel((2, 0, 1.5), "y_min", 1, 1, (1, 1))])
    gain_db, ap, place = build_radio_map(scene, 1.0).gain_db, (1, 3.5, 2), (2, 0, 1.5)
    for cell in np.ndindex(4, 4):
        robot = tuple(at(scene, cell))
        am, im, ai = budget(scene, robot, ap), budget(scene, robot, place), budget(scene, ap, place)
        amplitude = sqrt(am.eta * am.factor) + sqrt(im.eta * im.factor * ai.eta * ai.factor)
        gain = amplitude**2 + am.eta + ai.eta * im.eta * (im.factor + ai.factor + 1)
        assert gain_db[cell] == pytest.approx(10 * log10(gain), abs=1e-11)


def test_a_single_element_of_one_bit_takes_the_better_sign():
    scene = hall(irs_panels=[panel((2, 0, 1.5), "y_min", 1, 1, (1, 1))])
    gain_db, wavenumber = build_radio_map(scene, 1.0, None, 1).gain_db, 2 * pi * 2e9 / 299_792_458
    signs = set()
    for cell in np.ndindex(4, 4):
        robot, ap, place = at(scene, cell), np.array((1, 3.5, 2)), np.array((2, 0, 1.5))
        am, im, ai = budget(scene, robot, ap), budget(scene, robot, place), budget(scene, ap, place)
        d_am, d_im, d_ai = (
            np.linalg.norm(a - b) for a, b in [(robot, ap), (robot, place), (ap, place)]
        )
        direct = sqrt(am.eta * am.factor) * exp(-1j * wavenumber * d_am)
        reflected = sqrt(im.eta * im.factor * ai.eta * ai.factor) * exp(
            -1j * wavenumber * (d_im + d_ai)
        )
        powers = [abs(direct + reflected) ** 2, abs(direct - reflected) ** 2]
        tau = am.eta + ai.eta * im.eta * (im.factor + ai.factor + 1)
        assert gain_db[cell] == pytest.approx(10 * log10(max(powers) + tau), abs=1e-11)
        signs.add(powers.index(max(powers)))
    assert signs == {0, 1}


def test_elements_lie_symmetrically_about_the_centre():
    assert element_offsets(1, 0.3).tolist() == [0]
    assert element_offsets(4, 0.5).tolist() == [-0.75, -0.25, 0.25, 0.75]


def test_plane_waves_meet_sub_surfaces_of_one_element_coherently():
    scene = hall(irs_panels=[panel((2, 0, 1.5), "y_min", 5, 4, (1, 1))])
    for bits in (None, 2):
        far, coherent = (
            build_radio_map(scene, 1.0, None, bits, array_model=model).gain_db
            for model in ("far_field", "coherent")
        )
        assert np.allclose(far, coherent, rtol=0, atol=1e-12)


def test_spherical_waves_of_a_small_panel_are_plane():
    """The phase that plane waves leave out falls with the square of the panel's size."""
    worst = []
    for pitch in (0.1, 0.01):
        scene = hall(irs_panels=[panel((2, 0, 1.5), "y_min", 4, 4, (1, 4), pitch)])
        far, spherical = (
            build_radio_map(scene, 1.0, None, 2, array_model=model).gain_db
            for model in ("far_field", "spherical")
        )
        worst.append(np.abs(far - spherical).max())
    assert worst[0] > 1e-3
    assert worst[1] < worst[0] / 50


# --- phase shifts ---------------------------------------------------------------------------------


def random_channels(count, subsurfaces, rng, has_direct=True):
    real, imaginary = rng.standard_normal((2, count, subsurfaces + 1)) * rng.uniform(
        0.1, 3, (count, subsurfaces + 1)
    )
    both = real + 1j * imaginary
    return both[:, 0] * has_direct, both[:, 1:]


def magnitude(direct, reflected, phases):
    return np.abs(direct + (reflected * np.exp(1j * phases)).sum(axis=1))


def best_of_all_settings(direct, reflected, levels) -> float:
    turns = np.exp(2j * pi * np.arange(levels) / levels)
    totals = np.array([direct])
    for each in reflected:
        totals = np.add.outer(totals, each * turns).ravel()
    return np.abs(totals).max()


@pytest.mark.parametrize("has_direct", [True, False])
@pytest.mark.parametrize("levels", [2, 3, 4, 8])
@pytest.mark.parametrize("subsurfaces", [1, 2, 3, 4, 5, 6])
def test_optimal_phases_equal_brute_force_over_all_settings(subsurfaces, levels, has_direct):
    count = 2 if levels**subsurfaces > 10_000 else 20
    direct, reflected = random_channels(count, subsurfaces, np.random.default_rng(6), has_direct)
    phases = optimal_phases(direct, reflected, levels)
    assert phases == pytest.approx(np.rint(phases * levels / (2 * pi)) * 2 * pi / levels, abs=1e-12)
    assert ((phases >= 0) & (phases < 2 * pi - 1e-9)).all()
    best = [best_of_all_settings(h, w, levels) for h, w in zip(direct, reflected, strict=True)]
    assert magnitude(direct, reflected, phases) == pytest.approx(best, rel=1e-12)


@pytest.mark.parametrize("levels", [2, 3, 4, 8])
@pytest.mark.parametrize(
    ("direct", "reflected"),
    [
        (1, [1, 1, 1, 1]),  # all in phase already
        (-1, [1, 1, 1]),  # all opposed
        (1, [1j, -1j, 1j, -1j]),  # midway between two levels
        (0, [1, 1j, -1, -1j]),
        (0, [1, np.exp(2j), np.exp(4j)]),
        (0.1, [1, -1, 1j, 1e-9, 0]),
        (5, [0, 0]),
        (0, [0, 0]),
        (1e-9, [1e-9j, -1e-9, 3e-9]),
    ],
)
def test_optimal_phases_equal_brute_force_where_settings_tie(direct, reflected, levels):
    h, w = np.array([direct], dtype=complex), np.array([reflected], dtype=complex)
    best = best_of_all_settings(direct, reflected, levels)
    assert magnitude(h, w, optimal_phases(h, w, levels))[0] == pytest.approx(best, rel=1e-12)


def test_continuous_phases_attain_the_papers_upper_bound():
    direct, reflected = random_channels(200, 30, np.random.default_rng(7))
    phases = continuous_phases(direct, reflected)
    assert ((phases >= 0) & (phases < 2 * pi)).all()
    bound = np.abs(direct) + np.abs(reflected).sum(axis=1)
    assert magnitude(direct, reflected, phases) == pytest.approx(bound, rel=1e-14)
    assert (
        magnitude(direct, reflected, phases + np.random.default_rng(8).uniform(0, 7, phases.shape))
        < bound
    ).all()


def test_without_a_direct_path_the_reference_phase_is_zero():
    _, reflected = random_channels(50, 8, np.random.default_rng(9))
    blocked = 0.0 * np.exp(1j * np.linspace(0, 6, 50))  # zeros of either sign
    turned = reflected * np.exp(1j * continuous_phases(blocked, reflected))
    assert np.abs(np.angle(turned)).max() < 1e-12
    for phases in (as_printed_phases, nearest_phases, optimal_phases):
        assert np.array_equal(phases(blocked, reflected, 4), phases(np.zeros(50), reflected, 4))


@pytest.mark.parametrize("levels", [2, 3, 4, 8])
def test_sub_surfaces_that_reflect_nothing_hold_the_phase_of_the_direct_path(levels):
    direct, _ = random_channels(200, 1, np.random.default_rng(12))
    nothing = 0.0 * np.exp(1j * np.linspace(0, 6, 8)) * np.ones((200, 1))  # zeros of either sign
    assert len(np.unique(np.angle(nothing))) > 1
    wanted = continuous_phases(direct, nothing)
    assert wanted == pytest.approx(
        np.mod(np.angle(direct), 2 * pi)[:, None] * np.ones(8), abs=1e-12
    )
    for phases in (as_printed_phases, nearest_phases, optimal_phases):
        assert np.array_equal(
            phases(direct, nothing, levels), phases(direct, np.zeros((200, 8)), levels)
        )
    assert np.array_equal(
        optimal_phases(direct, nothing, levels), nearest_phases(direct, nothing, levels)
    )


@pytest.mark.parametrize("model", ["far_field", "coherent", "spherical"])
@pytest.mark.parametrize("bits", [None, 1, 2])
def test_where_the_panel_is_out_of_sight_all_sub_surfaces_hold_the_phase_of_the_direct_path(
    bits, model
):
    grid = PAPER.grid(0.5)
    free = map(tuple, np.argwhere(build_radio_map().free))
    robots = {cell: (*grid.centre(cell), PAPER.antenna_height) for cell in free}
    ap, place = PAPER.access_points[0].position, PAPER.irs_panels[0].position
    blind = [cell for cell, robot in robots.items() if budget(PAPER, robot, place).factor == 0]
    assert len(blind) == 506
    lengths = np.array([np.linalg.norm(np.subtract(robots[cell], ap)) for cell in blind])
    is_lit = np.array([budget(PAPER, robots[cell], ap).factor > 0 for cell in blind])
    angles = np.where(is_lit, -2 * pi * 2e9 / 299_792_458 * lengths, 0.0)
    half_a_level = 0.0 if bits is None else pi / 2**bits
    for quantiser in ("nearest", "optimal"):
        shifts = build_phase_shifts(PAPER, 0.5, None, bits, quantiser, model)[
            tuple(zip(*blind, strict=True))
        ]
        assert np.ptp(shifts, axis=1).max() == 0
        apart = np.abs(np.angle(np.exp(1j * (shifts[:, 0] - angles))))
        assert apart.max() <= half_a_level + 1e-5


@pytest.mark.parametrize("levels", [2, 3, 4, 8, 64])
def test_nearest_is_the_level_nearest_on_the_circle(levels):
    direct, reflected = random_channels(40, 20, np.random.default_rng(10))
    wanted, chosen = continuous_phases(direct, reflected), nearest_phases(direct, reflected, levels)
    every_level = 2 * pi * np.arange(levels) / levels
    apart = np.abs(np.exp(1j * every_level) - np.exp(1j * wanted[..., None]))
    assert chosen == pytest.approx(every_level[apart.argmin(axis=-1)], abs=1e-12)


@pytest.mark.parametrize("levels", [2, 3, 4, 8, 64])
def test_as_printed_is_the_level_nearest_on_the_line(levels):
    direct, reflected = random_channels(40, 20, np.random.default_rng(11))
    wanted, chosen = (
        continuous_phases(direct, reflected),
        as_printed_phases(direct, reflected, levels),
    )
    every_level = 2 * pi * np.arange(levels) / levels
    assert chosen == pytest.approx(
        every_level[np.abs(every_level - wanted[..., None]).argmin(axis=-1)], abs=1e-12
    )


@pytest.mark.parametrize(("bits", "loss_db"), [(1, 3.0), (2, 0.5), (3, 0.07)])
def test_leaving_out_the_wrap_costs_what_the_notes_say(bits, loss_db):
    """Reflected amplitude of sub-surfaces whose phases are spread evenly over the circle."""
    reflected, direct = np.exp(2j * pi * (np.arange(4096) + 0.5) / 4096)[None], np.zeros(1)
    nearest, printed = (
        magnitude(direct, reflected, phases(direct, reflected, 2**bits))[0]
        for phases in (nearest_phases, as_printed_phases)
    )
    assert nearest / 4096 == pytest.approx(np.sinc(2.0**-bits), rel=1e-5)
    assert 20 * log10(nearest / printed) == pytest.approx(loss_db, abs=0.02)


def test_sixteen_bits_are_nearly_continuous():
    fine, continuous = build_radio_map(phase_bits=16, cell_size=1.0), build_radio_map(cell_size=1.0)
    free = continuous.free
    assert np.abs(fine.gain_db[free] - continuous.gain_db[free]).max() < 1e-6


def test_phase_shifts_of_the_map_are_levels_and_zero_in_obstacles():
    shifts = build_phase_shifts(cell_size=1.0, phase_bits=2)
    assert shifts.shape == (20, 20, 60)
    assert shifts.dtype == np.float32
    assert not shifts[9, 9].any()
    assert np.unique(shifts).tolist() == pytest.approx([0, pi / 2, pi, 3 * pi / 2], rel=1e-6)
    assert build_phase_shifts(cell_size=1.0, irs_elements=0).shape == (20, 20, 0)


@pytest.mark.parametrize("quantiser", ["nearest", "as_printed", "optimal"])
def test_without_a_panel_the_quantiser_has_no_effect(quantiser):
    plain = build_radio_map(cell_size=1.0, irs_elements=0).gain_db
    assert np.array_equal(build_radio_map(PAPER, 1.0, 0, 1, quantiser).gain_db, plain)


# --- several access points and panels -------------------------------------------------------------

TWO_OF_EACH = hall(
    obstacles=[BETWEEN],
    access_points=[{"position": (1, 3.5, 2)}, {"position": (3.5, 0.5, 2.5)}],
    irs_panels=[panel((2, 0, 1.5), "y_min"), panel((4, 3, 1), "x_max", 3, 1, (2, 2))],
)


@pytest.mark.parametrize("hardware", HARDWARE, ids=lambda h: f"{h.phase_bits} {h.quantiser}")
def test_each_cell_is_served_by_the_access_point_that_gives_it_the_highest_gain(hardware):
    setting = (1.0, None, hardware.phase_bits, hardware.quantiser)
    alone = [
        TWO_OF_EACH.model_copy(update={"access_points": (point,)})
        for point in TWO_OF_EACH.access_points
    ]
    gains = np.array([build_radio_map(scene, *setting).gain_db for scene in alone])
    assert np.array_equal(build_radio_map(TWO_OF_EACH, *setting).gain_db, gains.max(axis=0))
    serving = gains.argmax(axis=0)
    assert set(serving.ravel()) == {0, 1}
    shifts, each = (
        build_phase_shifts(TWO_OF_EACH, *setting),
        [build_phase_shifts(scene, *setting) for scene in alone],
    )
    assert shifts.shape == (4, 4, 7)
    for cell in np.ndindex(4, 4):
        assert np.array_equal(shifts[cell], each[serving[cell]][cell])


def test_panels_out_of_sight_of_all_add_scatter_alone():
    blind = hall(obstacles=[{"center": (2, 0.5), "size": (1, 0.9, 3)}])
    power, without = (
        10 ** (build_radio_map(blind, 1.0, elements).gain_db / 10) for elements in (None, 0)
    )
    for cell in np.ndindex(4, 4):
        place = blind.irs_panels[0].position
        sent, received = (
            budget(blind, end, place) for end in (blind.access_points[0].position, at(blind, cell))
        )
        assert (sent.factor, received.factor) == (0, 0)
        assert power[cell] == pytest.approx(
            without[cell] + sent.gain * received.gain * 16, rel=1e-12
        )


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [0, -1, 17, True, False, np.True_, 1.5, 2.0, "2", float("nan")])
def test_a_resolution_that_no_phase_shifter_has_is_refused(bits):
    with pytest.raises(ValueError, match=r"phase_bits=.* must be an integer from 1 to 16, or None"):
        Hardware(bits)
    with pytest.raises(ValueError, match=r"phase_bits=.* must be an integer from 1 to 16, or None"):
        build_radio_map(phase_bits=bits)


@pytest.mark.parametrize("quantiser", ["best", "Nearest", None, 3, ["nearest"]])
def test_an_unknown_quantiser_is_refused_with_those_that_exist(quantiser):
    for bits in (None, 1):
        with pytest.raises(
            ValueError, match=r"quantiser=.* one of \('nearest', 'as_printed', 'optimal'\)"
        ):
            build_radio_map(phase_bits=bits, quantiser=quantiser)


@pytest.mark.parametrize("model", ["near_field", "", None])
def test_an_unknown_array_model_is_refused_with_those_that_exist(model):
    with pytest.raises(
        ValueError, match=r"array_model=.* one of \('far_field', 'coherent', 'spherical'\)"
    ):
        build_radio_map(array_model=model)


def test_numpy_integers_are_integers():
    assert Hardware(np.int64(3)).levels == 8
    assert Hardware().levels is None
