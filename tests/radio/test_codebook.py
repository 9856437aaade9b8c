"""Facts of codebooks: gains equal to a sum over elements and to Monte Carlo means, designs that are
what they say, files that hold nothing else.
"""

import os
from cmath import exp
from fractions import Fraction
from math import inf, log10, nan, pi

import numpy as np
import pytest
from test_irs import HALLS, at, monte_carlo, standard_errors
from test_radio_map import (
    FACTORY,
    MODELS,
    PAPER,
    Burglar,
    reference_cells,
    reference_channel,
)

from irs_gym import (
    Codebook,
    build_phase_shifts,
    build_radio_map,
    codebook_gain_db,
    dft_codebook,
    focused_codebook,
)
from irs_gym.memory import VARIABLE
from irs_gym.radio.codebook import radio_hash
from irs_gym.radio.scene import load_scene


def drawn(scene, size=3, seed=0, irs_elements=None) -> Codebook:
    """A codebook of phase shifts drawn from beyond one turn."""
    panels = scene.with_irs_elements(irs_elements).irs_panels
    rng = np.random.default_rng(seed)
    shifts = rng.uniform(-9, 9, (size, sum(panel.subsurfaces for panel in panels)))
    return Codebook.from_array(shifts, scene, irs_elements)


# --- gains ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("scene", "cell_size", "stride"), [(PAPER, "1/2", 23), (FACTORY, "2/5", 7), (FACTORY, "1", 1)]
)
def test_gains_equal_a_sum_over_all_elements(scene, cell_size, stride, model):
    codebook = drawn(scene)
    gain_db = codebook_gain_db(scene, codebook, float(Fraction(cell_size)), array_model=model)

    for cell, robot in reference_cells(scene, cell_size, stride).items():
        for k, shifts in enumerate(codebook.phase_shifts.tolist()):
            if robot is None:
                assert gain_db[k][cell] == -inf
                continue
            expected = max(
                abs(h + sum(w * exp(1j * turn) for w, turn in zip(reflected, shifts, strict=True)))
                ** 2
                + tau
                for h, reflected, tau in reference_channel(scene, robot, model)
            )
            assert gain_db[k][cell] == pytest.approx(10 * log10(expected), abs=1e-9)


@pytest.mark.parametrize("name", HALLS)
def test_gains_equal_monte_carlo_means(name):
    scene, rng = HALLS[name], np.random.default_rng(3)
    codebook = drawn(scene, size=2, seed=1)
    gain = 10 ** (codebook_gain_db(scene, codebook, 1.0) / 10)
    for k, cell in np.ndindex(2, 16):
        place = divmod(cell, 4)
        draws = monte_carlo(scene, at(scene, place), codebook.phase_shifts[k], 2500, rng)
        assert abs(standard_errors(draws, gain[k][place])) < 4, (k, place)


def test_gains_are_those_of_all_cells_however_they_are_blocked(monkeypatch):
    codebook = drawn(FACTORY, size=5)
    whole = codebook_gain_db(FACTORY, codebook, 0.4)
    monkeypatch.setattr("irs_gym.radio.radio_map.BLOCK", 64)
    np.testing.assert_allclose(codebook_gain_db(FACTORY, codebook, 0.4), whole, rtol=0, atol=1e-11)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("scene", [PAPER, FACTORY], ids=lambda scene: scene.name)
@pytest.mark.parametrize(("bits", "quantiser"), [(None, "nearest"), (2, "optimal")])
def test_a_focused_configuration_gives_its_cell_what_the_map_says(scene, bits, quantiser, model):
    radio_map = build_radio_map(scene, 1.0, None, bits, quantiser, model)
    cells = np.argwhere(radio_map.free)[::3]
    codebook = focused_codebook(scene, cells, 1.0, None, bits, quantiser, model)
    gain_db = codebook_gain_db(scene, codebook, 1.0, array_model=model)
    own = gain_db[np.arange(len(cells)), cells[:, 0], cells[:, 1]]

    np.testing.assert_allclose(own, radio_map.gain_db[tuple(cells.T)], rtol=0, atol=1e-9)
    # and no cell more than its own best configuration: the optimal one of any resolution
    assert np.all(gain_db <= radio_map.gain_db + 1e-9)


