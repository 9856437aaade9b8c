"""Facts of the joint oracle: equal to networkx and to all paths of tiny maps, and to the oracle of
one map where configurations are alike.
"""

from functools import cache
from itertools import pairwise, product
from math import inf, nan, sqrt

import networkx as nx
import numpy as np
import pytest

from irs_gym import (
    RadioMap,
    build_radio_map,
    codebook_gain_db,
    distance_to_go,
    focused_codebook,
    highest_feasible_target,
    highest_joint_target,
    joint_distance_to_go,
    joint_shortest_path,
    shortest_path,
)
from irs_gym.memory import VARIABLE

# The gains of the fewest steps: whole dB from -3 to 0, some cells blocked.
SHAPES = [(1, 1), (1, 4), (2, 2), (2, 3), (3, 3), (5, 4), (9, 7)]
START, GOAL = (0, 20), (39, 20)  # of the paper's scene


def stacks(count, shapes=tuple(SHAPES), most=4):
    """Gains (K, X, Y) drawn of few values, so that there are ties; two cells; a cost in metres."""
    rng = np.random.default_rng(5)
    for n in range(count):
        shape = shapes[n % len(shapes)]
        gain_db = rng.integers(-3, 1, (int(rng.integers(1, most + 1)), *shape)).astype(float)
        gain_db[:, rng.random(shape) < 0.1] = -inf
        start, goal = (tuple(int(k) for k in rng.integers(shape)) for _ in range(2))
        yield gain_db, start, goal, float(rng.choice([0.0, 0.1, 0.5, 1.0, 3.7, 1000.0]))


def states_of(gain_db, target_db, cell_size, cost) -> nx.Graph:
    """All pairs (k, i, j) at the target, joined by moves and by every switch."""
    states = nx.Graph()
    states.add_nodes_from(map(tuple, np.argwhere((gain_db >= target_db) & np.isfinite(gain_db))))
    for k, i, j in list(states):
        for di, dj in product((-1, 0, 1), repeat=2):
            if (di, dj) != (0, 0) and (k, i + di, j + dj) in states:
                length = sqrt(di * di + dj * dj) * cell_size
                states.add_edge((k, i, j), (k, i + di, j + dj), weight=length)
        for other in range(len(gain_db)):
            if other != k and (other, i, j) in states:
                states.add_edge((k, i, j), (other, i, j), weight=cost)
    return states


def best_to_go(states, goal):
    ends = [state for state in states if tuple(state[1:]) == goal]
    return nx.multi_source_dijkstra_path_length(states, ends) if ends else {}


@cache
def paper_gains():
    """The paper's map, and the gains of the best configurations of all its free cells."""
    radio_map = build_radio_map("paper")
    codebook = focused_codebook("paper", np.argwhere(radio_map.free))
    return radio_map, codebook_gain_db("paper", codebook)


def assert_walks(path, gain_db, target_db, start, goal, cell_size, cost):
    """The path is one: moves and switches in place, all of it at the target, its cost added up."""
    assert tuple(path.cells[0]) == start
    assert tuple(path.cells[-1]) == goal
    assert np.all(gain_db[path.configurations, *path.cells.T] >= target_db)
    total = 0.0
    for (before, held), (after, holds) in pairwise(
        zip(path.cells.tolist(), path.configurations.tolist(), strict=True)
    ):
        apart = max(abs(a - b) for a, b in zip(before, after, strict=True))
        assert (apart == 1) != (held != holds)
        total += np.hypot(*np.subtract(after, before)) * cell_size + (held != holds) * cost
    assert path.distance == pytest.approx(total, abs=1e-9)
    assert path.switches == np.count_nonzero(np.diff(path.configurations))
    assert path.switches == len(path.switch_cells)


# --- against others -------------------------------------------------------------------------------


def test_joint_distances_equal_networkx_on_random_stacks():
    reached = missed = 0
    for gain_db, start, goal, cost in stacks(400):
        for target_db in (-2.0, -1.0):
            expected = best_to_go(states_of(gain_db, target_db, 0.5, cost), goal)
            to_go = joint_distance_to_go(gain_db, target_db, goal, 0.5, cost)
            for state in np.ndindex(gain_db.shape):
                assert to_go[state] == pytest.approx(expected.get(state, inf), abs=1e-9)

            for first in (None, 0):
                held = int(np.argmax(gain_db[:, *start])) if first is None else first
                arguments = (gain_db, target_db, start, goal, 0.5, cost, first)
                if (held, *start) not in expected:
                    missed += 1
                    with pytest.raises(ValueError, match="is infeasible"):
                        joint_shortest_path(*arguments)
                    continue

                path = joint_shortest_path(*arguments)
                assert path.configurations[0] == held
                assert path.distance == pytest.approx(expected[held, *start], abs=1e-9)
                assert_walks(path, gain_db, target_db, start, goal, 0.5, cost)
                reached += 1

    assert reached > 300
    assert missed > 300


