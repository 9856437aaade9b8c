"""Facts of scoring on scenes that an agent did not learn on."""

import json

import numpy as np
import pytest
from evaluating import call
from scipy.sparse.csgraph import dijkstra
from tiny_pool import tiny_pool

from agents.learning.map_configs import PlannerConfig
from agents.learning.map_learner import MapLearner
from agents.policies.map_policy import MapPolicy
from agents.rollout.episode import evaluation_env, roll_out
from agents.rollout.scene_set import SceneSetResults
from agents.runs.manifest import Config
from agents.runs.run_folder import Run
from eval.unseen.scores import detours, paper_scene_set, reference, scene_sets_of, score_of
from irs_gym import load_scene
from irs_gym.grid import flat_cells, octile_distance
from irs_gym.mdp.task import Task
from irs_gym.oracle.shortest_path import graph_of


@pytest.fixture
def run(tmp_path):
    """A planner that has hardly learned, as a run."""
    learner = MapLearner(PlannerConfig(total_scenes=8, batch_scenes=4), tiny_pool(), 0)
    learner.teacher.update(learner.pool, 0.0)
    run = Run.create(
        tmp_path / "run", Config(algorithm="planner", seed=0, env={}, agent={}, training={})
    )
    run.save_model("best", learner, 8, success=0.5, spl=0.5)
    return run


@pytest.fixture
def scenes(tmp_path):
    folder = tmp_path / "scenes"
    folder.mkdir()
    for target in (-63.0, -61.0):
        load_scene("paper").model_copy(update={"target_db": target}).save(
            folder / f"at{target:g}.json"
        )
    return folder


def test_scores_count_failures_and_the_hard_scenes_alone():
    episodes = SceneSetResults(
        np.array([True, True, False]), np.array([2.0, 5.0, 9.0]), np.array([2.0, 4.0, 3.0])
    )
    whole, hard = score_of(episodes), score_of(episodes, np.array([False, True, True]))
    assert (whole.scenes, whole.success, whole.exact) == (3, 2 / 3, 1 / 3)
    assert whole.spl == pytest.approx((1 + 0.8 + 0) / 3)
    assert whole.ratio == pytest.approx((1 + 1.25) / 2)
    assert (hard.scenes, hard.success, hard.ratio) == (2, 0.5, 1.25)
    assert score_of(episodes, np.zeros(3, dtype=bool)).spl is None


def test_detour_is_the_oracles_distance_over_the_octile_distance():
    pool = paper_scene_set()
    straight = octile_distance(np.array([39, 0])) * 0.5
    assert detours(pool) == pytest.approx(pool.oracle_distance / straight)
    assert pool.oracle_distance == pytest.approx([21.571, 21.571, 23.228, 25.642, 25.642], abs=1e-3)


def test_untrained_planner_reaches_every_goal_in_the_fewest_moves_but_not_metres():
    pool = tiny_pool(30, (14, 11), seed=7)
    found = reference("untrained_planner").episodes(pool)
    assert found.is_success.all()
    assert 0.9 < found.spl.mean() < 0.99
    for n, actions in enumerate(found.actions):
        graph = graph_of(pool.feasible[n])
        start, goal = flat_cells(np.stack([pool.start[n], pool.goal[n]]), pool.shape)
        fewest = dijkstra(graph, unweighted=True, indices=start)[goal]
        assert (actions >= 0).sum() == fewest


def test_scores_on_scene_files_are_those_of_playing_each_in_the_environment(
    monkeypatch, run, scenes
):
    assert call(monkeypatch, "score", run.folder, "--scenes", scenes) == 0
    record = json.loads((run.folder / "unseen.json").read_text())
    (found,) = record["scores"].values()
    policy, played = run.load_model(), []
    assert isinstance(policy, MapPolicy)
    for file in sorted(scenes.glob("*.json")):
        played.append(roll_out(policy, evaluation_env(Task(scene=file, observation="map"))))
    assert found["all"]["scenes"] == 2
    assert found["all"]["success"] == np.mean([each.is_success for each in played])
    assert found["all"]["spl"] == pytest.approx(np.mean([each.spl for each in played]))


def test_scenes_of_different_sizes_are_read_into_one_frame(scenes):
    load_scene("workshop").save(scenes / "workshop.json")
    (pool,) = scene_sets_of((), 1, scenes).values()
    assert pool.names == ("at-61", "at-63", "workshop")
    assert pool.shape == (64, 40)


def test_scenes_are_played_in_cells_of_the_size_that_is_asked_for(monkeypatch, capsys, run, scenes):
    (pool,) = scene_sets_of((), 1, scenes, 0.25).values()
    assert (pool.shape, pool.cell_size) == ((80, 80), 0.25)
    assert call(monkeypatch, "score", run.folder, "--scenes", scenes, "--cell-size", 1.0) == 0
    assert json.loads((run.folder / "unseen.json").read_text())
    assert call(monkeypatch, "score", run.folder, "--scenes", scenes, "--cell-size", -1) == 2
    assert "cell_size=-1" in capsys.readouterr().err


def test_scenes_of_a_split_are_played_in_other_cells_too(monkeypatch):
    found = scene_sets_of(("val",), 3, None, 0.25)
    assert found["val"].cell_size == found["paper"].cell_size == 0.25
    assert len(found["val"]) <= 3
    with pytest.raises(ValueError, match=r"cell_size=0\.0"):
        scene_sets_of(("val",), 3, None, 0.0)


@pytest.mark.parametrize("harm", ["missing", "empty", "damaged", "infeasible"])
def test_scenes_that_cannot_be_played_are_refused_by_name(monkeypatch, capsys, run, scenes, harm):
    if harm == "damaged":
        (scenes / "bad.json").write_text("{")
    if harm == "infeasible":
        load_scene("paper").model_copy(update={"target_db": -50.0}).save(scenes / "bad.json")
    if harm == "empty":
        for file in scenes.iterdir():
            file.unlink()
    folder = scenes / "nowhere" if harm == "missing" else scenes
    assert call(monkeypatch, "score", run.folder, "--scenes", folder) == 2
    said = capsys.readouterr().err
    expected = {"missing": "is no folder of scene files", "empty": "holds no scene file"}
    assert expected.get(harm, "bad") in said
    assert not (run.folder / "unseen.json").exists()


def test_agent_of_one_scene_is_not_scored_on_others(monkeypatch, capsys, tmp_path, scenes):
    config = Config(algorithm="q_learning", seed=0, env={}, agent={}, training={})
    folder = Run.create(tmp_path / "single", config).folder
    assert call(monkeypatch, "score", folder, "--scenes", scenes) == 2
    assert "acts in its own scene alone" in capsys.readouterr().err
