"""Facts of the statistics over seeds: hand-computed cases, failures that count, and intervals that
are wide enough.
"""

from math import comb, inf

import numpy as np
import pytest
from scipy import stats

from eval.statistics import (
    ALL_EQUAL,
    ONE_SEED,
    Estimate,
    band,
    estimate,
    interquartile_mean,
    mean,
    median,
    optimality_gap,
    share,
)


def interval(values, statistic=mean):
    found = estimate(values, statistic)
    return found.value, found.low, found.high


def test_two_seeds_resample_to_either_of_them():
    assert interval([0.0, 1.0]) == (
        0.5,
        0.0,
        1.0,
    )  # means 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4


def test_interval_ends_where_the_binomial_tail_ends():
    # Means of resamples of (0, 0, 0, 4) are k with probability C(4, k) 3^(4-k) / 4^4: P(4) = .004,
    # P(3 or more) = .051.
    assert sum(comb(4, k) * 3 ** (4 - k) for k in (3, 4)) / 4**4 > 0.025 > 1 / 4**4
    assert interval([0, 0, 0, 4]) == (1.0, 0.0, 3.0)
    # Of (0, 0, 3): P(3) = 1/27 is more than 2.5 %.
    assert interval([0, 0, 3]) == (1.0, 0.0, 3.0)


def test_mean_of_many_seeds_has_the_interval_of_the_normal_law():
    values = np.random.default_rng(1).normal(0.8, 0.1, size=400)
    value, low, high = interval(values)
    half = 1.96 * values.std() / 20
    assert value == pytest.approx(values.mean(), abs=1e-12)
    assert (low, high) == pytest.approx((value - half, value + half), abs=half / 10)


def test_interquartile_mean_leaves_out_a_quarter_at_each_end():
    assert interquartile_mean(np.array([[9.0], [1.0], [3.0], [5.0]])) == 4.0
    assert (
        interquartile_mean(np.array([[9.0, 1.0], [3.0, 5.0]])) == 4.0
    )  # over seeds and tasks alike
    assert interquartile_mean(np.arange(10.0)[:, None] ** 2) == np.mean(
        np.arange(2.0, 8.0) ** 2
    )  # int(10 / 4) each
    assert interquartile_mean(np.array([[1.0], [2.0], [6.0]])) == 3.0  # int(3 / 4) = 0


def test_optimality_gap_counts_what_is_missing_and_no_surplus():
    assert optimality_gap(np.array([[1.0], [0.5], [0.0], [1.25]])) == pytest.approx((0.5 + 1.0) / 4)


def test_median_with_failures_as_infinite():
    assert interval([3.0, 1.0, inf], median) == (3.0, 1.0, inf)
    assert estimate([1.0, 2.0, inf, inf], median).value == inf
    value, low, high = interval([5, 1, 2, 3, 4, 6, 7, 8, inf, 9], median)
    assert value == 5.5
    assert 1 <= low < value < high <= 9  # one failure of ten does not reach into the interval
    assert interval([inf] * 3, median) == (inf, inf, inf)


def test_one_seed_has_no_interval_and_says_so():
    assert estimate([0.5]) == Estimate(0.5, None, None, ONE_SEED)
    assert estimate([[0.5, 1.0, 0.0]]) == Estimate(
        0.5, None, None, ONE_SEED
    )  # three tasks are no three seeds


def test_equal_seeds_have_no_width_and_say_so():
    for statistic, value in (
        (mean, 1.0),
        (interquartile_mean, 1.0),
        (optimality_gap, 0.0),
        (median, 1.0),
    ):
        assert estimate([1.0] * 10, statistic) == Estimate(value, value, value, ALL_EQUAL)
    assert estimate([[0.0, 1.0]] * 3).note == ALL_EQUAL
    assert not estimate([[0.0, 1.0], [1.0, 0.0]]).note


def test_seeds_that_the_rounding_of_sums_alone_keeps_apart_are_equal():
    lengths = [0.1 + 0.2, 0.3]
    assert lengths[0] != lengths[1]
    for statistic in (mean, interquartile_mean, median):
        found = estimate([each / lengths[0] for each in lengths] * 5, statistic)
        assert (found.note, found.low, found.high) == (ALL_EQUAL, found.value, found.value)
    assert estimate([inf, inf], median) == Estimate(inf, inf, inf, ALL_EQUAL)
    assert not estimate([1.0, inf], median).note
    assert not estimate([1.0, 1.0 + 1e-6]).note


def test_share_of_seeds_keeps_an_interval_at_all_and_none():
    # Clopper and Pearson: all of n succeed with probability p^n, which is 2.5 % at the lower end.
    assert share(10, 10) == Estimate(1.0, pytest.approx(0.025 ** (1 / 10)), 1.0)
    assert share(0, 10) == Estimate(0.0, 0.0, pytest.approx(1 - 0.025 ** (1 / 10)))
    some = share(3, 5)
    assert stats.binom.sf(2, 5, some.low) == pytest.approx(0.025)
    assert stats.binom.cdf(3, 5, some.high) == pytest.approx(0.025)


def test_tasks_of_a_seed_stay_together():
    assert interval([[0.0] * 50, [1.0] * 50]) == (
        0.5,
        0.0,
        1.0,
    )  # as two seeds, not as a hundred draws
    opposite = np.array([[0.0, 1.0], [1.0, 0.0], [0.25, 0.75]])
    assert interval(opposite) == (0.5, 0.5, 0.5)  # each seed's mean is 1/2, so each resample's is


def draw_scores(rng, seeds=10, tasks=50):
    """Scores with mean 0: what a seed learned counts much more than the task."""
    return rng.normal(size=(seeds, 1)) + 0.3 * rng.normal(size=(seeds, tasks))


def test_resampling_task_by_task_would_be_too_narrow():
    rng, whole, wrong = np.random.default_rng(7), [], []
    for _ in range(60):
        scores = draw_scores(rng)
        whole.append(interval(scores)[1:])
        wrong.append(interval(scores.ravel())[1:])
    width = [np.ptp(each, axis=1).mean() for each in (whole, wrong)]
    holds_truth = [np.mean([low <= 0 <= high for low, high in each]) for each in (whole, wrong)]
    assert width[0] > 4 * width[1]
    assert holds_truth[0] > 0.8
    assert holds_truth[1] < 0.5


def test_band_is_the_interval_of_each_point():
    curves = np.random.default_rng(3).random((6, 4))
    middle, low, high = band(curves)
    assert middle == pytest.approx(curves.mean(axis=0))
    for n in range(4):
        _, expected_low, expected_high = interval(curves[:, n])
        assert (low[n], high[n]) == pytest.approx((expected_low, expected_high), abs=0.02)


def test_band_of_one_curve_has_no_width():
    middle, low, high = band([[0.0, 1.0]])
    assert middle.tolist() == low.tolist() == high.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("values", [[], [float("nan"), 1.0], [[[1.0]]]])
def test_values_that_mean_nothing_are_refused(values):
    with pytest.raises(ValueError, match="must be"):
        estimate(values)


def test_same_values_give_the_same_interval_again():
    values = np.random.default_rng(0).random(8)
    assert estimate(values) == estimate(values)
    assert estimate(values) != estimate(values, rng=1)
