"""Facts of the page of agents on factories never seen: what is played, kept, counted, compared and
told.
"""

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from evaluating import call
from tiny_pool import tiny_pool

from agents.learning.local_configs import ExplorerConfig
from agents.learning.map_configs import PlannerConfig
from agents.learning.map_learner import MapLearner
from agents.policies.replanning import Replanner
from agents.rollout.scene_set import SceneSetResults, play_scene_set
from agents.runs.manifest import Config
from agents.runs.pretrained import (
    GeneralistPretrainedEntry,
    Models,
    PretrainedError,
    load_pretrained,
)
from agents.runs.run_folder import Run
from eval.commands import generalisation, intervals
from eval.unseen import policy_results, throughput
from eval.unseen.gallery import choose_scenes
from eval.unseen.page import unseen_page
from eval.unseen.pretrained_scores import score_pretrained
from eval.unseen.record import estimated_anew, shipped
from eval.unseen.scene_scores import SceneScores, results_of
from eval.unseen.scores import PAPER_TARGETS_DB, Player, detours, reference, score_unseen
from irs_gym import load_scene
from irs_gym.datasets import generator
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.oracle.shortest_path import distance_to_go

POOL = tiny_pool(6, (12, 11))
SCORE = {"scenes": 6, "success": 0.5, "spl": 0.25, "ratio": 1.125, "exact": None}
PRETRAINED = {
    "set": "ood-rooms",
    "scenes": 6,
    "hard": 4,
    "rows": [
        {"name": "U-Net", "track": "map", "chosen_among": 5, "all": SCORE, "hard": SCORE},
        {"name": "replanning", "track": "local", "chosen_among": None, "all": SCORE, "hard": SCORE},
    ],
}
SCENES = {"split": "train", "num_scenes": 3000, "test_split": "val", "test_scenes": 200}


def save(folder, config, seed, *, scenes=3000, spl=0.5):
    """A complete run of an agent that has hardly learned."""
    learner = MapLearner(config, tiny_pool(seed=seed), seed)
    learner.teacher.update(learner.pool, 0.0)
    env = {**SCENES, "num_scenes": scenes}
    run = Run.create(
        folder,
        Config(algorithm=config.algorithm, seed=seed, env=env, agent=asdict(config), training={}),
    )
    run.save_model("best", learner, 8, success=0.5, spl=spl)
    run.write_curve(
        [{"steps": 80, "seconds": 4.0 + seed, "success": 0.5, "spl": spl, "ratio": 1.0}]
    )
    run.update(status="finished")
    return run


def generalisation_data():
    """What the page in the documents was made of."""
    return json.loads((Path(__file__).parents[2] / "docs" / "generalisation.json").read_text())


@pytest.fixture
def runs(tmp_path):
    planner, explorer = PlannerConfig(batch_scenes=4), ExplorerConfig(robots=4)
    for seed in (0, 1):
        save(tmp_path / f"runs/planner{seed}", planner, seed, spl=0.5 + seed / 4)
        save(tmp_path / f"runs/explorer{seed}", explorer, seed)
    save(tmp_path / "runs/few", planner, 0, scenes=10)
    save(tmp_path / "runs/margin", PlannerConfig(batch_scenes=4, encoding="margin"), 0)
    return tmp_path / "runs"


@pytest.fixture
def small(monkeypatch):
    """Small pools in place of the sets, and no measuring of speed."""
    monkeypatch.setattr(
        generalisation,
        "build_scene_set",
        lambda name, scenes: tiny_pool(scenes, (12, 11), seed=len(name)),
    )
    monkeypatch.setattr(
        generalisation, "largest_scene_set", lambda scenes: tiny_pool(2, (20, 20), seed=7)
    )
    monkeypatch.setattr(generalisation, "_pretrained", lambda scenes: PRETRAINED)
    rates = {
        "load_before": 0.5,
        "scenes_per_second": 12.0,
        "steps_per_second": {"64": 1e6, "1024": 3e6},
        "maps": 9,
    }
    monkeypatch.setattr(generalisation, "throughput", lambda: rates)