def test_a_panel_of_other_elements_has_codebooks_of_its_own():
    few = focused_codebook(PAPER, [(4, 20)], irs_elements=400)
    radio_map = build_radio_map(PAPER, irs_elements=400)
    gain_db = codebook_gain_db(PAPER, few, irs_elements=400)
    assert gain_db[0, 4, 20] == pytest.approx(radio_map.gain_db[4, 20], abs=1e-9)
    with pytest.raises(ValueError, match=r"shifts of 20 sub-surfaces, but the panels .* have 60"):
        codebook_gain_db(PAPER, few)


# --- designs --------------------------------------------------------------------------------------


def test_focused_configurations_are_the_phase_shifts_of_the_map():
    shifts = build_phase_shifts(FACTORY, 1.0, phase_bits=3)
    cells = [tuple(cell) for cell in np.argwhere(shifts.any(axis=2))[::9].tolist()]
    codebook = focused_codebook(FACTORY, cells, 1.0, phase_bits=3)
    for k, cell in enumerate(cells):
        np.testing.assert_allclose(codebook.phase_shifts[k], shifts[cell], atol=1e-6)


def test_the_reference_phase_is_zero_where_the_access_point_is_blocked():
    blocked = {}
    for cell, robot in reference_cells(PAPER, "1/2", 11).items():
        ((direct, reflected, _),) = (
            reference_channel(PAPER, robot, "far_field") if robot else [(1, [], 0)]
        )
        if direct == 0:
            blocked[cell] = np.array(reflected)

    codebook = focused_codebook(PAPER, list(blocked))
    assert len(blocked) > 20
    for reflected, shifts in zip(blocked.values(), codebook.phase_shifts, strict=True):
        # all parts arrive with the phase 0
        np.testing.assert_allclose(
            reflected * np.exp(1j * shifts), np.abs(reflected), rtol=0, atol=1e-15
        )


def test_beams_steer_a_line_of_elements_evenly_over_all_directions():
    panel = {**PAPER.irs_panels[0].model_dump(), "columns": 16, "rows": 1}
    line = PAPER.model_validate(
        {
            **PAPER.model_dump(),
            "irs_panels": [{**panel, "elements_per_subsurface": (1, 1), "pitch_wavelengths": 0.5}],
        }
    )
    # half a wavelength apart: the discrete Fourier transform
    vectors = np.exp(1j * dft_codebook(line, 16).phase_shifts)
    np.testing.assert_allclose(vectors @ vectors.conj().T, 16 * np.eye(16), atol=1e-10)


def test_beams_of_elements_close_together_steer_where_plane_waves_go_alone():
    # 10 columns a tenth of a wavelength apart: 2 k apart is 0.8 half turns
    steps = np.diff(dft_codebook(PAPER, 5).phase_shifts.reshape(5, 10, 6), axis=1)
    wrapped = (steps + pi) % (2 * pi) - pi
    np.testing.assert_allclose(
        wrapped, np.broadcast_to(0.16 * pi * np.arange(-2, 3)[:, None, None], (5, 9, 6)), atol=1e-12
    )


@pytest.mark.parametrize(("size", "up"), [(1, 1), (7, 1), (8, 2), (16, 4), (64, 4), (36, 6)])
def test_beams_differ_along_the_wall_and_up(size, up):
    shifts = dft_codebook(PAPER, size).phase_shifts.reshape(size, 10, 6)
    assert len(np.unique(shifts.round(9), axis=0)) == size
    assert len(np.unique(np.exp(1j * (shifts[:, 0, 1] - shifts[:, 0, 0])).round(9))) == up


def test_beams_of_several_panels_are_beams_of_each():
    shifts = dft_codebook(FACTORY, 6).phase_shifts
    for n, part in enumerate([shifts[:, :15], shifts[:, 15:]]):
        alone = FACTORY.model_copy(update={"irs_panels": (FACTORY.irs_panels[n],)})
        assert np.array_equal(part, dft_codebook(alone, 6).phase_shifts)


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_quantised_codebooks_hold_levels(bits):
    beams = dft_codebook(PAPER, 16, phase_bits=bits)
    free = dft_codebook(PAPER, 16)
    step = 2 * pi / 2**bits
    for codebook in (beams, focused_codebook(PAPER, [(0, 20), (30, 3)], phase_bits=bits)):
        levels = codebook.phase_shifts / step
        assert np.array_equal(levels, np.rint(levels))
        assert levels.max() < 2**bits
    apart = np.abs((beams.phase_shifts - free.phase_shifts + pi) % (2 * pi) - pi)
    assert apart.max() <= step / 2 + 1e-12
    printed = dft_codebook(PAPER, 16, phase_bits=bits, quantiser="as_printed").phase_shifts
    assert np.abs(printed - free.phase_shifts).max() < step