def all_walks(states, at, goal, seen):
    """Metres and switches of every way to the goal that passes no state twice."""
    if tuple(at[1:]) == goal:
        yield 0, 0, 0
    for after in states[at]:
        if after not in seen:
            straight, diagonal = abs(after[1] - at[1]), abs(after[2] - at[2])
            for a, b, switches in all_walks(states, after, goal, seen | {after}):
                yield (
                    a + (straight != diagonal),
                    b + (straight == diagonal == 1),
                    switches + (after[0] != at[0]),
                )


def test_no_walk_of_a_tiny_map_is_better_nor_as_good_with_fewer_switches():
    reached = 0
    for gain_db, start, goal, cost in [
        *stacks(150, ((1, 4), (2, 2)), most=3),
        *stacks(100, ((2, 3),), most=2),
    ]:
        states = states_of(gain_db, -2.0, 1.0, cost)
        first = int(np.argmax(gain_db[:, *start]))
        if (first, *start) not in states:
            continue
        walks = set(all_walks(states, (first, *start), goal, {(first, *start)}))
        if not walks:
            continue
        total = {walk: walk[0] + walk[1] * sqrt(2) + walk[2] * cost for walk in walks}
        best = min(total.values())
        fewest = min(walk[2] for walk in walks if total[walk] < best + 1e-9)
        path = joint_shortest_path(gain_db, -2.0, start, goal, 1.0, cost)
        assert path.distance == pytest.approx(best, abs=1e-9)
        assert path.switches == fewest
        reached += 1

    assert reached > 100


def test_the_highest_joint_target_is_the_last_at_which_a_path_exists():
    for gain_db, start, goal, _ in stacks(200):
        highest = highest_joint_target(gain_db, start, goal)
        feasible = [
            target_db
            for target_db in (-3.0, -2.0, -1.0, 0.0)
            if np.isfinite(joint_distance_to_go(gain_db, target_db, goal, 1.0)[:, *start]).any()
        ]
        assert highest == max(feasible, default=-inf)


def test_configurations_that_are_alike_are_one_map():
    for gain_db, start, goal, cost in stacks(200):
        one = gain_db[0]
        alike = np.stack([one] * 3)
        feasible = RadioMap.from_array(one, 0.5).feasible(-2.0)
        to_go = joint_distance_to_go(alike, -2.0, goal, 0.5, cost)
        for each in to_go:
            np.testing.assert_allclose(each, distance_to_go(feasible, goal, 0.5), atol=1e-9)
        assert highest_joint_target(alike, start, goal) == highest_feasible_target(one, start, goal)

        path = shortest_path(feasible, start, goal, 0.5)
        if path is not None:
            joint = joint_shortest_path(alike, -2.0, start, goal, 0.5, cost)
            assert (joint.distance, joint.switches) == (path.distance, 0)


def test_free_switches_between_the_best_of_all_cells_give_the_papers_optimum():
    radio_map, gain_db = paper_gains()
    for target_db in (-64.0, -62.0, -61.8, -61.2, -60.0, -59.6):
        best = shortest_path(radio_map.feasible(target_db), START, GOAL, 0.5)
        path = joint_shortest_path(gain_db, target_db, START, GOAL, 0.5)
        assert path.distance == best.distance
        assert_walks(path, gain_db, target_db, START, GOAL, 0.5, 0.0)

    assert highest_joint_target(gain_db, START, GOAL) == pytest.approx(
        highest_feasible_target(radio_map.gain_db, START, GOAL), abs=1e-9
    )


# --- what changes it, and how ---------------------------------------------------------------------


