"""Facts of the statistics over seeds: hand-computed cases, and failures that count; how often
intervals hold is in `tests/eval/test_coverage.py`.
"""

from math import inf

import numpy as np
import pytest
from scipy import stats

from eval.statistics import (
    ALL_EQUAL,
    FEW_SEEDS,
    ONE_SEED,
    SCORE,
    Estimate,
    band,
    crossed_mean,
    estimate,
    estimate_median,
    interquartile_mean,
    mean,
    mean_of_crossed,
    optimality_gap,
    share,
    success_rate,
)


def interval(values, statistic=mean):
    found = estimate(values, statistic)
    return found.value, found.low, found.high


def test_interval_of_symmetric_seeds_is_that_of_the_textbook():
    half = 3.182446 * np.std([1, 2, 3, 4], ddof=1) / 2
    assert interval([1.0, 2.0, 3.0, 4.0]) == pytest.approx((2.5, 2.5 - half, 2.5 + half), rel=1e-6)
    half = 12.7062 * 0.5  # two seeds have one degree of freedom, and show no skewness
    assert interval([0.0, 1.0]) == pytest.approx((0.5, 0.5 - half, 0.5 + half), rel=1e-5)


def test_the_end_towards_the_long_tail_is_moved_out():
    values = np.array([1.0, 1.1, 1.2, 1.3, 3.0])
    value, low, high = interval(values)
    half = stats.t.ppf(0.975, 4) * stats.sem(values)
    assert low == pytest.approx(value - half)
    assert high > value + 1.5 * half
    # Hall's transform of the T at that end is minus Student's quantile
    skewness = stats.skew(values, bias=False) / np.sqrt(5)
    t = (value - high) / stats.sem(values)
    transformed = t + skewness / 3 * t**2 + skewness**2 / 27 * t**3 + skewness / 6
    assert transformed == pytest.approx(-stats.t.ppf(0.975, 4))
    mirrored = interval(-values)
    assert mirrored[1:] == pytest.approx((-high, -low))


def test_interval_ends_where_a_score_can_be():
    found = estimate([0.9, 1.0, 1.0, 1.0, 0.99], within=SCORE)
    assert 0 < found.low < 0.9
    assert found.high == 1.0


def test_interval_of_other_statistics_is_that_of_the_jackknife():
    table = np.random.default_rng(2).random((8, 3))
    gap = estimate(table, optimality_gap)
    assert (gap.low, gap.high) == pytest.approx((1 - estimate(table).high, 1 - estimate(table).low))
    many = np.random.default_rng(3).normal(size=400)
    found = estimate(many, interquartile_mean)
    resampled = stats.bootstrap(
        (many,), lambda x, axis: stats.trim_mean(x, 0.25, axis), n_resamples=2000, rng=0
    )
    assert found.high - found.low == pytest.approx(np.ptp(resampled.confidence_interval), rel=0.1)


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
    assert estimate_median([3.0, 1.0, inf]) == Estimate(3.0, 1.0, inf, FEW_SEEDS)
    assert estimate_median([1.0, 2.0, inf, inf]).value == inf
    # the second of ten and the ninth: P(at most 1 of 10 below the median) = 11 / 1024
    assert estimate_median([5, 1, 2, 3, 4, 6, 7, 8, inf, 9]) == Estimate(5.5, 2.0, 9.0)
    assert estimate_median([5, 1, 2, 3, 4, 6, 7, inf, inf, 9]) == Estimate(5.5, 2.0, inf)
    assert estimate_median([inf] * 3) == Estimate(inf, inf, inf, ALL_EQUAL)
    assert estimate_median([2.0]) == Estimate(2.0, None, None, ONE_SEED)


def test_infinite_mean_has_no_interval():
    assert estimate([1.0, inf]) == Estimate(inf, None, None)


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
    ):
        assert estimate([1.0] * 10, statistic) == Estimate(value, value, value, ALL_EQUAL)
    assert estimate([[0.0, 1.0]] * 3).note == ALL_EQUAL
    assert not estimate([[0.0, 1.0], [1.0, 0.0]]).note


def test_seeds_that_the_rounding_of_sums_alone_keeps_apart_are_equal():
    lengths = [0.1 + 0.2, 0.3]
    assert lengths[0] != lengths[1]
    for statistic in (mean, interquartile_mean):
        found = estimate([each / lengths[0] for each in lengths] * 5, statistic)
        assert (found.note, found.low, found.high) == (ALL_EQUAL, found.value, found.value)
    assert estimate_median([inf, inf]) == Estimate(inf, inf, inf, ALL_EQUAL)
    assert not estimate([1.0, 1.0 + 1e-6]).note


def test_share_of_seeds_keeps_an_interval_at_all_and_none():
    # Clopper and Pearson: all of n succeed with probability p^n, which is 2.5 % at the lower end.
    assert share(10, 10) == Estimate(1.0, pytest.approx(0.025 ** (1 / 10)), 1.0)
    assert share(0, 10) == Estimate(0.0, 0.0, pytest.approx(1 - 0.025 ** (1 / 10)))
    some = share(3, 5)
    assert stats.binom.sf(2, 5, some.low) == pytest.approx(0.025)
    assert stats.binom.cdf(3, 5, some.high) == pytest.approx(0.025)