def test_page_tells_what_each_entrant_did_on_each_set(monkeypatch, small, runs, tmp_path):
    words = ("--num-scenes", 8, "--local-large-scenes", 5, "--trained-by", "first; second")
    assert call(monkeypatch, "generalisation", runs, "--out", tmp_path / "docs", *words) == 0
    record = json.loads((tmp_path / "docs/generalisation.json").read_text())
    told = {(each["name"], each["training_scenes"]): each for each in record["entrants"]}
    assert set(told) == {
        ("planning network, imitation, encoding mask", 3000),
        ("planning network, imitation, encoding mask", 10),
        ("planning network, imitation, encoding margin", 3000),
        ("explorer: imitation with memory", 3000),
        ("optimistic replanning", None),
        ("explorer, untrained", None),
        ("greedy (octile)", None),
        ("greedy on the margin", None),
    }
    explorer = told["explorer: imitation with memory", 3000]
    assert explorer["seeds"] == [0, 1]
    assert (explorer["seconds"], explorer["steps_per_second"]) == (4.5, np.median([80 / 4, 80 / 5]))
    pool = tiny_pool(8, (12, 11), seed=4)
    by_hand = [
        play_scene_set(Run.open(runs / f"explorer{seed}").load_model(), pool) for seed in (0, 1)
    ]
    found = explorer["sets"]["test"]["all"]
    assert found["spl_by_seed"] == pytest.approx([each.spl.mean() for each in by_hand])
    assert found["success"]["value"] == pytest.approx(
        np.mean([each.is_success for each in by_hand])
    )
    rival = play_scene_set(Replanner(pool.shape, 5), pool)
    assert found["over_replanning"]["value"] == pytest.approx(
        np.mean([each.spl - rival.spl for each in by_hand]), abs=1e-6
    )
    assert [record["sets"]["local"][name]["scenes"] for name in ("ood-irs", "ood-size")] == [8, 5]
    assert record["sets"]["map"]["ood-size"]["scenes"] == 8
    assert [each["target_db"] for each in explorer["paper"]] == list(PAPER_TARGETS_DB)
    assert record["over"] == "seeds and scenes"
    untrained = told["explorer, untrained", None]["sets"]["test"]["all"]
    assert found["over_untrained"]["value"] == pytest.approx(
        found["spl"]["value"] - untrained["spl"]["value"], abs=1e-6
    )
    assert "over_untrained" not in untrained
    page = (tmp_path / "docs/generalisation.md").read_text()
    assert "    first\n    second\n    python -m eval generalisation" in page
    for name, _ in told:
        assert f"| {name} |" in page
    for figure in ("scenes", "gallery"):
        assert (
            (tmp_path / f"docs/figures/generalisation/{figure}.png")
            .read_bytes()
            .startswith(b"\x89PNG")
        )


def test_anybody_can_make_the_intervals_anew_from_the_scores_in_the_scenes(
    monkeypatch, small, runs, tmp_path
):
    docs = tmp_path / "docs"
    monkeypatch.setattr(generalisation, "gallery", lambda entrants, pools: b"")
    monkeypatch.setattr(generalisation, "PAGE_REFERENCES", ("replanning", "untrained_explorer"))
    words = ("--out", docs, "--num-scenes", 4, "--local-large-scenes", 1)
    assert call(monkeypatch, "generalisation", runs, *words) == 0
    record = json.loads((docs / "generalisation.json").read_text())
    page = (docs / "generalisation.md").read_text()
    monkeypatch.setattr(intervals, "coverages", list)
    emptied = {**record, "entrants": [{**each, "sets": {}} for each in record["entrants"]]}
    (docs / "generalisation.json").write_text(json.dumps(emptied))
    (docs / "generalisation.md").unlink()
    assert call(monkeypatch, "intervals", "--out", docs) == 0
    assert json.loads((docs / "generalisation.json").read_text()) == record
    assert (docs / "generalisation.md").read_text() == page

    scores = SceneScores.read(docs / "generalisation.npz")
    table = scores.spl["explorer: imitation with memory, 3000 scenes/test"]
    assert (table.dtype, table.shape) == (np.float32, (2, 4))
    np.savez(docs / "generalisation.npz", **{"spl/x/test": table + 1})
    assert call(monkeypatch, "intervals", "--out", docs) == 2
    SceneScores({}, {}).write(docs / "generalisation.npz")
    assert call(monkeypatch, "intervals", "--out", docs) == 2


