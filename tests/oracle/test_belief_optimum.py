"""Facts of the best policy of a robot that does not know its scene: equal to all policies tried move
by move, played as it says, and never below what knows or sees less.
"""

from functools import cache
from itertools import product
from math import inf, sqrt

import numpy as np
import pytest

from irs_gym import belief_optimum, distance_to_go
from irs_gym.grid import MOVES, legal_moves
from irs_gym.oracle.scene_family import patch_of


def family_of(rng, shape, count, start, goal, closed=0.35):
    """Different maps in which the goal can be reached."""
    maps = set()
    for _ in range(1000):
        feasible = rng.random(shape) > closed
        feasible[start] = feasible[goal] = True
        if np.isfinite(distance_to_go(feasible, goal, 1.0)[start]):
            maps.add(feasible.tobytes())
        if len(maps) == count:
            break
    return np.array([np.frombuffer(each, dtype=bool).reshape(shape) for each in sorted(maps)])


def walls_with_doors(shape, columns):
    """Walls across the room at those columns, each with one door, in every combination."""
    maps = []
    for doors in product(range(shape[1]), repeat=len(columns)):
        feasible = np.ones(shape, dtype=bool)
        for column, door in zip(columns, doors, strict=True):
            feasible[column] = False
            feasible[column, door] = True
        maps.append(feasible)
    return np.array(maps)


def best_of_all_policies(maps, start, goal, radius, criterion, weights, longest, corner_cutting):
    """Try every move after everything that may have been seen, on walks up to so many cells.

    What is known is a set of cells with what was seen of them; nothing is shared with the package
    but its moves.
    """
    shape = maps.shape[1:]
    shortest = [
        distance_to_go(each, goal, 1.0, corner_cutting=corner_cutting)[start] for each in maps
    ]
    legal = legal_moves(maps, corner_cutting)

    @cache
    def look(known, scene, cell):
        near = product(
            *(
                range(max(0, c - radius), min(n, c + radius + 1))
                for c, n in zip(cell, shape, strict=True)
            )
        )
        return known | {(each, bool(maps[scene][each])) for each in near}

    @cache
    def possible(known):
        return [
            n
            for n, each in enumerate(maps)
            if all(each[cell] == is_open for cell, is_open in known)
        ]

    @cache
    def best(known, cell, straight, diagonal):
        scenes = possible(known)
        length = straight + diagonal * sqrt(2)
        if cell == goal:
            if criterion == "distance":
                return -sum(weights[n] * length for n in scenes)
            return sum(weights[n] * shortest[n] / max(length, shortest[n]) for n in scenes)
        if length > longest:
            return -inf if criterion == "distance" else 0.0

        found = []
        for move in np.flatnonzero(legal[scenes[0]][cell]).tolist():
            to = (cell[0] + int(MOVES[move][0]), cell[1] + int(MOVES[move][1]))
            walked = (straight, diagonal + 1) if move % 2 else (straight + 1, diagonal)
            found.append(
                sum(best(each, to, *walked) for each in {look(known, n, to) for n in scenes})
            )
        return max(found, default=-inf)

    firsts = {look(frozenset(), n, start) for n in range(len(maps))}
    return sum(best(each, start, 0, 0) for each in firsts)


def tiny_families():
    """Maps, start, goal, and cells that no best walk is longer than."""
    rng = np.random.default_rng(5)
    for shape, count in [((2, 3), 3), ((3, 3), 4), ((4, 4), 6)]:
        goal = (shape[0] - 1, shape[1] - 1)
        yield family_of(rng, shape, count, (0, 0), goal), (0, 0), goal, 10

    # a door out of sight, on one side or the other
    yield walls_with_doors((3, 5), [1])[[0, 4]], (0, 2), (2, 2), 10
    yield walls_with_doors((3, 6), [1]), (0, 2), (2, 3), 10
    yield walls_with_doors((3, 6), [1])[[0, 1, 4, 5]], (0, 3), (2, 0), 10
    yield walls_with_doors((5, 5), [1, 3])[[0, 4, 9, 10, 14]], (0, 2), (4, 2), 14


