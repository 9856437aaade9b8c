"""Facts of the page of agents on factories never seen: what is played, kept, counted, compared and
told.
"""

import json
from dataclasses import asdict, replace
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
from agents.rollout.scene_set import play_scene_set
from agents.runs.manifest import Config
from agents.runs.pretrained import (
    GeneralistPretrainedEntry,
    Models,
    PretrainedError,
    load_pretrained,
)
from agents.runs.run_folder import Run
from eval import statistics
from eval.commands import generalisation, intervals
from eval.unseen import played, throughput
from eval.unseen.gallery import choose_scenes
from eval.unseen.page_sets import (
    PAGE_SETS,
    WALL_DETOURS,
    PageSet,
    SetFacts,
    checksum_of,
    page_scene_set,
    wall_scene_set,
)
from eval.unseen.played import Trial, play_all
from eval.unseen.policy_results import Policy, family_left_out, learned_on
from eval.unseen.record import VERSION, estimated_anew
from eval.unseen.scene_scores import (
    FAMILY_SETS,
    MEAN,
    TOP,
    SceneScores,
    means_over_seeds,
    packed,
    results_of,
)
from eval.unseen.scores import PAPER_TARGETS_DB, detours, reference, score_unseen
from irs_gym import load_scene
from irs_gym.datasets import generator
from irs_gym.datasets.splits import FAMILIES, SPLITS, all_but
from irs_gym.oracle.shortest_path import distance_to_go

DOCS = Path(__file__).parents[2] / "docs"
POOL = tiny_pool(6, (12, 11))
SCENES = {"split": "train", "num_scenes": 3000, "test_split": "val", "test_scenes": 200}
RATES = {
    "load_before": 0.5,
    "scenes_per_second": 12.0,
    "steps_per_second": {"64": 1e6, "1024": 3e6},
    "maps": 9,
}


def save(folder, config, seed, *, scenes=3000, spl=0.5, split="train"):
    """A complete run of an agent that has hardly learned."""
    learner = MapLearner(config, tiny_pool(seed=seed), seed)
    learner.teacher.update(learner.pool, 0.0)
    env = {**SCENES, "num_scenes": scenes, "split": split}
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


IN_ORDER = list(PAGE_SETS)  # before a test replaces any


@pytest.fixture
def runs(tmp_path):
    """Two seeds of a planner and of an explorer, a point of the curve, another setting, and an
    explorer that mazes were left out for.
    """
    planner, explorer = PlannerConfig(batch_scenes=4), ExplorerConfig(robots=4)
    for seed in (0, 1):
        save(tmp_path / f"runs/planner{seed}", planner, seed, spl=0.5 + seed / 4)
        save(tmp_path / f"runs/explorer{seed}", explorer, seed)
        save(tmp_path / f"runs/no-maze{seed}", explorer, 2 + seed, split=all_but("maze"))
    save(tmp_path / "runs/few", planner, 0, scenes=10)
    save(tmp_path / "runs/margin", PlannerConfig(batch_scenes=4, encoding="margin"), 0)
    return tmp_path / "runs"


@pytest.fixture
def small(monkeypatch, tmp_path):
    """Small pools in place of some sets, no models that come with the package, and no measuring of
    speed; returns what a set's scenes are.
    """

    def build(name):
        side = 20 if name.startswith("160") else 12
        return lambda scenes: tiny_pool(scenes, (side, side - 1), seed=len(name))

    for name in (
        "ood-clutter",
        "ood-irs",
        "ood-size",
        "ood-rooms",
        "160x160-maze",
        "ood-clutter-anew",
    ):
        monkeypatch.delitem(PAGE_SETS, name)
    for name, each in PAGE_SETS.items():
        if name != "paper":
            few = PageSet(what=each.what, build=build(name), most=each.most)
            monkeypatch.setitem(PAGE_SETS, name, few)

    monkeypatch.setattr(generalisation, "MODELS", tmp_path / "no models")
    monkeypatch.setattr(generalisation, "throughput", lambda: RATES)
    monkeypatch.setenv("IRS_GYM_CACHE", str(tmp_path / "cache"))
    page_scene_set.cache_clear()
    yield build
    page_scene_set.cache_clear()


