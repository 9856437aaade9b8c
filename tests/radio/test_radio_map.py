"""Facts of radio maps: equal to a slow computation written straight from the paper, and safe in
files.
"""

import os
import pickle
from cmath import exp, phase
from fractions import Fraction
from functools import cache
from itertools import product
from math import hypot, inf, log10, nan, pi, sqrt

import numpy as np
import pytest
from test_geometry import exact, is_blocked

from irs_gym.grid import Grid
from irs_gym.radio.radio_map import RadioMap, as_scene, build_radio_map
from irs_gym.radio.scene import Scene, load_scene

PAPER = load_scene("paper")
MODELS = ["far_field", "coherent", "spherical"]

# two of each on walls of both directions, nothing of it symmetric, and a box higher than the links
FACTORY = Scene.model_validate(
    {
        **PAPER.model_dump(),
        "name": "factory",
        "room": {"x_min": -3.2, "x_max": 4.8, "y_min": 0.6, "y_max": 6.6, "height": 4.0},
        "obstacles": [
            {"center": (-1.2, 2.6), "size": (1.2, 1.6, 1.4)},
            {"center": (2.3, 4.1), "size": (1.0, 2.2, 3.4)},
            {"center": (4.3, 1.1), "size": (1.0, 1.0, 0.9)},
        ],
        "access_points": [{"position": (0.3, 6.6, 2.2)}, {"position": (4.8, 3.3, 2.7)}],
        "irs_panels": [
            {
                "position": (0.9, 0.6, 2.1),
                "wall": "y_min",
                "columns": 5,
                "rows": 3,
                "elements_per_subsurface": (2, 4),
                "pitch_wavelengths": 0.25,
            },
            {
                "position": (-3.2, 5.1, 1.7),
                "wall": "x_min",
                "columns": 4,
                "rows": 3,
                "elements_per_subsurface": (3, 1),
                "pitch_wavelengths": 0.5,
            },
        ],
        "antenna_height": 1.2,
        "start": (-3.2, 0.6),
        "goal": (4.8, 6.6),
        "carrier_ghz": 3.5,
        "rician_factor_db": 5.0,
    }
)

# --- the reference: the paper cell by cell and element by element, with exact blockage ------------


def distance(a, b) -> float:
    return hypot(*(float(x) - float(y) for x, y in zip(a, b, strict=True)))


def reference_cells(scene: Scene, cell_size: str, stride: int = 1) -> dict:
    """Exact antenna positions of every so many cells by (i, j), None where the centre is inside an
    obstacle.
    """
    size, room, cells = Fraction(cell_size), scene.room, {}
    x_min, x_max, y_min, y_max = exact((room.x_min, room.x_max, room.y_min, room.y_max))
    for i, j in list(
        product(range(int((x_max - x_min) / size)), range(int((y_max - y_min) / size)))
    )[::stride]:
        x, y = x_min + (i + Fraction(1, 2)) * size, y_min + (j + Fraction(1, 2)) * size
        inside = False
        for box in scene.obstacles:
            (cx, cy), (sx, sy, _) = exact(box.center), exact(box.size)
            inside = inside or (abs(x - cx) < sx / 2 and abs(y - cy) < sy / 2)
        cells[i, j] = None if inside else (x, y, *exact([scene.antenna_height]))
    return cells


def is_clear(scene: Scene, a, b) -> bool:
    for box in scene.obstacles:
        (cx, cy), (sx, sy, height) = exact(box.center), exact(box.size)
        if is_blocked(
            a, b, (cx - sx / 2, cy - sy / 2, Fraction(0)), (cx + sx / 2, cy + sy / 2, height)
        ):
            return False
    return True


def eta_and_factor(scene: Scene, a, b) -> tuple[float, float]:
    """Eta = L / (K + 1) and K, with L from eqs. (18) and (19)."""
    d, f = log10(distance(a, b)), log10(scene.carrier_ghz)
    los = 31.84 + 21.50 * d + 19 * f
    if is_clear(scene, a, b):
        factor = 10 ** (scene.rician_factor_db / 10)
        return 10 ** (-los / 10) / (factor + 1), factor
    return 10 ** (-max(los, 32.4 + 23 * d + 20 * f) / 10), 0.0


