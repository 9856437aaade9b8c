"""Facts of the scoreboard: every run is on it or named with the reason, and failures are never
averaged away.
"""

import csv
import json
import os
import re
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from evaluating import call
from markdown_it import MarkdownIt
from PIL import Image

from agents.policies.heuristics import REFERENCE_POLICIES
from agents.rollout.episode import arguments_of, evaluation_env, roll_out
from agents.runs.manifest import Config
from agents.runs.run_folder import Run
from agents.single.model import build_model
from agents.single.ppo import PpoConfig
from agents.vec_env import IrsNavVecEnv
from eval.markdown import code, text
from eval.scoreboard import board, results
from eval.scoreboard.learning_curves import align
from eval.scoreboard.page import FIGURES, scoreboard_page
from eval.scoreboard.results import Curve, find_runs, read_results
from eval.scoreboard.seed_scores import episode_record, estimated_anew, group_names, overall
from eval.statistics import FEW_SEEDS
from irs_gym import RadioMap
from irs_gym.mdp.task import Task

TINY = PpoConfig(n_envs=2, n_steps=4, batch_size=8, net_arch=(4,))
FLOOR = RadioMap.from_array(np.zeros((4, 2)), 1.0)
TASK = Task(radio_map=FLOOR, start=(0, 0), goal=(3, 0), observation="flat", patch_radius=0)
MOVES = {
    "optimal": [0],
    "longer": [2, 6, 0],
    "failing": [4],
}  # straight; 1 m north and back first; into the wall


class Script:
    """A policy that takes the moves of a list, the last one for ever; in place of a model."""

    def __init__(self, moves):
        self.moves = list(moves)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.array(self.moves.pop(0) if len(self.moves) > 1 else self.moves[0]), state


@pytest.fixture(scope="module")
def model():
    return build_model(TINY, IrsNavVecEnv(2, **arguments_of(TASK)), 0)


@pytest.fixture(autouse=True)
def _scripts(monkeypatch):
    """Models of runs whose folder is named after a script play that script."""
    load = Run.load_model

    def load_model(run, name="best"):
        loaded = load(run, name)  # with its check of the hash
        kind = run.folder.name.partition("-")[0]
        return Script(MOVES[kind]) if kind in MOVES else loaded

    monkeypatch.setattr(Run, "load_model", load_model)


@pytest.fixture
def make_run(tmp_path, model):
    def make(
        kind: str, seed: int, *, status="finished", task: Task = TASK, rows=None, **agent
    ) -> Run:
        """A run whose best model does as its kind says: it arrives at second 20 of tests at 10, 20
        and 30.
        """
        settings = {"net_arch": [4], **agent}
        config = Config(
            algorithm="ppo", seed=seed, env=arguments_of(task), agent=settings, training={}
        )
        run = Run.create(tmp_path / "runs" / f"{kind}-{len(find_runs(tmp_path))}", config)
        episode = roll_out(Script(MOVES[kind]), evaluation_env(run.task))
        run.save_model("best", model, 200, is_success=episode.is_success, ratio=episode.ratio)
        told = [(0, None, 0.0)] + [(int(episode.is_success), episode.ratio, episode.spl)] * 2
        run.write_curve(
            rows
            or [
                {
                    "steps": 100 * n,
                    "seconds": 10.0 * n,
                    "is_success": success,
                    "ratio": ratio,
                    "spl": spl,
                }
                for n, (success, ratio, spl) in enumerate(told, start=1)
            ]
        )
        run.update(status=status, error="out of memory" if status == "failed" else None)
        return run

    return make


def board_of(monkeypatch, folder: Path) -> dict:
    """The scoreboard of a folder, without the time that its pictures take."""
    monkeypatch.setattr(board, "draw_curves", lambda curves: b"")
    monkeypatch.setattr(board, "draw_path_overlay", lambda *paths, **settings: b"")
    assert call(monkeypatch, "board", folder, "--episodes", 3) == 0
    return json.loads((folder / "board.json").read_text())


