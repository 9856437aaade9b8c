"""Facts of straight segments over closed cells."""

import numpy as np
import pytest

from irs_gym.mdp.segment import (
    BELOW,
    OBSTACLE,
    OPEN,
    padded,
    snapped_many,
    walk,
    walk_many,
)

COLUMNS, ROWS = 7, 5
WIDTH = ROWS + 2


def some_map(seed, blocked=0.35):
    rng = np.random.default_rng(seed)
    kinds = np.full((COLUMNS, ROWS), OPEN, dtype=np.uint8)
    kinds[rng.random(kinds.shape) < blocked] = BELOW
    kinds[rng.random(kinds.shape) < blocked / 2] = OBSTACLE

    return padded(kinds, OBSTACLE)


def is_in(kinds, points, at_least=OPEN, slack=1e-9):
    """Whether points (n, 2) lie in a closed cell of that kind: a look at every cell."""
    cells = np.argwhere(kinds >= at_least) - 1  # (k, 2)
    apart = points[:, None] - cells  # (n, k, 2)
    return ((apart >= -slack) & (apart <= 1 + slack)).all(axis=2).any(axis=1)


def some_points(rng, kinds, count):
    """Points in open cells: anywhere, on borders, at corners."""
    points = rng.uniform((0, 0), (COLUMNS, ROWS), (20 * count, 2))
    coarse = rng.random(points.shape) < 0.4
    points[coarse] = np.round(points[coarse])

    return points[is_in(kinds, points, slack=0.0)][:count]


def some_segments(seed, count=400):
    rng = np.random.default_rng(seed)
    kinds = some_map(seed)
    starts = some_points(rng, kinds, count)
    ends = starts + rng.uniform(-3, 3, starts.shape)
    # along borders, diagonals through corners, and to corners
    along = rng.random(starts.shape) < 0.2
    ends[along] = starts[along]
    whole = rng.random(len(starts)) < 0.3
    ends[whole] = np.round(ends[whole])
    ends = snapped_many(ends)
    is_still = (ends == starts).all(axis=1)

    return kinds, starts[~is_still], ends[~is_still]


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_comes_as_far_as_every_point_on_the_way_is_open(seed):
    kinds, starts, ends = some_segments(seed)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        share, x, y, blocked, _ = walk(kinds.tobytes(), None, WIDTH, tuple(start), tuple(end))
        way = np.subtract(end, start)
        assert np.allclose((x, y), start + share * way, atol=1e-9)
        # all of the way is open, and what comes after it is not
        shares = np.linspace(0.0, share, 101)[:, None]
        assert is_in(kinds, start + shares * way).all()
        if blocked < 0:
            assert (share, x, y) == (1.0, *end)
        else:
            beyond = np.array(start) + (share + 1e-6 * np.ones((1, 1))) * way
            assert not is_in(kinds, beyond, slack=0.0).any()
            assert is_in(kinds, beyond, BELOW, slack=0.0).any() == (blocked == BELOW)


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_never_leaves_the_closed_cells(seed):
    """Bounced about for long, it always stands in an open cell, without any rounding."""
    kinds = some_map(seed)
    rng = np.random.default_rng(seed)
    at = some_points(rng, kinds, 1)[0]
    for _ in range(500):
        end = snapped_many(at + rng.uniform(-1.5, 1.5, 2))
        _, *at, _, _ = walk(kinds.tobytes(), None, WIDTH, tuple(at), tuple(end.tolist()))
        at = np.array(at)
        assert is_in(kinds, at[None], slack=0.0).all()


def test_a_robot_at_a_border_goes_along_it_and_back():
    kinds = padded(np.array([[OPEN, OPEN], [BELOW, OBSTACLE]], dtype=np.uint8), OBSTACLE)
    cells = kinds.tobytes()
    stopped = walk(cells, None, 4, (0.3, 0.2), (1.1, 0.8))
    assert (stopped.x, stopped.blocked) == (1.0, BELOW)
    assert walk(cells, None, 4, (stopped.x, stopped.y), (1.0, 2.0)) == (1.0, 1.0, 2.0, -1, 0.0)
    assert walk(cells, None, 4, (1.0, 0.5), (0.1, 0.5)) == (1.0, 0.1, 0.5, -1, 0.0)
    assert walk(cells, None, 4, (1.0, 0.5), (1.0, 9.0)).y == 2.0
    assert walk(cells, None, 4, (1.0, 1.5), (1.5, 1.5)) == (0.0, 1.0, 1.5, OBSTACLE, 0.0)


@pytest.mark.parametrize("off", [0.0, 1e-13, -1e-13])
def test_where_cells_touch_at_a_corner_a_robot_passes_whatever_the_rounding(off):
    kinds = padded(np.array([[OPEN, BELOW], [BELOW, OPEN]], dtype=np.uint8), OBSTACLE)
    assert walk(kinds.tobytes(), None, 4, (0.5, 0.5 + off), (1.5, 1.5 + off)).share == 1.0
    near = walk(kinds.tobytes(), None, 4, (0.5, 0.5 + 1e-6), (1.5, 1.5 + 1e-6))
    assert near.blocked == BELOW


@pytest.mark.parametrize("seed", range(3))
def test_what_is_paid_is_the_rate_along_the_way(seed):
    kinds, starts, ends = some_segments(seed, 100)
    kinds = np.where(kinds == BELOW, OPEN, kinds).astype(np.uint8)
    rate = np.random.default_rng(seed).random(kinds.shape)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        share, _, _, _, paid = walk(
            kinds.tobytes(), rate.ravel().tolist(), WIDTH, tuple(start), tuple(end)
        )
        # of cells inside, by midpoints of many pieces; borders are the lower of two
        shares = (np.arange(20_000) + 0.5) / 20_000 * share
        points = np.array(start) + shares[:, None] * np.subtract(end, start)
        low = np.inf
        for shift in ((0, 0), (-1e-9, 0), (0, -1e-9), (1e-9, 0), (0, 1e-9)):
            i, j = np.floor(points + shift).astype(int).T + 1
            here = np.where(kinds[i, j] == OPEN, rate[i, j], np.inf)
            low = np.minimum(low, here)
        assert paid == pytest.approx(share * low.mean(), abs=1e-3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("is_costly", [False, True])
def test_many_robots_walk_as_one_does(seed, is_costly):
    kinds, starts, ends = some_segments(seed)
    others, more_starts, more_ends = some_segments(seed + 100)
    rng = np.random.default_rng(seed)
    starts = np.concatenate([starts, more_starts])
    ends = np.concatenate([ends, more_ends])
    maps = np.repeat([0, 1], [len(starts) - len(more_starts), len(more_starts)])
    rate = rng.random((2, *kinds.shape)) if is_costly else None
    until = np.where(rng.random(len(starts)) < 0.5, 1.0, rng.random(len(starts)))
    both = np.stack([kinds, others])
    walks = walk_many(
        both.ravel(),
        None if rate is None else rate.ravel(),
        WIDTH,
        maps * kinds.size,
        starts.T,
        ends.T,
        until,
    )
    for n, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        rates = None if rate is None else rate[maps[n]].ravel().tolist()
        one = walk(both[maps[n]].tobytes(), rates, WIDTH, tuple(start), tuple(end), float(until[n]))
        assert one == (
            walks.share[n], walks.at[0, n], walks.at[1, n], walks.blocked[n], walks.paid[n]
        )  # fmt: skip
