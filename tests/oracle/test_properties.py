"""Facts that hold in every factory: hypothesis searches random scenes for one that breaks them."""

import tempfile
from itertools import pairwise
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from irs_gym.oracle.shortest_path import distance_to_go, highest_feasible_target, shortest_path
from irs_gym.radio.irs import Hardware, channel
from irs_gym.radio.radio_map import RadioMap, build_radio_map
from irs_gym.radio.scene import Scene, load_scene

# some boxes are smaller than a cell
pytestmark = pytest.mark.filterwarnings("ignore:.*no cell is blocked by")

PAPER = load_scene("paper").model_dump()
SAME = {wall: wall for wall in ("x_min", "x_max", "y_min", "y_max")}
MIRRORED = SAME | {"x_min": "x_max", "x_max": "x_min"}
SWAPPED = {"x_min": "y_min", "x_max": "y_max", "y_min": "x_min", "y_max": "x_max"}

models = st.sampled_from(["far_field", "coherent", "spherical"])
cell_sizes = st.sampled_from([0.5, 1.0])


def facts(examples):
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow],
    )


def tenths(low: int, high: int) -> st.SearchStrategy[float]:
    """Decimals from ``low`` to ``high`` tenths."""
    return st.integers(low, high).map(lambda n: n / 10)


