"""Facts of the paths that pretrained policies lend to the workbench."""

import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from irs_gym import load_scene
from irs_gym.workbench.policy_paths import GROUP

ROOT = Path(__file__).resolve().parents[2]
LENT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][GROUP]


@pytest.mark.parametrize("name", LENT)
def test_what_the_project_lends_leads_from_start_to_goal_on_the_papers_scene(name):
    path = EntryPoint(name, LENT[name], GROUP).load()(load_scene("paper"))
    assert path[[0, -1]].tolist() == [[0, 20], [39, 20]]
    assert np.abs(np.diff(path, axis=0)).max() == 1


def test_a_target_that_no_path_meets_is_told():
    planner = EntryPoint("planner", LENT["planner"], GROUP).load()
    with pytest.raises(ValueError, match="the highest feasible target is"):
        planner(load_scene("paper").model_copy(update={"target_db": -50.0}))