def subsurface_sums(scene, panel, robot, ap, model):
    """For each sub-surface, the sum over its elements of the unit-amplitude cascaded channel."""
    wavelength = 299792458 / (scene.carrier_ghz * 1e9)
    wavenumber, pitch = 2 * pi / wavelength, panel.pitch_wavelengths * wavelength
    robot, ap, centre = [float(x) for x in robot], list(ap), list(panel.position)
    d_im, d_ai = distance(robot, centre), distance(ap, centre)
    bend = [(r - c) / d_im + (a - c) / d_ai for r, a, c in zip(robot, ap, centre, strict=True)]
    per_column, per_row = panel.elements_per_subsurface
    axis = 1 if panel.wall in ("x_min", "x_max") else 0
    sums = []
    for column, row in product(range(panel.columns), range(panel.rows)):
        elements = []
        for a, b in product(range(per_column), range(per_row)):
            offset = [0.0, 0.0, 0.0]
            offset[axis] = pitch * (column * per_column + a - (panel.columns * per_column - 1) / 2)
            offset[2] = pitch * (row * per_row + b - (panel.rows * per_row - 1) / 2)
            elements.append(offset)
        if model == "coherent":
            mean = [sum(e[axis] for e in elements) / len(elements) for axis in range(3)]
            elements = [mean] * len(elements)
        total = 0j
        for e in elements:
            if model == "spherical":
                place = [c + x for c, x in zip(centre, e, strict=True)]
                travelled = distance(robot, place) + distance(ap, place)
            else:
                travelled = d_im + d_ai - sum(u * x for u, x in zip(bend, e, strict=True))
            total += exp(-1j * wavenumber * travelled)
        sums.append(total)
    return sums


@cache
def reference_channel(scene: Scene, robot, model):
    """(h, w_1 ... w_N, tau) of each access point, Lemma 1 with eta_AM and M."""
    channels = []
    for point in scene.access_points:
        ap = point.position
        eta_am, k_am = eta_and_factor(scene, robot, ap)
        wavenumber = 2 * pi * scene.carrier_ghz * 1e9 / 299792458
        h, w, tau = sqrt(eta_am * k_am) * exp(-1j * wavenumber * distance(robot, ap)), [], eta_am
        for panel in scene.irs_panels:
            (eta_im, k_im), (eta_ai, k_ai) = (
                eta_and_factor(scene, end, panel.position) for end in (robot, ap)
            )
            sums = subsurface_sums(scene, panel, robot, ap, model)
            w += [sqrt(eta_im * k_im) * sqrt(eta_ai * k_ai) * each for each in sums]
            tau += eta_ai * eta_im * (k_im + k_ai + 1) * panel.elements
        channels.append((h, w, tau))
    return channels


def wrapped(angle: float) -> float:
    return abs((angle + pi) % (2 * pi) - pi)


def reference_magnitude(h, w, levels, quantiser) -> float:
    """abs(h + w^T theta) for the phase shifts that the quantiser chooses."""
    if levels is None or not w:
        return abs(h) + sum(abs(each) for each in w)
    delta = 2 * pi / levels
    if quantiser == "optimal":
        # The best total has some phase phi, and each sub-surface the level that turns it nearest to
        # phi. The choice changes only where a sub-surface is midway between two levels: try one phi
        # between each two such places.
        angles = np.angle(w)
        midway = np.sort(
            np.mod((angles[:, None] + delta * (np.arange(levels) + 0.5)).ravel(), 2 * pi)
        )
        phi = (midway + np.append(midway[1:], midway[0] + 2 * pi)) / 2
        nearest = np.rint((phi[:, None] - angles) / delta) * delta
        return float(np.abs(h + (np.array(w) * np.exp(1j * nearest)).sum(axis=1)).max())
    total, reference = h, phase(h) if h else 0.0
    for each in w:
        wanted = (reference - phase(each)) % (2 * pi)
        misses = [
            (wrapped if quantiser == "nearest" else abs)(n * delta - wanted) for n in range(levels)
        ]
        total += each * exp(1j * delta * misses.index(min(misses)))
    return abs(total)


