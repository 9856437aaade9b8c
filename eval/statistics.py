"""`Estimate`: a figure with its 95 % interval, over seeds, or over seeds and scenes.

A seed is one draw, with all that its policy did on however many tasks: task by task, one policy
would count as many, and intervals would be too narrow. Failures are part of the figures: 0 in SPL
and success, infinity in ratios and times.

There is one rule for means, and the interval is that of Student, made wider. Few skewed draws have
their long tail where they scatter least, so that end is moved out by the skewness that the draws
show (Hall 1992, "On the removal of skewness by transformation"). Where claims go beyond the scenes
as well, the variances of seeds and of scenes add up, and the quantile lies between those of both
(Cochran). `eval.coverage` simulates how often this holds. Medians have the interval of the order
statistics, shares that of the binomial law: both are exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

CONFIDENCE = 0.95
ONE_SEED = "one seed"
ALL_EQUAL = "all seeds equal"
FEW_SEEDS = "smallest to largest seed"
FEWEST = 6  # seeds of which the smallest and the largest hold a median with 95 %: 1 - 2**(1 - 6)
UNBOUNDED = (-np.inf, np.inf)
SCORE = (0.0, 1.0)  # what an SPL or a share can be
_EQUAL = 1e-9  # values this close, in proportion, differ by the rounding of sums alone
_STRAIGHT = 1e-7  # skewness below which the correction is nought

Floats = NDArray[np.float64]
Bounds = tuple[float, float]
Statistic = Callable[[Floats], Any]  # values (seeds, tasks) to a number


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
        Why the interval says little: ``"one seed"``; ``"all seeds equal"`` (no spread is seen,
        which is not to say that the next seed will be equal too); ``"smallest to largest seed"``
        (too few for 95 %); or nothing.
    """

    value: float
    low: float | None
    high: float | None
    note: str = ""


# --- what is estimated ----------------------------------------------------------------------------


def mean(values: Floats) -> Any:
    """Mean over seeds and tasks."""
    return values.mean()


def interquartile_mean(values: Floats) -> Any:
    """Mean of the middle half of all seeds and tasks (Agarwal et al. 2021); the plain mean of fewer
    than four.
    """
    return stats.trim_mean(values.ravel(), 0.25)


def optimality_gap(values: Floats) -> Any:
    """Mean shortfall of scores from 1 (Agarwal et al. 2021): 0 where all are optimal."""
    return np.maximum(1.0 - values, 0.0).mean()


def estimate(
    values: ArrayLike, statistic: Statistic = mean, within: Bounds = UNBOUNDED
) -> Estimate:
    """A smooth statistic of values ``(seeds,)`` or ``(seeds, tasks)``, with its interval over
    seeds; none where it is infinite.

    A statistic other than the mean is studentised by the jackknife, whose pseudo-values (Tukey)
    take the place of the seeds' means; of a mean they are these means.

    Parameters
    ----------
    within
        What the figure can be: the interval ends there.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = _table(values)
    count = len(table)
    value = float(statistic(table))
    if count == 1:
        return Estimate(value, None, None, ONE_SEED)
    if _is_equal(table):
        return Estimate(value, value, value, ALL_EQUAL)
    if np.isinf(value):
        return Estimate(value, None, None)

    without = np.array([statistic(np.delete(table, n, axis=0)) for n in range(count)])
    low, high = mean_interval(count * value - (count - 1) * without)

    return _clipped(value, value + low, value + high, within)


def estimate_median(values: ArrayLike) -> Estimate:
    """Median over seeds ``(seeds,)``, infinite where half or more are, with the interval between
    two of them that holds the median of the law with 95 % or more, whatever the law.

    Fewer than `FEWEST` seeds hold it with 1 - 2**(1 - seeds): 94 % of five, from the smallest to
    the largest.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = _table(values)[:, 0]
    value = float(np.median(table))
    if len(table) == 1:
        return Estimate(value, None, None, ONE_SEED)
    if _is_equal(table[:, None]):
        return Estimate(value, value, value, ALL_EQUAL)
    if len(table) < FEWEST:
        return Estimate(value, float(table.min()), float(table.max()), FEW_SEEDS)

    ends = stats.quantile_test(table, p=0.5).confidence_interval(CONFIDENCE)

    return Estimate(value, float(ends.low), float(ends.high))


def share(successes: int, seeds: int) -> Estimate:
    """Share of the seeds that succeeded, with the exact binomial interval of Clopper and Pearson.

    Resampling 10 successes of 10 would give an interval without width; the exact one ends at 0.69.
    """
    interval = stats.binomtest(successes, seeds).proportion_ci(CONFIDENCE, method="exact")
    return Estimate(successes / seeds, float(interval.low), float(interval.high))


