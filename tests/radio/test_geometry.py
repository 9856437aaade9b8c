"""Facts of boxes and line of sight, against exact rational arithmetic."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from irs_gym.radio.geometry import Boxes, is_in_footprint, is_line_of_sight

# one box: 4 x 4 m, 1.3 m high, about the origin
BOX = Boxes(np.array([[-2.0, -2.0, 0.0]]), np.array([[2.0, 2.0, 1.3]]))


def exact(numbers) -> tuple[Fraction, ...]:
    """Decimals as they are written, not as doubles round them."""
    return tuple(n if isinstance(n, Fraction) else Fraction(repr(float(n))) for n in numbers)


def is_blocked(start, end, low, high) -> bool:
    """Whether an open box holds any point of an open segment, in exact arithmetic.

    The planes of the faces cut the segment into pieces. No piece crosses a face, so each lies
    inside with its midpoint, or not at all.
    """
    start, end, low, high = exact(start), exact(end), exact(low), exact(high)
    if any(
        max(a, b) <= lo or min(a, b) >= hi
        for a, b, lo, hi in zip(start, end, low, high, strict=True)
    ):
        return False
    cuts = {Fraction(0), Fraction(1)}
    for a, b, *faces in zip(start, end, low, high, strict=True):
        cuts |= {(face - a) / (b - a) for face in faces if a != b and 0 < (face - a) / (b - a) < 1}
    ordered = sorted(cuts)
    for t in [(first + second) / 2 for first, second in pairwise(ordered)]:
        point = [a + t * (b - a) for a, b in zip(start, end, strict=True)]
        if all(lo < p < hi for p, lo, hi in zip(point, low, high, strict=True)):
            return True
    return False


def sees(start, end, boxes=BOX) -> bool:
    return bool(is_line_of_sight(np.array(start, dtype=float), end, boxes))


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((-5, 0, 1), (5, 0, 1)),  # through the middle, along x
        ((0, 5, 1), (0, -5, 1)),  # along y
        ((0, 0, 5), (0, 0, 1)),  # down into it
        ((-5, -5, 0.5), (5, 5, 1)),  # diagonally
        ((-2.1, 1.8, 1), (-1.8, 2.1, 1.2)),  # across a vertical edge, 14 cm of it
        ((0, 0, 1), (5, 0, 1)),  # from inside
        ((0, 0, 0.5), (0.5, 0, 0.5)),  # inside altogether
        ((-2, -2, 0), (2, 2, 1.3)),  # from corner to corner
        ((-2, 0, 1), (2, 0, 1)),  # from face to face
        ((-5, 0, 1), (0, 0, 1.2)),  # ends inside
    ],
)
def test_a_segment_through_a_box_is_blocked(start, end):
    assert not sees(start, end)
    assert is_blocked(start, end, BOX.lower[0], BOX.upper[0])


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((-5, 2, 1), (5, 2, 1)),  # along a side face
        ((-5, 0, 1.3), (5, 0, 1.3)),  # along the roof
        ((-5, -5, 1.3), (5, 5, 1.3)),  # across the roof
        ((2, 2, 0), (2, 2, 5)),  # along a vertical edge
        ((-5, 2, 1.3), (5, 2, 1.3)),  # along an edge of the roof
        ((1, 3, 1), (3, 1, 1)),  # touches a vertical edge
        ((-3, -1, 0.3), (-1, -3, 2.3)),  # touches it in one point while it rises
        ((3, 3, 1.3), (2, 2, 1.3)),  # ends on a corner
        ((5, 0, 1), (2, 0, 1)),  # ends on a face
        ((-2, -1, 1), (-2, 1, 1)),  # lies in a face
        ((1, 1, 1.3), (0, 0, 4)),  # rises from the roof
        ((-5, 0, 1), (-2.1, 0, 1)),  # ends before it
        ((5, 0, 1), (9, 0, 1)),  # lies behind it
        ((-5, 0, 1.4), (5, 0, 1.4)),  # passes above
        ((-5, 3, 1), (5, 2.2, 1)),  # passes by
        ((5, 5, 1), (5, 5, 1)),  # is a point
    ],
)
def test_a_segment_that_misses_or_only_grazes_a_box_is_clear(start, end):
    assert sees(start, end)
    assert sees(end, start)
    assert not is_blocked(start, end, BOX.lower[0], BOX.upper[0])


@pytest.mark.parametrize("shift", [0.1, -0.3, 1 / 3, 7.7, 1e3])
def test_grazing_does_not_depend_on_rounding(shift):
    moved = Boxes(BOX.lower + shift, BOX.upper + shift)
    for start, end in [
        ((-5, 2, 1), (5, 2, 1)),
        ((1, 3, 1), (3, 1, 1)),
        ((-5, -5, 1.3), (5, 5, 1.3)),
    ]:
        assert sees(np.array(start) + shift, np.array(end) + shift, moved)
    for start, end in [((-5, 1.999999, 1), (5, 1.999999, 1)), ((1, 2.99999, 1), (2.99999, 1, 1))]:
        assert not sees(np.array(start) + shift, np.array(end) + shift, moved)


def test_line_of_sight_equals_exact_arithmetic_on_a_lattice_where_touching_is_common():
    rng = np.random.default_rng(2)
    clear = blocked = grazing = 0
    for _ in range(60):
        low, high = rng.integers(-4, 1, 3) / 10, rng.integers(1, 5, 3) / 10
        starts, end = rng.integers(-6, 7, (40, 3)) / 10, rng.integers(-6, 7, 3) / 10
        seen = is_line_of_sight(starts, end, Boxes(low[None], high[None]))
        for start, is_seen in zip(starts, seen, strict=True):
            is_inside = is_blocked(start, end, low, high)
            assert is_seen != is_inside, (start, end, low, high)
            clear, blocked = clear + is_seen, blocked + is_inside
            grazing += not is_inside and is_blocked(
                start, end, (low - 1e-3).round(3), (high + 1e-3).round(3)
            )
    assert min(clear, blocked) > 300
    assert grazing > 30


def test_line_of_sight_is_mutual():
    rng = np.random.default_rng(3)
    boxes = Boxes(rng.uniform(-3, 0, (4, 3)), rng.uniform(0.1, 3, (4, 3)))
    starts, end = rng.uniform(-6, 6, (500, 3)), np.array([4.0, -5.0, 2.0])
    there = is_line_of_sight(starts, end, boxes)
    back = [sees(end, start, boxes) for start in starts]
    assert there.tolist() == back
    assert 0.1 < there.mean() < 0.9


def test_any_of_several_boxes_blocks():
    rng = np.random.default_rng(4)
    boxes = Boxes(rng.uniform(-3, 0, (3, 3)), rng.uniform(0.1, 3, (3, 3)))
    starts, end = rng.uniform(-6, 6, (200, 3)), np.array([4.0, -5.0, 2.0])
    one_by_one = [
        is_line_of_sight(starts, end, Boxes(boxes.lower[[n]], boxes.upper[[n]])) for n in range(3)
    ]
    assert np.array_equal(is_line_of_sight(starts, end, boxes), np.all(one_by_one, axis=0))


def test_without_boxes_all_is_clear():
    none = Boxes(np.zeros((0, 3)), np.zeros((0, 3)))
    assert is_line_of_sight(np.zeros((2, 3, 3)), (1, 2, 3), none).tolist() == [[True] * 3] * 2
    assert not is_in_footprint(np.zeros((2, 3, 2)), none).any()


def test_a_footprint_is_open():
    inside = [(0, 0), (1.999, -1.999), (-1.9, 1.9)]
    outside = [(2, 0), (0, -2), (2, 2), (2.001, 0), (0, 5)]
    assert (
        is_in_footprint(np.array(inside + outside, dtype=float), BOX).tolist()
        == [True] * 3 + [False] * 5
    )


def test_a_footprint_does_not_depend_on_rounding():
    border = Boxes(np.array([[0.1, 0.1, 0.0]]), np.array([[0.3, 0.7, 1.0]]))
    assert not is_in_footprint(
        np.array([[0.1 + 0.2, 0.5], [0.3, 0.5], [0.2, 0.7000000000000001]]), border
    ).any()