def reference_gain_db(scene, robot, levels=None, quantiser="nearest", model="far_field") -> float:
    if robot is None:
        return -inf
    channels = reference_channel(scene, robot, model)
    return 10 * log10(
        max(reference_magnitude(h, w, levels, quantiser) ** 2 + tau for h, w, tau in channels)
    )


def worst_difference_db(scene, cell_size, bits, quantiser, model, stride) -> float:
    gain_db = build_radio_map(
        scene, float(Fraction(cell_size)), None, bits, quantiser, model
    ).gain_db
    worst = 0.0
    for cell, robot in reference_cells(scene, cell_size, stride).items():
        expected = reference_gain_db(scene, robot, 2**bits if bits else None, quantiser, model)
        worst = max(worst, 0.0 if gain_db[cell] == expected else abs(gain_db[cell] - expected))
    return worst


@pytest.mark.parametrize(("model", "stride"), [("far_field", 1), ("coherent", 3), ("spherical", 5)])
def test_the_papers_map_equals_the_reference(model, stride):
    assert worst_difference_db(PAPER, "1/2", None, "nearest", model, stride) < 1e-9


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("quantiser", ["nearest", "as_printed", "optimal"])
@pytest.mark.parametrize("bits", [1, 2, 3])
def test_the_papers_map_with_discrete_phases_equals_the_reference(bits, quantiser, model):
    assert worst_difference_db(PAPER, "1/2", bits, quantiser, model, 12) < 1e-9


@pytest.mark.parametrize(
    ("bits", "quantiser"), [(None, "nearest"), (1, "nearest"), (2, "as_printed"), (1, "optimal")]
)
@pytest.mark.parametrize(
    ("cell_size", "elements", "stride"),
    [
        ("2", 2000, 1),  # centres on the faces of boxes, rays along them
        ("1", 200, 3),
        ("1", 3000, 17),
        ("2/5", 600, 19),
        ("1/3", 800, 31),
        ("1/4", 1600, 101),
        ("1/10", 400, 501),
        ("1/2", 0, 7),
    ],
)
def test_maps_of_other_cells_and_elements_equal_the_reference(
    cell_size, elements, stride, bits, quantiser
):
    scene = PAPER.with_irs_elements(elements)
    assert worst_difference_db(scene, cell_size, bits, quantiser, "far_field", stride) < 1e-9


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("bits", "quantiser"), [(None, "nearest"), (1, "as_printed"), (2, "nearest"), (3, "optimal")]
)
@pytest.mark.parametrize(("cell_size", "stride"), [("1", 1), ("2/5", 3), ("1/4", 11)])
def test_a_map_of_several_access_points_and_panels_equals_the_reference(
    cell_size, stride, bits, quantiser, model
):
    assert worst_difference_db(FACTORY, cell_size, bits, quantiser, model, stride) < 1e-9


def test_a_room_higher_than_its_boxes_and_a_carrier_of_millimetre_waves_change_nothing_of_that():
    high = PAPER.model_copy(
        update={"antenna_height": 1.45, "carrier_ghz": 28.0, "rician_factor_db": -7.0}
    )
    for bits, quantiser in [(None, "nearest"), (2, "nearest"), (2, "optimal")]:
        assert worst_difference_db(high, "1", bits, quantiser, "far_field", 7) < 1e-9


def test_the_factory_has_links_of_every_kind():
    kinds = set()
    for robot in filter(None, reference_cells(FACTORY, "1/2").values()):
        for point, panel in product(FACTORY.access_points, FACTORY.irs_panels):
            ap, place = point.position, panel.position
            kinds.add(
                tuple(
                    is_clear(FACTORY, *ends) for ends in [(robot, ap), (robot, place), (ap, place)]
                )
            )
    assert len(kinds) == 8


# --- the paper's map ------------------------------------------------------------------------------