@st.composite
def scenes(draw) -> Scene:
    """A hall of 3 to 7 m with up to three boxes, two access points and two panels, lengths in
    decimetres.
    """
    x, y, width, depth = (draw(st.integers(*ends)) for ends in [(-4, 3), (-4, 3), (3, 7), (3, 7)])
    room = {"x_min": x, "x_max": x + width, "y_min": y, "y_max": y + depth, "height": 3}

    def box():
        size = [draw(tenths(3, 10 * side // 2)) for side in (width, depth)] + [draw(tenths(4, 30))]
        corner = [
            draw(tenths(0, 10 * side - round(10 * s)))
            for side, s in zip((width, depth), size, strict=False)
        ]
        return {"center": (x + corner[0] + size[0] / 2, y + corner[1] + size[1] / 2), "size": size}

    def panel():
        wall = draw(st.sampled_from(list(SAME)))
        along = draw(tenths(1, 10 * (depth if wall[0] == "x" else width) - 1))
        foot = (room[wall], y + along) if wall[0] == "x" else (x + along, room[wall])
        return {
            "position": (*foot, draw(tenths(5, 25))),
            "wall": wall,
            "columns": draw(st.integers(1, 4)),
            "rows": draw(st.integers(1, 3)),
            "elements_per_subsurface": (draw(st.integers(1, 2)), draw(st.integers(1, 4))),
            "pitch_wavelengths": draw(tenths(1, 6)),
        }

    def access_point():
        inside = (x + draw(tenths(1, 10 * width - 1)), y + draw(tenths(1, 10 * depth - 1)))
        return {"position": (*inside, draw(tenths(15, 29)))}

    ends = [(x + 0.5, y + 0.5), (x + width - 0.5, y + depth - 0.5)]
    boxes = [box() for _ in range(draw(st.integers(0, 3)))]
    clear = [each for each in boxes if not any(holds(each, end) for end in ends)]
    parts = {
        "name": "hall",
        "room": room,
        "obstacles": clear,
        "access_points": [access_point() for _ in range(draw(st.integers(1, 2)))],
        "irs_panels": [panel() for _ in range(draw(st.integers(0, 2)))],
        "start": ends[0],
        "goal": ends[1],
        "rician_factor_db": draw(st.sampled_from([-5.0, 3.0, 12.0])),
    }
    return Scene.model_validate({**PAPER, **parts})


def holds(box, point) -> bool:
    return all(
        abs(p - c) <= s / 2 for p, c, s in zip(point, box["center"], box["size"], strict=False)
    )


def placed(scene: Scene, moved, walls=SAME, axes=(0, 1)) -> Scene:
    """The scene with every point (x, y) moved, its walls renamed and its boxes' sides in another
    order.
    """
    data = scene.model_dump()
    (x_min, y_min), (x_max, y_max) = (
        moved(*corner) for corner in (scene.room.lower, scene.room.upper)
    )
    data["room"] |= {
        "x_min": min(x_min, x_max),
        "x_max": max(x_min, x_max),
        "y_min": y_min,
        "y_max": y_max,
    }
    for box in data["obstacles"]:
        box["center"] = moved(*box["center"])
        box["size"] = (*(box["size"][axis] for axis in axes), box["size"][2])
    for part in (*data["access_points"], *data["irs_panels"]):
        part["position"] = (*moved(*part["position"][:2]), part["position"][2])
    for panel in data["irs_panels"]:
        panel["wall"] = walls[panel["wall"]]
    data["start"], data["goal"] = moved(*scene.start), moved(*scene.goal)
    return Scene.model_validate(data)


def largest_difference_db(one, other) -> float:
    """+inf where the obstacles differ."""
    free = np.isfinite(one)
    return (
        np.abs(one[free] - other[free]).max(initial=0.0)
        if np.array_equal(free, np.isfinite(other))
        else inf
    )


def power(scene, *setting):
    return 10 ** (build_radio_map(scene, *setting).gain_db / 10)


# --- the map --------------------------------------------------------------------------------------


@facts(60)
@given(scenes(), models)
def test_continuous_phases_beat_optimal_levels_and_those_beat_the_nearest(scene, model):
    continuous = power(scene, 1.0, None, None, "nearest", model)
    for bits in (1, 2, 3):
        optimal, nearest, printed = (
            power(scene, 1.0, None, bits, quantiser, model)
            for quantiser in ("optimal", "nearest", "as_printed")
        )
        assert (continuous >= optimal * (1 - 1e-12)).all()
        assert (optimal >= nearest * (1 - 1e-12)).all()
        assert (optimal >= printed * (1 - 1e-12)).all()


@facts(60)
@given(scenes(), models)
def test_more_bits_never_lower_the_optimal_gain(scene, model):
    gains = [power(scene, 1.0, None, bits, "optimal", model) for bits in (1, 2, 3, 4, None)]
    for coarse, fine in pairwise(gains):
        assert (fine >= coarse * (1 - 1e-12)).all()


@facts(60)
@given(scenes(), models, st.integers(0, 2**32 - 1))
def test_no_phase_shifts_give_more_than_the_papers_upper_bound(scene, model, seed):
    centres = scene.grid(1.0).centres().reshape(-1, 2)
    robots = np.column_stack([centres, np.full(len(centres), scene.antenna_height)])
    for point in scene.access_points:
        each = channel(scene, point, robots)
        direct, reflected, tau = each.direct_los, each.reflected_los(model), each.scattered_power()
        bound = (np.abs(direct) + np.abs(reflected).sum(axis=1)) ** 2 + tau
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, reflected.shape)
        anyhow = np.abs(direct + (reflected * np.exp(1j * phases)).sum(axis=1)) ** 2 + tau
        assert (anyhow <= bound * (1 + 1e-12)).all()
        assert np.allclose(
            each.expected_gain(Hardware(None, "nearest", model)), bound, rtol=1e-12, atol=0
        )
        for quantiser in ("nearest", "as_printed", "optimal"):
            assert (each.expected_gain(Hardware(1, quantiser, model)) <= bound * (1 + 1e-12)).all()


@facts(60)
@given(scenes(), models, tenths(-3000, 3000), tenths(-3000, 3000))
def test_moving_the_whole_scene_changes_nothing(scene, model, dx, dy):
    away = placed(scene, lambda x, y: (x + dx, y + dy))
    for bits, quantiser in [(None, "nearest"), (1, "optimal"), (2, "optimal")]:
        here, there = (
            build_radio_map(s, 1.0, None, bits, quantiser, model).gain_db for s in (scene, away)
        )
        assert largest_difference_db(here, there) < 1e-9


@facts(60)
@given(scenes(), models, cell_sizes)
def test_mirroring_the_scene_mirrors_the_map(scene, model, cell_size):
    mirrored = placed(scene, lambda x, y: (-x, y), MIRRORED)
    for bits, quantiser in [(None, "nearest"), (1, "optimal"), (3, "optimal")]:
        here, there = (
            build_radio_map(s, cell_size, None, bits, quantiser, model).gain_db
            for s in (scene, mirrored)
        )
        assert largest_difference_db(here, there[::-1]) < 1e-9


@facts(40)
@given(scenes(), models)
def test_swapping_the_axes_swaps_those_of_the_map(scene, model):
    swapped = placed(scene, lambda x, y: (y, x), SWAPPED, axes=(1, 0))
    here, there = (build_radio_map(s, 1.0, array_model=model).gain_db for s in (scene, swapped))
    assert largest_difference_db(here, there.T) < 1e-9


@facts(40)
@given(scenes())
def test_the_order_of_parts_does_not_matter(scene):
    turned = scene.model_copy(
        update={
            name: getattr(scene, name)[::-1]
            for name in ("obstacles", "access_points", "irs_panels")
        }
    )
    for bits in (None, 2):
        here, there = (
            build_radio_map(s, 1.0, None, bits, "optimal").gain_db for s in (scene, turned)
        )
        assert largest_difference_db(here, there) < 1e-9


# --- the oracle -----------------------------------------------------------------------------------


@facts(60)
@given(scenes(), cell_sizes)
def test_a_higher_target_never_shortens_the_path(scene, cell_size):
    radio_map = build_radio_map(scene, cell_size, None, 1)
    start, goal = radio_map.grid.cell_of(scene.start), radio_map.grid.cell_of(scene.goal)
    targets = np.unique(radio_map.gain_db[radio_map.free])
    lengths, to_go = [], np.zeros(radio_map.grid.shape)
    for target_db in (-inf, *targets[:: max(1, len(targets) // 12)], targets[-1] + 1e-9):
        feasible = radio_map.feasible(target_db)
        path = shortest_path(feasible, start, goal, cell_size)
        lengths.append(path.distance if path else inf)
        before, to_go = to_go, distance_to_go(feasible, goal, cell_size)
        assert (to_go >= before - 1e-9).all()
    assert lengths == sorted(lengths)
    assert lengths[-1] == inf


@facts(60)
@given(scenes(), cell_sizes)
def test_the_highest_target_is_where_the_path_breaks(scene, cell_size):
    radio_map = build_radio_map(scene, cell_size, None, 1)
    start, goal = radio_map.grid.cell_of(scene.start), radio_map.grid.cell_of(scene.goal)
    highest = highest_feasible_target(radio_map.gain_db, start, goal)
    above = radio_map.feasible(np.nextafter(highest, inf))
    assert shortest_path(above, start, goal, cell_size) is None
    assert (highest > -inf) == (shortest_path(radio_map.free, start, goal, cell_size) is not None)
    if highest > -inf:
        assert shortest_path(radio_map.feasible(highest), start, goal, cell_size) is not None


# --- files ----------------------------------------------------------------------------------------


@facts(40)
@given(scenes())
def test_scenes_survive_their_files_and_compare_by_value(scene):
    with tempfile.TemporaryDirectory() as folder:
        scene.save(Path(folder) / "scene.json")
        again = load_scene(Path(folder) / "scene.json")
    assert again == scene
    assert hash(again) == hash(scene)
    assert again.model_copy(update={"name": "other"}) != scene


@facts(40)
@given(scenes(), cell_sizes)
def test_maps_survive_their_files(scene, cell_size):
    radio_map = build_radio_map(scene, cell_size)
    with tempfile.TemporaryDirectory() as folder:
        radio_map.save(Path(folder) / "map.npz")
        again = RadioMap.load(Path(folder) / "map.npz")
    assert again.gain_db.tobytes() == radio_map.gain_db.tobytes()
    assert again.grid == radio_map.grid
