"""Facts of the board of agents that switch the panel: it counts runs beside the exact optimum, keeps
what it needs of them, and says what was not run.
"""

import json
from pathlib import Path
from shlex import split
from shutil import copytree, rmtree

import pytest
from evaluating import call as evaluate
from tiny import call

from agents.rollout.episode import evaluation_env
from agents.runs.problem import problem_of
from eval.scoreboard import codebook_board
from eval.scoreboard.codebook_board import LEARNERS, TASKS, CodebookBoard
from irs_gym.datasets.codebook_task import CodebookTask
from train.plan import Plan

FEW = [
    CodebookTask(codebook=("cover", 4), switch_cost=0.5, target_db=target_db, cell_size=1.0)
    for target_db in (-61.8, -62.0)
]
WORDS = split(
    "q_learning --no-progress --env.codebook cover 4 --env.switch-cost 0.5 --env.target-db -61.8 "
    "--env.cell-size 1 --env.random-start 0.9"
)
COMPUTED = "# The panel\n\nTables that took long."


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Two seeds that find the optimum, and one that has hardly begun."""
    folder = tmp_path_factory.mktemp("runs")
    for seed in range(2):
        assert call([*WORDS, "--seed", seed, "--out", folder / f"seed{seed}"]) == 0
    short = ["--agent.total-timesteps", 256, "--seed", 0, "--out", folder / "short"]
    assert call([*WORDS, *short]) == 0
    return folder


@pytest.fixture
def docs(tmp_path, monkeypatch):
    """A folder with the page's computed part, and two settings on the board."""
    monkeypatch.setattr(codebook_board, "TASKS", FEW)
    folder = tmp_path / "docs"
    folder.mkdir()
    (folder / "codebook.md").write_text(f"{COMPUTED}\n", encoding="utf-8")
    return folder


def page_of(monkeypatch, docs, *words):
    assert evaluate(monkeypatch, "codebook", *words, "--keep-tables", "--out", docs) == 0
    return (docs / "codebook.md").read_text(encoding="utf-8")


def rows_of(page, title):
    """Cells of the rows of a setting's table, by the policies' names."""
    lines = page.partition(f"### {title}")[2].partition("###")[0].splitlines()
    cells = [[each.strip() for each in line.split("|")[1:-1]] for line in lines if "|" in line]
    return {name: rest for name, *rest in cells[2:]}


def test_the_board_counts_runs_beside_the_joint_optimum(trained, docs, monkeypatch):
    page = page_of(monkeypatch, docs, trained, "--trained-by", "python -m train sweep x.toml")
    oracle = evaluation_env(FEW[0]).unwrapped.oracle
    assert page.startswith(COMPUTED)
    assert f"{oracle.distance:.3f} m, the costs of {oracle.switches} switches" in page
    assert "python -m train sweep x.toml" in page
    assert "{" not in page

    rows = rows_of(page, "-61.8 dB")
    assert rows["joint oracle"] == ["–", "yes", "1.0000", "–", "–", str(oracle.switches)]
    assert rows["never switch"][-1] == "0"
    found = rows["Q-learning"]
    assert found[:3] == ["2", "2 of 2", "1.0000"]
    assert found[-1] == str(oracle.switches)
    short = rows["Q-learning, total_timesteps 256"]
    assert short[1:5] == ["0 of 1", "does not arrive", "none", "none"]
    for name in ("PPO", "DQN", "MaskablePPO"):
        assert rows[name] == ["none", *"–––––"]

    elsewhere = rows_of(page, "-62.0 dB")
    assert elsewhere["Q-learning"] == ["none", *"–––––"]
    assert elsewhere["joint oracle"][1] == "yes"


def test_what_is_kept_makes_the_same_page_without_the_runs(trained, docs, monkeypatch, tmp_path):
    runs = tmp_path / "runs"
    copytree(trained, runs)
    page = page_of(monkeypatch, docs, runs)
    rmtree(runs)
    assert page_of(monkeypatch, docs) == page
    assert CodebookBoard.load(docs / "codebook.json").settings[0].problem == problem_of(FEW[0])


def test_runs_are_added_to_those_that_are_kept(trained, docs, monkeypatch, tmp_path, capsys):
    page_of(monkeypatch, docs, trained / "seed0")
    (tmp_path / "none").mkdir()
    copytree(trained / "seed1", tmp_path / "more" / "seed1")
    page = page_of(monkeypatch, docs, tmp_path / "more")
    assert rows_of(page, "-61.8 dB")["Q-learning"][:2] == ["2", "2 of 2"]

    # a seed that is there already, and what is left of a run
    copytree(trained / "seed0", tmp_path / "more" / "again")
    (tmp_path / "more" / "broken").mkdir()
    (tmp_path / "more" / "broken" / "config.json").write_text("{}")
    page = page_of(monkeypatch, docs, tmp_path / "more")
    assert rows_of(page, "-61.8 dB")["Q-learning"][:2] == ["2", "2 of 2"]
    assert "Made of 2 runs" in page
    assert "more/broken: " in page

    rmtree(tmp_path / "more" / "broken")
    assert evaluate(monkeypatch, "codebook", tmp_path / "none", "--out", docs) == 2
    assert "no complete run lies below" in capsys.readouterr().err
    assert (docs / "codebook.md").read_text(encoding="utf-8") == page


def test_without_runs_the_page_names_the_references_alone(docs, monkeypatch):
    page = page_of(monkeypatch, docs)
    for title in ("-61.8 dB", "-62.0 dB"):
        rows = rows_of(page, title)
        assert set(rows) == {*codebook_board.REFERENCES.values()} | {
            "PPO", "DQN", "MaskablePPO", "Q-learning"
        }  # fmt: skip
        assert [rows[name][0] for name in ("PPO", "Q-learning")] == ["none", "none"]


def test_what_is_damaged_or_missing_is_refused(docs, monkeypatch, capsys):
    (docs / "codebook.json").write_text(json.dumps({"format_version": 2}))
    words = ("codebook", "--keep-tables", "--out", docs)
    assert evaluate(monkeypatch, *words) == 2
    assert "is damaged at 'format_version'" in capsys.readouterr().err

    (docs / "codebook.json").unlink()
    (docs / "codebook.md").unlink()
    assert evaluate(monkeypatch, *words) == 2
    assert "codebook.md" in capsys.readouterr().err
    assert not list(docs.iterdir())


def test_the_board_names_the_settings_of_the_sweep(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where no run of it lies yet
    configs = Plan.load(Path(__file__).parents[2] / "train/sweeps/codebook.toml").configs()
    asked = {(each.env.codebook, each.env.switch_cost, each.env.target_db) for each in configs}
    assert asked == {(each.codebook, each.switch_cost, each.target_db) for each in TASKS}
    assert {each.agent.algorithm for each in configs} == set(LEARNERS)