def test_a_scenes_own_resolution_is_the_default():
    coarse = PAPER.model_copy(update={"phase_bits": 1})
    for codebook in (dft_codebook(coarse, 9), focused_codebook(coarse, [(0, 20)])):
        assert set(np.unique(codebook.phase_shifts)) == {0.0, pi}


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shifts", "message"),
    [
        ([[nan] * 60], "phase_shifts holds NaN or inf"),
        ([[inf] * 60], "phase_shifts holds NaN or inf"),
        ([["a"] * 60], "type <U1"),
        ([[1j] * 60], "type complex128"),
        ([[None] * 60], "type object"),
        ([[True] * 60], "type bool"),
        (np.zeros((0, 60)), r"shape \(0, 60\)"),
        (np.zeros((2, 0)), r"shape \(2, 0\)"),
        (np.zeros(60), r"shape \(60,\)"),
        ([[0.0], [0.0, 1.0]], "phase_shifts is no array"),
        (np.zeros((2, 59)), "shifts of 59 sub-surfaces, but the panels of scene 'paper' have 60"),
    ],
)
def test_phase_shifts_that_are_none_are_refused(shifts, message):
    with pytest.raises(ValueError, match=message):
        Codebook.from_array(shifts, "paper")


def test_a_codebook_of_another_scene_or_panel_is_refused():
    codebook = dft_codebook(PAPER, 2)
    panel = PAPER.irs_panels[0]
    others = {
        "irs_panels": (panel.model_copy(update={"pitch_wavelengths": 0.2}),),
        "obstacles": PAPER.obstacles[1:],
        "carrier_ghz": 3.0,
        "antenna_height": 1.3,
    }
    for field, value in others.items():
        with pytest.raises(ValueError, match="codebook: it was made for another scene or panel"):
            codebook_gain_db(PAPER.model_copy(update={field: value}), codebook)
    with pytest.raises(ValueError, match="must be a Codebook"):
        codebook_gain_db(PAPER, codebook.phase_shifts)


def test_a_scene_with_another_task_is_the_same_to_a_codebook():
    task = {"name": "b", "start": (0.0, 9.0), "goal": (1.0, 9.0), "target_db": -70.0}
    assert radio_hash(PAPER.model_copy(update=task)) == radio_hash(load_scene("paper"))


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([], "cells holds none"),
        (np.zeros((0, 2), int), "cells holds none"),
        ([(0, 40)], r"cells\[0\]=\(0, 40\) lies off the map"),
        ([(0, 20), (-1, 0)], r"cells\[1\]=\(-1, 0\) lies off the map"),
        ([(0, 20), (0.5, 1)], r"cells\[1\]=\(0.5, 1\) must be a cell"),
        ([3], r"cells\[0\]=3 must be a cell"),
        (None, "cells=None must be a list of cells"),
        ("ab", r"cells\[0\]='a' must be a cell"),
    ],
)
def test_cells_that_cannot_be_focused_on_are_refused(cells, message):
    with pytest.raises(ValueError, match=message):
        focused_codebook("paper", cells)


def test_a_cell_inside_an_obstacle_cannot_be_focused_on():
    blocked = [tuple(cell) for cell in np.argwhere(~build_radio_map().free).tolist()]
    with pytest.raises(ValueError, match=r"cells\[1\]=.* lies inside an obstacle"):
        focused_codebook("paper", [(0, 20), blocked[0]])


@pytest.mark.parametrize("size", [0, -1, 1.5, True, "4", None, nan])
def test_a_size_that_is_none_is_refused(size):
    with pytest.raises(ValueError, match=r"size=.* must be a positive number of configurations"):
        dft_codebook("paper", size)


def test_a_scene_without_a_panel_has_no_codebook():
    for make in (
        lambda: dft_codebook("paper", 4, irs_elements=0),
        lambda: focused_codebook("paper", [(0, 0)], irs_elements=0),
        lambda: codebook_gain_db("paper", dft_codebook("paper", 4), irs_elements=0),
    ):
        with pytest.raises(ValueError, match="has no IRS panel to configure"):
            make()