@pytest.mark.parametrize("criterion", ["spl", "distance"])
@pytest.mark.parametrize("corner_cutting", [True, False])
def test_the_optimum_is_the_best_of_all_policies_tried_move_by_move(criterion, corner_cutting):
    rng = np.random.default_rng(6)
    informed = 0
    for given, start, goal, longest in tiny_families():
        to_go = [
            distance_to_go(each, goal, 1.0, corner_cutting=corner_cutting)[start] for each in given
        ]
        maps = given[np.isfinite(to_go)]
        weights = rng.random(len(maps)) + 0.1
        weights /= weights.sum()
        found = belief_optimum(
            maps,
            start,
            goal,
            1.0,
            radius=1,
            criterion=criterion,
            weights=weights,
            corner_cutting=corner_cutting,
        )
        expected = best_of_all_policies(
            maps,
            start,
            goal,
            1,
            criterion,
            weights,
            longest + 2 * (not corner_cutting),
            corner_cutting,
        )
        assert found.is_exact
        assert found.value == pytest.approx(abs(expected), abs=1e-12)
        informed += float(found.spl @ weights) < 1 - 1e-9

    assert informed >= 3  # where not knowing costs something


def played(found, feasible, labels, start, goal):
    """The cells of the policy in one scene, told nothing but patches."""
    patch = patch_of(labels, start[0] * feasible.shape[1] + start[1], found.radius)
    node = found.first[start, goal, patch.tobytes()]
    cells = [start]
    while True:
        assert tuple(node.walk[0]) == cells[-1]
        cells += [tuple(each) for each in node.walk[1:].tolist()]
        if node.is_last:
            return cells
        at = cells[-1][0] * feasible.shape[1] + cells[-1][1]
        node = node.after[patch_of(labels, at, found.radius).tobytes()]


@pytest.mark.parametrize("criterion", ["spl", "distance"])
def test_played_by_patches_alone_the_policy_comes_to_what_it_claims(criterion):
    rng = np.random.default_rng(7)
    maps = np.concatenate(
        [walls_with_doors((8, 8), [2, 5]), family_of(rng, (8, 8), 60, (0, 0), (7, 7))]
    )
    starts = np.array([(0, 4)] * 64 + [(0, 0)] * 60)
    goals = np.array([(7, 4)] * 64 + [(7, 7)] * 60)
    weights = rng.random(len(maps)) + 0.1
    found = belief_optimum(maps, starts, goals, 0.5, radius=1, criterion=criterion, weights=weights)
    lengths = []
    for n, feasible in enumerate(maps):
        start, goal = tuple(starts[n].tolist()), tuple(goals[n].tolist())
        cells = played(found, feasible, feasible, start, goal)
        assert cells[-1] == goal
        assert cells == [tuple(each) for each in found.path(n).cells.tolist()]
        assert all(feasible[each] for each in cells)
        steps = np.abs(np.diff(cells, axis=0))
        assert (steps.max(axis=1) == 1).all()
        lengths.append(0.5 * np.hypot(*steps.T).sum())

    shortest = np.array(
        [
            distance_to_go(each, tuple(goal), 0.5)[tuple(start)]
            for each, start, goal in zip(maps, starts.tolist(), goals.tolist(), strict=True)
        ]
    )
    scores = shortest / np.maximum(lengths, shortest) if criterion == "spl" else lengths
    assert found.is_exact
    assert np.average(scores, weights=weights) == pytest.approx(found.value, abs=1e-12)
    assert found.distances == pytest.approx(lengths)
    assert found.oracle_distances == pytest.approx(shortest)
    assert found.spl.mean() < 0.99


def test_who_sees_further_or_knows_more_is_never_worse_and_all_knowing_is_one():
    maps = walls_with_doors((9, 9), [3, 5])
    ends = (0, 4), (8, 4)
    rng = np.random.default_rng(8)
    weights = rng.random(len(maps)) + 0.1
    values = [
        belief_optimum(maps, *ends, 0.5, radius=radius, weights=weights).value
        for radius in (1, 2, 3, 8)
    ]
    assert values[0] < values[1] < values[2] < values[3] == pytest.approx(1.0)

    # told which part its scene is in
    for _ in range(3):
        part = rng.integers(3, size=len(maps))
        parts = [
            belief_optimum(maps[part == n], *ends, 0.5, radius=1, weights=weights[part == n]).value
            for n in range(3)
        ]
        shares = [weights[part == n].sum() for n in range(3)]
        assert np.average(parts, weights=shares) > values[0]


