"""Facts of the room traced by Sionna RT: its meshes, its saved map, its page."""

import sys
from pathlib import Path
from shutil import copy

import gymnasium
import numpy as np
import pytest

from eval.commands import sionna
from eval.paper import traced
from irs_gym import RadioMap, build_radio_map, load_scene, shortest_path
from irs_gym.radio.geometry import is_line_of_sight

DOCS = Path(__file__).parents[2] / "docs"
SCENE = load_scene("paper")


@pytest.fixture
def saved() -> RadioMap:
    return RadioMap.load(DOCS / "sionna.npz")


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3) and triangles (F, 3) of an ASCII mesh."""
    lines = path.read_text(encoding="ascii").splitlines()
    assert lines[:2] == ["ply", "format ascii 1.0"]
    corners, faces = (int(next(line for line in lines if f"element {part}" in line).split()[-1])
                      for part in ("vertex", "face"))  # fmt: skip
    body = lines[lines.index("end_header") + 1 :]
    assert len(body) == corners + faces
    triangles = np.array([list(map(int, line.split())) for line in body[corners:]])
    assert (triangles[:, 0] == 3).all()
    return np.array([list(map(float, line.split())) for line in body[:corners]]), triangles[:, 1:]


# --- meshes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_room", [False, True])
def test_a_box_is_closed_and_its_normals_point_out_of_the_material(tmp_path, is_room):
    lower, upper = (-7.0, -3.0, 0.5), (-3.0, 1.0, 1.3)
    traced.write_box(tmp_path / "box.ply", lower, upper, is_room)
    corners, triangles = read_ply(tmp_path / "box.ply")
    assert sorted(map(tuple, corners)) == sorted(
        (x, y, z) for x in (-7, -3) for y in (-3, 1) for z in (0.5, 1.3)
    )
    # closed and of one orientation: each edge is run along once either way
    edges = [(int(t[a]), int(t[b])) for t in triangles for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges)
    assert {edge[::-1] for edge in edges} == set(edges)
    first, second, third = (corners[triangles[:, n]] for n in range(3))
    volume = np.einsum("ij,ij->i", first, np.cross(second, third)).sum() / 6
    assert volume == pytest.approx((-1 if is_room else 1) * 4 * 4 * 0.8)
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2
    assert area == pytest.approx(2 * (4 * 4 + 4 * 0.8 + 4 * 0.8))


def test_the_meshes_are_the_room_and_all_its_boxes(tmp_path):
    meshes = traced.write_meshes(SCENE, tmp_path)
    assert {part: len(paths) for part, paths in meshes.items()} == {"room": 1, "obstacle": 5}
    room, _ = read_ply(meshes["room"][0])
    assert room.min(axis=0).tolist() == [-10, -10, 0]
    assert room.max(axis=0).tolist() == [10, 10, 5]
    for path, box in zip(meshes["obstacle"], SCENE.obstacles, strict=True):
        corners, _ = read_ply(path)
        np.testing.assert_allclose(
            [corners.min(axis=0), corners.max(axis=0)], [box.lower, box.upper], atol=1e-9
        )


def test_an_access_point_on_a_wall_is_moved_into_the_room_and_no_other():
    assert traced.inside(SCENE, (0.0, 10.0, 2.0)) == [0.0, 10.0 - traced.INSET_M, 2.0]
    assert traced.inside(SCENE, (1.0, 2.0, 3.0)) == [1.0, 2.0, 3.0]


# --- the saved map --------------------------------------------------------------------------------


def test_the_saved_map_lies_on_the_papers_grid_with_its_obstacles(saved):
    model = build_radio_map(SCENE, irs_elements=0)
    assert saved.grid == model.grid
    np.testing.assert_array_equal(saved.free, model.free)


def test_the_saved_map_is_near_free_space_in_sight_of_the_access_point_and_below_it_in_the_shadows(
    saved,
):
    places = np.concatenate(
        [saved.grid.centres(), np.full((*saved.grid.shape, 1), SCENE.antenna_height)], axis=-1
    )
    offset = places - traced.inside(SCENE, SCENE.access_points[0].position)
    free_space_db = 20 * np.log10(299_792_458 / 2e9 / (4 * np.pi * np.linalg.norm(offset, axis=-1)))
    is_clear = is_line_of_sight(places, SCENE.access_points[0].position, SCENE.boxes)
    over = saved.gain_db - free_space_db
    # walls, floor and ceiling reflect, so more arrives than through free space, but never less than
    # a little
    assert over[saved.free & is_clear].min() > -1
    assert 0 < np.median(over[saved.free & is_clear]) < 6
    assert np.median(over[saved.free & ~is_clear]) < np.median(over[saved.free & is_clear]) - 3


def test_the_saved_map_is_as_symmetric_as_the_room(saved):
    gain_db = np.where(saved.free, saved.gain_db, 0)
    assert np.sqrt(np.mean((gain_db - gain_db[::-1]) ** 2)) < 0.3  # rays are random


def test_the_saved_map_is_an_environment_whose_oracle_crosses_the_room(saved):
    ends = {"start": (0, 20), "goal": (39, 20)}
    env = gymnasium.make(
        "irs_gym:IrsNav-v0", radio_map=str(DOCS / "sionna.npz"), target_db=-63.0, **ends
    )
    _, info = env.reset(seed=0)
    expected = shortest_path(saved.gain_db >= -63.0, (0, 20), (39, 20), 0.5)
    assert info["oracle_distance"] == pytest.approx(expected.distance, abs=1e-9)


# --- the command ----------------------------------------------------------------------------------


def test_the_page_is_written_again_from_the_saved_map(tmp_path):
    for name in ("sionna.npz", "sionna.json"):
        copy(DOCS / name, tmp_path)
    assert sionna.main(out=tmp_path, retrace=False) == 0
    assert (tmp_path / "sionna.md").read_text() == (DOCS / "sionna.md").read_text()
    for suffix in ("png", "svg", "csv"):
        assert (tmp_path / "figures" / f"sionna.{suffix}").stat().st_size > 1000
    assert (tmp_path / "figures" / "sionna.csv").read_text() == (
        DOCS / "figures" / "sionna.csv"
    ).read_text()


def test_without_a_saved_map_it_says_so(tmp_path, capsys):
    assert sionna.main(out=tmp_path, retrace=False) == 2
    assert "sionna.npz" in capsys.readouterr().err


def test_without_sionna_it_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "sionna.rt", None)
    assert sionna.main(out=tmp_path) == 2
    assert 'pip install "irs_gym[sionna]"' in capsys.readouterr().err


def test_tracing_anew_gives_the_saved_map_again(saved):
    pytest.importorskip("sionna.rt", reason="sionna-rt, an optional extra, is not installed")
    again = traced.trace(SCENE, 0.5, 10**6, 6, 7)
    np.testing.assert_array_equal(again.free, saved.free)
    apart = again.gain_db[saved.free] - saved.gain_db[saved.free]
    assert abs(apart.mean()) < 0.1
    assert apart.std() < 0.6  # a tenth of the rays
