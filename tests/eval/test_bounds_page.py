"""Facts of `python -m eval bounds`: its page holds what is computed, and says what is wrong."""

import pytest

from eval.commands import bounds
from eval.paper import continuous
from irs_gym import load_scene


def test_the_page_is_written_with_its_figure_and_the_distances_of_the_grid(tmp_path, monkeypatch):
    monkeypatch.setattr(continuous, "TARGETS_DB", (-61.8,))
    monkeypatch.setattr(continuous, "WITHOUT_IRS_DB", (-64.0,))
    assert bounds.main(out=tmp_path, tolerance=0.02) == 0

    page = (tmp_path / "bounds.md").read_text()
    assert "| -61.8 | yes | 23.228 | 21.743 | " in page
    assert "| -64 | no | 21.571 | " in page
    assert "up to 2 %" in page
    for suffix in ("png", "svg", "csv"):
        assert (tmp_path / "figures" / f"bounds.{suffix}").stat().st_size > 100


def test_what_the_grid_costs_lies_between_its_distance_over_both_bounds():
    found = continuous.compare(load_scene("paper"), -62.5, 0.01, has_irs=False)
    least, most = found.cost
    assert found.grid == pytest.approx(25.642, abs=1e-3)
    assert 0 < least <= most
    assert found.bounds.lower * (1 + most) == pytest.approx(found.grid)


def test_a_tolerance_out_of_its_range_is_told(tmp_path, capsys):
    assert bounds.main(out=tmp_path, tolerance=2.0) == 2
    assert "tolerance=2.0 must be" in capsys.readouterr().err
    assert not (tmp_path / "bounds.md").exists()