def test_a_configuration_more_a_lower_target_and_a_cheaper_switch_never_make_it_longer():
    for gain_db, _, goal, cost in stacks(200):
        to_go = joint_distance_to_go(gain_db, -1.0, goal, 0.5, cost)
        fewer = (
            joint_distance_to_go(gain_db[:-1], -1.0, goal, 0.5, cost) if len(gain_db) > 1 else inf
        )
        lower = joint_distance_to_go(gain_db, -2.0, goal, 0.5, cost)
        cheaper = joint_distance_to_go(gain_db, -1.0, goal, 0.5, cost / 3)
        assert np.all(to_go[:-1] <= fewer + 1e-9)
        assert np.all(lower <= to_go + 1e-9)
        assert np.all(cheaper <= to_go + 1e-9)
        assert np.all(to_go[:, *goal][gain_db[:, *goal] >= -1.0] == 0)


def test_a_dear_switch_is_made_where_there_is_no_other_way_only():
    gain_db = np.full((3, 5, 2), -9.0)
    gain_db[0, :3, 0] = gain_db[1, 2:, 0] = 0.0  # two that share the straight way
    gain_db[2, [0, 1, 2, 3, 4], [0, 1, 1, 1, 0]] = 0.0  # and one for a way around
    around = 2 + 2 * sqrt(2)
    for cost, first, distance, switches in [
        (0.5, 0, 4.5, 1),
        (0.5, 2, around, 0),  # no 1.0 for two switches
        (0.1, 2, 4.2, 2),
        (around - 4, 0, around, 1),
        (1e9, 0, 4 + 1e9, 1),
        (1e9, 2, around, 0),
    ]:
        path = joint_shortest_path(gain_db, -1.0, (0, 0), (4, 0), 1.0, cost, first)
        assert (path.distance, path.switches) == (pytest.approx(distance), switches)


def test_of_equally_good_paths_that_of_fewest_switches_is_taken():
    gain_db = np.zeros((4, 6, 6))
    for cost in (0.0, 1.0):
        assert joint_shortest_path(gain_db, -1.0, (0, 0), (5, 5), 1.0, cost).switches == 0

    # three in a row of which each next one serves a cell more, and one that serves all of them
    gain_db = np.where(np.arange(5) <= np.array([1, 2, 3, 4])[:, None], 0.0, -9.0)[:, :, None]
    gain_db[0, 0] = 1.0
    assert joint_shortest_path(gain_db, -1.0, (0, 0), (4, 0), 1.0).switches == 1


def test_free_switches_are_made_no_more_than_it_takes():
    tied = 0
    for gain_db, start, goal, _ in stacks(300, ((3, 3), (5, 4), (9, 7)), most=6):
        # so little a switch that no other path is taken for it
        expected = best_to_go(states_of(gain_db, -2.0, 1.0, 1e-6), goal)
        first = int(np.argmax(gain_db[:, *start]))
        if (first, *start) not in expected:
            continue
        path = joint_shortest_path(gain_db, -2.0, start, goal, 1.0)
        assert path.distance + 1e-6 * path.switches == pytest.approx(
            expected[first, *start], abs=1e-9
        )
        tied += path.switches > 0

    assert tied > 10


def test_a_way_far_around_is_found_where_the_straight_one_takes_many_switches():
    gain_db = np.full((6, 11, 4), -9.0)
    for k in range(5):
        gain_db[k, 2 * k : 2 * k + 3, 0] = 0.0  # five in a row, each of three cells
    around = [*((n, n) for n in range(4)), *((n, 3) for n in range(4, 7))]
    for i, j in [*around, *((10 - i, j) for i, j in around)]:
        gain_db[5, i, j] = 0.0

    path = joint_shortest_path(gain_db, -1.0, (0, 0), (10, 0), 1.0, 1.0, first=5)
    assert (path.distance, path.switches) == (pytest.approx(4 + 6 * sqrt(2)), 0)
    path = joint_shortest_path(gain_db, -1.0, (0, 0), (10, 0), 1.0, 0.4, first=5)
    assert (path.distance, path.switches) == (pytest.approx(12.0), 5)


def test_the_first_configuration_is_the_one_of_the_highest_gain_unless_it_is_given():
    gain_db = np.zeros((3, 2, 1))
    gain_db[1:, 0] = 5.0
    assert joint_shortest_path(gain_db, -1.0, (0, 0), (1, 0), 1.0).configurations[0] == 1
    given = joint_shortest_path(gain_db, -1.0, (0, 0), (1, 0), 1.0, first=np.int64(2))
    assert given.configurations.tolist() == [2, 2]