def test_success_everywhere_keeps_an_interval_over_scenes():
    assert success_rate(np.ones((5, 1000))) == share(1000, 1000)
    assert success_rate(np.zeros((5, 8))) == share(0, 8)
    some = [[1, 1, 1, 1, 0, 1], [1, 1, 1, 0, 0, 1]]
    assert success_rate(some) == crossed_mean(some, SCORE)


def test_variances_of_seeds_and_of_scenes_add_up():
    rng = np.random.default_rng(0)
    of_scenes = rng.normal(size=(1, 400))
    of_seeds = rng.normal(0, 0.1, size=(40, 1))
    one = crossed_mean(0.5 + of_scenes)
    assert (one.value, one.note) == (pytest.approx(0.5 + of_scenes.mean()), ONE_SEED)
    assert one.high - one.low == pytest.approx(2 * 1.96 * of_scenes.std() / 20, rel=0.05)
    both = crossed_mean(0.5 + of_scenes + of_seeds)
    spread = 1.96 * np.sqrt(of_scenes.var() / 400 + of_seeds.var() / 40)
    assert both.high - both.low == pytest.approx(2 * spread, rel=0.08)
    assert crossed_mean(np.full((3, 4), 0.5)) == Estimate(0.5, 0.5, 0.5, ALL_EQUAL)
    with pytest.raises(ValueError, match="without NaN"):
        crossed_mean([[np.nan]])


def test_tasks_of_a_seed_stay_together():
    found = interval([[0.0] * 50, [1.0] * 50])
    assert found == pytest.approx(interval([0.0, 1.0]))  # as two seeds, not as a hundred draws
    opposite = np.array([[0.0, 1.0], [1.0, 0.0], [0.25, 0.75]])
    assert interval(opposite) == pytest.approx((0.5, 0.5, 0.5))  # each seed's mean is 1/2


def draw_scores(rng, seeds=10, tasks=50):
    """Scores with mean 0: what a seed learned counts much more than the task."""
    return rng.normal(size=(seeds, 1)) + 0.3 * rng.normal(size=(seeds, tasks))


def test_counting_task_by_task_would_be_too_narrow():
    rng, whole, wrong = np.random.default_rng(7), [], []
    for _ in range(60):
        scores = draw_scores(rng)
        whole.append(interval(scores)[1:])
        wrong.append(interval(scores.ravel())[1:])
    width = [np.ptp(each, axis=1).mean() for each in (whole, wrong)]
    holds_truth = [np.mean([low <= 0 <= high for low, high in each]) for each in (whole, wrong)]
    assert width[0] > 4 * width[1]
    assert holds_truth[0] > 0.9
    assert holds_truth[1] < 0.5


def test_band_is_the_interval_of_each_point():
    curves = np.random.default_rng(3).random((6, 4))
    middle, low, high = band(curves)
    assert middle == pytest.approx(curves.mean(axis=0))
    for n in range(4):
        _, expected_low, expected_high = interval(curves[:, n])
        expected = np.clip([expected_low, expected_high], *SCORE)
        assert (low[n], high[n]) == pytest.approx(expected)


def test_band_of_one_curve_has_no_width():
    middle, low, high = band([[0.0, 1.0]])
    assert middle.tolist() == low.tolist() == high.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("values", [[], [float("nan"), 1.0], [[[1.0]]]])
def test_values_that_mean_nothing_are_refused(values):
    with pytest.raises(ValueError, match="must be"):
        estimate(values)


def test_mean_of_one_table_is_that_of_the_table_and_of_equal_ones_has_no_width():
    table = np.random.default_rng(2).normal(size=(4, 30))
    one, alone = mean_of_crossed([table]), crossed_mean(table)
    assert (one.low, one.value, one.high) == pytest.approx((alone.low, alone.value, alone.high))
    equal = np.full((3, 5), 0.25)
    assert mean_of_crossed([equal, equal]) == Estimate(0.25, 0.25, 0.25, ALL_EQUAL)
    assert mean_of_crossed([table[:1], table[1:2]]).note == ONE_SEED
    with pytest.raises(ValueError, match="one table or more"):
        mean_of_crossed([])


def test_interval_of_independent_means_has_the_freedom_of_welch_and_satterthwaite():
    rng = np.random.default_rng(3)
    draws = [rng.normal(size=(1, 4)), rng.normal(size=(1, 9))]
    found = mean_of_crossed(draws)
    a, b = (stats.sem(each[0]) ** 2 for each in draws)
    freedom = (a + b) ** 2 / (a**2 / 3 + b**2 / 8)
    half = stats.t.ppf(0.975, freedom) * np.sqrt(a + b) / 2
    inner = (found.value - found.low, found.high - found.value)
    assert min(inner) == pytest.approx(half)  # the other end is moved out by the skewness
