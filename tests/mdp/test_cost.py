"""Facts of what cells cost: what each kind counts, where it is 0, and where it is infinite."""

import numpy as np
import pytest

from irs_gym import (
    RadioMap,
    build_radio_map,
    cost_map,
    generate_scene,
    load_scene,
    outage_probability,
)
from irs_gym.datasets.scene_set import scene_set_of
from irs_gym.mdp.cost import cell_costs

INF = float("inf")
PAPER = build_radio_map("paper", 1.0)


@pytest.mark.parametrize("target_db", [-70.0, -61.8, -60.0])
def test_a_violation_is_1_where_a_free_cell_is_not_feasible(target_db):
    costs = cost_map(PAPER, target_db, "violation")
    assert costs.dtype == np.float64
    np.testing.assert_array_equal(costs == 0, PAPER.feasible(target_db))
    np.testing.assert_array_equal(costs == 1, PAPER.free & ~PAPER.feasible(target_db))
    np.testing.assert_array_equal(costs == INF, ~PAPER.free)


def test_a_deficit_is_what_a_cell_lacks_in_db():
    costs = cost_map(PAPER, -61.8, "deficit")
    lacking = PAPER.free & (PAPER.gain_db < -61.8)
    np.testing.assert_array_equal(costs[lacking], -61.8 - PAPER.gain_db[lacking])
    np.testing.assert_array_equal(costs == 0, PAPER.feasible(-61.8))
    np.testing.assert_array_equal(costs == INF, ~PAPER.free)


def test_a_free_cell_that_receives_nothing_is_a_violation_and_lacks_infinitely_much():
    radio_map = RadioMap.from_array([[-60.0, -INF]], 0.5, free=np.array([[True, True]]))
    assert cost_map(radio_map, -60.0, "violation").tolist() == [[0.0, 1.0]]
    assert cost_map(radio_map, -60.0, "deficit").tolist() == [[0.0, INF]]


def test_an_outage_is_the_probability_that_the_gain_lies_below_and_inf_in_obstacles():
    costs = cost_map(PAPER, -66.0, "outage")
    free = PAPER.free
    np.testing.assert_array_equal(costs[free], outage_probability("paper", -66.0, 1.0)[free])
    assert 0.01 < costs[free].mean() < 0.99
    np.testing.assert_array_equal(costs == INF, ~free)


def test_an_outage_needs_a_map_that_knows_its_fading(tmp_path):
    bare = RadioMap(PAPER.gain_db, grid=PAPER.grid)
    with pytest.raises(ValueError, match=r"^kind='outage' needs a map with fading"):
        cost_map(bare, -66.0, "outage")
    PAPER.save(tmp_path / "map.npz", fading=True)
    again = RadioMap.load(tmp_path / "map.npz")
    np.testing.assert_array_equal(
        cost_map(again, -66.0, "outage"), cost_map(PAPER, -66.0, "outage")
    )


def test_the_scenes_of_a_set_cost_what_each_costs():
    rng = np.random.default_rng(0)
    scenes = [generate_scene(rng, difficulty="easy") for _ in range(2)]
    scenes.append(load_scene("paper"))
    pool = scene_set_of(scenes, ["a", "b", "c"])
    together = cell_costs(
        pool.gain_db, pool.free, pool.target_db[:, None, None] - 8.0, "outage", pool.fading
    )
    for n, scene in enumerate(scenes):
        own = cost_map(build_radio_map(scene), scene.target_db - 8.0, "outage")
        columns, rows = own.shape
        np.testing.assert_array_equal(together[n, :columns, :rows], own)
        assert (together[n, columns:] == INF).all()


@pytest.mark.parametrize("kind", ["violation", "deficit"])
def test_many_maps_cost_what_each_costs(kind):
    others = [RadioMap(PAPER.gain_db + n, grid=PAPER.grid) for n in range(3)]
    targets = np.array([-62.0, -61.0, -60.0])
    together = cell_costs(
        np.stack([each.gain_db for each in others]),
        np.stack([each.free for each in others]),
        targets[:, None, None],
        kind,
    )
    for n, each in enumerate(others):
        np.testing.assert_array_equal(together[n], cost_map(each, targets[n], kind))


@pytest.mark.parametrize("kind", ["", "violations", None, 1, ["violation"]])
def test_an_unknown_kind_is_refused_by_name(kind):
    with pytest.raises(ValueError, match=r"^kind=.* must be one of \('violation', 'deficit'"):
        cost_map(PAPER, -60.0, kind)


@pytest.mark.parametrize("target_db", [INF, -INF, float("nan"), None, "60", True, [1.0]])
def test_a_target_that_is_no_number_is_refused_by_name(target_db):
    with pytest.raises(ValueError, match=r"^target_db=.* must be a finite number of dB"):
        cost_map(PAPER, target_db, "violation")