def test_failures_count_in_every_figure(monkeypatch, tmp_path, make_run):
    for seed, kind in enumerate(["optimal", "longer", "failing", "optimal"]):
        make_run(kind, seed)
    (problem,) = board_of(monkeypatch, tmp_path / "runs")["problems"]
    oracle, ppo, *_ = problem["standings"]
    found = {name: each["value"] for name, each in ppo["estimates"].items()}
    assert problem["oracle_distance"] == 3.0
    assert ppo["seeds"] == [0, 1, 2, 3]
    assert (found["at_optimum"], found["success"]) == (0.5, 0.75)
    assert found["ratio"] == pytest.approx((1 + 5 / 3) / 2)  # the median of 1, 1, 5/3 and infinity
    assert found["spl_mean"] == pytest.approx((1 + 0.6 + 0 + 1) / 4)
    assert found["spl_iqm"] == pytest.approx((1 + 0.6) / 2)
    assert found["spl_gap"] == pytest.approx((0.4 + 1) / 4)
    assert found["refused"] == 400 / 4
    assert found["steps_to_optimum"] is None  # the median of 200, 200 and twice never
    assert oracle["estimates"]["spl_mean"] == {"value": 1.0, "interval": None, "note": ""}
    at_optimum = ppo["estimates"]["at_optimum"]["interval"]
    assert at_optimum == pytest.approx([0.0676, 0.9324], abs=1e-4)  # Clopper and Pearson, 2 of 4


def test_median_time_is_that_of_the_seed_in_the_middle(monkeypatch, tmp_path, make_run):
    for seed, kind in enumerate(["optimal", "optimal", "failing"]):
        make_run(kind, seed)
    found = board_of(monkeypatch, tmp_path / "runs")
    estimates = found["problems"][0]["standings"][1]["estimates"]
    assert estimates["seconds_to_optimum"] == {
        "value": 20.0,
        "interval": [20.0, None],
        "note": FEW_SEEDS,
    }
    assert [each["seconds_to_optimum"] for each in found["runs"]] == [20.0, 20.0, None]
    page = (tmp_path / "runs/scoreboard.md").read_text()
    assert "20 ‡<br><sub>20 to ∞</sub>" in page
    assert "2 of 3, 20 s" in page


def test_every_run_is_on_the_board_or_named_with_the_reason(
    monkeypatch, capsys, tmp_path, make_run
):
    make_run("optimal", 0)
    reasons = {
        make_run("longer", 1, status="running").folder: "has not ended: its status is 'running'",
        make_run(
            "longer", 2, status="interrupted"
        ).folder: "has not ended: its status is 'interrupted'",
        make_run("longer", 8, status="failed").folder: "has failed: out of memory",
        make_run("optimal", 0).folder: "repeats seed 0 of ",
        make_run(
            "optimal", 3, rows=[{"steps": 1, "seconds": 2, "ratio": 1}]
        ).folder: "learning_curve.csv' is damaged",
    }
    (damaged := make_run("optimal", 4).folder / "best-200.npz").write_bytes(b"other")
    reasons[damaged.parent] = "is not loaded: its SHA-256"
    (cut := make_run("optimal", 5).folder / "config.json").write_text("{")
    reasons[cut.parent] = "config.json' is not loaded"
    (lost := make_run("optimal", 6).folder / "manifest.json").unlink()
    reasons[lost.parent] = "not a run folder"
    lying = make_run("longer", 7)
    entry = lying.manifest.models["best"].model_copy(update={"ratio": 1.0})
    lying.update(models={"best": entry})
    reasons[lying.folder] = "now has the ratio"

    found = board_of(monkeypatch, tmp_path / "runs")
    assert [each["seed"] for each in found["runs"]] == [0]
    said, page = capsys.readouterr().err, (tmp_path / "runs/scoreboard.md").read_text()
    report = (tmp_path / "runs/report.html").read_text()
    told = {each["folder"]: each["reason"] for each in found["left_out"]}
    assert set(told) == set(map(str, reasons))
    for folder, reason in reasons.items():
        assert reason in told[str(folder)]
        assert all(str(folder) in text for text in (said, page, report))
    ppo = found["problems"][0]["standings"][1]
    assert (ppo["seeds"], ppo["left_out"]) == (
        [0],
        7,
    )  # of the others, two cannot be read far enough to tell
    assert "1 (7 left out)" in page


