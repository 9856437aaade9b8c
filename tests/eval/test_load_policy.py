"""Facts of what a user names to look at: which policy it is, and where it plays."""

import gymnasium
import numpy as np
import pytest
from evaluating import call
from tiny_pool import tiny_pool

from agents.policies.explorer_policy import Explorer
from agents.policies.replanning import Replanner
from agents.rollout.episode import roll_out
from agents.rollout.scene_set import play_scene_set
from agents.runs.pretrained import MODELS, load_pretrained
from eval.load_policy import AT_HOME, Place, load_policy
from irs_gym import load_scene, shortest_path
from irs_gym.datasets import random_task, scene_set
from irs_gym.datasets.scene_set import scene_set_of

POOL = tiny_pool(4, (50, 40), seed=1)


@pytest.fixture
def splits(monkeypatch):
    """Small maps in place of the generated ones; returns what was asked for."""
    asked = []

    def build(split, num_scenes):
        asked.append((split, num_scenes))
        return POOL

    monkeypatch.setattr(scene_set, "build_scene_set", build)
    random_task._build_worlds.cache_clear()
    yield asked
    random_task._build_worlds.cache_clear()


def episode_of(found):
    return roll_out(found.policy, found.env, options=found.options)


@pytest.mark.parametrize("name", ["planner", "explorer", "models/explorer.npz", "replanning"])
def test_policies_of_many_scenes_play_the_generated_scene_that_is_named(splits, name):
    name = name.replace("models", str(MODELS))
    found = load_policy(name, Place(split="ood-size", scene_id=2), "ansi")
    assert splits == [("ood-size", 3)]
    policy = (
        Replanner(POOL.shape, 5)
        if name == "replanning"
        else load_pretrained(name.split("/")[-1][:8]).policy
    )
    assert episode_of(found).distance == pytest.approx(play_scene_set(policy, POOL).distance[2])
    if isinstance(found.policy, Explorer):
        assert found.policy.shape == POOL.shape


def test_policies_of_many_scenes_play_the_first_test_scene_at_home_and_one_scene_as_it_is_changed(
    splits,
):
    load_policy("planner", AT_HOME, "ansi")
    assert splits == [("test", 1)]
    found = load_policy("planner", Place(target_db=-62.0, phase_bits=2, irs_elements=600), "ansi")
    inner = found.env.unwrapped
    paper = load_scene("paper").with_irs_elements(600)
    expected = scene_set_of([paper.model_copy(update={"target_db": -62.0, "phase_bits": 2})])
    np.testing.assert_array_equal(inner.radio_map.gain_db, expected.gain_db[0])
    assert inner.world.target_db == -62.0
    assert episode_of(found).oracle_distance == pytest.approx(expected.oracle_distance[0])


def test_references_play_the_task_and_the_generated_scenes(splits):
    found = load_policy("oracle", Place(target_db=-63.0), "ansi")
    assert found.env.spec.id == "IrsNav-v0"
    assert episode_of(found).distance == pytest.approx(21.571, abs=1e-3)
    assert not splits
    found = load_policy("oracle", Place(scene_id=1), "ansi")
    path = shortest_path(
        POOL.feasible[1], tuple(POOL.start[1].tolist()), tuple(POOL.goal[1].tolist()), 0.5
    )
    assert episode_of(found).distance == pytest.approx(path.distance)


@pytest.mark.parametrize(
    ("name", "distance"), [("oracle", 21.493), ("grid_oracle", 22.978), ("straight", None)]
)
def test_references_go_anywhere_on_the_floor_where_that_is_asked_for(name, distance):
    found = load_policy(name, Place(target_db=-61.8, continuous=True), "ansi")
    assert found.env.spec.id == "IrsNavContinuous-v0"
    episode = episode_of(found)
    assert episode.is_success == (distance is not None)
    assert distance is None or episode.distance == pytest.approx(distance, abs=1e-3)


def test_references_go_anywhere_in_a_generated_scene(splits):
    found = load_policy("oracle", Place(split="ood-size", scene_id=1, continuous=True), "ansi")
    assert splits == [("ood-size", 2)]
    assert found.env.spec.id == "IrsNavContinuous-v0"
    assert found.options == {"scene_id": 1}
    assert episode_of(found).is_optimal


def test_pretrained_agents_of_one_task_play_it_alone():
    found = load_policy("ppo", Place(target_db=-62.5, phase_bits=1), "ansi")
    assert isinstance(found.env, gymnasium.Env)
    assert episode_of(found).ratio == pytest.approx(1.0)
    with pytest.raises(
        ValueError, match="split cannot be given here: this policy learned in one scene"
    ):
        load_policy("ppo", Place(split="test"), "ansi")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["planner", "--split", "tests"], "tests"),
        (["planner", "--scene-id", "-1"], "scene_id=-1 must be 0 or more"),
        (
            ["planner", "--scene", "paper", "--scene-id", "1"],
            "scene_id cannot be given along with scene",
        ),
        (
            ["oracle", "--split", "test", "--target-db", "-60"],
            "split cannot be given along with target_db",
        ),
        (["planner", "--target-db", "-40"], "-59.5106 dB"),
        (["planner", "--phase-bits", "0"], "phase_bits"),
        (["nowhere.npz"], "nowhere.npz"),
        (["straight"], "'straight' goes anywhere on the floor: continuous must be given too"),
        (["planner", "--continuous"], "continuous is for oracle, grid_oracle, straight, random"),
        (
            ["oracle", "--continuous", "--scene-id", "1", "--target-db", "-60"],
            "scene_id cannot be given along with target_db",
        ),
    ],
)
def test_what_cannot_be_shown_is_told_in_a_line(monkeypatch, capsys, words, message):
    assert call(monkeypatch, "watch", *words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