def record_of(monkeypatch, runs, docs, *words, gallery=False):
    """What the command tells of some runs."""
    if not gallery:
        monkeypatch.setattr(generalisation, "gallery", lambda entrants: b"")
    given = (runs, "--out", docs, "--jobs", 1, *words)
    assert call(monkeypatch, "generalisation", *given) == 0
    return json.loads((docs / "generalisation.json").read_text())


def test_page_tells_what_each_entrant_did_on_each_set(monkeypatch, small, runs, tmp_path):
    words = ("--num-scenes", 8, "--local-scenes", 6, "--trained-by", "first; second")
    record = record_of(monkeypatch, runs, tmp_path / "docs", *words, gallery=True)
    told = {(each["name"], each["training_scenes"]): each for each in record["entrants"]}
    assert set(told) == {
        ("planning network, imitation, encoding mask", 3000),
        ("planning network, imitation, encoding mask", 10),
        ("planning network, imitation, encoding margin", 3000),
        ("explorer: imitation with memory", 3000),
        ("explorer: imitation with memory, all kinds but maze", 3000),
        ("planning network, untrained", None),
        ("optimistic replanning", None),
        ("explorer, untrained", None),
        ("greedy (octile)", None),
        ("greedy on the margin", None),
    }
    explorer = told["explorer: imitation with memory", 3000]
    assert explorer["seeds"] == [0, 1]
    assert (explorer["seconds"], explorer["steps_per_second"]) == (4.5, np.median([80 / 4, 80 / 5]))
    assert set(explorer["sets"]) == {*PAGE_SETS, MEAN}
    pool = small("ood-maze")(6)
    by_hand = [
        play_scene_set(Run.open(runs / f"explorer{seed}").load_model(), pool) for seed in (0, 1)
    ]
    found = explorer["sets"]["ood-maze"]["all"]
    assert found["spl_by_seed"] == pytest.approx([each.spl.mean() for each in by_hand], abs=1e-5)
    assert found["success"]["value"] == pytest.approx(
        np.mean([each.is_success for each in by_hand])
    )
    rival = play_scene_set(Replanner(pool.shape, 5), pool)
    assert found["over_replanning"]["value"] == pytest.approx(
        np.mean([each.spl - rival.spl for each in by_hand]), abs=1e-5
    )
    sizes = [record["sets"][track]["160x160"]["scenes"] for track in ("map", "local")]
    assert sizes == [8, 6]
    assert [each["target_db"] for each in explorer["paper"]] == list(PAPER_TARGETS_DB)
    untrained = told["explorer, untrained", None]["sets"]
    assert found["over_untrained"]["value"] == pytest.approx(
        found["spl"]["value"] - untrained["ood-maze"]["all"]["spl"]["value"], abs=1e-6
    )
    assert "over_untrained" not in untrained["test"]["all"]
    assert "over_untrained" in told["optimistic replanning", None]["sets"]["test"]["all"]
    assert set(told["planning network, imitation, encoding mask", 10]["sets"]) == {"test"}
    page = (tmp_path / "docs/generalisation.md").read_text()
    assert "    first\n    second\n    python -m eval generalisation" in page
    for each in record["entrants"]:
        assert each["training_scenes"] == 10 or each["group"] in page
    for figure in ("scenes", "gallery"):
        assert (
            (tmp_path / f"docs/figures/generalisation/{figure}.png")
            .read_bytes()
            .startswith(b"\x89PNG")
        )


