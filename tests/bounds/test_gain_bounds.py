"""Facts of the gain over whole cells: no point of one has less or more."""

import numpy as np
import pytest

from irs_gym import Scene, generate_scene, load_scene
from irs_gym.bounds.gain_bounds import GainBounds
from irs_gym.radio.irs import Hardware
from irs_gym.radio.radio_map import serve

PAPER = load_scene("paper")


def with_changes(**changes):
    """The paper's scene with other values, written as a scene file has them."""
    return Scene.from_data({**PAPER.to_data(), "format_version": 2, **changes})


def panel(**changes):
    return {**PAPER.to_data()["irs_panels"][0], **changes}


SCENES = {
    "paper": PAPER,
    "without IRS": PAPER.with_irs_elements(0),
    "many elements along the wall": with_changes(
        irs_panels=[panel(elements_per_subsurface=[20, 20], pitch_wavelengths=0.5)]
    ),
    "a panel at an angle, below the antenna": with_changes(
        irs_panels=[panel(wall=30.0, position=[6.0, -9.0, 0.5], elements_per_subsurface=[7, 3])]
    ),
    "two of each": load_scene("workshop"),
    "an access point below the boxes' tops": with_changes(
        access_points=[{"position": [0.5, 8.0, 0.7]}]
    ),
    "an access point at the antenna's height": with_changes(
        access_points=[{"position": [0.5, 8.0, 1.0]}]
    ),
    "an antenna above the boxes": with_changes(antenna_height=1.6),
    "polygons and a raster": with_changes(
        obstacles=[
            {"polygon": [[-5.0, -5.0], [0.0, -6.0], [-1.0, 1.0], [-2.5, -3.0]], "height": 1.5},
            {"polygon": [[3.0, 0.0], [7.0, 1.0], [4.0, 6.0]], "height": 3.0},
            {"origin": [-8.0, 3.0], "cell_size": 1.0, "rows": ["##.", ".##"], "height": 1.4},
        ]
    ),
    "a generated room": generate_scene(np.random.default_rng(3)),
    "path loss by name": with_changes(path_loss="InF-DH"),
    "no line-of-sight part": with_changes(rician_factor_db=-300.0),
}
HARDWARE = {
    "continuous": Hardware(),
    "coherent": Hardware(array_model="coherent"),
    "1 bit": Hardware(1),
    "3 bits": Hardware(3),
    "2 bits, the best": Hardware(2, "optimal"),
}


def points_in(cells, count, rng):
    """Corners and points at random of each cell, shape ``(4 + count, n, 2)``."""
    shares = rng.random((count, len(cells), 2))
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])[:, None] * np.ones((1, len(cells), 1))
    shares = np.concatenate([corners, shares])
    return cells[:, :2] * (1 - shares) + cells[:, 2:] * shares


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("hardware", HARDWARE.values(), ids=HARDWARE)
def test_no_point_of_a_cell_has_a_gain_beyond_its_bounds(scene, hardware):
    rng = np.random.default_rng(0)
    bounds = GainBounds(scene, hardware)
    low = np.array(scene.room.lower)
    high = np.array(scene.room.upper)
    sizes = 10.0 ** rng.uniform(-4, 0, 300)
    corners = rng.uniform(low, high - sizes[:, None], (300, 2))
    cells = np.concatenate([corners, corners + sizes[:, None]], axis=1)
    least, most = bounds.over(cells)
    points = points_in(cells, 12, rng)
    positions = np.concatenate([points, np.full((*points.shape[:2], 1), scene.antenna_height)], 2)
    gains, _, _ = serve(scene, hardware, positions.reshape(-1, 3), needs_shifts=False)
    gains = gains.reshape(points.shape[:2])

    assert np.all((least <= gains) & (gains <= most))


def test_bounds_meet_as_cells_shrink_wherever_all_of_one_sees_the_same():
    rng = np.random.default_rng(1)
    corners = rng.uniform(-10, 10 - 1e-4, (2000, 2))
    least, most = GainBounds(PAPER, Hardware()).over(
        np.concatenate([corners, corners + 1e-4], axis=1)
    )
    apart_db = 10 * np.log10(most / least)
    assert np.mean(apart_db < 0.01) > 0.99


def test_a_cell_on_the_edge_of_a_shadow_has_both_gains():
    # a map of small cells has a jump of 3.7 dB in x = -7.15 along y = 2.25
    bounds = GainBounds(PAPER, Hardware())
    across, beside = np.array([[-7.4, 2.0, -6.9, 2.5]]), np.array([[-6.9, 2.0, -6.4, 2.5]])
    least, most = bounds.over(across)
    assert 10 * np.log10(most / least) > 3
    least, most = bounds.over(beside)
    assert 10 * np.log10(most / least) < 2


def test_cells_along_the_sides_of_a_box_are_told_apart_from_their_other_side():
    # a cell that only touches a box is neither in its shadow nor half in it on the side that sees
    bounds = GainBounds(PAPER.with_irs_elements(0), Hardware())
    front = np.array([[-0.1, 2.0, 0.0, 2.01]])  # of the box at the origin, towards the AP
    behind = np.array([[-0.1, -2.01, 0.0, -2.0]])
    for cell in (front, behind):
        least, most = bounds.over(cell)
        assert 10 * np.log10(most / least) < 0.1
