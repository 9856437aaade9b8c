"""Facts of `python -m eval outage`: which cells it draws, what it counts as an error, and its page."""

import numpy as np
import pytest

from eval.commands import outage
from eval.paper import outage_draws
from eval.paper.outage_draws import OutageDraws, paper_cells
from irs_gym import build_radio_map, load_scene
from irs_gym.radio.fading import RicianFading
from irs_gym.radio.geometry import is_line_of_sight

PAPER = load_scene("paper")


def draws_of(scattered: float, drawn: float) -> OutageDraws:
    """Exponential draws of one mean beside the closed form of another."""
    fading = RicianFading(np.asarray(0.0), np.asarray(scattered))
    gains = drawn * -np.log1p(-(np.arange(1000) + 0.5) / 1000)
    return OutageDraws("place", "continuous", 1, fading, gains)


def test_the_cells_are_of_the_kinds_that_they_are_called():
    grid = build_radio_map(PAPER).grid
    sees = {
        name: tuple(
            bool(is_line_of_sight(np.array([[*grid.centre(cell), PAPER.antenna_height]]), end, PAPER.boxes))
            for end in (PAPER.access_points[0].position, PAPER.irs_panels[0].position)
        )
        for name, cell in paper_cells(PAPER).items()
    }  # fmt: skip
    assert sees["sees AP and panel"] == (True, True)
    assert sees["sees the AP alone"] == (True, False)
    assert sees["sees the panel alone"] == (False, True)
    assert sees["sees neither"] == (False, False)


def test_the_worst_error_is_that_of_all_thresholds():
    assert draws_of(1e-7, 1e-7).worst_error == pytest.approx(0.0005, abs=1e-12)
    # 1 - exp(-x) - (1 - exp(-x/2)) is largest at x = 2 ln 2, where it is 1/4
    assert draws_of(1e-7, 2e-7).worst_error == pytest.approx(0.25, abs=1e-3)
    assert draws_of(1e-7, 1e-7).sampling_error == pytest.approx(0.0616, abs=1e-4)


def test_the_page_is_written_with_its_figures(tmp_path, monkeypatch):
    monkeypatch.setattr(outage_draws, "PANELS", ((1, 1), (4, 4)))
    assert outage.main(out=tmp_path, draws=500) == 0
    page = (tmp_path / "fading.md").read_text()
    assert "| sees neither | 1 bit | 1200 |" in page
    assert "workshop" in page
    for name in ("outage", "outage_error"):
        assert f"figures/{name}.png" in page
        for suffix in ("png", "svg", "csv"):
            assert (tmp_path / "figures" / f"{name}.{suffix}").stat().st_size > 100


def test_a_product_of_two_scattered_links_is_told_from_a_gaussian(monkeypatch):
    monkeypatch.setattr(outage_draws, "PANELS", ((1, 1),))
    found = outage_draws.draw_panels(2000, 0)
    blocked = found["panel alone, both links blocked"][0]
    assert blocked.worst_error > 3 * blocked.sampling_error
    in_room = found["beside the panel of the paper's room"][0]
    assert in_room.worst_error < in_room.sampling_error


def test_no_draws_are_refused(tmp_path, capsys):
    assert outage.main(out=tmp_path, draws=0) == 2
    assert "draws=0 must be positive" in capsys.readouterr().err