def test_agents_that_a_family_was_left_out_for_play_that_family_alone(
    monkeypatch, small, runs, tmp_path
):
    save(tmp_path / "runs/no-hall", ExplorerConfig(robots=4), 4, split=all_but("hall"), scenes=3000)
    record = record_of(monkeypatch, runs, tmp_path, "--num-scenes", 2, "--local-scenes", 5)
    told = {each["name"]: each for each in record["entrants"]}
    mazes = told["explorer: imitation with memory, all kinds but maze"]
    assert set(mazes["sets"]) == {"ood-maze"}
    assert mazes["seeds"] == [2, 3]
    (left_out,) = record["left_out_families"]
    assert left_out["name"] == "explorer: imitation with memory"
    assert set(left_out["families"]) == {"maze", "hall"}
    assert left_out["families"]["maze"]["seeds"] == [2, 3]

    # each family counts once, however many seeds
    scores = SceneScores.read(tmp_path / "generalisation.npz")
    key = "explorer: imitation with memory, all kinds but {}, 3000 scenes/ood-{}"
    less = [
        scores.spl[key.format(name, name)] / TOP
        - scores.spl[f"explorer, untrained/ood-{name}"] / TOP
        for name in ("maze", "hall")
    ]
    assert [len(each) for each in less] == [2, 1]
    mean = left_out["mean"]["over_untrained"]
    assert mean["these"]["value"] == pytest.approx(np.mean([each.mean() for each in less]))
    assert mean["these"]["value"] == mean["others"]["value"]
    by_hand = statistics.mean_of_crossed(less)
    assert mean["these"]["interval"] == pytest.approx([by_hand.low, by_hand.high])
    page = (tmp_path / "generalisation.md").read_text()
    assert "all kinds but maze" not in page  # it stands in the table of families
    assert "the family left out" in page


def test_what_agents_learned_on_in_words():
    assert learned_on("train") == "usual"
    assert learned_on(all_but("trap")) == "all kinds but trap"
    assert learned_on("+".join(["train", *(f"train-{name}" for name in FAMILIES)])) == "all kinds"
    without = ["train", *(f"train-{name}" for name in FAMILIES if name not in ("hall", "aps"))]
    assert learned_on("+".join(without)) == "all kinds but hall and aps"
    assert learned_on("train+train-maze") == learned_on("3*train+train-maze") == "usual, maze"
    assert learned_on("train-maze+train-hall") == "maze, hall"
    assert [family_left_out(all_but(name)) for name in FAMILIES] == list(FAMILIES)
    assert family_left_out("train") is None


def test_a_row_says_what_it_learned_on_where_that_is_not_usual(monkeypatch, small, tmp_path):
    runs, docs, explorer = tmp_path / "runs", tmp_path / "docs", ExplorerConfig(robots=4)
    words = ("--num-scenes", 2, "--local-scenes", 2)

    save(runs / "walls", explorer, 0, split="train+train-maze")
    record = record_of(monkeypatch, runs, docs, *words)
    names = [each["name"] for each in record["entrants"] if each["is_run"]]
    assert names == ["explorer: imitation with memory, usual, maze"]

    # beside one of the usual scenes alone, both say it
    save(runs / "usual", explorer, 0)
    record = record_of(monkeypatch, runs, docs, *words)
    names = [each["name"] for each in record["entrants"] if each["is_run"]]
    title = "explorer: imitation with memory"
    assert names == [f"{title}, usual", f"{title}, usual, maze"]


def test_rows_are_kept_where_the_page_gets_new_sets(monkeypatch, small, tmp_path):
    docs, words = tmp_path / "docs", ("--num-scenes", 2, "--local-scenes", 2)
    save(tmp_path / "old/planner", PlannerConfig(batch_scenes=4), 0)
    with monkeypatch.context() as before:
        before.delitem(PAGE_SETS, "test-anew")
        record_of(before, tmp_path / "old", docs, *words)

    save(tmp_path / "new/explorer", ExplorerConfig(robots=4), 0)
    record = record_of(monkeypatch, tmp_path / "new", docs, *words, "--keep-rows")
    sets = {each["algorithm"]: {*each["sets"]} for each in record["entrants"] if each["is_run"]}
    assert sets["explorer"] - sets["planner"] == {"test-anew"}
    page = (docs / "generalisation.md").read_text()
    assert "| test-anew |" in page


