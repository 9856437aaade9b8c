"""Facts about the paths of many robots."""

import numpy as np
import pytest

from irs_gym.mdp.path_history import PathHistory, cells_of


def test_repeated_cells_count_once_and_maps_lie_one_above_the_other():
    assert cells_of(np.array([0, 0, 5, 6, 6, 5]), (3, 5)) == [(0, 0), (1, 0), (1, 1), (1, 0)]
    assert cells_of(np.array([15, 16]), (3, 5)) == [(0, 0), (0, 1)]


@pytest.mark.parametrize("length", [7, 20])
def test_paths_are_those_walked_whenever_robots_begin_anew(length):
    rng = np.random.default_rng(0)
    history = PathHistory(4, length, (6, 6))
    walked = [[int(cell)] for cell in rng.integers(36, size=4)]
    history.begin(np.arange(4), np.array([each[0] for each in walked]), 0)

    for clock in range(1, 201):
        cells = rng.integers(36, size=4)
        history.advance(cells, clock)
        for each, cell in zip(walked, cells, strict=True):
            each.append(int(cell))

        ended = np.flatnonzero([len(each) > length or rng.random() < 0.1 for each in walked])
        before = {i: walked[i] for i in ended}
        for i in ended:
            walked[i] = [int(rng.integers(36))]
        history.begin(ended, np.array([walked[i][0] for i in ended], dtype=np.int64), clock)

        for i in range(4):
            assert history.path(i) == cells_of(np.array(walked[i]), (6, 6))
            assert history.steps(i) == len(walked[i]) - 1
        for i, each in before.items():
            assert history.path(i, of_last_episode=True) == cells_of(np.array(each), (6, 6))