def test_figures_of_scores_in_the_scenes_by_hand():
    spl = np.array([[1.0, 0.5, 0.0, 0.8], [1.0, 0.5, 0.5, 1.0]])
    is_hard = np.array([False, True, True, False])
    rival = np.array([[0.5, 0.5, 0.5, 0.5]])
    found = results_of(spl, is_hard, {"over_replanning": rival})
    whole, hard = found["all"], found["hard"]
    assert whole["success"]["value"] == 7 / 8
    assert whole["spl_by_seed"] == pytest.approx([2.3 / 4, 3 / 4])
    assert whole["ratio"] == pytest.approx(((1 + 2 + 1.25) / 3 + (1 + 2 + 2 + 1) / 4) / 2)
    assert whole["exact"] == 3 / 8
    assert whole["over_replanning"]["value"] == pytest.approx(5.3 / 8 - 0.5)
    assert hard["success_by_seed"] == [0.5, 1.0]
    assert set(results_of(spl, np.zeros(4, bool), {})) == {"all"}


def test_a_shipped_model_stands_beside_the_mean_of_its_seeds(monkeypatch):
    record = generalisation_data()
    told = {each["name"]: each for each in shipped(record["entrants"], None)}
    own = told["explorer: PPO with memory"]
    assert (own["seed"], own["chosen_among"]) == (2, 5)
    entrant = next(each for each in record["entrants"] if each["name"] == own["name"])
    by_seed = entrant["sets"]["test"]["all"]["spl_by_seed"]
    assert own["spl"]["test"]["value"] == by_seed[2] < np.mean(by_seed)
    assert shipped([{**each, "models": []} for each in record["entrants"]], None) == []


def test_without_scores_intervals_are_over_seeds_and_the_page_says_so():
    record = generalisation_data()
    again = estimated_anew(record, None)
    assert again == record
    assert "over seeds *in these very scenes*" in unseen_page(again, "figures")


def test_the_page_that_is_there_is_written_anew_with_the_pretrained_models_on_it(
    monkeypatch, small, tmp_path
):
    kept = generalisation_data()
    kept.pop("pretrained", None)
    (tmp_path / "generalisation.json").write_text(json.dumps(kept))
    assert call(monkeypatch, "generalisation", "--out", tmp_path) == 0
    page = (tmp_path / "generalisation.md").read_text()
    assert "| U-Net | the map | 0.5000 | 0.2500 | 1.1250 | – | 0.5000 | 0.2500 |" in page
    assert "on the 6 scenes of `ood-rooms`, 4 of them hard" in page
    again = json.loads((tmp_path / "generalisation.json").read_text())
    assert again.pop("pretrained") == PRETRAINED
    assert again == kept


def test_without_a_page_there_is_none_to_write_anew(monkeypatch, tmp_path, capsys):
    assert call(monkeypatch, "generalisation", "--out", str(tmp_path)) == 2
    assert "generalisation.json" in capsys.readouterr().err


