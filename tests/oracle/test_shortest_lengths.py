"""Facts of the lengths of many tasks: each is that of its own shortest path."""

from math import inf

import numpy as np
import pytest

from irs_gym import shortest_lengths, shortest_path


def maze() -> np.ndarray:
    """A spiral: ways far longer than they look."""
    free = np.zeros((21, 21), dtype=bool)
    i = j = 0
    di, dj = 1, 0
    for length in (20, 20, 20, 18, 18, 16, 16, 14, 14, 12, 12, 10, 10):
        for _ in range(length):
            free[i, j] = True
            i, j = i + di, j + dj
        di, dj = -dj, di
    return free


@pytest.mark.parametrize("corner_cutting", [True, False])
@pytest.mark.parametrize("share", [0.1, 0.35, None])
def test_each_length_is_that_of_its_shortest_path(corner_cutting, share):
    rng = np.random.default_rng(2)
    free = maze() if share is None else rng.random((21, 18)) > share
    starts = rng.integers(0, free.shape, (60, 2))
    goals = rng.integers(0, free.shape, (60, 2))
    starts[20:40] = starts[20]  # some share an end
    options = {"corner_cutting": corner_cutting}
    for first, second in ((starts, goals), (goals, starts)):
        found = shortest_lengths(free, first, second, 0.5, **options)
        for length, start, goal in zip(found, first.tolist(), second.tolist(), strict=True):
            path = shortest_path(free, tuple(start), tuple(goal), 0.5, **options)
            assert length == pytest.approx(inf if path is None else path.distance, abs=1e-9)


def test_no_tasks_have_no_lengths():
    cells = np.zeros((0, 2), dtype=int)
    assert shortest_lengths(np.ones((3, 3), dtype=bool), cells, cells, 1.0).shape == (0,)


@pytest.mark.parametrize(
    ("starts", "goals", "message"),
    [
        ([(0, 0)], [(0, 0), (1, 1)], "1 starts and 2 goals"),
        ([(0, 0)], [(0, 3)], r"goals\[0\]=\(0, 3\) lies off the map"),
        ([(0, 0), (-1, 0)], [(0, 0), (1, 1)], r"starts\[1\]=\(-1, 0\) lies off"),
        ([(0.5, 0)], [(0, 0)], "starts has the shape"),
        ((0, 0), (0, 0), r"starts has the shape \(2,\)"),
        ([(0, 0, 0)], [(0, 0)], r"starts has the shape \(1, 3\)"),
    ],
)
def test_cells_that_are_none_are_refused_by_name(starts, goals, message):
    with pytest.raises(ValueError, match=message):
        shortest_lengths(np.ones((3, 3), dtype=bool), starts, goals, 1.0)