def test_the_papers_map_counts_of_cells():
    free = build_radio_map().free
    cells = {cell: robot for cell, robot in reference_cells(PAPER, "1/2").items() if robot}
    ap, panel = PAPER.access_points[0].position, PAPER.irs_panels[0].position
    from_ap, from_irs = (
        {c for c, robot in cells.items() if not is_clear(PAPER, robot, end)} for end in (ap, panel)
    )
    assert (free.size, free.sum()) == (1600, 1280)
    assert set(cells) == set(zip(*np.nonzero(free), strict=True))
    assert (len(from_ap), len(from_irs), len(from_ap & from_irs)) == (506, 506, 98)


def test_the_map_is_symmetric_as_the_papers_factory_is():
    for setting in [
        {},
        {"irs_elements": 0},
        {"phase_bits": 1},
        {"phase_bits": 2, "quantiser": "optimal"},
    ]:
        gain_db = build_radio_map(**setting).gain_db
        free = np.isfinite(gain_db)
        assert np.array_equal(free, free[::-1])
        assert np.allclose(gain_db[free], gain_db[::-1][free], rtol=0, atol=1e-9)


def test_without_irs_the_gain_is_the_path_gain():
    gain_db = build_radio_map(irs_elements=0).gain_db
    for cell, robot in reference_cells(PAPER, "1/2").items():
        expected = -inf
        if robot:
            d = log10(distance(robot, (0, 10, 2)))
            los, nlos = 31.84 + 21.5 * d + 19 * log10(2), 32.4 + 23 * d + 20 * log10(2)
            expected = -los if is_clear(PAPER, robot, (0, 10, 2)) else -max(los, nlos)
        assert gain_db[cell] == pytest.approx(expected, abs=1e-12)


def test_an_irs_never_lowers_the_gain():
    without, continuous = build_radio_map(irs_elements=0), build_radio_map()
    free = without.free
    assert (continuous.gain_db[free] > without.gain_db[free]).all()


def test_obstacles_are_minus_infinity_where_the_centre_is_inside():
    assert np.isneginf(build_radio_map().gain_db[16:24, 16:24]).all()
    assert np.isfinite(build_radio_map().gain_db[15, 16:24]).all()
    # centres on the faces at x = -7 and -3 are not inside
    assert np.isfinite(build_radio_map(cell_size=2.0).gain_db[[1, 3], 2]).all()
    assert np.isneginf(build_radio_map(cell_size=2.0).gain_db[2, 2])


def test_a_scene_is_given_by_its_name_its_file_or_itself(tmp_path):
    PAPER.save(tmp_path / "mine.json")
    maps = [build_radio_map(each, 1.0).gain_db for each in ("paper", PAPER, tmp_path / "mine.json")]
    assert np.array_equal(maps[0], maps[1])
    assert np.array_equal(maps[0], maps[2])
    assert as_scene(PAPER) is PAPER
    with pytest.raises(FileNotFoundError, match="scene='hangar' is neither a file nor"):
        build_radio_map("hangar")


def test_an_antenna_in_the_centre_of_a_cell_is_refused():
    low = PAPER.model_copy(
        update={
            "access_points": (
                PAPER.access_points[0].model_copy(update={"position": (1.5, 9.5, 1)}),
            )
        }
    )
    build_radio_map(low, 0.5)
    with pytest.raises(
        ValueError, match=r"an antenna at \(1.5, 9.5, 1.0\) m coincides with the centre of a cell"
    ):
        build_radio_map(low, 1.0)


# --- maps from elsewhere --------------------------------------------------------------------------


def sample() -> RadioMap:
    gain_db = np.random.default_rng(0).normal(-60, 5, (7, 4))
    gain_db[2, 1:3] = -inf
    return RadioMap.from_array(gain_db, 0.3, (-1.1, 2.7))


def test_a_map_keeps_its_own_numbers():
    source = np.zeros((2, 3))
    radio_map = RadioMap.from_array(source, 1.0)
    source[:] = 5
    assert not radio_map.gain_db.any()
    with pytest.raises(ValueError, match="read-only"):
        radio_map.gain_db[0, 0] = 1


