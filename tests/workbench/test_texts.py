"""Facts of what the page says: lengths, targets and names, of which none is HTML."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from irs_gym import load_scene
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.commands import training_commands
from irs_gym.workbench.texts import commands_of, reason_of, score_of, scores_of, summary_of
from train.config import parse

PAPER = load_scene("paper")
MARKUP = "<script>alert(1)</script>"


def test_the_summary_tells_the_papers_numbers():
    said = summary_of(Bench.of(PAPER).drawing)
    assert "<b>23.228 m</b>" in said
    assert "<b>-59.511 dB</b>" in said


def test_where_there_is_no_path_the_summary_tells_the_highest_target():
    said = summary_of(Bench.of(PAPER).with_target(-50.0).drawing)
    assert "none at -50.00 dB" in said
    assert "<b>-59.511 dB</b>" in said


def test_an_obstacle_that_robots_drive_through_is_told_and_no_name_is_html():
    thin = PAPER.obstacles[0].model_copy(update={"size": (0.1, 4.0, 1.3)})
    scene = PAPER.model_copy(update={"name": MARKUP, "obstacles": (thin,)})
    said = summary_of(Bench.of(scene).drawing)
    assert "no cell is blocked by obstacles[0]" in said
    assert MARKUP not in said
    assert MARKUP not in commands_of(Path(f"{MARKUP}.json"), True)
    assert MARKUP not in scores_of(Bench.of(PAPER), {MARKUP: MARKUP}, {MARKUP: "red"})


def test_a_policys_path_is_told_beside_the_oracles():
    bench = Bench.of(PAPER)
    cells = bench.drawing.path.cells
    assert score_of(bench, cells) == "23.228 m, +0.0 %"
    assert score_of(bench, np.concatenate([cells[:2], cells])).startswith("24.")
    assert score_of(bench, cells[:-1]).startswith("does not reach the goal, after ")


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (FileNotFoundError(2, "gone", "/secret/place"), "the file is not there any more"),
        (PermissionError(13, "Permission denied", "/secret/place"), "Permission denied"),
        (ValueError("goal=... lies in an obstacle"), "goal=... lies in an obstacle"),
        (KeyError("x"), "KeyError: 'x'"),
    ],
)
def test_errors_are_told_in_a_line(error, why):
    assert reason_of(error) == why


def test_the_commands_are_those_of_train(tmp_path):
    file = tmp_path / "my hall.json"
    PAPER.save(file)
    for command in training_commands(file):
        python, module, train, algorithm, *arguments = shlex.split(command)
        assert (python, module, train) == ("python", "-m", "train")
        assert str(parse(algorithm, arguments).env.scene) == str(file)
