"""Facts of the intervals: they hold the truth as often as they say, where resampling does not."""

import numpy as np
import pytest
from scipy import stats

from eval.coverage import CROSSED, LAWS, SEEDS, over_both, over_seeds
from eval.statistics import (
    FEW_SEEDS,
    UNBOUNDED,
    crossed_mean,
    estimate,
    estimate_median,
    mean_of_crossed,
)

LEAST, MOST = 0.93, 0.97


@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("law", LAWS)
def test_intervals_over_few_seeds_hold_and_resampled_ones_do_not(law, seeds):
    found = over_seeds(law, seeds)
    assert LEAST <= found.held <= MOST
    assert found.resampled < LEAST


@pytest.mark.parametrize("spread", CROSSED)
@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("law", LAWS[:2])
def test_intervals_over_seeds_and_scenes_hold(law, seeds, spread):
    assert LEAST <= over_both(law, seeds, spread).held <= MOST


def test_where_seeds_differ_much_resampling_both_does_not_hold():
    assert over_both("normal", 5, (1.0, 1.0, 1.0), rounds=2000).resampled < LEAST


def test_interval_of_scenes_that_are_all_new_needs_the_scenes():
    rng = np.random.default_rng(0)
    held = {"seeds": 0, "both": 0}
    for _ in range(200):
        scores = rng.normal(0, 0.05, (5, 1)) + rng.normal(size=(1, 40)) + rng.normal(size=(5, 40))
        for name, found in (("seeds", estimate(scores)), ("both", crossed_mean(scores))):
            held[name] += found.low <= 0 <= found.high
    assert held["seeds"] < 0.9 * 200 < held["both"]


@pytest.mark.parametrize("spread", [(1.0, 1.0, 1.0), (0.1, 1.0, 0.3), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("seeds", [2, 3])
def test_interval_of_a_mean_over_families_holds_with_few_seeds_of_each(seeds, spread):
    of_seeds, of_scenes, of_both = spread
    rng = np.random.default_rng(seeds)
    held = 0
    for _ in range(1000):
        tables = [
            rng.normal(0, of_seeds, (seeds, 1))
            + rng.normal(0, of_scenes, (1, 40)) / np.sqrt(seeds)
            + rng.normal(0, of_both, (seeds, 40))
            + 0.5
            for _ in range(8)
        ]
        found = mean_of_crossed(tables)
        held += found.low <= 0.5 <= found.high
    assert 0.93 <= held / 1000 <= 0.98


@pytest.mark.parametrize("seeds", [5, 6, 9, 10])
def test_interval_of_a_median_holds_as_often_as_the_binomial_law_says(seeds):
    found = estimate_median(np.arange(float(seeds)))
    place = int(found.low)  # of the lower end, from 0 on
    assert int(found.high) == seeds - 1 - place
    exact = 1 - 2 * stats.binom.cdf(place, seeds, 0.5)
    drawn = np.sort(np.random.default_rng(seeds).exponential(size=(20_000, seeds)))
    held = np.mean((drawn[:, place] <= np.log(2)) & (drawn[:, -1 - place] >= np.log(2)))
    assert held == pytest.approx(exact, abs=0.006)
    assert (exact >= 0.95) == (seeds >= 6) == (found.note != FEW_SEEDS)


def test_interval_over_scenes_of_one_seed_is_that_of_the_scenes():
    scenes = np.random.default_rng(1).exponential(size=60)
    one = crossed_mean(scenes)
    many = estimate(scenes, within=UNBOUNDED)
    assert (one.low, one.high) == pytest.approx((many.low, many.high))
    turned = crossed_mean(scenes[:, None])  # and over seeds of one scene
    assert (turned.low, turned.high) == pytest.approx((many.low, many.high))