def test_sets_of_the_page_are_all_frozen_ones_and_what_has_no_split():
    frozen = {name for name, each in SPLITS.items() if each.is_frozen} - {"val"}
    others = {"test-anew", "ood-clutter-anew", "160x160", "160x160-maze", "walls", "paper"}
    assert {*PAGE_SETS} == {*frozen, *others}
    assert IN_ORDER[5:13] == list(FAMILY_SETS)


def test_single_walls_have_ways_around_of_their_lengths():
    pool = wall_scene_set(20)
    # in a row of cells past the wall two diagonal moves save a little
    np.testing.assert_allclose(pool.oracle_distance, np.array(WALL_DETOURS) - 2 + np.sqrt(2.0))
    free = np.isfinite(pool.gain_db)
    np.testing.assert_array_equal(pool.feasible, free)  # the target excludes nothing
    assert (~free).sum(axis=(1, 2)).tolist() == [159] * 20  # one row of cells but one
    assert len(wall_scene_set(3)) == 3


def test_anybody_can_make_the_intervals_anew_from_the_scores_in_the_scenes(
    monkeypatch, small, runs, tmp_path
):
    docs = tmp_path / "docs"
    record = record_of(monkeypatch, runs, docs, "--num-scenes", 3, "--local-scenes", 2)
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
    assert (table.dtype, table.shape) == (np.uint16, (2, 2))
    np.savez(docs / "generalisation.npz", **{"spl/x/test": table.astype(float)})
    assert call(monkeypatch, "intervals", "--out", docs) == 2
    SceneScores({}, {}).write(docs / "generalisation.npz")
    assert call(monkeypatch, "intervals", "--out", docs) == 2


def test_the_page_in_the_documents_is_that_of_the_scores_beside_it():
    record = json.loads((DOCS / "generalisation.json").read_text())
    scores = SceneScores.read(DOCS / "generalisation.npz")
    told = {each["algorithm"]: each for each in record["entrants"] if not each["is_run"]}
    untrained = told["untrained_explorer"]["sets"]["ood-maze"]["all"]
    spl = scores.spl["explorer, untrained/ood-maze"] / TOP  # as the page tells to do it by hand
    rival = scores.spl["optimistic replanning/ood-maze"] / TOP
    found = statistics.crossed_mean(spl - rival)
    assert untrained["over_replanning"]["value"] == pytest.approx(found.value)
    assert untrained["over_replanning"]["interval"] == pytest.approx([found.low, found.high])
    assert untrained["spl"]["value"] == pytest.approx(spl.mean())
    assert estimated_anew(record, scores)["left_out_families"] == record["left_out_families"]


def test_kept_scores_tell_failures_and_exact_paths_apart_from_all_others():
    spl = np.array([[0.0, 1e-9, 0.5, 1 - 1e-5, 1 - 1e-7, 1.0]])
    kept = packed(spl)
    assert kept.dtype == np.uint16
    assert (kept[0, [0, -2, -1]] == [0, TOP, TOP]).all()
    assert 0 < kept[0, 1] < kept[0, 2] < kept[0, 3] < TOP
    np.testing.assert_allclose(kept / TOP, spl, atol=2 / TOP)


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

    # in these very scenes the two means alone are draws: 0.575 and 0.75, less 0.5
    here = whole["over_replanning_in_these_scenes"]
    half = 12.7062 * abs(0.75 - 0.575) / 2  # Student's quantile of one degree of freedom
    assert here["value"] == pytest.approx(whole["over_replanning"]["value"])
    assert here["interval"] == pytest.approx([max(0.1625 - half, -1.0), min(0.1625 + half, 1.0)])
    alone = results_of(spl[:1], is_hard, {"over_replanning": rival})["all"]
    assert "over_replanning" in alone
    assert "over_replanning_in_these_scenes" not in alone
    assert hard["success"]["value"] == 3 / 4
    assert set(results_of(spl, np.zeros(4, bool), {})) == {"all"}