def test_pretrained_models_are_scored_on_rooms_beside_references():
    found = score_pretrained("ood-rooms", build_scene_set("ood-rooms", 3, jobs=1))
    by_name = {each["name"]: each for each in found["rows"]}
    assert len(by_name) == 6 + len(policy_results.REFERENCE_TITLES)
    assert {each["track"] for each in found["rows"]} == {"map", "local"}
    assert by_name["planning network, imitation"]["all"]["spl"] > 0.9
    assert by_name["optimistic replanning"]["all"]["success"] == 1.0
    assert by_name["greedy (octile)"]["all"]["scenes"] == found["scenes"] == 3


def test_what_was_played_is_played_once_and_anew_for_another_model(tmp_path):
    played = []

    def episodes(pool):
        played.append(pool)
        return SceneSetResults(
            np.ones(6, dtype=bool), pool.oracle_distance * 2, pool.oracle_distance
        )

    file, player = tmp_path / "new/kept.npz", Player("it", episodes)
    first = policy_results.kept(file, POOL, "a", player)
    again = policy_results.kept(file, POOL, "a", player)
    assert len(played) == 1
    np.testing.assert_array_equal(first.spl, again.spl)
    policy_results.kept(file, POOL, "b", player)
    policy_results.kept(file, tiny_pool(6, (12, 11), seed=1), "b", player)
    assert len(played) == 3


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: {**arrays, "distance": np.full(6, np.nan)},
        lambda arrays: {**arrays, "distance": np.zeros(6)},
        lambda arrays: {**arrays, "is_success": np.ones(7, bool)},
        lambda arrays: {**arrays, "is_success": np.ones(6)},
        lambda arrays: {"key": arrays["key"]},
        lambda arrays: {**arrays, "key": np.array([None])},
    ],
)
def test_what_was_played_is_played_anew_where_its_file_is_forged_or_damaged(tmp_path, change):
    file, played = tmp_path / "kept.npz", []

    def episodes(pool):
        played.append(pool)
        return SceneSetResults(
            np.ones(6, dtype=bool), pool.oracle_distance * 2, pool.oracle_distance
        )

    policy_results.kept(file, POOL, "a", Player("it", episodes))
    with np.load(file) as arrays:
        forged = change(dict(arrays))
    np.savez(file, **forged)
    found = policy_results.kept(file, POOL, "a", Player("it", episodes))
    assert len(played) == 2
    np.testing.assert_array_equal(found.distance, POOL.oracle_distance * 2)
    file.write_bytes(file.read_bytes()[:-9])
    policy_results.kept(file, POOL, "a", Player("it", episodes))
    assert len(played) == 3


def test_runs_that_cannot_count_are_left_out_by_name(monkeypatch, small, runs, tmp_path, capsys):
    Run.open(runs / "few").update(status="interrupted")
    Run.create(
        runs / "single", Config(algorithm="q_learning", seed=0, env={}, agent={}, training={})
    )
    assert (
        call(monkeypatch, "generalisation", runs, "--out", tmp_path / "docs", "--num-scenes", 3)
        == 0
    )
    said = capsys.readouterr().err
    assert "few: has not ended: its status is 'interrupted'" in said
    assert "single: q_learning learned in one scene" in said
    assert "few" in (tmp_path / "docs/generalisation.md").read_text().split("## Runs left out")[1]


@pytest.mark.parametrize(
    ("words", "message"), [((), "no complete run"), (("--num-scenes", 0), "num_scenes=0")]
)
def test_page_without_runs_or_scenes_is_refused(monkeypatch, capsys, tmp_path, words, message):
    assert call(monkeypatch, "generalisation", tmp_path, *words) == 2
    assert message in capsys.readouterr().err


def test_gallery_shows_long_detours_solved_and_the_worst():
    spl = np.array([1.0, 0.99, 0.0, 0.97, 0.3, 0.5])
    detour = np.array([1.0, 1.3, 1.1, 1.5, 1.0, 1.0])
    assert choose_scenes(spl, detour) == [3, 1, 2, 4]


