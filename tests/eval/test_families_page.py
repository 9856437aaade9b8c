"""Facts about `python -m eval families`: what stands on the page of families."""

from pathlib import Path

from evaluating import call
from PIL import Image

from irs_gym.datasets.splits import FAMILIES

DOCS = Path(__file__).parents[2] / "docs"


def test_every_family_has_a_row_and_a_picture(monkeypatch, tmp_path):
    assert call(monkeypatch, "families", "--out", tmp_path, "--num-scenes", 2) == 0
    page = (tmp_path / "families.md").read_text()
    assert page.count("| `ood-") == page.count("| `train-") == len(FAMILIES) == 8
    for name in FAMILIES:
        assert f"![{name}](figures/families/{name}.png)" in page
        with Image.open(tmp_path / "figures" / "families" / f"{name}.png") as picture:
            assert picture.width > 500


def test_detours_on_the_page_that_is_kept_are_from_1_2_to_6_where_walls_decide():
    rows = [
        [each.strip() for each in line.split("|")]
        for line in (DOCS / "families.md").read_text().splitlines()
        if line.startswith("| `ood-")
    ]
    walled = [row for row in rows if FAMILIES[row[1].strip("`")[4:]].family]
    assert len(walled) == 6
    assert all(1.2 <= float(row[3]) <= float(row[7]) <= 6.0 for row in walled)


def test_more_scenes_than_there_are_is_answered_in_one_line(monkeypatch, capsys, tmp_path):
    assert call(monkeypatch, "families", "--out", tmp_path, "--num-scenes", 1001) == 2
    assert "num_scenes=1001" in capsys.readouterr().err
