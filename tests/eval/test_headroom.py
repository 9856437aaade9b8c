"""Facts about `python -m eval headroom`: the small families, and what stands on the page."""

import re
from dataclasses import replace
from pathlib import Path

import networkx
import numpy as np
import pytest
from evaluating import call

from agents.policies.belief_policy import BeliefPolicy
from agents.policies.replanning import Replanner
from eval.commands import headroom as command
from eval.unseen.headroom import REPLANNING, UNTRAINED, headroom_of, path_of, policies
from eval.unseen.small_families import (
    CELL_SIZE,
    drawn_families,
    listed_families,
    scene_set,
)
from irs_gym import belief_optimum, distance_to_go

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def listed():
    return listed_families()


@pytest.fixture
def mazes(listed):
    """Some of the mazes, each as likely."""
    family = listed["maze"]
    rooms = family.feasible[::8]
    return replace(family, feasible=rooms, weights=np.full(len(rooms), 1 / len(rooms)))


def test_families_hold_different_rooms_that_can_be_crossed_and_probabilities(listed):
    for family in (*listed.values(), *drawn_families(30).values()):
        assert family.weights.sum() == pytest.approx(1.0)
        assert len({each.tobytes() for each in family.feasible}) == len(family) > 5
        for room in family.feasible[::50]:
            assert np.isfinite(distance_to_go(room, family.goal, CELL_SIZE)[family.start])

    # as many as Kirchhoff's theorem says
    lattice = networkx.grid_2d_graph(3, 3)
    trees = networkx.number_of_spanning_trees(lattice)
    assert len(listed["maze"]) == round(trees) == 192
    assert [len(listed[name]) for name in ("door", "two doors", "three doors")] == [12, 100, 512]


def test_fewer_rooms_are_the_first_of_more():
    few, many = drawn_families(10), drawn_families(20)
    for name, family in few.items():
        assert (many[name].feasible[: len(family)] == family.feasible).all()


def test_no_policy_exceeds_the_bound_and_the_belief_policy_meets_it(mazes):
    def best(shape, radius):
        found = belief_optimum(mazes.feasible, mazes.start, mazes.goal, CELL_SIZE, radius=radius)
        return BeliefPolicy(found, shape)

    found = headroom_of(mazes, 1, {**policies(), "best": best}, max_states=1000)
    assert found.is_bound_kept
    assert found.highest == found.spl("best") == pytest.approx(found.best_spl.value)
    assert found.spl(REPLANNING) < found.best_spl.value - 0.02
    assert found.spl(UNTRAINED) < found.best_spl.value
    assert len(found.played) == 5

    # the map tells no more than feasibility, and shows it as it is
    assert (scene_set(mazes).feasible == mazes.feasible).all()
    for scene in range(len(mazes)):
        cells = path_of(found.played["best"], scene, mazes.start)
        assert cells.tolist() == found.best_spl.path(scene).cells.tolist()


def test_the_page_has_a_row_for_each_family_and_radius(monkeypatch, tmp_path, listed):
    door = {"door": listed["door"]}
    drawn = drawn_families(16)
    monkeypatch.setattr(command, "DRAWN_FAMILY", "door")
    monkeypatch.setattr(command, "listed_families", lambda: door)
    monkeypatch.setattr(command, "drawn_families", lambda count: {"scattered": drawn["scattered"]})
    monkeypatch.setattr(command, "policies", lambda: {REPLANNING: Replanner, "twin": Replanner})
    few = ("--drawn", 64, "--most-played", 11)
    assert call(monkeypatch, "headroom", "--out", tmp_path, *few) == 0
    page = (tmp_path / "headroom.md").read_text()
    assert "were not played in families of 12 rooms or more." in page
    assert page.count("| door | 1 |") == page.count("| door | 2 |") == 2  # SPL and metres
    assert page.count("| scattered | 1 |") == 5  # four lists, and the longest once more
    assert page.count("| met |") == 3
    assert (tmp_path / "figures" / "headroom.png").stat().st_size > 10_000

    # a search cut short says what the optimum lies between
    assert call(monkeypatch, "headroom", "--out", tmp_path, *few, "--max-states", 2) == 0
    page = (tmp_path / "headroom.md").read_text()
    assert re.search(r"\| door \| 1 \| 0\.\d{4} to \d\.\d{4} \|", page)
    assert " or more |" in page
    assert "NOT MET" in page


def test_what_cannot_be_drawn_is_answered_in_one_line(monkeypatch, capsys, tmp_path):
    assert call(monkeypatch, "headroom", "--out", tmp_path, "--drawn", 63) == 2
    assert "drawn=63 must be 64 or more" in capsys.readouterr().err


def test_on_the_page_that_is_kept_no_policy_exceeds_the_optimum_and_all_are_exact():
    page = (DOCS / "headroom.md").read_text()
    assert page.count("| met |") == 3
    assert "NOT MET" not in page
    rows = [
        [each.strip() for each in line.split("|")[1:-1]]
        for line in page.splitlines()
        if re.match(r"\| [a-z ]+ \| [12] \| [01]\.\d{4} \|", line)
    ]
    assert len(rows) == 2 * 8 + 2 * 3
    for _, _, best, *scores, over_replanning, over_the_best in rows:
        played = [float(each) for each in scores if each]  # replanning first
        assert float(best) >= max(played)
        assert float(over_replanning) == pytest.approx(float(best) - played[0], abs=2e-4)
        assert float(over_the_best) == pytest.approx(float(best) - max(played), abs=2e-4)