def test_a_shipped_model_that_is_one_of_the_seeds_stands_beside_their_mean(
    monkeypatch, small, runs, tmp_path
):
    models = tmp_path / "models"
    assert call(monkeypatch, "pretrain", runs, "--out", models) == 0
    monkeypatch.setattr(generalisation, "MODELS", models)
    monkeypatch.setattr("eval.unseen.record.MODELS", models)
    few = ("--num-scenes", 3, "--local-scenes", 3)
    record = record_of(monkeypatch, runs, tmp_path, *few)
    told = {each["name"]: each for each in record["shipped"]}
    own = told["planning network, imitation, encoding mask"]
    assert (own["seed"], own["seeds"], own["chosen_among"]) == (1, 2, 4)
    by_name = {each["name"]: each for each in record["entrants"]}
    entrant = by_name[own["name"]]  # of the two of that name, that with the usual scenes
    by_seed = entrant["sets"]["ood-trap"]["all"]["spl_by_seed"]
    assert own["spl"]["ood-trap"]["value"] == pytest.approx(by_seed[1])
    assert own["spl"][MEAN]["value"] == pytest.approx(
        np.mean([own["spl"][name]["value"] for name in FAMILY_SETS])
    )


def test_a_shipped_model_that_is_but_a_point_of_the_curve_plays_all_sets_too(monkeypatch, tmp_path):
    run = save(tmp_path / "runs", PlannerConfig(batch_scenes=4), 0, scenes=10)
    left_out = save(tmp_path / "no-maze", ExplorerConfig(robots=4), 0, split=all_but("maze"))
    monkeypatch.setattr(generalisation, "MODELS", tmp_path / "models")
    for folder in (run.folder, left_out.folder):
        call(monkeypatch, "pretrain", folder, "--out", tmp_path / "models")
    point, maze, shipped, *references = generalisation.policies_of([run, left_out])
    assert (point.sets, maze.sets) == (["test"], ["ood-maze"])
    assert (shipped.source, shipped.model) == ("planner", point.model)
    assert shipped.sets == list(PAGE_SETS)
    # what a family was left out for is never shipped
    assert {each.config for each in references} == {None}


def test_earlier_runs_keep_their_intervals_until_there_are_new_ones(
    monkeypatch, small, runs, tmp_path
):
    scores = {"success_by_seed": [1.0, 0.9, 0.8], "spl_by_seed": [0.5, 0.6, 0.7]}
    earlier = [
        {
            "algorithm": algorithm,
            "name": f"the earlier {algorithm}",
            "track": "map",
            "training_scenes": 3000,
            "split": "train",
            "learned_on": "usual",
            "seeds": [0, 1, 2],
            "sets": {"test": {"all": scores, "hard": scores}},
        }
        for algorithm in ("planner", "vin")
    ]
    before = {"format_version": VERSION, "earlier": earlier}
    (tmp_path / "generalisation.json").write_text(json.dumps(before))
    few = ("--num-scenes", 1, "--local-scenes", 1)
    record = record_of(monkeypatch, runs, tmp_path, *few)
    (kept,) = record["earlier"]
    assert kept["name"] == "the earlier vin"
    assert kept["sets"]["test"]["all"]["spl"]["value"] == pytest.approx(0.6)
    assert means_over_seeds(kept) == kept["sets"]
    page = (tmp_path / "generalisation.md").read_text()
    assert "| the earlier vin | 3,000 | 3 | 0.6000<br>" in page
    again = record_of(monkeypatch, runs, tmp_path, *few)
    assert again["earlier"] == record["earlier"]