def test_algorithm_without_a_complete_run_keeps_its_row(monkeypatch, tmp_path, make_run):
    make_run("optimal", 0)
    make_run("optimal", 0, gamma=0.5, status="running")
    found = board_of(monkeypatch, tmp_path / "runs")
    rows = {each["name"]: each for each in found["problems"][0]["standings"]}
    assert rows["PPO, gamma 0.5"]["estimates"] == {}
    assert "| PPO, gamma 0.5 | 0 (1 left out) |" in (tmp_path / "runs/scoreboard.md").read_text()


def test_runs_are_grouped_by_problem_and_settings(monkeypatch, tmp_path, make_run):
    far = replace(TASK, goal=(3, 1))
    for seed in range(2):
        make_run("optimal", seed)
        make_run("failing", seed, task=far)
        make_run("longer", seed, task=replace(TASK, shaping=False))
    problems = board_of(monkeypatch, tmp_path / "runs")["problems"]
    rows = [
        {
            each["name"]: each["seeds"]
            for each in problem["standings"][1 : 1 - len(REFERENCE_POLICIES)]
        }
        for problem in problems
    ]
    assert rows == [{"PPO": [0, 1], "PPO, shaping False": [0, 1]}, {"PPO": [0, 1]}]
    assert len({problem["label"] for problem in problems}) == 2


def test_settings_shared_by_all_are_not_in_the_names(make_run):
    kinds = ({"gamma": 0.9}, {"gamma": 0.9, "width": 8}, {"gamma": 0.8})
    groups = [
        results.Group.of(None, make_run("optimal", n, **kind).config)
        for n, kind in enumerate(kinds)
    ]
    assert list(group_names(groups).values()) == ["PPO", "PPO, width 8", "PPO, gamma 0.8"]


def test_references_stand_beside_the_agents(monkeypatch, tmp_path, make_run):
    make_run("optimal", 0)
    standings = board_of(monkeypatch, tmp_path / "runs")["problems"][0]["standings"]
    names = [name.replace("_", " ") for name in REFERENCE_POLICIES]
    assert [each["name"] for each in standings] == [names[0], "PPO", *names[1:]]
    assert [len(each["seeds"]) for each in standings] == [1, 1, 1, 1, 1, 3, 3]
    assert [len(each["played"]) for each in standings] == [1, 0, 1, 1, 1, 3, 3]


def test_all_estimates_follow_from_the_episodes_that_are_kept(monkeypatch, tmp_path, make_run):
    for seed, kind in enumerate(["optimal", "longer", "failing", "optimal"]):
        make_run(kind, seed)
    found = board_of(monkeypatch, tmp_path / "runs")
    emptied = json.loads(json.dumps(found))
    emptied["overall"] = []
    for standing in emptied["problems"][0]["standings"]:
        standing["estimates"] = {}
    assert estimated_anew(emptied) == found


def test_scores_over_all_problems_keep_the_seeds_whole(tmp_path, make_run):
    near, far = TASK, replace(TASK, goal=(3, 1), start=(0, 1))
    for seed, kind in enumerate(["optimal", "failing", "optimal"]):
        for task in (near, far):
            make_run(kind, seed, task=task)
    make_run("failing", 3, task=near)  # has no counterpart
    found, left_out = read_results(find_runs(tmp_path))
    assert not left_out
    by_problem = [
        [each for each in found if each.problem.goal == goal] for goal in ((3, 0), (3, 1))
    ]
    rows = [
        [{"seed": each.seed, **episode_record(each.episode)} for each in some]
        for some in by_problem
    ]
    record = overall("PPO", rows, 2)
    assert record["seeds"] == [0, 1, 2]
    assert record["at_optimum"] == {"runs": 4, "of": 7}
    assert record["spl_mean"] == {"value": pytest.approx(2 / 3), "interval": [0.0, 1.0], "note": ""}


