"""Facts of the joint oracle for robots that cut no corners, or whose body cannot make every move:
equal to networkx, and to all walks of tiny maps.
"""

from itertools import pairwise
from math import floor, inf, sqrt

import numpy as np
import pytest
from test_joint import all_walks, best_to_go, stacks, states_of
from test_switch_front import least_metres

from irs_gym import highest_joint_target, joint_distance_to_go, joint_shortest_path, switch_front
from irs_gym.grid import MOVES

WAYS = [tuple(way) for way in MOVES.tolist()]
TARGETS = (-3.0, -2.0, -1.0, 0.0)


def some_moves(rng, shape):
    """Moves ``(X, Y, 8)`` of which most can be made, there and back."""
    passable = np.ones((*shape, 8), dtype=bool)
    for move, (di, dj) in enumerate(WAYS[:4]):
        for i, j in np.ndindex(shape):
            passable[i, j, move] = rng.random() < 0.8
            if 0 <= i + di < shape[0] and 0 <= j + dj < shape[1]:
                passable[i + di, j + dj, move + 4] = passable[i, j, move]
    return passable


def states_for(gain_db, target_db, cell_size, cost, corner_cutting, passable):
    """The states of `states_of` without the moves that such a robot does not make."""
    states = states_of(gain_db, target_db, cell_size, cost)
    for (k, i, j), (other, a, b) in list(states.edges):
        if k != other:
            continue
        cuts = i != a and j != b and not {(k, i, b), (k, a, j)} <= set(states)
        is_met = passable is not None and not passable[i, j, WAYS.index((a - i, b - j))]
        if is_met or (cuts and not corner_cutting):
            states.remove_edge((k, i, j), (k, a, b))
    return states


def tasks(count, **sizes):
    """Gains, two cells and a cost, with every kind of robot in turn."""
    rng = np.random.default_rng(11)
    for n, (gain_db, start, goal, cost) in enumerate(stacks(count, **sizes)):
        passable = some_moves(rng, gain_db.shape[1:]) if n % 3 else None
        motion = {"corner_cutting": n % 3 == 1, "passable": passable}
        yield gain_db, start, goal, cost, motion


def test_joint_distances_and_paths_equal_networkx_whatever_the_robot():
    reached = longer = 0
    for gain_db, start, goal, cost, motion in tasks(240):
        states = states_for(gain_db, -2.0, 0.5, cost, **motion)
        expected = best_to_go(states, goal)
        to_go = joint_distance_to_go(gain_db, -2.0, goal, 0.5, cost, **motion)
        for state in np.ndindex(gain_db.shape):
            assert to_go[state] == pytest.approx(expected.get(state, inf), abs=1e-9)

        first = int(np.argmax(gain_db[:, *start]))
        if (first, *start) not in expected:
            with pytest.raises(ValueError, match="is infeasible"):
                joint_shortest_path(gain_db, -2.0, start, goal, 0.5, cost, **motion)
            continue

        path = joint_shortest_path(gain_db, -2.0, start, goal, 0.5, cost, **motion)
        assert path.distance == pytest.approx(expected[first, *start], abs=1e-9)
        walked = [
            (k, *cell) for k, cell in zip(path.configurations, path.cells.tolist(), strict=True)
        ]
        assert all(states.has_edge(*pair) for pair in pairwise(walked))
        longer += (
            path.distance > joint_shortest_path(gain_db, -2.0, start, goal, 0.5, cost).distance
        )
        reached += 1

    assert reached > 80
    assert longer > 20


def test_no_walk_of_a_tiny_map_is_better_whatever_the_robot():
    reached = 0
    for gain_db, start, goal, cost, motion in tasks(150, shapes=((2, 2), (2, 3)), most=2):
        states = states_for(gain_db, -2.0, 1.0, cost, **motion)
        first = int(np.argmax(gain_db[:, *start]))
        if (first, *start) not in states:
            continue
        walks = set(all_walks(states, (first, *start), goal, {(first, *start)}))
        if not walks:
            continue
        best = min(a + b * sqrt(2) + switches * cost for a, b, switches in walks)
        path = joint_shortest_path(gain_db, -2.0, start, goal, 1.0, cost, **motion)
        assert path.distance == pytest.approx(best, abs=1e-9)
        reached += 1

    assert reached > 60


def test_a_diagonal_asks_for_cells_beside_it_that_no_short_path_leads_through():
    passable = np.ones((2, 3, 8), dtype=bool)
    passable[0, 1, 2] = passable[0, 2, 6] = False  # neither north from (0, 1) nor back
    motion = {"corner_cutting": False, "passable": passable}
    for cost in (0.0, 0.5):
        path = joint_shortest_path(np.zeros((1, 2, 3)), -1.0, (1, 1), (0, 2), 1.0, cost, **motion)
        assert path.cells.tolist() == [[1, 1], [0, 2]]


def test_the_highest_joint_target_is_the_last_that_networkx_reaches_whatever_the_robot():
    lower = 0
    for gain_db, start, goal, _, motion in tasks(160):
        joined = [
            target_db
            for target_db in TARGETS
            if any(
                state[1:] == start
                for state in best_to_go(states_for(gain_db, target_db, 1.0, 0.0, **motion), goal)
            )
        ]
        highest = highest_joint_target(gain_db, start, goal, **motion)
        assert highest == max(joined, default=-inf)
        lower += highest < highest_joint_target(gain_db, start, goal)
        if highest > -inf:
            said = f"the highest joint target is {floor(highest * 1e4) / 1e4} dB"
            with pytest.raises(ValueError, match=said):
                switch_front(gain_db, highest + 0.5, start, goal, 1.0, **motion)

    assert lower > 10


def test_fronts_equal_networkx_whatever_the_robot():
    several = 0
    for gain_db, start, goal, _, motion in tasks(90, shapes=((9, 7),), most=6):
        plain = states_for(gain_db, -1.0, 0.5, 0.0, **motion)
        if not any(state[1:] == start for state in best_to_go(plain, goal)):
            with pytest.raises(ValueError, match="is infeasible"):
                switch_front(gain_db, -1.0, start, goal, 0.5, **motion)
            continue

        front = switch_front(gain_db, -1.0, start, goal, 0.5, **motion)
        for switches, metres in enumerate(least_metres(plain, start, goal, 5)):
            assert front.distance_with(switches) == pytest.approx(metres, abs=1e-9)
        several += len(front.switches) > 1

    assert several > 5


def test_moves_of_another_map_are_refused_by_name():
    gain_db = np.zeros((2, 3, 2))
    for passable in (np.ones((3, 2), dtype=bool), np.ones((2, 3, 2, 8), dtype=bool)):
        for work in (joint_shortest_path, switch_front):
            with pytest.raises(ValueError, match=r"passable has the shape .* needed: \(3, 2, 8\)"):
                work(gain_db, -1.0, (0, 0), (2, 1), 1.0, passable=passable)
        with pytest.raises(ValueError, match="passable has the shape"):
            joint_distance_to_go(gain_db, -1.0, (2, 1), 1.0, passable=passable)
        with pytest.raises(ValueError, match="passable has the shape"):
            highest_joint_target(gain_db, (0, 0), (2, 1), passable=passable)
