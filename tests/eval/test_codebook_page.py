"""Facts of the page on codebooks: it says what is computed, and draws all of it."""

from pathlib import Path

import numpy as np
import pytest
from evaluating import call

from eval.commands import codebook as command
from eval.paper.codebooks import CodebookStudy, Row, best_switches, turning_points
from eval.paper.study import CONTINUOUS, Study
from eval.scoreboard import codebook_board
from irs_gym import SwitchFront, load_scene

DOCS = Path(__file__).parents[2] / "docs"
FRONTS = [
    ([0, 1, 2, 3], [25.6, 24.5, 23.6, 23.2]),
    ([1, 2, 3], [30.2, 26.2, 25.6]),
    ([0, 2, 3, 7], [9.0, 8.9, 3.0, 2.9]),
    ([4], [1.0]),
]


@pytest.mark.parametrize(("switches", "distances"), FRONTS)
def test_switches_turn_where_fewer_are_as_good(switches, distances):
    front = SwitchFront(np.array(switches), np.array(distances), paths=())
    found = turning_points(front)
    costs = [cost for cost, _ in found] + [1e6]
    for n, (cost, at) in enumerate(found):
        between = (cost + costs[n + 1]) / 2
        assert best_switches(front, between) == at
        if n:
            before = found[n - 1][1]
            totals = front.distances + cost * front.switches
            assert totals[before] == pytest.approx(totals[at], abs=1e-9)


def test_designs_of_one_size_are_codebooks_of_that_size():
    codebooks = CodebookStudy(Study(load_scene("paper"), 1.0))
    for design in command.DESIGNS:
        assert codebooks.codebook(design, 6, -61.8).size == 6
    assert codebooks.metres("cover", 4, -61.8) == pytest.approx(21.485, abs=1e-3)
    assert codebooks.metres("DFT", 1, -60.0) == np.inf
    with pytest.raises(ValueError, match="no path to focus on"):
        codebooks.codebook("focused", 6, -50.0)


def test_the_finding_counts_rows_that_switches_make_as_good():
    def row(following, *distances):
        front = SwitchFront(np.arange(len(distances)), np.array(distances), paths=())
        return Row(CONTINUOUS, -60.0, following, front if distances else None)

    same = row(21.0, 25.0, 21.0)
    said = command.finding([same, row(np.inf), row(20.0, 20.0)])
    assert said.startswith("In 2 of the 2 rows")
    assert said.endswith("at most 1 switches.")
    assert "it gives less" in command.finding([same, row(20.0, 20.5)])
    assert "it gives less" in command.finding([same, row(20.0)])
    assert "phases are rounded" in command.finding([same, row(21.0, 20.0)])


def test_the_page_in_the_documents_says_what_is_computed():
    row = CodebookStudy(Study(load_scene("paper"))).row(CONTINUOUS, -61.8)
    page = (DOCS / "codebook.md").read_text(encoding="utf-8")
    assert command.fronts_table([row]).splitlines()[-1] in page
    assert command.costs_table([row]).splitlines()[-1] in page


def test_the_page_is_written_with_all_its_figures(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(command, "SIZES", (1, 4))
    monkeypatch.setattr(command, "SIZES_AT_DB", (-61.8,))
    monkeypatch.setattr(codebook_board, "TASKS", ())
    out = tmp_path / "docs"
    assert call(monkeypatch, "codebook", "--out", out, "--cell-size", 1.0) == 0
    page = (out / "codebook.md").read_text(encoding="utf-8")
    assert "| continuous | -61.8 | 21.485 | 25.142 | 23.728 | 21.485 | 21.485 |" in page
    assert "| -61.8 | cover | 25.142 | 21.485 |" in page
    assert "{" not in page
    assert command.LEARNED in page
    names = {f"codebook_{each}" for each in ("paths", "maps", "sizes", "costs")}
    files = {file.name for file in (out / "figures").iterdir()}
    assert files == {f"{name}.{kind}" for name in names for kind in ("png", "svg", "csv")}
    assert all(f"figures/{file}" in page for file in files)

    assert call(monkeypatch, "codebook", "--out", out, "--cell-size", 0.7) == 2
    assert "cell_size=0.7" in capsys.readouterr().err