def test_a_map_from_an_array_lies_where_it_is_told():
    assert sample().grid == Grid((7, 4), 0.3, (-1.1, 2.7))
    assert RadioMap.from_array([[1, 2], [3, 4]], 1, [0, 0]).gain_db.dtype == np.float64
    assert RadioMap.from_array(np.float32([[1]]), np.float32(0.5), np.zeros(2)).grid == Grid(
        (1, 1), 0.5, (0.0, 0.0)
    )


def test_a_cell_at_the_target_is_feasible_and_an_obstacle_never_is():
    radio_map = RadioMap.from_array([[-60.0, np.nextafter(-60.0, -inf)], [-inf, -59.0]], 1.0)
    assert radio_map.free.tolist() == [[True, True], [False, True]]
    assert radio_map.feasible(-60.0).tolist() == [[True, False], [False, True]]
    assert radio_map.feasible(-inf).tolist() == radio_map.free.tolist()
    assert not radio_map.feasible(inf).any()


def test_a_target_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="target_db is NaN"):
        sample().feasible(nan)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[nan, 1.0]], 0.5), r"gain_db holds NaN or \+inf"),
        (([[inf, 1.0]], 0.5), r"gain_db holds NaN or \+inf"),
        (([1.0, 2.0], 0.5), r"gain_db has the shape \(2,\), but a map has two axes"),
        ((np.zeros((2, 2, 2)), 0.5), r"gain_db has the shape \(2, 2, 2\), but a map has two axes"),
        ((-60.0, 0.5), r"gain_db has the shape \(\), but a map has two axes"),
        ((np.zeros((0, 3)), 0.5), r"gain_db has the shape \(0, 3\)"),
        ((np.zeros((2, 2), complex), 0.5), "gain_db holds values of the type complex128"),
        ((np.zeros((2, 2), bool), 0.5), "gain_db holds values of the type bool"),
        (([[None, 1.0]], 0.5), "gain_db holds values of the type object"),
        (([["-60"]], 0.5), "gain_db holds values of the type <U3"),
        (([[0.0]], 0.0), r"cell_size=0.0 must be a positive number"),
        (([[0.0]], nan), "cell_size=nan must be a positive number"),
        (([[0.0]], "0.5"), r"cell_size='0.5' must be a positive number"),
        (([[0.0]], 0.5, (0.0, nan)), r"origin=\(0.0, nan\) must be two finite numbers"),
        (([[0.0]], 0.5, (0.0, 1.0, 2.0)), r"origin=.* must be two finite numbers"),
    ],
)
def test_an_array_that_is_no_map_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        RadioMap.from_array(*arguments)


def test_a_map_must_have_the_shape_of_its_grid():
    with pytest.raises(ValueError, match=r"gain_db has the shape \(3, 2\), the grid \(2, 3\)"):
        RadioMap(np.zeros((3, 2)), grid=Grid((2, 3), 1.0, (0.0, 0.0)))
    with pytest.raises(ValueError, match=r"gain_db holds NaN or \+inf"):
        RadioMap(np.full((2, 3), nan), grid=Grid((2, 3), 1.0, (0.0, 0.0)))


# --- files ----------------------------------------------------------------------------------------


def stored(tmp_path, **changes):
    """A map file with other arrays; None leaves one out."""
    arrays = {
        "format_version": 1,
        "gain_db": np.zeros((2, 3)),
        "cell_size": 0.5,
        "origin": np.zeros(2),
        **changes,
    }
    path = tmp_path / "map.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


@pytest.mark.parametrize("radio_map", [sample(), build_radio_map()], ids=["sample", "paper"])
def test_a_saved_map_loads_bit_for_bit(radio_map, tmp_path):
    radio_map.save(tmp_path / "map.npz")
    again = RadioMap.load(tmp_path / "map.npz")
    assert again.gain_db.tobytes() == radio_map.gain_db.tobytes()
    assert again.grid == radio_map.grid
    assert os.listdir(tmp_path) == ["map.npz"]


def test_a_map_is_saved_under_the_very_name_it_is_given(tmp_path):
    sample().save(str(tmp_path / "map"))
    assert os.listdir(tmp_path) == ["map"]
    assert RadioMap.load(str(tmp_path / "map")).grid == sample().grid


