"""Facts of the belief optimum in the environment: its policy makes what it claims there, and no
other policy makes more.
"""

import gymnasium
import numpy as np
import pytest

from agents.policies.belief_policy import BeliefPolicy
from agents.policies.replanning import Replanner
from agents.rollout.alike_scenes import roll_out_alike
from agents.rollout.episode import roll_out
from agents.rollout.scene_set import roll_out_scene_set
from irs_gym import RadioMap, belief_optimum, distance_to_go
from irs_gym.datasets.random_task import RandomTask
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVES

pytestmark = pytest.mark.needs("torch")


def scattered(count, shape, seed, closed=0.35):
    """Maps with closed cells at random, from one corner to the other."""
    rng = np.random.default_rng(seed)
    goal = (shape[0] - 1, shape[1] - 1)
    maps = []
    while len(maps) < count:
        feasible = rng.random(shape) > closed
        feasible[0, 0] = feasible[goal] = True
        if np.isfinite(distance_to_go(feasible, goal, 0.5)[0, 0]):
            maps.append(feasible)
    return np.array(maps)


def set_of(maps):
    """The maps as a set of scenes, feasible cells 5 dB above their target."""
    count, columns, rows = maps.shape
    goal = (columns - 1, rows - 1)
    return SceneSet(
        scenes=(),
        names=tuple(map(str, range(count))),
        target_db=np.zeros(count),
        gain_db=np.where(maps, 5.0, -np.inf),
        distance_to_go=np.stack([distance_to_go(each, goal, 0.5) for each in maps]),
        irs=np.full((count, 3), -1.0, dtype=np.float32),
        start=np.zeros((count, 2), dtype=np.int64),
        goal=np.tile(np.array(goal), (count, 1)),
        cell_size=0.5,
    )


@pytest.mark.parametrize("criterion", ["spl", "distance"])
def test_in_the_environment_it_makes_what_it_claims_in_every_scene_and_replanning_no_more(
    criterion,
):
    maps = scattered(80, (9, 8), seed=3)
    found = belief_optimum(maps, (0, 0), (8, 7), 0.5, radius=1, criterion=criterion)
    pool = set_of(maps)
    ours = roll_out_alike(BeliefPolicy(found, (9, 8)), pool, patch_radius=1, max_steps=200)
    assert ours.is_success.all()
    assert ours.distance == pytest.approx(found.distances)
    assert ours.spl == pytest.approx(found.spl)

    theirs = roll_out_alike(Replanner((9, 8), 1), pool, patch_radius=1, max_steps=200)
    assert theirs.is_success.all()
    if criterion == "spl":
        assert found.value == pytest.approx(ours.spl.mean())
        assert found.value > theirs.spl.mean() + 0.01
    else:
        assert found.value == pytest.approx(ours.distance.mean())
        assert found.value < theirs.distance.mean() - 0.05


def test_it_plays_single_environments_and_dict_observations():
    maps = scattered(20, (7, 7), seed=4)
    found = belief_optimum(maps, (0, 0), (6, 6), 0.5, radius=1)
    policy = BeliefPolicy(found, (7, 7))
    for n in range(5):
        radio_map = RadioMap.from_array(np.where(maps[n], 5.0, -np.inf), 0.5)
        env = gymnasium.make(
            "irs_gym:IrsNav-v0",
            radio_map=radio_map,
            target_db=0.0,
            start=(0, 0),
            goal=(6, 6),
            patch_radius=1,
        )
        episode = roll_out(policy, env)
        assert episode.path.tolist() == found.path(n).cells.tolist()
        assert episode.spl == pytest.approx(found.spl[n])


def test_asked_once_for_all_that_looks_alike_a_policy_makes_the_episodes_that_it_makes_one_by_one():
    maps = scattered(40, (14, 13), seed=6)
    pool = set_of(maps)
    radius = RandomTask.patch_radius
    found = belief_optimum(maps, (0, 0), (13, 12), 0.5, radius=radius)
    for policy in (Replanner(pool.shape, radius), BeliefPolicy(found, pool.shape)):
        together = roll_out_alike(policy, pool, patch_radius=radius, max_steps=15)
        each = roll_out_scene_set(policy, pool, "flat", 15)
        assert together.distance == pytest.approx(each.distance, abs=1e-12)
        assert (together.is_success == each.is_success).all()
        assert (together.actions == each.actions).all()
        assert 0 < together.is_success.sum() < 40


def test_moves_are_those_of_the_grid():
    maps = scattered(60, (8, 8), seed=5)
    found = belief_optimum(maps, (0, 0), (7, 7), 0.5, radius=1)
    policy = BeliefPolicy(found, (8, 8))
    played = roll_out_alike(policy, set_of(maps), patch_radius=1, max_steps=100)
    for n in range(len(maps)):
        moves = played.actions[n][played.actions[n] >= 0]
        assert np.diff(found.path(n).cells, axis=0).tolist() == MOVES[moves].tolist()


def test_a_scene_of_no_family_is_said_to_be_one():
    maps = scattered(20, (7, 7), seed=4)
    found = belief_optimum(maps[:10], (0, 0), (6, 6), 0.5, radius=1)
    policy = BeliefPolicy(found, (7, 7))
    with pytest.raises(ValueError, match="no scene of the family looks from the cell"):
        roll_out_alike(policy, set_of(maps), patch_radius=1, max_steps=50)