@pytest.mark.parametrize("name", ["oracle", "greedy", "greedy_margin"])
def test_references_on_a_pool_do_what_their_rules_say(name):
    found = reference(name).episodes(POOL)
    if name == "oracle":
        np.testing.assert_allclose(found.distance, POOL.oracle_distance)
        assert found.is_success.all()
    for n in np.flatnonzero(found.is_success):
        to_go = distance_to_go(POOL.feasible[n], tuple(POOL.goal[n].tolist()), 0.5)
        assert found.distance[n] >= to_go[tuple(POOL.start[n])] - 1e-9
    scores = score_unseen(reference(name), {"it": POOL})["it"]
    assert scores[1].scenes == 6
    assert scores[2].scenes == (detours(POOL) > 1.2).sum()


def test_best_generalist_is_kept_and_loaded_only_as_it_was_kept(monkeypatch, runs, tmp_path):
    models = tmp_path / "models"
    assert call(monkeypatch, "pretrain", runs, "--out", models) == 0
    entries = {each.config.algorithm: each for each in Models.read(models).generalists}
    assert set(entries) == {"planner", "explorer"}
    assert (entries["planner"].config.seed, entries["planner"].chosen_among) == (1, 4)
    kept = load_pretrained("planner", folder=models, split="val", num_scenes=2)
    run = Run.open(runs / "planner1")
    np.testing.assert_array_equal(
        play_scene_set(kept.policy, POOL).distance, play_scene_set(run.load_model(), POOL).distance
    )
    assert load_pretrained("explorer", folder=models, split="ood-size").policy.shape == (80, 80)
    with pytest.raises(PretrainedError, match="observation='map', not 'flat'"):
        load_pretrained("planner", folder=models, observation="flat")
    with pytest.raises(
        PretrainedError, match="no pretrained 'vin' for many scenes; there are explorer, planner"
    ):
        load_pretrained("vin", folder=models)
    path = models / "planner.npz"
    path.write_bytes(path.read_bytes() + b"x")
    with pytest.raises(PretrainedError, match="is not loaded"):
        load_pretrained("planner", folder=models)
    assert isinstance(entries["planner"], GeneralistPretrainedEntry)
    assert sha256(path.read_bytes()[:-1]).hexdigest() == entries["planner"].sha256


def test_files_and_references_are_scored_beside_runs(monkeypatch, capsys, runs, tmp_path):
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    load_scene("paper").save(scenes / "paper.json")
    (file,) = (runs / "planner1").glob("best-*.npz")
    assert (
        call(monkeypatch, "score", file, "replanning", runs / "explorer0", "--scenes", scenes) == 0
    )
    said = capsys.readouterr().out
    assert str(file) in said
    assert "replanning" in said
    assert (runs / "explorer0/unseen.json").exists()
    assert call(monkeypatch, "score", "replanning", "--env", "IrsNav-v0") == 2
    assert "plays run folders alone" in capsys.readouterr().err
    (tmp_path / "bad.npz").write_bytes(b"no")
    assert call(monkeypatch, "score", tmp_path / "bad.npz", "--scenes", scenes) == 2
    assert "does not hold a network" in capsys.readouterr().err


def test_throughput_counts_scenes_and_steps(monkeypatch):
    monkeypatch.setattr(throughput, "ROUNDS", 2)
    drawn = []
    monkeypatch.setattr(
        throughput, "draw_solved_scene", lambda rng: drawn.append(generator.draw_solved_scene(rng))
    )

    class Env:
        def __init__(self, robots, **_):
            self.robots = robots

        def reset(self, seed):
            pass

        def step(self, actions):
            assert actions.shape == (self.robots,)

    monkeypatch.setattr(throughput, "IrsNavRandomVectorEnv", Env)
    found = throughput.throughput(scenes=2, seconds=0.01)
    assert len(drawn) == 4
    assert found["scenes_per_second"] > 0
    assert set(found["steps_per_second"]) == {"64", "1024"}
