from types import SimpleNamespace

import numpy as np
import pytest

from irs_gym import from_sionna


def traced(gains, cell_size=(0.5, 0.5), first=(-9.75, -4.75, 1.0), along=(1.0, 0.0), up=0.0):
    """What Sionna returns for a plane: gains (transmitters, Y, X), in single precision, rows along
    ``along``.
    """
    gains = np.asarray(gains, dtype=np.float32)
    y, x = np.indices(gains.shape[1:])
    across = (-along[1], along[0])
    centres = np.stack(
        [
            first[0] + cell_size[0] * (x * along[0] + y * across[0]),
            first[1] + cell_size[1] * (x * along[1] + y * across[1]),
            first[2] + up * x,
        ],
        axis=-1,
    )
    return SimpleNamespace(
        path_gain=gains,
        cell_centers=centres.astype(np.float32),
        cell_size=np.float32(cell_size).reshape(2, 1),
    )


def test_axes_are_turned_to_x_first_and_gains_to_decibels():
    radio_map = from_sionna(
        traced([[[1e-6, 1e-7, 1e-8], [1e-3, 1e-4, 1e-5]]])
    )  # 3 cells along x, 2 along y
    np.testing.assert_allclose(radio_map.gain_db, [[-60, -30], [-70, -40], [-80, -50]], atol=1e-5)


def test_grid_is_that_of_the_cell_centres_without_the_rounding_of_single_precision():
    radio_map = from_sionna(
        traced(np.ones((1, 20, 40)), cell_size=(0.1, 0.1), first=(-1.95, 0.35, 1.0))
    )
    assert radio_map.grid.cell_size == 0.1
    assert radio_map.grid.origin == (-2.0, 0.3)
    assert radio_map.grid.shape == (40, 20)


def test_each_cell_is_served_by_the_best_transmitter():
    radio_map = from_sionna(traced([[[1e-6, 1e-7]], [[1e-8, 1e-5]]]))
    np.testing.assert_allclose(radio_map.gain_db[:, 0], [-60, -50], atol=1e-5)


def test_a_free_cell_without_any_path_stays_free_and_receives_nothing():
    free = np.array([[True, True], [False, True]])
    radio_map = from_sionna(traced([[[1e-6, 1e-6], [0.0, 1e-6]]]), free)
    np.testing.assert_array_equal(radio_map.free, free)
    np.testing.assert_allclose(radio_map.gain_db, [[-60, -np.inf], [-np.inf, -60]], atol=1e-5)
    assert radio_map.feasible(-100.0).tolist() == [[True, False], [False, True]]


def test_without_free_cells_told_those_without_any_path_are_blocked():
    radio_map = from_sionna(traced([[[1e-6, 1e-6], [0.0, 1e-6]]]))
    assert radio_map.free.tolist() == [[True, False], [True, True]]


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (traced(np.ones((1, 4, 4)), along=(0.6, 0.8)), "horizontal"),
        (traced(np.ones((1, 4, 4)), up=0.1), "horizontal"),
        (traced(np.ones((1, 4, 4)), along=(-1.0, 0.0)), "horizontal"),
        (traced(np.ones((1, 4, 4)), cell_size=(0.5, 0.25)), r"cell_size=\[0.5, 0.25\]"),
        (traced(-np.ones((1, 4, 4))), "path_gain"),
        (traced(np.full((1, 4, 4), np.nan)), "path_gain"),
        (traced(np.ones((0, 4, 4))), "path_gain"),
        (
            SimpleNamespace(**vars(traced(np.ones((1, 4, 4)))) | {"path_gain": np.ones((4, 4))}),
            "path_gain",
        ),
        (
            SimpleNamespace(**vars(traced(np.ones((1, 4, 4)))) | {"path_gain": np.ones((1, 3, 4))}),
            "cell_centers",
        ),
    ],
)
def test_a_result_that_is_no_map_of_square_cells_on_the_floor_is_refused(result, message):
    with pytest.raises(ValueError, match=message):
        from_sionna(result)


def test_a_mesh_radio_map_is_refused_by_what_it_lacks():
    with pytest.raises(TypeError, match="SimpleNamespace has no cell_centers, cell_size"):
        from_sionna(SimpleNamespace(path_gain=np.ones((1, 10))))


@pytest.mark.parametrize("free", [np.ones((3, 2), bool), np.ones((2, 3))])
def test_free_cells_of_another_shape_or_type_are_refused(free):
    with pytest.raises(ValueError, match=r"free must be an array of bools .* \(2, 3\)"):
        from_sionna(traced(np.ones((1, 3, 2))), free)


def test_map_traced_by_sionna_itself_is_that_of_free_space_around_the_transmitter():
    sionna = pytest.importorskip(
        "sionna.rt", reason="sionna-rt, an optional extra, is not installed"
    )
    scene = sionna.load_scene()  # nothing but the transmitter
    scene.frequency = 2e9
    scene.tx_array = scene.rx_array = sionna.PlanarArray(
        num_rows=1, num_cols=1, pattern="iso", polarization="V"
    )
    scene.add(sionna.Transmitter("tx", position=[3.0, -1.0, 21.0]))
    plane = {
        "center": [1.0, 2.0, 1.0],
        "orientation": [0.0, 0.0, 0.0],
        "size": [20.0, 10.0],
        "cell_size": [0.5, 0.5],
    }
    result = sionna.RadioMapSolver()(scene, **plane, samples_per_tx=10**7, max_depth=0)
    radio_map = from_sionna(result)
    assert radio_map.grid.shape == (40, 20)
    assert (radio_map.grid.cell_size, radio_map.grid.origin) == (0.5, (-9.0, -3.0))
    distance = np.hypot(np.linalg.norm(radio_map.grid.centres() - [3.0, -1.0], axis=-1), 20.0)
    free_space_db = 20 * np.log10(299792458 / 2e9 / (4 * np.pi * distance))
    assert (
        np.abs(radio_map.gain_db - free_space_db).max() < 0.5
    )  # rays are counted, so each cell has some noise
    assert abs(np.mean(radio_map.gain_db - free_space_db)) < 0.02
