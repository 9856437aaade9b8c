"""Facts about `python -m eval scenes`: what stands on the page of scenes."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from eval.commands import scenes
from irs_gym.mdp.task import Task, build_world
from irs_gym.radio.scene import scene_names

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def written(tmp_path, monkeypatch) -> Path:
    """A folder into which the command has written, with maps of fewer obstacles."""
    found = {"cells": 160_000, "free": 150_000, "seconds": 1.25, "mebibytes": 99.6}
    monkeypatch.setattr(scenes, "time_map", lambda kind: found)
    assert scenes.main(out=tmp_path) == 0
    return tmp_path


def test_the_page_that_is_kept_says_what_is_computed(written):
    def computed(page):
        return [line for line in page.read_text().splitlines() if line.startswith(("| `", "| In"))]

    assert len(computed(written / "scenes.md")) == 4 + 5
    assert computed(written / "scenes.md") == computed(DOCS / "scenes.md")
    assert "| 1,000 polygons | 150,000 | 1.2 | 100 |" in (written / "scenes.md").read_text()


def test_every_scene_of_the_package_has_an_entry_and_a_picture(written):
    page = (written / "scenes.md").read_text()
    for name in scene_names():
        assert f"\n## {name}\n" in page
        assert f"(figures/scenes/{name}.png)" in page
        with Image.open(written / "figures" / "scenes" / f"{name}.png") as picture:
            assert max(picture.size) == scenes.PICTURE_SIZE


def test_a_row_holds_the_lengths_and_targets_of_the_papers_scene():
    row = scenes.scene_row("paper", build_world(Task()))
    assert row[-4:] == ("21.571", "23.228", "-59.51", "-62.08")


@pytest.mark.parametrize("kind", scenes.KINDS)
def test_a_hall_is_full_of_obstacles_and_its_ends_are_free(kind):
    hall = scenes.hall(kind)
    assert len(hall.obstacles) == scenes.KINDS[kind]
    assert hall.grid(0.5).shape == (400, 400)
    points = np.random.default_rng(0).uniform(0, scenes.SIDE, (2000, 2))
    assert 0.02 < hall.floor.is_covered(points).mean() < 0.3