def test_a_scene_alone_is_the_shortest_path_and_one_listed_twice_is_one_with_twice_the_weight():
    maps = walls_with_doors((7, 7), [3])
    for feasible in maps:
        found = belief_optimum(feasible[None], (0, 3), (6, 3), 0.5, radius=1, criterion="distance")
        assert found.value == pytest.approx(distance_to_go(feasible, (6, 3), 0.5)[0, 3])

    twice = belief_optimum(maps[[0, 1, 2, 2, 5, 6]], (0, 3), (6, 3), 0.5, radius=1)
    weighed = belief_optimum(
        maps[[0, 1, 2, 5, 6]], (0, 3), (6, 3), 0.5, radius=1, weights=[1, 1, 2, 1, 1]
    )
    assert twice.value == pytest.approx(weighed.value, abs=1e-12)


def test_labels_that_tell_scenes_apart_at_once_leave_nothing_to_find_out():
    maps = walls_with_doors((7, 7), [3])
    labels = np.zeros(maps.shape, dtype=np.int64)
    labels[:, 0, 3] = np.arange(len(maps))  # the start looks different in each
    found = belief_optimum(maps, (0, 3), (6, 3), 0.5, radius=1, labels=labels)
    assert found.value == pytest.approx(1.0)
    assert belief_optimum(maps, (0, 3), (6, 3), 0.5, radius=1).value < 0.9
    for n, feasible in enumerate(maps):
        cells = played(found, feasible, labels[n], (0, 3), (6, 3))
        assert cells == [tuple(each) for each in found.path(n).cells.tolist()]


@pytest.mark.parametrize("criterion", ["spl", "distance"])
def test_a_search_cut_short_has_a_policy_and_a_bound_around_the_optimum(criterion):
    maps = walls_with_doors((9, 7), [2, 4, 6])[::3]
    ask = {"radius": 1, "criterion": criterion}
    best = belief_optimum(maps, (0, 3), (8, 3), 0.5, **ask)
    sign = 1 if criterion == "spl" else -1
    gaps = []
    for max_states in (1, 10, 100):
        found = belief_optimum(maps, (0, 3), (8, 3), 0.5, **ask, max_states=max_states)
        assert sign * found.value <= sign * best.value + 1e-9
        assert sign * found.bound >= sign * best.value - 1e-9
        assert not found.is_exact
        gaps.append(sign * (found.bound - found.value))
    assert gaps[0] > gaps[2] > 0
    assert best.is_exact


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"feasible": np.ones((3, 4), dtype=bool)}, "feasible has the shape"),
        ({"feasible": np.ones((1, 4, 4))}, "feasible has the shape"),
        ({"feasible": np.ones((1, 65, 64), dtype=bool)}, "more than 4096"),
        ({"start": (0, 9)}, "start lies off the map"),
        ({"goal": (0.5, 1)}, "goal="),
        ({"goal": (0, 3)}, "start: in scene 0 it is the goal"),
        ({"radius": 0}, "radius=0"),
        ({"criterion": "steps"}, "criterion='steps'"),
        ({"weights": [1, 0, 1, 1, 1, 1, 1]}, "weights must be"),
        ({"weights": [np.nan] * 7}, "weights must be"),
        ({"labels": np.ones((7, 7, 7))}, "labels has the shape"),
        ({"max_states": 0}, "max_states=0"),
        ({"max_states": 10**12}, "max_states=1000000000000: .* more than the limit"),
        ({"cell_size": -1.0}, "cell_size"),
        ({"corner_cutting": 1}, "corner_cutting"),
    ],
)
def test_what_cannot_be_asked_is_refused_by_name(change, said):
    given = {
        "feasible": walls_with_doors((7, 7), [3]),
        "start": (0, 3),
        "goal": (6, 3),
        "cell_size": 0.5,
        "radius": 1,
    } | change
    with pytest.raises(ValueError, match=said):
        belief_optimum(**given)


def test_a_scene_whose_goal_cannot_be_reached_is_named():
    maps = walls_with_doors((7, 7), [3])
    maps[4, 3] = False
    with pytest.raises(ValueError, match="in scene 4 the goal cannot be reached"):
        belief_optimum(maps, (0, 3), (6, 3), 0.5, radius=1)