def test_report_is_one_file_that_needs_no_other(monkeypatch, tmp_path, make_run):
    for seed in range(2):
        make_run("optimal", seed)
    assert (
        call(monkeypatch, "board", tmp_path / "runs", "--out", tmp_path / "docs", "--episodes", 2)
        == 0
    )
    page = (tmp_path / "runs/report.html").read_text()
    sources = re.findall(r'(?:src|href)="(.*?)"', page)
    assert sum(each.startswith("data:image/png;base64,") for each in sources) == 2
    assert all(each.startswith(("data:", "#")) for each in sources)
    assert "http" not in re.sub(r"data:\S+", "", page)
    for run in find_runs(tmp_path / "runs"):
        assert str(run) in page


def test_page_and_figures_go_where_they_are_wanted(monkeypatch, tmp_path, make_run):
    make_run("optimal", 0)
    assert (
        call(monkeypatch, "board", tmp_path / "runs", "--out", tmp_path / "docs", "--episodes", 2)
        == 0
    )
    page = (tmp_path / "docs/scoreboard.md").read_text()
    links = re.findall(r"!\[.*?\]\((.*?)\)", page)
    assert len(links) == 2
    for link in links:
        with Image.open(tmp_path / "docs" / link) as picture:
            assert picture.width > 700
        assert (tmp_path / "docs" / link).stat().st_size < 60_000
    found = json.loads((tmp_path / "docs/board.json").read_text())
    assert page == scoreboard_page(
        found, "figures/scoreboard"
    )  # nothing on the page comes from elsewhere
    assert sorted(each.name for each in (tmp_path / "runs").iterdir()) == [
        "optimal-0",
        "report.html",
    ]


def test_ablations_tell_how_many_times_the_usual_steps_each_variant_takes(
    monkeypatch, tmp_path, make_run
):
    later = [{"steps": 500, "seconds": 9, "is_success": 1, "ratio": 1.0, "spl": 1.0}]
    for seed in range(3):
        make_run("optimal", seed)  # 200 steps to the optimum
        make_run("optimal", seed, gamma=0.9, rows=later)
        make_run("longer", seed, task=replace(TASK, shaping=False))
    monkeypatch.setattr(board, "draw_path_overlay", lambda *paths, **settings: b"")
    assert call(monkeypatch, "ablations", tmp_path / "runs", "--out", tmp_path / "docs") == 0
    page = (tmp_path / "docs/ablations.md").read_text()
    assert "| PPO | 1.00 | 3 of 3 |" in page
    assert "| PPO, gamma 0.9 | 2.50 | 3 of 3 |" in page
    assert "| PPO, shaping False | never in half of the seeds | 0 of 3 |" in page
    (link,) = re.findall(r"!\[.*?\]\((.*?)\)", page)
    assert (tmp_path / "docs" / link).is_file()


def test_ablations_of_two_problems_are_refused(monkeypatch, capsys, tmp_path, make_run):
    make_run("optimal", 0)
    make_run("failing", 0, task=replace(TASK, goal=(3, 1)))
    assert call(monkeypatch, "ablations", tmp_path / "runs", "--out", tmp_path / "docs") == 2
    assert "holds runs on 2 problems" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["nowhere"], [""], ["--episodes", 0]])
def test_folder_without_a_complete_run_is_refused_in_words(
    monkeypatch, capsys, tmp_path, make_run, words
):
    make_run("optimal", 0, status="running")
    folder = tmp_path / "runs" / str(words[0]) if len(words) == 1 else tmp_path / "runs"
    assert call(monkeypatch, "board", folder, *words[1 if len(words) == 1 else 0 :]) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert any(text in said for text in ("is not a folder", "has not ended", "episodes=0"))
    assert not (tmp_path / "runs/board.json").exists()