@pytest.mark.parametrize("step", ["replace", "write"])
def test_a_save_that_fails_leaves_the_old_map(step, tmp_path, monkeypatch):
    path = tmp_path / "map.npz"
    sample().save(path)
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(
        *{"replace": (os, "replace"), "write": (np, "savez_compressed")}[step], fail
    )
    with pytest.raises(OSError, match="no space left"):
        build_radio_map(cell_size=1.0).save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["map.npz"]


@pytest.mark.parametrize(
    "content", [b"", b"garbage", b"PK\x03\x04 and then nothing", b"\x93NUMPY\x01\x00"]
)
def test_garbage_is_no_map(content, tmp_path):
    (tmp_path / "map.npz").write_bytes(content)
    with pytest.raises(
        ValueError, match=r"map.npz' is not a radio map: it is not a whole npz archive"
    ):
        RadioMap.load(tmp_path / "map.npz")


def test_a_map_cut_short_is_refused_wherever_the_cut_is(tmp_path):
    path = tmp_path / "map.npz"
    sample().save(path)
    whole = path.read_bytes()
    for length in range(0, len(whole), 3):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="is not a radio map"):
            RadioMap.load(path)


def test_a_damaged_map_is_refused_or_still_the_same(tmp_path):
    path = tmp_path / "map.npz"
    sample().save(path)
    whole, refused = path.read_bytes(), 0
    for place in range(0, len(whole), 2):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            same = RadioMap.load(path).gain_db.tobytes() == sample().gain_db.tobytes()
        except ValueError as error:
            same, refused = "is not a radio map" in str(error), refused + 1
        assert same, place
    assert refused > len(whole) / 4


class Burglar:
    """Breaks in when unpickled."""

    def __reduce__(self):
        return os.mkdir, (self.folder,)

    def __init__(self, folder):
        self.folder = str(folder)


@pytest.mark.parametrize("field", ["gain_db", "format_version", "cell_size", "origin"])
def test_a_map_file_is_never_unpickled(field, tmp_path):
    path = stored(tmp_path, **{field: np.array([[Burglar(tmp_path / "broken in")]], dtype=object)})
    with pytest.raises(ValueError, match=r"is not a radio map: .*allow_pickle=False"):
        RadioMap.load(path)
    assert os.listdir(tmp_path) == ["map.npz"]


def test_a_pickle_in_place_of_a_map_is_never_unpickled(tmp_path):
    (tmp_path / "map.npz").write_bytes(pickle.dumps(Burglar(tmp_path / "broken in")))
    with pytest.raises(ValueError, match="is not a radio map"):
        RadioMap.load(tmp_path / "map.npz")
    assert os.listdir(tmp_path) == ["map.npz"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format_version": 2}, "format_version is 2, and 1 is read here"),
        ({"format_version": None}, "format_version"),
        ({"gain_db": None}, "gain_db is not a file"),
        ({"origin": None}, "origin is not a file"),
        ({"gain_db": np.full((2, 2), nan)}, r"gain_db holds NaN or \+inf"),
        ({"gain_db": np.full((2, 2), inf)}, r"gain_db holds NaN or \+inf"),
        ({"gain_db": np.zeros(4)}, "two axes"),
        ({"gain_db": np.array([["a"]])}, "type <U1"),
        ({"cell_size": -1.0}, r"cell_size=-1.0 must be a positive number"),
        ({"cell_size": nan}, "cell_size=nan must be a positive number"),
        ({"cell_size": np.ones(2)}, "scalar"),
        ({"origin": np.zeros(3)}, "origin=.* must be two finite numbers"),
        ({"origin": np.array([0, nan])}, "origin=.* must be two finite numbers"),
        ({"origin": 0.0}, "origin=0.0 must be two finite numbers"),
    ],
)
def test_an_archive_of_other_arrays_is_no_map(change, message, tmp_path):
    with pytest.raises(ValueError, match=f"map.npz' is not a radio map: .*{message}"):
        RadioMap.load(stored(tmp_path, **change))


def test_a_map_that_is_not_there_is_said_so(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no-such-map\.npz"):
        RadioMap.load(tmp_path / "no-such-map.npz")