def test_rows_are_kept_as_they_are_where_their_runs_are_gone(
    monkeypatch, small, runs, tmp_path, capsys
):
    few = ("--num-scenes", 3, "--local-scenes", 2)
    docs = tmp_path / "docs"
    before = record_of(monkeypatch, runs, docs, *few)
    scores = SceneScores.read(docs / "generalisation.npz")
    gone = ("planner0", "planner1", "few", "margin", "no-maze0", "no-maze1", "explorer1")
    for each in gone:
        (runs / each).rename(tmp_path / each)
    save(runs / "explorer1", ExplorerConfig(robots=4), 7)  # another one in its place
    after = record_of(monkeypatch, runs, docs, *few, "--keep-rows")
    names = [(each["name"], each["training_scenes"]) for each in before["entrants"]]
    assert {*names} == {(each["name"], each["training_scenes"]) for each in after["entrants"]}
    told = {(each["name"], each["training_scenes"]): each for each in after["entrants"]}
    for each in before["entrants"]:
        found = dict(told[each["name"], each["training_scenes"]])
        is_kept = found.pop("scored_from", None) is not None
        assert is_kept == (each["algorithm"] == "planner" or each["family"] == "maze")
        if is_kept or not each["is_run"]:
            assert found == each
    assert told["explorer: imitation with memory", 3000]["models"] != next(
        each["models"] for each in before["entrants"] if each["group"].startswith("explorer: imi")
    )
    now = SceneScores.read(docs / "generalisation.npz")
    assert now.spl.keys() == scores.spl.keys()
    name = "planning network, imitation, encoding mask, 3000 scenes/test"
    np.testing.assert_array_equal(now.spl[name], scores.spl[name])
    page = (docs / "generalisation.md").read_text()
    assert "Kept as they were, scored from commit " in page
    assert after["left_out_families"] == before["left_out_families"]
    again = record_of(monkeypatch, runs, docs, *few, "--keep-rows")
    assert again["entrants"] == after["entrants"]

    other = ("--num-scenes", 2, "--local-scenes", 2)
    call(monkeypatch, "generalisation", runs, "--out", docs, *other, "--keep-rows")
    assert "it is of other scenes of the " in capsys.readouterr().err
    assert json.loads((docs / "generalisation.json").read_text()) == again  # nothing was written

    call(
        monkeypatch, "generalisation", runs, "--out", docs, *few, "--keep-rows", "--drop-rows", "U"
    )
    assert "drop_rows: 'U' must be one of the rows of runs [" in capsys.readouterr().err
    call(monkeypatch, "generalisation", runs, "--out", docs, *few, "--drop-rows", "U")
    assert "drop_rows=('U',) needs keep_rows" in capsys.readouterr().err
    margin = "planning network, imitation, encoding margin"
    without = record_of(monkeypatch, runs, docs, *few, "--keep-rows", "--drop-rows", margin)
    assert [each for each in again["entrants"] if each["name"] != margin] == without["entrants"]
    assert len(without["entrants"]) < len(again["entrants"])


def test_a_page_whose_rows_are_to_be_kept_has_to_be_there_and_whole(
    monkeypatch, small, runs, tmp_path, capsys
):
    given = ("generalisation", runs, "--out", tmp_path, "--keep-rows", "--num-scenes", 1)
    assert call(monkeypatch, *given, "--local-scenes", 1) == 2
    assert "generalisation.json" in capsys.readouterr().err
    (tmp_path / "generalisation.json").write_text("[]")
    assert call(monkeypatch, *given, "--local-scenes", 1) == 2
    assert "must be the data of a page of version" in capsys.readouterr().err


def counted(monkeypatch, pool=POOL):
    """The trials that are played from here on, of small scenes."""
    plays = []
    real = played.play

    def play(trial, folder=None):
        plays.append(trial)
        return real(trial, folder)

    monkeypatch.setattr(played, "play", play)
    monkeypatch.setattr(played, "page_scene_set", lambda name, count: pool)
    return plays


TRIAL = Trial("replanning", "a", "test", 6)
FACTS = {("test", 6): SetFacts.of(POOL)}