def test_curves_hold_their_latest_test():
    def curve(steps, spl):
        return Curve(
            np.array(steps, float),
            np.array(steps, float),
            np.array(spl),
            np.zeros(len(steps), bool),
        )

    steps, spl = align([curve([10, 30], [0.5, 1.0]), curve([20], [0.25])])
    assert steps.tolist() == [10, 20, 30]
    assert spl.tolist() == [[0.5, 0.5, 1.0], [0.0, 0.25, 0.25]]


def test_first_optimum_of_a_curve():
    curve = Curve(*np.array([[1, 2, 3.0], [10, 20, 30], [0, 1, 1]]), np.array([False, True, True]))
    assert (curve.first_optimum(curve.steps), curve.first_optimum(curve.seconds)) == (2.0, 20.0)
    assert replace(curve, is_optimal=np.zeros(3, bool)).first_optimum(curve.steps) == inf


def test_curve_of_a_run_is_read_as_it_was_written(make_run):
    run = make_run("longer", 0)
    with (run.folder / "learning_curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    curve = results.read_result(run).curve
    assert curve.steps.tolist() == [float(row["steps"]) for row in rows]
    assert curve.spl.tolist() == [float(row["spl"]) for row in rows]
    assert not curve.is_optimal.any()


def test_the_committed_scoreboard_is_the_page_of_its_board_and_marks_all_that_is_equal():
    docs = Path(__file__).parents[2] / "docs"
    told = json.loads((docs / "board.json").read_text(encoding="utf-8"))
    assert scoreboard_page(told, FIGURES) == (docs / "scoreboard.md").read_text(encoding="utf-8")
    spl = {}
    for run in told["runs"]:
        spl.setdefault((run["problem"], run["policy"]), []).append(run["spl"])
    for problem in told["problems"]:
        for standing in problem["standings"]:
            if standing["kind"] == "learned":
                values = spl[problem["label"], standing["name"]]
                is_marked = standing["estimates"]["spl_mean"]["note"] == "all seeds equal"
                assert is_marked == (max(values) - min(values) < 1e-9)


CURVE = "learning_curve.csv"
DAMAGE = {
    "curve is no text": lambda run: (run.folder / CURVE).write_bytes(b"\xff\xfe\x00"),
    "curve has NaN": lambda run: spoil(run, CURVE, "20.0", "nan"),
    "curve goes back": lambda run: spoil(run, CURVE, "300", "150"),
    "curve has a score above 1": lambda run: spoil(run, CURVE, ",1.0\n", ",1e300\n"),
    "curve has too many columns": lambda run: spoil(run, CURVE, ",1.0\n", ",1.0,2,3\n" * 2),
    "curve is a pipe": lambda run: replace_by(os.mkfifo, run.folder / CURVE),
    "manifest is a folder": lambda run: replace_by(os.mkdir, run.folder / "manifest.json"),
    "manifest is enormous": lambda run: os.truncate(run.folder / "manifest.json", 10**11),
    "manifest is deep": lambda run: (run.folder / "manifest.json").write_text("[" * 100_000),
    "manifest lists a generalist": lambda run: spoil(
        run, "manifest.json", '"ratio": 1.0', '"spl": 1.0'
    ),
    "config has NaN": lambda run: spoil(run, "config.json", '"agent": {', '"agent": {"gamma": NaN'),
    "config is endless": lambda run: spoil(
        run, "config.json", '"agent": {', '"agent": {"x": "' + "y" * 10**6 + '"'
    ),
    "config is of a generalist": lambda run: spoil(run, "config.json", '"ppo"', '"planner"'),
}


def replace_by(make, path: Path) -> None:
    path.unlink()
    make(path)


def spoil(run: Run, name: str, old: str, new: str) -> None:
    before = (run.folder / name).read_text()
    assert old in before
    (run.folder / name).write_text(before.replace(old, new, 1))


def test_no_damaged_run_takes_the_board_with_it(monkeypatch, capsys, tmp_path, make_run):
    whole = make_run("optimal", 0)
    damaged = {kind: make_run("optimal", seed) for seed, kind in enumerate(DAMAGE, start=1)}
    for kind, run in damaged.items():
        DAMAGE[kind](run)
    found = board_of(monkeypatch, tmp_path / "runs")
    told = {each["folder"]: each["reason"] for each in found["left_out"]}
    assert {kind: str(run.folder) in told for kind, run in damaged.items()} == dict.fromkeys(
        DAMAGE, True
    )
    assert [each["folder"] for each in found["runs"]] == [str(whole.folder)]
    assert capsys.readouterr().err.count("\n") == len(DAMAGE)


@pytest.mark.parametrize(
    "error",
    [RecursionError, MemoryError, KeyError("x"), UnicodeDecodeError("utf-8", b"", 0, 1, "")],
)
def test_run_is_left_out_whatever_it_raises(monkeypatch, make_run, error):
    runs = [make_run("optimal", seed) for seed in range(2)]
    load = Run.load_model

    def load_model(run, name="best"):
        if run.folder == runs[0].folder:
            raise error
        return load(run, name)

    monkeypatch.setattr(Run, "load_model", load_model)
    found, left_out = read_results([run.folder for run in runs])
    assert [each.run.folder for each in found] == [runs[1].folder]
    assert left_out[0].reason
    assert "\n" not in left_out[0].reason


def test_one_damaged_run_keeps_no_other_from_being_scored(monkeypatch, capsys, make_run):
    runs = [make_run("optimal", seed) for seed in range(3)]
    spoil(runs[1], "config.json", "{", "[")
    assert call(monkeypatch, "score", *(run.folder for run in runs)) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"python -m eval score: {runs[1].folder}: ")
    assert said.count("\n") == 1
    assert [(run.folder / "scores.json").exists() for run in runs] == [True, False, True]


