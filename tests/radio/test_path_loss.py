"""Facts of path loss: the presets against the table of TR 38.901, free space, walls that count."""

from math import log10

import numpy as np
import pytest

from irs_gym import build_radio_map
from irs_gym.radio.path_loss import PRESETS, MultiWall, formulas_of
from irs_gym.radio.propagation import link, path_loss_db
from irs_gym.radio.scene import Scene, load_scene
from irs_gym.units import wavelength_m

PAPER = load_scene("paper")

# 3GPP TR 38.901, table 7.4.1-1, as it is printed: d in metres, f in GHz
LOS_INF = lambda d, f: 31.84 + 21.50 * log10(d) + 19.00 * log10(f)  # noqa: E731
LOS_INH = lambda d, f: 32.4 + 17.3 * log10(d) + 20 * log10(f)  # noqa: E731
SL = lambda d, f: 33 + 25.5 * log10(d) + 20 * log10(f)  # noqa: E731
TABLE = {
    "InF-SL": (LOS_INF, lambda d, f: max(SL(d, f), LOS_INF(d, f))),
    "InF-DL": (
        LOS_INF,
        lambda d, f: max(18.6 + 35.7 * log10(d) + 20 * log10(f), LOS_INF(d, f), SL(d, f)),
    ),
    "InF-SH": (
        LOS_INF,
        lambda d, f: max(32.4 + 23.0 * log10(d) + 20 * log10(f), LOS_INF(d, f)),
    ),
    "InF-DH": (
        LOS_INF,
        lambda d, f: max(33.63 + 21.9 * log10(d) + 20 * log10(f), LOS_INF(d, f)),
    ),
    "InH-Office": (
        LOS_INH,
        lambda d, f: max(38.3 * log10(d) + 17.30 + 24.9 * log10(f), LOS_INH(d, f)),
    ),
}


def scene(path_loss, **more):
    return Scene.from_data({**PAPER.to_data(), "format_version": 2, "path_loss": path_loss, **more})


@pytest.mark.parametrize("name", TABLE)
@pytest.mark.parametrize("carrier_ghz", [0.5, 2.0, 3.5, 28.0, 100.0])
def test_a_preset_is_the_tables(name, carrier_ghz):
    for distance in (1.0, 2.5, 10.0, 40.0, 150.0, 600.0):
        for is_clear, formula in zip((True, False), TABLE[name], strict=True):
            loss_db = path_loss_db(distance, np.array(is_clear), name, carrier_ghz)
            assert loss_db == pytest.approx(formula(distance, carrier_ghz), abs=1e-12)


def test_every_preset_is_tested_here():
    assert {*TABLE, "free-space"} == {*PRESETS}


def test_values_of_the_table_worked_by_hand():
    # 100 m at 1 GHz: log10 d = 2, log10 f = 0
    losses = {name: float(path_loss_db(100.0, np.array(False), name, 1.0)) for name in TABLE}
    assert losses == pytest.approx(
        {"InF-SL": 84.0, "InF-DL": 90.0, "InF-SH": 78.4, "InF-DH": 77.43, "InH-Office": 93.9}
    )
    # near by, the sparse hall is worse than the dense one, and holds for it
    assert path_loss_db(10.0, np.array(False), "InF-DL", 1.0) == pytest.approx(58.5)


def test_free_space_is_friis_with_sight_and_without():
    for distance, carrier_ghz in ((1.0, 1.0), (7.3, 2.0), (120.0, 60.0)):
        friis = 20 * log10(4 * np.pi * distance / wavelength_m(carrier_ghz))
        for is_clear in (True, False):
            loss_db = path_loss_db(distance, np.array(is_clear), "free-space", carrier_ghz)
            assert loss_db == pytest.approx(friis, abs=1e-12)


def test_the_papers_coefficients_are_the_preset_of_a_sparse_hall_with_high_antennas():
    assert formulas_of(PAPER.path_loss) == formulas_of("InF-SH")
    by_name = build_radio_map(scene("InF-SH"))
    assert (by_name.gain_db == build_radio_map(PAPER).gain_db).all()


WALLS = [
    {"center": [-2, 0], "size": [0.1, 8, 3]},
    {"polygon": [[0, -4], [0.2, -4], [1, 4], [0.8, 4]], "height": 3},
    {"origin": [2, -4], "cell_size": 0.25, "rows": ["#"] * 32, "height": 3},
    {"polygon": [[3, -4], [6, -4], [6, 4], [5, 4], [5, -3], [4, -3], [4, 4], [3, 4]], "height": 3},
]


@pytest.mark.parametrize(
    ("end", "walls"),
    [
        ((-5, 0, 1.0), 0),
        ((-1, 0, 1.0), 1),
        ((1.5, 0, 1.0), 2),
        ((2.5, 0, 1.0), 3),
        ((4.5, 0, 1.0), 4),
        ((7, 0, 1.0), 5),  # both legs of the last
        ((7, 0, 3.5), 4),  # rises over their tops at 3 m from x = 4.4 on, behind one of these
    ],
)
def test_each_wall_in_the_way_costs_as_much(end, walls):
    rooms = scene({"wall_loss_db": 3.4}, obstacles=WALLS, start=[-9, -9], goal=[9, 9])
    start = np.array([-6.0, 0.0, 1.0])
    found = link(rooms, start, end)
    free_db = path_loss_db(found.distance_m, np.array(True), "free-space", rooms.carrier_ghz)
    assert -10 * np.log10(found.path_gain) == pytest.approx(free_db + 3.4 * walls, abs=1e-9)
    assert (found.rician_factor > 0) == (walls == 0)


def test_walls_of_no_loss_are_free_space_but_for_the_sight():
    rooms = scene({"wall_loss_db": 0.0}, obstacles=WALLS, start=[-9, -9], goal=[9, 9])
    named = scene("free-space", obstacles=WALLS, start=[-9, -9], goal=[9, 9])
    assert np.allclose(
        build_radio_map(rooms, 1.0).gain_db, build_radio_map(named, 1.0).gain_db, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("path_loss", "message"),
    [
        ("InF-XX", r"path_loss: Input should be 'InF-SL'.* \(got 'InF-XX'\)"),
        ({"wall_loss_db": -1.0}, r"path_loss\.wall_loss_db: .* greater than or equal to 0"),
        ({"wall_loss_db": 3.0, "floors": 2}, r"path_loss\.floors: Extra inputs"),
        (3.0, r"path_loss: .*object"),
        (None, r"path_loss: .*object"),
    ],
)
def test_a_model_that_is_none_is_named(path_loss, message):
    with pytest.raises(ValueError, match=message):
        scene(path_loss)


def test_a_model_survives_the_round_trip():
    for model in ("InH-Office", {"wall_loss_db": 6.9}):
        made = scene(model)
        assert Scene.from_data(made.to_data()) == made
    assert scene({"wall_loss_db": 6.9}).path_loss == MultiWall(wall_loss_db=6.9)