def test_what_was_played_is_played_once_and_anew_for_another_model(monkeypatch, tmp_path):
    plays = counted(monkeypatch)
    first = play_all([TRIAL, TRIAL], FACTS, tmp_path / "new")[TRIAL]
    again = play_all([TRIAL], FACTS, tmp_path / "new")[TRIAL]
    assert len(plays) == 1
    np.testing.assert_array_equal(first.distance, again.distance)
    assert first.seconds == again.seconds > 0
    by_hand = play_scene_set(Replanner(POOL.shape, 5), POOL)
    np.testing.assert_array_equal(first.results(POOL.oracle_distance).spl, by_hand.spl)

    play_all([Trial("replanning", "b", "test", 6)], FACTS, tmp_path / "new")
    other = tiny_pool(6, (12, 11), seed=1)
    monkeypatch.setattr(played, "page_scene_set", lambda name, count: other)
    play_all([TRIAL], {("test", 6): SetFacts.of(other)}, tmp_path / "new")
    assert len(plays) == 3
    play_all([TRIAL], {("test", 6): SetFacts.of(other)}, None)
    assert len(plays) == 4


def test_a_set_is_another_where_any_map_target_or_end_is():
    same = tiny_pool(6, (12, 11))
    assert checksum_of(same) == checksum_of(POOL)
    for name in ("gain_db", "target_db", "start", "goal"):
        changed = np.array(getattr(POOL, name))
        changed[-1] += 1
        assert checksum_of(replace(POOL, **{name: changed})) != checksum_of(POOL)


def test_several_processes_play_what_one_does(tmp_path):
    trials = [Trial(name, name, "walls", 2) for name in ("replanning", "greedy")]
    facts = {("walls", 2): SetFacts.of(wall_scene_set(2))}
    here = play_all(trials, facts, None, jobs=1)
    elsewhere = play_all(trials, facts, None, jobs=2)
    for each in trials:
        np.testing.assert_array_equal(here[each].distance, elsewhere[each].distance)
    assert here[trials[0]].is_success.all()


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: {**arrays, "distance": np.full(6, np.nan)},
        lambda arrays: {**arrays, "distance": np.zeros(6)},
        lambda arrays: {**arrays, "is_success": np.ones(7, bool)},
        lambda arrays: {**arrays, "is_success": np.ones(6)},
        lambda arrays: {**arrays, "seconds": np.array(-1.0)},
        lambda arrays: {"seconds": arrays["seconds"]},
        lambda arrays: {**arrays, "distance": np.array([None] * 6)},
    ],
)
def test_what_was_played_is_played_anew_where_its_file_is_forged_or_damaged(
    monkeypatch, tmp_path, change
):
    plays = counted(monkeypatch)
    first = play_all([TRIAL], FACTS, tmp_path)[TRIAL]
    (file,) = tmp_path.glob("*.npz")
    with np.load(file) as arrays:
        forged = change(dict(arrays))
    np.savez(file, **forged)
    found = play_all([TRIAL], FACTS, tmp_path)[TRIAL]
    assert len(plays) == 2
    np.testing.assert_array_equal(found.distance, first.distance)
    file.write_bytes(file.read_bytes()[:-9])
    play_all([TRIAL], FACTS, tmp_path)
    assert len(plays) == 3


def test_what_was_played_is_played_anew_where_what_policies_do_has_changed(monkeypatch, tmp_path):
    plays = counted(monkeypatch)
    play_all([TRIAL], FACTS, tmp_path)
    monkeypatch.setattr(played, "code_checksum", lambda: "another")
    play_all([TRIAL], FACTS, tmp_path)
    assert len(plays) == 2
    before = 'def f(x):\n    """What it is."""\n    return x + 1  # one more\n'
    after = 'def f(x):\n    """Another word."""\n\n    return (x + 1)\n'
    assert played.code_of(before) == played.code_of(after)
    assert played.code_of(before) != played.code_of(after.replace("1", "2"))


def test_the_untrained_explorer_is_known_by_its_weights():
    found = Policy.of_reference("untrained_explorer")
    assert len(found.model) == 64
    assert Policy.of_reference("replanning").model == "replanning"


def test_runs_that_cannot_count_are_left_out_by_name(monkeypatch, small, runs, tmp_path, capsys):
    Run.open(runs / "few").update(status="interrupted")
    Run.create(
        runs / "single", Config(algorithm="q_learning", seed=0, env={}, agent={}, training={})
    )
    record_of(monkeypatch, runs, tmp_path / "docs", "--num-scenes", 1, "--local-scenes", 1)
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