def test_start_and_goal_may_be_one_cell():
    path = joint_shortest_path(np.zeros((2, 1, 1)), -1.0, (0, 0), (0, 0), 1.0, 0.5)
    assert (path.distance, path.switches, path.cells.tolist()) == (0.0, 0, [[0, 0]])


def test_results_are_read_only():
    path = joint_shortest_path(np.zeros((2, 3, 1)), -1.0, (0, 0), (2, 0), 1.0)
    for array in (path.cells, path.configurations):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


# --- what is refused ------------------------------------------------------------------------------


def test_a_target_with_no_joint_path_is_refused_with_the_highest_that_has_one():
    _, gain_db = paper_gains()
    few = gain_db[[100, 900]]
    with pytest.raises(
        ValueError, match=r"with the 2 configurations.*target is (-\S+) dB$"
    ) as told:
        joint_shortest_path(few, -59.0, START, GOAL, 0.5)
    said = float(str(told.value).split()[-2])
    assert said == pytest.approx(highest_joint_target(few, START, GOAL), abs=1e-4)
    joint_shortest_path(few, said, START, GOAL, 0.5)

    # one that begins below the target names the highest for that beginning
    gain_db = np.array([[[-5.0], [0.0]], [[0.0], [0.0]]])
    with pytest.raises(ValueError, match=r"from configuration 0: the highest .* is -5.0 dB"):
        joint_shortest_path(gain_db, -1.0, (0, 0), (1, 0), 1.0, first=0)
    with pytest.raises(ValueError, match="no target is"):
        joint_shortest_path([[[0.0, -inf, 0.0]]], -1.0, (0, 0), (0, 2), 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gain_db": np.zeros((0, 2, 2))}, r"gain_db has the shape \(0, 2, 2\)"),
        ({"gain_db": np.zeros((2, 2))}, r"gain_db has the shape \(2, 2\)"),
        ({"gain_db": np.full((1, 2, 2), nan)}, r"gain_db holds NaN or \+inf"),
        ({"gain_db": np.full((1, 2, 2), inf)}, r"gain_db holds NaN or \+inf"),
        ({"gain_db": np.full((1, 2, 2), "a")}, "type <U1"),
        ({"gain_db": [[[0.0]], [[0.0, 0.0]]]}, "gain_db is no array"),
        ({"target_db": nan}, "target_db=nan must be a number of dB"),
        ({"target_db": "-60"}, "target_db='-60' must be a number of dB"),
        ({"start": (2, 0)}, r"start=\(2, 0\) lies off the map"),
        ({"goal": (0, -1)}, r"goal=\(0, -1\) lies off the map"),
        ({"goal": (0.5, 0)}, r"goal=\(0.5, 0\) must be a cell"),
        ({"cell_size": 0}, "cell_size=0 must be a positive number"),
        ({"switch_cost": -0.1}, "switch_cost=-0.1 must be a number of metres from 0"),
        ({"switch_cost": nan}, "switch_cost=nan must be a number of metres from 0"),
        ({"switch_cost": inf}, "switch_cost=inf must be a number of metres from 0"),
        ({"switch_cost": "1"}, "switch_cost='1' must be a number of metres from 0"),
        ({"switch_cost": True}, "switch_cost=True must be a number of metres from 0"),
        ({"first": 1}, "first=1 must be the number of one of 1 configurations"),
        ({"first": -1}, "first=-1 must be the number"),
        ({"first": 0.0}, "first=0.0 must be the number"),
        ({"first": True}, "first=True must be the number"),
    ],
)
def test_arguments_that_are_none_are_refused(change, message):
    arguments = {
        "gain_db": np.zeros((1, 2, 2)),
        "target_db": -1.0,
        "start": (0, 0),
        "goal": (1, 1),
        "cell_size": 1.0,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        joint_shortest_path(**arguments)
    if "first" not in change and "start" not in change:
        del arguments["start"]
        with pytest.raises(ValueError, match=message):
            joint_distance_to_go(**arguments)


def test_a_search_beyond_memory_is_refused_before_it_begins(monkeypatch):
    monkeypatch.setenv(VARIABLE, "1MiB")
    with pytest.raises(ValueError, match=r"a search over 12,800 pairs .* would take"):
        joint_shortest_path(np.zeros((8, 40, 40)), -1.0, (0, 0), (1, 1), 1.0)
    with pytest.raises(ValueError, match=r"gain_db: work on 999 maps of 40 x 40 cells would take"):
        joint_distance_to_go(np.zeros((999, 40, 40)), -1.0, (0, 0), 1.0)
