"""Facts about trails and the ring that remembers them."""

import numpy as np
import pytest

from irs_gym.trail import History, Trail


def test_a_trail_is_a_sequence_of_cells_without_standing_still():
    trail = Trail(np.array([0, 0, 5, 6, 6, 5]), (3, 5))
    assert list(trail) == [(0, 0), (1, 0), (1, 1), (1, 0)]
    assert trail == [(0, 0), (1, 0), (1, 1), (1, 0)]
    assert trail != [(0, 0)]
    assert (len(trail), trail[-1], trail[1:3]) == (4, (1, 0), [(1, 0), (1, 1)])
    assert np.asarray(trail).tolist() == [[0, 0], [1, 0], [1, 1], [1, 0]]
    assert np.asarray(trail, dtype=float).dtype == float
    with pytest.raises(TypeError):
        hash(trail)


def test_the_ring_gives_back_every_trail_however_often_it_went_round():
    rng = np.random.default_rng(0)
    history, walked = History(4, 8, (6, 6)), [[0] for _ in range(4)]
    for step in range(100):
        cells = rng.integers(0, 36, 4)
        history.advance(cells)
        for n, cell in enumerate(cells):
            walked[n].append(cell)
        if step % 3 == 0:  # robot step % 4 goes elsewhere
            n, cell = step % 4, int(rng.integers(0, 36))
            history.begin(np.array([n]), np.array([cell]))
            walked[n] = [cell]
        steps = np.array([min(len(each) - 1, 7) for each in walked])
        for trail, each, count in zip(history.trails(np.arange(4), steps)(), walked, steps, strict=True):
            assert trail == Trail(np.array(each[len(each) - 1 - count :]), (6, 6))
