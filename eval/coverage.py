"""`Coverage`: how often intervals hold the truth, in draws from known laws.

A score is the sum of what a seed adds, what a scene adds and what is left; each has the same law,
of mean 0 and the given standard deviation. The intervals are those of `eval.statistics` and, for
comparison, the percentile bootstrap.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.statistics import CONFIDENCE, crossed_interval, mean_interval

SEEDS = (5, 10)
SCENES = 30
LAWS = ("normal", "lognormal", "exponential")
# standard deviations of what a seed adds, what a scene adds, and what is left
CROSSED = ((1.0, 1.0, 1.0), (0.3, 1.0, 1.0), (0.1, 1.0, 0.3), (0.3, 0.0, 1.0))
ROUNDS = 20_000
CROSSED_ROUNDS = 6_000
RESAMPLES = 999

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Coverage:
    """How often an interval held the mean of a law.

    Attributes
    ----------
    law, seeds
        What was drawn, and how many.
    spread
        Standard deviations of seeds, scenes and the remainder; None where seeds alone are drawn.
    held
        Share of the rounds in which the interval of `eval.statistics` held the mean.
    resampled
        The same of the percentile bootstrap, over seeds, or over seeds and scenes.
    """

    law: str
    seeds: int
    spread: tuple[float, float, float] | None
    held: float
    resampled: float


def coverages() -> list[Coverage]:
    """All laws, over seeds, and over seeds and scenes."""
    return [
        *(over_seeds(law, seeds) for seeds in SEEDS for law in LAWS),
        *(over_both(law, seeds, s) for seeds in SEEDS for law in LAWS[:2] for s in CROSSED),
    ]


def over_seeds(law: str, seeds: int, rounds: int = ROUNDS) -> Coverage:
    """Intervals of a mean over seeds."""
    rng = np.random.default_rng([seeds, LAWS.index(law)])
    values = _draw(rng, law, (rounds, seeds))
    middle = values.mean(axis=-1)
    low, high = mean_interval(values)

    few = values[: rounds // 4]  # (rounds, seeds)
    resampled = few @ _shares(rng, seeds).T  # (rounds, resamples)

    return Coverage(
        law, seeds, None, _held(middle + low, middle + high), _held(*_percentiles(resampled))
    )


def over_both(
    law: str, seeds: int, spread: tuple[float, float, float], rounds: int = CROSSED_ROUNDS
) -> Coverage:
    """Intervals of a mean over seeds and scenes."""
    rng = np.random.default_rng([seeds, LAWS.index(law), *(int(100 * each) for each in spread)])
    shapes = ((rounds, seeds, 1), (rounds, 1, SCENES), (rounds, seeds, SCENES))
    parts = [each * _draw(rng, law, shape) for each, shape in zip(spread, shapes, strict=True)]
    values = parts[0] + parts[1] + parts[2]  # (rounds, seeds, scenes)
    middle = values.mean(axis=(-2, -1))
    low, high = crossed_interval(values)

    few = values[: rounds // 6]
    by_scene = np.einsum("kn,rns->rks", _shares(rng, seeds), few, optimize=True)
    resampled = np.einsum("rks,ks->rk", by_scene, _shares(rng, SCENES), optimize=True)

    return Coverage(
        law, seeds, spread, _held(middle + low, middle + high), _held(*_percentiles(resampled))
    )


def _draw(rng: np.random.Generator, law: str, shape: tuple[int, ...]) -> Floats:
    """Draws of mean 0 and standard deviation 1; the skewness is 0, 1.75 or 2."""
    if law == "normal":
        return rng.normal(size=shape)
    if law == "exponential":
        return rng.exponential(size=shape) - 1.0

    variance = 0.25  # of the logarithm
    middle = np.exp(variance / 2.0)
    spread = middle * np.sqrt(np.exp(variance) - 1.0)

    return np.asarray((rng.lognormal(0.0, np.sqrt(variance), size=shape) - middle) / spread)


def _shares(rng: np.random.Generator, count: int) -> Floats:
    """Shares of a resample's draws that fall on each, ``(resamples, count)``."""
    return rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES) / count


def _percentiles(resampled: Floats) -> tuple[Floats, Floats]:
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(resampled, [tail, 1.0 - tail], axis=-1)
    return low, high


def _held(low: Floats, high: Floats) -> float:
    return float(np.mean((low <= 0.0) & (high >= 0.0)))
