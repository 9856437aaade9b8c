"""Facts about `python -m eval grids`: what it counts as equal, and what it says of files that do
not fit.
"""

import pytest
from evaluating import call

from eval.benchmark.published_lengths import compare_lengths, last_digit

ROWS = [
    "....@...",
    "..@@@.T.",
    "........",
    "WWW..S.G",
]
MAP = "type octile\nheight 4\nwidth 8\nmap\n" + "\n".join(ROWS) + "\n"


def scenario(start, goal, length, shape=(8, 4), name="maps/tiny/tiny.map"):
    return "\t".join(map(str, (0, name, *shape, *start, *goal, length)))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "tiny.map").write_text(MAP)
    return tmp_path


def write(folder, *lines, name="tiny.map.scen"):
    (folder / name).write_text("version 1\n" + "\n".join(lines) + "\n")
    return folder / name


def test_printed_lengths_are_counted_as_equal_within_their_rounding(folder, monkeypatch):
    write(
        folder,
        scenario((2, 0), (2, 2), "4"),
        scenario((0, 0), (1, 1), "1.41421"),
        scenario((0, 0), (0, 0), "0"),
        scenario((0, 3), (2, 3), "2"),  # on water, which is not left
        scenario((3, 2), (5, 3), "2.41421"),  # into a swamp, as over ground
    )
    found = compare_lengths(folder / "tiny.map.scen", folder)
    assert found.is_equal.all()
    assert found.cells == 24
    assert call(monkeypatch, "grids", folder, "--out", folder, "--no-timing") == 0
    assert "**5 of 5 lengths in 1 files agree**" in (folder / "grids.md").read_text()


@pytest.mark.parametrize(
    ("start", "goal", "printed"),
    [
        ((2, 0), (2, 2), "2.82843"),  # with a corner cut
        ((0, 0), (1, 1), "1.41422"),
        ((0, 2), (0, 3), "1"),  # from ground into water
        ((3, 0), (5, 0), "100"),
    ],
)
def test_a_length_that_differs_is_told_and_fails(folder, monkeypatch, start, goal, printed):
    write(folder, scenario((0, 0), (1, 0), "1"), scenario(start, goal, printed))
    assert call(monkeypatch, "grids", folder, "--out", folder, "--no-timing") == 1
    page = (folder / "grids.md").read_text()
    assert "**1 of 2 lengths" in page
    assert f"`{printed}`" in page.split("## Lengths that differ")[1]


def test_the_page_times_other_packages_and_shows_that_they_find_the_same(folder, monkeypatch):
    pytest.importorskip("networkx")
    write(folder, scenario((2, 0), (2, 2), "4"))
    assert call(monkeypatch, "grids", folder, "--out", folder) == 0
    row = (folder / "grids.md").read_text().split("## Time")[1].strip().splitlines()[-3]
    assert row.split(" | ")[-1] == "2.82843, 4 |"  # with corners cut, and without


def test_maps_may_lie_anywhere_below_the_folder(folder, tmp_path_factory):
    other = folder / "scenarios"
    other.mkdir()
    path = write(other, scenario((2, 0), (2, 2), "4"), name="tiny.scen")
    assert compare_lengths(path, folder).is_equal.all()
    with pytest.raises(FileNotFoundError, match=r"there is no map 'tiny.map' beside it"):
        compare_lengths(path, other)


def test_the_last_digit_of_six():
    assert [last_digit(x) for x in (0, 1, 9.99999, 10, 760.938)] == [1e-5, 1e-5, 1e-5, 1e-4, 1e-3]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([scenario((0, 0), (1, 0), "1", shape=(8, 5))], r"scenario 0 is of a map of \(8, 5\)"),
        ([scenario((0, 0), (9, 0), "1")], r"line 2: start or goal .* lies off a map of 8 x 4"),
        ([scenario((0, 0), (1, 0), "x")], r"line 2 holds what is no number"),
        ([scenario((0, 0), (1, 0), "nan")], r"line 2: the length nan is none"),
        ([scenario((0, 0), (1, 0), "-1")], r"the length -1 is none"),
        (["0\ttiny.map\t8"], r"line 2 has 3 fields, not 9"),
        ([scenario((0, 0), (1, 0), "1"), scenario((0, 0), (1, 0), "1", name="b.map")], "2 maps"),
        ([scenario((0, 0), (1, 0), "1", name="other.map")], None),
        ([], "it holds no scenario"),
    ],
)
def test_a_scenario_file_that_is_damaged_or_of_another_map_is_told(
    folder, monkeypatch, capsys, lines, message
):
    path = write(folder, *lines)
    if message is None:
        assert compare_lengths(path, folder).is_equal.all()  # by its file's name
        return

    with pytest.raises(ValueError, match=message):
        compare_lengths(path, folder)
    assert call(monkeypatch, "grids", folder, "--out", folder) == 2
    assert "tiny.map.scen" in capsys.readouterr().err
    assert not (folder / "grids.md").exists()


def test_a_folder_without_scenario_files_is_told(tmp_path, monkeypatch, capsys):
    for folder in (tmp_path, tmp_path / "none"):
        assert call(monkeypatch, "grids", folder, "--out", tmp_path) == 2
        assert "holds no scenario file" in capsys.readouterr().err