NAMES = [
    *("<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "a|b", "a\nb"),
    *("[x](javascript:alert(1))", "`x`|`", "![x](http://a.b/c)", "&lt;b&gt;", "**x** _y_ ~~z~~"),
    *("\\", "a\\|b", "\u202eabc", "$\\frac$", "\udcff", "```\nx"),
]


def test_names_of_strangers_are_text_on_the_page_and_nothing_else(monkeypatch, tmp_path, make_run):
    make_run("optimal", 0)
    for seed in range(3):
        make_run("optimal", seed, **{f"key{name}": name for name in NAMES[seed:-2:3]})
    evil = tmp_path / "runs" / "optimal-<b>x<|`$(y)\n[z](javascript:q)"
    make_run("optimal", 99).folder.rename(evil)
    make_run("optimal", 50, status="failed").update(error="<script>|\n<b>")
    assert call(monkeypatch, "board", tmp_path / "runs", "--episodes", 1) == 0
    page = re.sub('"data:[^"]*"', '"#"', (tmp_path / "runs/report.html").read_text())
    known = (
        "html head meta title link style body nav a div table thead tbody tr th td "
        "h1 h2 p pre code em br sub img"
    )
    assert set(re.findall(r"<(\w+)", page)) <= set(known.split(" "))
    assert not re.findall(r'(?:href|src)="(?!#)', page)
    rows = [
        line
        for line in (tmp_path / "runs/scoreboard.md").read_text().splitlines()
        if line.startswith("| PPO")
    ]
    assert len(rows) == 2 * 4  # over all problems, and on the one


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", [text, code])
def test_any_name_is_one_cell_that_shows_it(name, form):
    page = f"| a | b |\n|---|---|\n| {form(name)} | end |"
    page.encode()
    shown = MarkdownIt("commonmark").enable("table").render(page)
    cells = re.findall("<td>(.*?)</td>", shown, re.DOTALL)
    assert cells[1] == "end"
    inner = cells[0].removeprefix("<code>").removesuffix("</code>")
    assert not re.search("[<>]", inner)
    plain = (
        inner.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", '"').replace("&amp;", "&")
    )
    assert plain == "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)
