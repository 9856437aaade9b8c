"""`Estimate`: a figure over seeds with its 95 % interval, which comes from resampling whole seeds.

A seed is the unit that is drawn: all that one policy did, on however many tasks, stays together.
Resampling task by task would take what one policy does on many tasks for as many independent draws,
and give intervals too narrow. Failures are part of the figures: 0 in SPL and success, infinity in
ratios and times.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 9999
ONE_SEED = "one seed"
ALL_EQUAL = "all seeds equal"
_EQUAL = 1e-9  # values this close, in proportion, differ by the rounding of sums alone

Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Any]  # values (..., seeds, tasks) to (...)


@dataclass(frozen=True)
class Estimate:
    """A figure and its interval.

    Attributes
    ----------
    value
        May be infinite: a median time where half of the seeds or more never arrived.
    low, high
        Ends of the interval; None where one seed gives none.
    note
        Why the interval says little: ``"one seed"``, ``"all seeds equal"`` (resampling equals shows
        no spread, which is not to say that the next seed will be equal too), or nothing.
    """

    value: float
    low: float | None
    high: float | None
    note: str = ""


def mean(values: Floats) -> Any:
    """Mean over seeds and tasks, the last two axes."""
    return values.mean(axis=(-2, -1))


def interquartile_mean(values: Floats) -> Any:
    """Mean of the middle half of all seeds and tasks (Agarwal et al. 2021); the plain mean of fewer
    than four.
    """
    return stats.trim_mean(values.reshape(*values.shape[:-2], -1), 0.25, axis=-1)


def optimality_gap(values: Floats) -> Any:
    """Mean shortfall of scores from 1 (Agarwal et al. 2021): 0 where all are optimal."""
    return np.maximum(1.0 - values, 0.0).mean(axis=(-2, -1))


def median(values: Floats) -> Any:
    """Median over seeds and tasks; infinite where half or more are."""
    return np.median(values, axis=(-2, -1))


def estimate(values: ArrayLike, statistic: Statistic = mean, *, rng: int = 0) -> Estimate:
    """A statistic of values ``(seeds,)`` or ``(seeds, tasks)``, with a percentile interval over
    resampled seeds.

    The ends of the interval are statistics of resamples themselves, not values between two of them,
    so that they may be infinite. ``rng`` is the seed of the resampling.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = np.asarray(values, dtype=np.float64)
    if table.ndim not in (1, 2) or table.size == 0 or np.isnan(table).any():
        raise ValueError(
            f"values {table.shape} must be (seeds,) or (seeds, tasks), not empty and without NaN"
        )

    table = table.reshape(len(table), -1)  # (seeds, tasks)
    value = float(statistic(table))
    if len(table) == 1:
        return Estimate(value, None, None, ONE_SEED)
    if np.allclose(table, table[0], rtol=_EQUAL, atol=_EQUAL):
        return Estimate(value, value, value, ALL_EQUAL)

    # infinite statistics have no standard error, which is not looked at
    with np.errstate(invalid="ignore"):
        found = stats.bootstrap(
            (np.arange(len(table)),),
            lambda seeds, axis: statistic(table[seeds.astype(np.int64)]),
            vectorized=True,
            n_resamples=RESAMPLES,
            batch=max(1, 10**7 // table.size),  # values in work at a time
            method="percentile",
            rng=np.random.default_rng(rng),
        )

    low, high = _middle(found.bootstrap_distribution)

    return Estimate(value, float(low), float(high))


def t_interval(values: ArrayLike) -> Estimate:
    """Mean over seeds ``(seeds,)`` with Student's interval; none where the mean is infinite.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 1 or table.size == 0 or np.isnan(table).any():
        raise ValueError(f"values {table.shape} must be (seeds,), not empty and without NaN")

    value = float(table.mean())
    if len(table) == 1 or np.isinf(value):
        return Estimate(value, None, None, ONE_SEED if len(table) == 1 else "")
    if np.allclose(table, table[0], rtol=_EQUAL, atol=_EQUAL):
        return Estimate(value, value, value, ALL_EQUAL)

    low, high = stats.t.interval(CONFIDENCE, len(table) - 1, loc=value, scale=stats.sem(table))

    return Estimate(value, float(low), float(high))


def paired_difference(differences: ArrayLike, *, rng: int = 0) -> Estimate:
    """Mean of differences ``(seeds, scenes)``, one policy's score less another's in the same scene.

    Seeds and scenes are both resampled, each on its own, so that the interval holds for other seeds
    and other scenes. With one seed, scenes alone are.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = np.atleast_2d(np.asarray(differences, dtype=np.float64))
    if table.size == 0 or np.isnan(table).any():
        raise ValueError(
            f"differences {table.shape} must be (seeds, scenes), not empty and without NaN"
        )

    # shares of the draws that fall on each, (RESAMPLES, seeds) and (RESAMPLES, scenes)
    draws = np.random.default_rng(rng)
    shares = [draws.multinomial(n, np.full(n, 1.0 / n), size=RESAMPLES) / n for n in table.shape]
    found = ((shares[0] @ table) * shares[1]).sum(axis=1)
    low, high = _middle(found)

    return Estimate(
        float(table.mean()), float(low), float(high), ONE_SEED if len(table) == 1 else ""
    )


def share(successes: int, seeds: int) -> Estimate:
    """Share of the seeds that succeeded, with the exact binomial interval of Clopper and Pearson.

    Resampling 10 successes of 10 would give an interval without width; the exact one ends at 0.69.
    """
    interval = stats.binomtest(successes, seeds).proportion_ci(CONFIDENCE, method="exact")
    return Estimate(successes / seeds, float(interval.low), float(interval.high))


def band(curves: ArrayLike, *, rng: int = 0) -> tuple[Floats, Floats, Floats]:
    """Mean of curves ``(seeds, T)`` and the ends of its interval at each point, ``(T,)`` each."""
    table = np.asarray(curves, dtype=np.float64)
    if len(table) == 1:
        return table[0], table[0], table[0]

    found = stats.bootstrap(
        (table,),
        np.mean,
        axis=0,
        vectorized=True,
        n_resamples=1999,
        batch=100,
        method="percentile",
        rng=np.random.default_rng(rng),
    )
    low, high = _middle(found.bootstrap_distribution)

    return table.mean(axis=0), low, high


def _middle(distribution: Floats) -> Floats:
    """Ends of the middle 95 % of resampled statistics along the last axis."""
    tail = (1.0 - CONFIDENCE) / 2.0
    return np.quantile(distribution, [tail, 1.0 - tail], axis=-1, method="inverted_cdf")
