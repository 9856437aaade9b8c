"""Facts of `python -m eval budget`: its figures are those of the mixtures and of the exact hull."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluating import call as evaluate
from tiny import TINY, call

import irs_gym
from agents.policies.policy import Policy
from agents.rollout.episode import evaluation_env
from agents.single.mixture import Mixture
from eval.scoreboard.expected_cost import estimated_anew, expectation, hull_at
from irs_gym.grid import MOVES
from irs_gym.mdp.task import Task, build_world
from train.plan import Plan

TASK = Task(
    target_db=-60.0, constraint="budget", budget=13.0, on_exhausted="continue", observation="flat"
)


class Along:
    """Follows a path, by the gain that it sees in no cell twice alike: by its own clock."""

    def __init__(self, cells: np.ndarray) -> None:
        steps = np.diff(cells, axis=0)
        self.moves = [int(np.flatnonzero((step == MOVES).all(axis=1))[0]) for step in steps]
        self.clock = 0

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        move = self.moves[self.clock]
        self.clock = (self.clock + 1) % len(self.moves)
        return move, state


@pytest.fixture(scope="module")
def corners() -> list[Policy]:
    world = build_world(TASK)
    cost = irs_gym.cost_map(world.radio_map, -60.0, "violation")
    hull = irs_gym.pareto_front(cost, world.start, world.goal, 0.5).hull()
    assert hull.costs.tolist() == [0.0, 26.0]
    return [Along(hull.path(n).cells) for n in range(2)]


def test_a_mixture_of_the_corners_lies_on_the_hull(corners):
    mixture = Mixture(corners, np.array([0.5, 0.5]), 0, np.zeros((0, 3)))
    cost, distance = expectation(mixture, TASK)
    optimum, price = hull_at(TASK, 13.0)
    assert cost == 13.0
    assert distance == pytest.approx(optimum, abs=1e-9)
    assert optimum == pytest.approx(23.607, abs=1e-3)
    assert price == pytest.approx((25.642136 - 21.571068) / 26, abs=1e-6)


def test_drawn_episodes_cost_in_the_mean_what_is_expected(corners):
    mixture = Mixture(corners, np.array([0.25, 0.75]), 0, np.zeros((0, 3)))
    env = evaluation_env(TASK)
    costs = []
    for _ in range(60):
        for corner in corners:
            corner.clock = 0
        observation, info = env.reset()
        total, state, is_over = info["cost"], None, False
        while not is_over:
            first = np.array([state is None])
            action, state = mixture.predict(observation, state, first, True)
            observation, _, is_over, _, info = env.step(int(action))
            total += info["cost"]
        costs.append(total)
    assert set(costs) == {0.0, 26.0}
    assert np.mean(costs) == pytest.approx(0.75 * 26, abs=4.5)


def test_beyond_the_ends_of_the_hull_a_bound_is_worth_nothing():
    assert hull_at(replace(TASK, budget=40.0), 40.0) == (pytest.approx(21.571068), 0.0)
    assert hull_at(replace(TASK, budget=0.0), 0.0)[0] == pytest.approx(25.642136)


def test_page_tells_the_runs_below_a_folder(tmp_path, monkeypatch):
    for seed in range(2):
        words = [*TINY["ppo_lagrangian"], "--agent.total-timesteps", 128, "--seed", seed]
        assert call(["ppo_lagrangian", "--out", tmp_path / "runs" / str(seed), *words]) == 0
    hard = ["--env.constraint", "budget", "--env.budget", 1.0, "--env.target-db", -61.8]
    words = [*TINY["q_learning"], *hard, "--agent.total-timesteps", 128]
    assert call(["q_learning", "--out", tmp_path / "runs" / "hard", *words]) == 0

    out = tmp_path / "a" / "page"  # is made
    assert evaluate(monkeypatch, "budget", tmp_path / "runs", "--out", out) == 0
    board = json.loads((out / "budget.json").read_text())
    ((bound,), (budget,)) = board["expected"], board["hard"]
    assert (bound["bound"], bound["seeds"]) == (13.0, [0, 1])
    assert bound["optimum"] == pytest.approx(23.607, abs=1e-3)
    assert bound["distances"] == [None, None]  # after 128 steps nothing arrives
    assert estimated_anew(bound) == bound  # all follows from what is kept
    assert (budget["exact"], budget["seeds"]) == (0, [0])
    assert budget["optimum"] == pytest.approx(22.399, abs=1e-3)
    page = (out / "budget.md").read_text()
    assert "23.607 m" in page
    assert "0 of 1" in page


def test_settings_are_told_where_they_differ_within_a_problem_alone(tmp_path, monkeypatch):
    words = [*TINY["q_learning"], "--env.constraint", "budget", "--env.target-db", -61.8]
    words += ["--agent.total-timesteps", 128]
    runs = [(1.0, 0.1), (2.0, 0.2), (2.0, 0.3)]  # budgets and learning rates
    for budget, rate in runs:
        out = tmp_path / "runs" / f"{budget}-{rate}"
        own = ["--env.budget", budget, "--agent.learning-rate", rate]
        assert call(["q_learning", "--out", out, *words, *own]) == 0

    assert evaluate(monkeypatch, "budget", tmp_path / "runs", "--out", tmp_path) == 0
    found = json.loads((tmp_path / "budget.json").read_text())["hard"]
    said = {(each["optimum"] < 22, each["policy"]) for each in found}
    assert {name for is_of_two, name in said if not is_of_two} == {"Q-learning"}
    assert len({name for is_of_two, name in said if is_of_two}) == 2


def test_without_runs_nothing_is_written(tmp_path, monkeypatch, capsys):
    assert evaluate(monkeypatch, "budget", tmp_path, "--out", tmp_path / "docs") == 2
    assert "no complete run lies below" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


def test_sweep_over_budgets_holds_hard_ones_and_four_bounds_of_ten_seeds(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where no run of it lies yet
    plan = Plan.load(Path(__file__).parents[2] / "train/sweeps/budget.toml")
    plan.check()
    configs = plan.configs()
    assert len(configs) == (6 * 3 + 4) * 10
    hard = {
        (each.env.target_db, each.env.rules.least_budget)
        for each in configs
        if each.env.on_exhausted != "continue"
    }
    assert hard == {(-61.8, 0.0), (-61.8, 1.0), (-61.8, 2.0)} | {
        (-60.0, budget) for budget in (0.0, 13.0, 26.0)
    }
    bounds = {
        (each.env.cost, each.env.budget)
        for each in configs
        if each.agent.algorithm == "ppo_lagrangian"
    }
    assert bounds == {("violation", b) for b in (6.5, 13.0, 19.5)} | {("outage", 17.0)}
