"""`time_in_turns`: rates of several contenders, taken in turns, so that whatever else the machine
does meets them all alike.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

Steps = Callable[[int], int]  # calls `step` that often and returns how many transitions that made


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of repeated measurements."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Spread of one value or more."""
        low, median, high = np.percentile(values, [25, 50, 75]).tolist()
        return cls(median, low, high)


@dataclass(frozen=True)
class Rates:
    """Transitions per second in each round, by contender; all have the same number of rounds."""

    by_name: dict[str, list[float]]

    def of(self, name: str) -> Spread:
        """Transitions per second of a contender."""
        return Spread.of(self.by_name[name])

    def ratio(self, name: str, other: str) -> Spread:
        """How many times as fast as another a contender is, compared round by round."""
        return Spread.of(
            [a / b for a, b in zip(self.by_name[name], self.by_name[other], strict=True)]
        )


def time_in_turns(contenders: dict[str, Steps], rounds: int, seconds: float) -> Rates:
    """Time each contender for about ``seconds`` in each of the rounds.

    Raises
    ------
    ValueError
        Where ``rounds`` or ``seconds`` is not positive.
    """
    if rounds < 1 or seconds <= 0:
        raise ValueError(f"rounds={rounds} and seconds={seconds} must be positive")

    calls = {name: _enough_calls(steps, seconds) for name, steps in contenders.items()}
    rates: dict[str, list[float]] = {name: [] for name in contenders}

    for _ in range(rounds):
        for name, steps in contenders.items():
            # caches warm up, and threads of the one before come to rest
            steps(-(-calls[name] // 4))
            transitions, elapsed = _timed(steps, calls[name])
            rates[name].append(transitions / elapsed)

    return Rates(rates)


def _enough_calls(steps: Steps, seconds: float) -> int:
    """How many calls take about that long, found by doubling; it warms the contender up as well."""
    calls = 1

    while True:
        _, elapsed = _timed(steps, calls)
        if elapsed >= seconds / 2:  # long enough to tell the rest from
            return max(1, round(calls * seconds / elapsed))
        calls *= 2


def _timed(steps: Steps, calls: int) -> tuple[int, float]:
    began = perf_counter()
    transitions = steps(calls)
    return transitions, perf_counter() - began
