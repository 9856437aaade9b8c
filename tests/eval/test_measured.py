"""Facts of `python -m eval measured`: what its page says of a small room is what the package computes
there.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from evaluating import call

from eval.commands import measured
from eval.paper.measured_room import LEVEL_DBM, longest_ways, read_room
from irs_gym import cost_map, shortest_path

LEVELS = [-90.0, -80.0, -70.0, -60.0]
SHAPE = (7, 5)
RECEIVERS = ("a1", "a2", "b1")


@pytest.fixture
def room(tmp_path) -> Path:
    """A floor with a block in its middle, whose receivers are heard better in one half or the other."""
    folder = tmp_path / "room"
    for name in ("grd/best_0.5", "occ", "cnf"):
        (folder / name).mkdir(parents=True)
    cells = list(np.ndindex(SHAPE))
    area = f"{json.dumps([[0.0, 0.0], [3.0, 2.0]])}::0.5"
    places = {cell: f"[{cell[0] * 0.5}, {cell[1] * 0.5}]" for cell in cells}
    rng = np.random.default_rng(0)
    for n, receiver in enumerate(RECEIVERS):
        lines = [f"{receiver}::{area}::{LEVELS}"]
        for i, j in cells:
            weight = np.array([1.0, 2.0, 1.0 + (j > 2) * n, 1.0 + (i > 3)])
            lines.append(f"{places[i, j]}::b::{rng.dirichlet(weight).tolist()}")
        path = folder / "grd" / "best_0.5" / f"room_rssi_{receiver}_0.5.grd"
        path.write_text("\n".join(lines))
    blocked = {(i, j) for i in (2, 3, 4) for j in (1, 2, 3)}
    occupancy = [f"{places[cell]}::{int(cell in blocked)}" for cell in cells]
    (folder / "occ" / "room_0.5.occ").write_text("\n".join([area, *occupancy]))
    devices = {"a1": [[1.0, 2.0, 2.3], 255, "one"], "b1": [[3.0, 0.0, 2.3], 255, "two"]}
    (folder / "cnf" / "room.dev").write_text(f"Dongles:{json.dumps(devices)}\nBeacons:{{}}\n")
    return folder


def test_the_way_leads_between_the_walkable_cells_nearest_to_two_corners(room):
    receivers = read_room(room)
    assert [each.name for each in receivers] == list(RECEIVERS)
    assert [each.place for each in receivers] == [(1.0, 2.0), None, (3.0, 0.0)]
    assert {(each.start, each.goal) for each in receivers} == {((0, 0), (6, 4))}


def test_the_highest_target_is_feasible_and_a_hundredth_more_is_not(room):
    for each in read_room(room):
        ends = (each.start, each.goal, 0.5)
        assert shortest_path(each.radio_map.feasible(each.highest_target), *ends) is not None
        assert shortest_path(each.radio_map.feasible(each.highest_target + 0.01), *ends) is None
        found = each.path.cells
        assert (each.radio_map.gain_db[tuple(found.T)] >= each.highest_target).all()


def test_points_of_the_fronts_cost_what_their_cells_do(room):
    for each in read_room(room):
        for kind, front in each.fronts.items():
            costs = cost_map(each.radio_map, LEVEL_DBM, kind)
            for n in range(len(front.costs)):
                cells = front.path(n).cells
                assert costs[tuple(cells.T)].sum() == pytest.approx(front.costs[n], abs=1e-12)
            assert front.distances[-1] == each.trade_off.distances[0]


def test_the_page_is_written_with_its_figures(room, tmp_path, monkeypatch):
    monkeypatch.setattr(measured, "PLAYED", 1)
    assert call(monkeypatch, "measured", room, "--out", tmp_path / "docs", "--steps", 4096) == 0
    page = (tmp_path / "docs" / "measured.md").read_text()
    assert "7 x 5 cells of 0.5 m, of which 26 can be walked, and 3 Bluetooth receivers" in page
    assert "CC0" in page
    (longest,) = longest_ways(read_room(room), 1)
    assert (
        f"| {longest.name} | {longest.highest_target:.2f} | {longest.path.distance:.3f} |" in page
    )
    for name in ("mean", "outage", "trade_off", "fronts"):
        assert (tmp_path / "docs" / "figures" / f"measured_{name}.png").stat().st_size > 1000
    # maps are pictures alone: their numbers are others' data
    assert not (tmp_path / "docs" / "figures" / "measured_mean.csv").exists()


def test_a_folder_without_a_room_is_told_in_one_line(room, tmp_path, monkeypatch, capsys):
    assert call(monkeypatch, "measured", tmp_path, "--out", tmp_path / "docs") == 2
    assert "holds no files grd" in capsys.readouterr().err
    (room / "cnf" / "room.dev").write_text("Dongles:{broken\n")
    assert call(monkeypatch, "measured", room, "--out", tmp_path / "docs") == 2
    assert "python -m eval measured: " in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()