def crossed_mean(values: ArrayLike, within: Bounds = UNBOUNDED) -> Estimate:
    """Mean of values ``(seeds, scenes)``, each seed in the same scenes, with an interval that holds
    for other seeds and other scenes; with one seed, for other scenes.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = _crossed_table(values)
    value = float(table.mean())
    note = ONE_SEED if len(table) == 1 else ""
    if table.size == 1:
        return Estimate(value, None, None, note)
    if np.ptp(table) <= _EQUAL * max(1.0, abs(value)):
        return Estimate(value, value, value, ALL_EQUAL)

    low, high = crossed_interval(table)

    return _clipped(value, value + low, value + high, within, note)


def mean_of_crossed(tables: Sequence[ArrayLike], within: Bounds = UNBOUNDED) -> Estimate:
    """Mean of the means of several tables ``(seeds, scenes)``, no two of which have a seed or a
    scene in common, with an interval that holds for other seeds and scenes of each.

    The variances of seeds add up, and so do those of scenes; each sum has the degrees of freedom of
    Welch and Satterthwaite.

    Raises
    ------
    ValueError
        Where there is no table, or one has no value or a NaN.
    """
    each = [_crossed_table(table) for table in tables]
    if not each:
        raise ValueError("there must be one table or more")

    value = float(np.mean([table.mean() for table in each]))
    note = ONE_SEED if all(len(table) == 1 for table in each) else ""
    if any(table.size == 1 for table in each):
        return Estimate(value, None, None, note)
    if all(np.ptp(table) <= _EQUAL * max(1.0, abs(value)) for table in each):
        return Estimate(value, value, value, ALL_EQUAL)

    parts = [_crossed_scatter(table) for table in each]
    kinds = ([part[kind] for part in parts if kind in part] for kind in ("seeds", "scenes"))
    low, high = _ends([_Scatter.joined(kind, len(each)) for kind in kinds if kind])

    return _clipped(value, value + low, value + high, within, note)


def success_rate(values: ArrayLike) -> Estimate:
    """Mean of successes ``(seeds, scenes)``, 0 or 1, as `crossed_mean`.

    Where every seed succeeds in every scene, or none in any, no spread is seen: the interval is the
    exact one for so many scenes, as if of one seed.

    Raises
    ------
    ValueError
        Where there is no value, or one is NaN.
    """
    table = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if table.size and (table == table.flat[0]).all() and table.flat[0] in SCORE:
        scenes = table.shape[1]
        return share(scenes if table.flat[0] else 0, scenes)

    return crossed_mean(table, SCORE)


def band(curves: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Mean of scores ``(seeds, T)`` and the ends of its interval at each point, ``(T,)`` each."""
    table = np.asarray(curves, dtype=np.float64)
    middle = table.mean(axis=0)
    if len(table) == 1:
        return table[0], table[0], table[0]

    low, high = mean_interval(table.T)

    return middle, np.clip(middle + low, *SCORE), np.clip(middle + high, *SCORE)


# --- the rule for means ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Scatter:
    """Of a mean of n draws: variance and third central moment, ``(...)``, and n - 1, or what takes
    its place in a mean of such means.
    """

    variance: Floats
    third: Floats
    freedom: float

    @classmethod
    def of(cls, draws: Floats) -> "_Scatter":
        """From draws ``(..., n)``, by unbiased moments; two draws show no skewness."""
        n = draws.shape[-1]
        centred = draws - draws.mean(axis=-1, keepdims=True)
        variance = (centred**2).sum(axis=-1) / (n - 1)
        third = (centred**3).sum(axis=-1) * (n / ((n - 1) * (n - 2)) if n > 2 else 0.0)

        return cls(variance / n, third / n**2, n - 1)

    @classmethod
    def joined(cls, parts: "Sequence[_Scatter]", count: int) -> "_Scatter":
        """Of the sum of independent means over their ``count``; of each, one number."""
        variances = np.array([float(part.variance) for part in parts])
        squares = sum(
            variance**2 / part.freedom for variance, part in zip(variances, parts, strict=True)
        )
        whole = float(variances.sum())
        third = np.array([float(part.third) for part in parts]).sum()

        return cls(
            variance=np.asarray(whole / count**2),
            third=np.asarray(third / count**3),
            freedom=whole**2 / squares if squares else min(part.freedom for part in parts),
        )

    def scaled(self, factor: Floats) -> "_Scatter":
        """With that share of the variance, ``(...)``, and the same skewness."""
        return _Scatter(self.variance * factor, self.third * factor**1.5, self.freedom)

    @property
    def quantile(self) -> float:
        """Student's, which so much of the law lies between that and its negative."""
        return float(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, self.freedom))


