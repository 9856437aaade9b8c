"""Facts about what a discount makes of the returns on a problem."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from evaluating import call

from eval.commands import shaping
from eval.commands.ablations import GAMMAS
from eval.scoreboard.ablations import discounts_section
from eval.scoreboard.return_variance import (
    best_ratios,
    count_longer,
    optimal_values,
    random_spread,
    reached,
    return_variances,
)
from irs_gym.mdp.dynamics import tabulate, transition
from irs_gym.mdp.task import Task, World, build_world
from irs_gym.oracle.shortest_path import shortest_path
from irs_gym.radio.radio_map import RadioMap

DOCS = Path(__file__).resolve().parents[2] / "docs"
WALL = np.array(
    [[0, 0, 0, 0, 0], [0, -9, -9, -9, 0], [0, 0, 0, 0, 0], [0, -9, 0, -9, 0]], dtype=float
)


@pytest.fixture
def world() -> World:
    radio_map = RadioMap.from_array(WALL, cell_size=0.5)
    return build_world(
        Task(radio_map=radio_map, start=(0, 2), goal=(2, 2), target_db=-1.0, shaping=False)
    )


def flat(world: World, cell: tuple[int, int]) -> int:
    return int(np.ravel_multi_index(cell, world.feasible.shape))


def test_undiscounted_optimal_values_are_the_bonus_minus_the_distance_to_go(world):
    moves = transition(world, world.goal)
    values = optimal_values(moves, 1.0, flat(world, world.start))
    to_go = tabulate(world, world.goal).distance_to_go.ravel()
    seen = reached(moves, flat(world, world.start))
    assert set(seen) == set(np.flatnonzero(np.isfinite(to_go) & (to_go > 0)))
    np.testing.assert_allclose(values[seen], world.task.goal_bonus - to_go[seen], atol=1e-9)


@pytest.mark.parametrize("gamma", [0.9, 1.0])
def test_the_spread_is_that_of_sampled_returns(world, gamma):
    rng, moves = np.random.default_rng(0), transition(world, world.goal)
    samples = 20_000
    cells, returns, weight = (
        np.full(samples, flat(world, world.start)),
        np.zeros(samples),
        np.ones(samples),
    )
    while weight.any():
        actions = rng.integers(8, size=samples)
        returns += weight * moves.reward[cells, actions]
        weight *= gamma * ~moves.is_terminated[cells, actions]
        weight[weight < 1e-9] = 0.0
        cells = moves.next_cell[cells, actions]
    spread = random_spread(moves, gamma, flat(world, world.start))
    assert spread == pytest.approx(returns.std(), rel=0.05)


def test_a_discount_near_one_leaves_the_best_path_the_best_and_a_small_one_does_not():
    # the goal's bonus is far away: under a strong discount, moves that cost nothing now are worth
    # more
    world = build_world(Task())
    near, far = return_variances(world, [0.98, 0.3])
    assert near.ratio == pytest.approx(1.0, abs=1e-12)
    assert far.ratio > 1.0
    assert near.episodes == pytest.approx((near.spread / (0.02 * 23.2279)) ** 2, rel=1e-4)


# --- the best path and the shortest ---------------------------------------------------------------


def returns(world: World, cells: list[tuple[int, int]], gamma: float) -> float:
    """Discounted return of a path, with the reward written out: -metres + Phi' - Phi, and the bonus
    at the goal.
    """
    total, weight = 0.0, 1.0
    for here, there in pairwise(cells):
        octile = [
            max(d) + (2**0.5 - 1) * min(d)
            for d in (np.abs(np.subtract(c, world.goal)) for c in (here, there))
        ]
        metres = 0.5 * np.hypot(*np.subtract(there, here))
        bonus = world.task.goal_bonus * (there == world.goal)
        total += weight * (-metres + 0.5 * (octile[0] - octile[1]) * world.task.shaping + bonus)
        weight *= gamma
    return total


def test_undiscounted_the_best_path_is_the_shortest_from_every_start():
    ratios = best_ratios(build_world(Task()), 1.0)
    assert count_longer(ratios) == "0 of 933"
    assert np.nanmax(np.abs(ratios - 1.0)) < 1e-9


def test_at_a_discount_of_98_percent_the_best_path_is_longer_from_10_of_933_starts():
    world, gamma = build_world(Task()), 0.98
    ratios = best_ratios(world, gamma)
    assert count_longer(ratios) == "10 of 933"
    assert np.nanmax(ratios) == pytest.approx(1.0264, abs=5e-5)
    assert ratios[world.start] == pytest.approx(1.0, abs=1e-9)

    # The value of such a start is a larger return than that of the oracle's path, counted move by
    # move.
    values = optimal_values(transition(world, world.goal), gamma, flat(world, world.start))
    for start in np.argwhere(ratios > 1.0 + 1e-9):
        path = shortest_path(world.feasible, tuple(start), world.goal, 0.5)
        assert (
            values[flat(world, tuple(start))]
            > returns(world, list(map(tuple, path.cells)), gamma) + 1e-9
        )


def test_two_of_the_first_hundred_test_scenes_have_a_longer_best_path_from_their_own_start():
    worlds = shaping.generated_worlds(100)
    longer = [
        n for n, world in enumerate(worlds) if best_ratios(world, 0.98)[world.start] > 1.0 + 1e-9
    ]
    assert longer == [27, 66]


def test_in_a_long_spiral_it_is_best_never_to_arrive_because_of_the_shaping():
    ratios = [
        best_ratios(world, 0.98)[world.start] for world in map(shaping.spiral_world, (19, 21))
    ]
    assert 1.0 < ratios[0] < 1.03
    assert ratios[1] == np.inf
    bare = shaping.spiral_world(21, shaping=False)
    assert 1.0 < best_ratios(bare, 0.98)[bare.start] < 1.03


def test_a_spiral_is_one_corridor():
    cells = shaping.spiral(9)
    assert len(cells) == len(set(cells)) == 49
    assert (cells[0], cells[-1]) == ((0, 0), (4, 4))
    for n, cell in enumerate(cells):
        near = [
            m for m, other in enumerate(cells) if 0 < np.abs(np.subtract(cell, other)).max() < 2
        ]
        assert all(abs(m - n) <= 2 for m in near)


def test_the_pages_say_what_is_computed():
    world = build_world(Task())
    distance = float(tabulate(world, world.goal).distance_to_go[world.start])
    section = discounts_section(distance, return_variances(world, GAMMAS)).strip()
    assert section in (DOCS / "ablations.md").read_text(encoding="utf-8")
    page = (DOCS / "shaping.md").read_text(encoding="utf-8")
    assert shaping.paper_section().strip() in page
    assert "| 0.98 | 14 of 1,000 |" in page
    assert "| 0.98 | 16 of 20 | 12 of 20 |" in page


def test_the_page_is_written_of_as_many_scenes_as_are_asked_for(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(shaping, "SPIRAL_SIDES", range(5, 9, 2))
    assert call(monkeypatch, "shaping", "--out", tmp_path / "docs", "--scenes", 3) == 0
    page = (tmp_path / "docs/shaping.md").read_text(encoding="utf-8")
    assert "| 0.98 | 0 of 3 |" in page
    assert "| 0.98 | 0 of 2 | 0 of 2 |" in page
    assert call(monkeypatch, "shaping", "--out", tmp_path / "docs", "--scenes", 0) == 2
    assert "num_scenes=0" in capsys.readouterr().err