def test_work_beyond_memory_is_refused_before_it_begins(monkeypatch):
    codebook = dft_codebook("paper", 64)
    monkeypatch.setenv(VARIABLE, "1GiB")
    with pytest.raises(ValueError, match=r"codebook: .* would take"):
        codebook_gain_db("paper", codebook, cell_size=0.01)
    with pytest.raises(ValueError, match=r"size=10{9}: .* would take"):
        dft_codebook("paper", 10**9)
    # 64 configurations of 160,000 cells are within it
    monkeypatch.setattr("irs_gym.radio.codebook.cell_blocks", lambda *_: ())
    assert codebook_gain_db("paper", codebook, cell_size=0.05).shape == (64, 400, 400)


# --- files ----------------------------------------------------------------------------------------


def stored(tmp_path, **changes):
    """A codebook file with other arrays; None leaves one out."""
    arrays = {
        "format_version": 1,
        "phase_shifts": np.zeros((2, 60)),
        "radio_hash": "0" * 64,
        "design": "given",
        **changes,
    }
    path = tmp_path / "codebook.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


@pytest.mark.parametrize("name", ["codebook.npz", "codebook"])
def test_a_saved_codebook_loads_bit_for_bit(name, tmp_path):
    codebook = drawn(FACTORY)
    codebook.save(str(tmp_path / name))
    again = Codebook.load(str(tmp_path / name))
    assert again.phase_shifts.tobytes() == codebook.phase_shifts.tobytes()
    assert (again.radio_hash, again.design) == (codebook.radio_hash, codebook.design)
    assert os.listdir(tmp_path) == [name]
    again.check_scene(FACTORY)


def test_a_codebook_is_read_only_and_keeps_its_own_numbers():
    given = np.zeros((2, 60))
    codebook = Codebook.from_array(given)
    given[:] = 1
    assert not codebook.phase_shifts.any()
    with pytest.raises(ValueError, match="read-only"):
        codebook.phase_shifts[0, 0] = 1


def test_a_damaged_codebook_is_refused_or_still_the_same(tmp_path):
    path = stored(tmp_path)
    whole = path.read_bytes()
    for place in range(0, len(whole), 11):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            same = not Codebook.load(path).phase_shifts.any()
        except ValueError as error:
            same = "is not a codebook" in str(error)
        assert same, place
        path.write_bytes(whole[:place])
        with pytest.raises(ValueError, match="is not a codebook"):
            Codebook.load(path)


@pytest.mark.parametrize("field", ["phase_shifts", "format_version", "radio_hash", "design"])
def test_a_codebook_file_is_never_unpickled(field, tmp_path):
    burglar = np.array([[Burglar(tmp_path / "broken in")]], dtype=object)
    with pytest.raises(ValueError, match=r"is not a codebook: .*allow_pickle=False"):
        Codebook.load(stored(tmp_path, **{field: burglar}))
    assert os.listdir(tmp_path) == ["codebook.npz"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format_version": 2}, "format_version is 2, and 1 is read here"),
        ({"format_version": None}, "format_version is not a file"),
        ({"format_version": np.ones(2, int)}, "format_version must be a single value"),
        ({"phase_shifts": None}, "phase_shifts is not a file"),
        ({"phase_shifts": np.full((2, 60), nan)}, "phase_shifts holds NaN or inf"),
        ({"phase_shifts": np.zeros((0, 60))}, "shape"),
        ({"phase_shifts": np.array([["a"]])}, "type <U1"),
        ({"radio_hash": 3}, "radio_hash must be a single value"),
        ({"radio_hash": "x" * 64}, "radio_hash='x+' must be 64 hexadecimal digits"),
        ({"design": "x" * 201}, "design must be a string of at most 200"),
    ],
)
def test_an_archive_of_other_arrays_is_no_codebook(change, message, tmp_path):
    with pytest.raises(ValueError, match=f"codebook.npz' is not a codebook: .*{message}"):
        Codebook.load(stored(tmp_path, **change))


@pytest.mark.parametrize("path", [3, None, b"x", "a\0b"])
def test_what_is_no_path_of_a_codebook_is_said_so(path):
    with pytest.raises(ValueError, match=r"codebook=.* must be the path of a file"):
        Codebook.load(path)
    with pytest.raises(ValueError, match=r"codebook=.* must be the path of a file"):
        drawn(PAPER).save(path)