def mean_interval(draws: Floats) -> tuple[Floats, Floats]:
    """From the mean of draws ``(..., n)`` to the ends of its interval: ``(...)`` each, the first
    one negative.
    """
    return _ends([_Scatter.of(draws)])


def crossed_interval(values: Floats) -> tuple[Floats, Floats]:
    """The same for the mean of values ``(..., seeds, scenes)`` over other seeds and scenes.

    In the variance of the mean, seeds count with what they and scenes have together; scenes count
    with what is beyond that, if anything is.
    """
    return _ends([*_crossed_scatter(values).values()])


def _crossed_scatter(values: Floats) -> dict[str, _Scatter]:
    """What ``"seeds"`` and ``"scenes"`` add to the scatter of a mean of values ``(..., seeds,
    scenes)``; one alone adds nothing.
    """
    seeds, scenes = values.shape[-2:]
    of_seeds = values.mean(axis=-1)  # (..., seeds)
    of_scenes = values.mean(axis=-2)  # (..., scenes)
    if seeds == 1:
        return {"scenes": _Scatter.of(of_scenes)}
    if scenes == 1:
        return {"seeds": _Scatter.of(of_seeds)}

    # the variance of the mean that comes from the remainder, values less the effects of both
    whole = values.mean(axis=(-2, -1), keepdims=True)
    remainder = values - of_seeds[..., :, None] - of_scenes[..., None, :] + whole
    together = (remainder**2).sum(axis=(-2, -1)) / ((seeds - 1) * (scenes - 1) * seeds * scenes)

    scatter = _Scatter.of(of_scenes)
    beyond = np.maximum(scatter.variance - together, 0.0)
    factor = np.divide(
        beyond, scatter.variance, out=np.zeros_like(beyond), where=scatter.variance > 0
    )

    return {"seeds": _Scatter.of(of_seeds), "scenes": scatter.scaled(factor)}


def _ends(parts: list[_Scatter]) -> tuple[Floats, Floats]:
    """Student's interval of a sum of independent parts, and Hall's: the outer of each two ends."""
    variance = np.asarray(sum(part.variance for part in parts))
    third = np.asarray(sum(part.third for part in parts))
    positive = np.where(variance > 0, variance, 1.0)
    error = np.sqrt(variance)

    # Cochran's quantile: each part's own by its share of the variance
    weighted = np.asarray(sum(part.variance * part.quantile for part in parts))
    quantile = weighted / positive
    skewness = third / positive**1.5

    low = -np.maximum(quantile, _unskewed(quantile, skewness)) * error
    high = np.maximum(quantile, -_unskewed(-quantile, skewness)) * error

    return low, high


def _unskewed(quantile: Floats, skewness: Floats) -> Floats:
    """The T whose transform has that quantile: Hall's T + a T^2 + a^2 T^3 / 3 + a / 2, where a is a
    third of the skewness of the mean, is nearly as symmetric as T of a symmetric law.
    """
    a = np.where(np.abs(skewness) < _STRAIGHT, _STRAIGHT, skewness) / 3.0
    return np.asarray((np.cbrt(1.0 + 3.0 * a * (quantile - a / 2.0)) - 1.0) / a)


def _crossed_table(values: ArrayLike) -> Floats:
    """Values as ``(seeds, scenes)``."""
    table = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if table.ndim != 2 or table.size == 0 or np.isnan(table).any():
        raise ValueError(f"values {table.shape} must be (seeds, scenes), not empty and without NaN")

    return table


def _table(values: ArrayLike) -> Floats:
    """Values as ``(seeds, tasks)``."""
    table = np.asarray(values, dtype=np.float64)
    if table.ndim not in (1, 2) or table.size == 0 or np.isnan(table).any():
        raise ValueError(
            f"values {table.shape} must be (seeds,) or (seeds, tasks), not empty and without NaN"
        )

    return table.reshape(len(table), -1)


def _is_equal(table: Floats) -> bool:
    """Whether all seeds did the same."""
    return bool(np.allclose(table, table[0], rtol=_EQUAL, atol=_EQUAL))


def _clipped(value: float, low: Any, high: Any, within: Bounds, note: str = "") -> Estimate:
    """The interval as far as the figure can be."""
    return Estimate(value, max(float(low), within[0]), min(float(high), within[1]), note)
