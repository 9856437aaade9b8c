"""Facts of the front of switches and metres: equal to layers in networkx, and to a table of the
paper's scene.
"""

from math import inf

import networkx as nx
import numpy as np
import pytest
from test_joint import GOAL, START, assert_walks, paper_gains, stacks, states_of

from irs_gym import joint_distance_to_go, joint_shortest_path, switch_front

# Metres with 0, 1, 2, 3 switches, all configurations focused on a free cell considered: found by a
# prototype that shares no line with this package.
TABLE = {
    -62.0: (21.571, {0: 25.642, 1: 21.571}),
    -61.8: (23.228, {0: 25.642, 1: 24.471, 2: 23.642, 3: 23.228}),
    -61.2: (25.642, {0: 25.642}),
    -60.0: (25.642, {1: 30.228, 2: 26.228, 3: 25.642}),
    -59.6: (26.228, {3: 26.228}),
}


def least_metres(plain, start, goal, most):
    """Least metres with at most 0, 1 ... switches: copies of all states, one a switch."""
    layers = nx.DiGraph()
    for layer in range(most + 1):
        for one, other, data in plain.edges(data=True):
            for a, b in ((one, other), (other, one)):
                to = layer + (a[0] != b[0])
                if to <= most:
                    layers.add_edge((layer, a), (to, b), weight=data["weight"])
        layers.add_nodes_from((layer, state) for state in plain)

    starts = [(0, state) for state in plain if tuple(state[1:]) == start]
    found = nx.multi_source_dijkstra_path_length(layers, starts) if starts else {}
    return [
        min(
            (
                length
                for (at, state), length in found.items()
                if at <= layer and tuple(state[1:]) == goal
            ),
            default=inf,
        )
        for layer in range(most + 1)
    ]


def test_fronts_equal_networkx_on_random_stacks():
    points = several = missed = 0
    for gain_db, start, goal, _ in [*stacks(150), *stacks(150, ((5, 4), (9, 7)), most=6)]:
        expected = least_metres(states_of(gain_db, -1.0, 0.5, 0.0), start, goal, 5)
        if expected[-1] == inf:
            # unreachable with five switches: with any, on maps so small
            missed += 1
            with pytest.raises(ValueError, match="is infeasible"):
                switch_front(gain_db, -1.0, start, goal, 0.5)
            continue

        front = switch_front(gain_db, -1.0, start, goal, 0.5)
        for switches, metres in enumerate(expected):
            assert front.distance_with(switches) == pytest.approx(metres, abs=1e-9)
        assert np.all(np.diff(front.switches) > 0)
        assert np.all(np.diff(front.distances) < 0)
        for path, switches, distance in zip(
            front.paths, front.switches, front.distances, strict=True
        ):
            assert (path.switches, path.distance) == (switches, distance)
            assert_walks(path, gain_db, -1.0, start, goal, 0.5, 0.0)
        points += len(front.switches)
        several += len(front.switches) > 1

    assert points > 150
    assert several > 10
    assert missed > 30


@pytest.mark.parametrize("target_db", TABLE)
def test_three_switches_give_all_that_a_panel_gives_that_follows_the_robot(target_db):
    _, gain_db = paper_gains()
    front = switch_front(gain_db, target_db, START, GOAL, 0.5)
    following, metres = TABLE[target_db]
    assert (
        dict(zip(front.switches.tolist(), front.distances.round(3).tolist(), strict=True)) == metres
    )
    assert round(front.distances[-1], 3) == following
    for path in front.paths:
        assert_walks(path, gain_db, target_db, START, GOAL, 0.5, 0.0)


def test_the_joint_optimum_at_any_cost_is_a_point_of_the_front():
    for gain_db, start, goal, cost in stacks(200):
        to_go = joint_distance_to_go(gain_db, -2.0, goal, 0.5, cost)[:, *start]
        if np.isinf(to_go).all():
            continue
        front = switch_front(gain_db, -2.0, start, goal, 0.5)
        assert (front.distances + front.switches * cost).min() == pytest.approx(
            to_go.min(), abs=1e-9
        )
        free = [
            joint_shortest_path(gain_db, -2.0, start, goal, 0.5, 0.0, first)
            for first in np.flatnonzero(np.isfinite(to_go)).tolist()
        ]
        assert min((path.distance, path.switches) for path in free) == (
            front.distances[-1],
            front.switches[-1],
        )


def test_with_fewer_switches_than_the_fewest_there_is_no_path():
    gain_db = np.full((2, 3, 1), -9.0)
    gain_db[0, :2] = gain_db[1, 1:] = 0.0
    front = switch_front(gain_db, -1.0, (0, 0), (2, 0), 1.0)
    assert [front.distance_with(n) for n in (0, 1, 7)] == [inf, 2.0, 2.0]
    assert front.paths[0].cells.tolist() == [[0, 0], [1, 0], [1, 0], [2, 0]]
    assert front.paths[0].configurations.tolist() == [0, 0, 1, 1]


def test_arguments_that_are_none_are_refused():
    gains = np.zeros((1, 2, 2))
    for arguments, message in [
        ((gains[0], -1.0, (0, 0), (1, 1), 1.0), "shape"),
        ((gains, float("nan"), (0, 0), (1, 1), 1.0), "target_db=nan"),
        ((gains, -1.0, (0, 2), (1, 1), 1.0), r"start=\(0, 2\) lies off"),
        ((gains, -1.0, (0, 0), (1, 1), -1.0), "cell_size=-1.0"),
        ((gains, 1.0, (0, 0), (1, 1), 1.0), "the highest joint target is 0.0 dB"),
    ]:
        with pytest.raises(ValueError, match=message):
            switch_front(*arguments)
