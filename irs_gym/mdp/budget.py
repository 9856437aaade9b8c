"""A budget of costs: what may be asked for, what is left of it, and how that is seen."""

from collections.abc import Sequence
from math import isfinite
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.memory import frozen

Floats = NDArray[np.float64]

Budget = float | tuple[float, float]  # one for all episodes, or the range each is drawn from
OnExhausted = Literal["terminate", "continue", "refuse"]

# A robot may overdraw by this much: what a user hands over may be a sum in another order.
SLACK = 1e-9
# Costs are whole multiples of this, so that their sums are exact in any order, up to 2**17.
_UNIT = 2.0**-36
# Numbers as arrays (): arrays are computed with them faster than with a float.
_ONE = frozen(np.array(1.0))
# The bits of negative floats, as whole numbers, count up from the least, that of -0.0.
_SLACK_BITS = frozen(np.array(-SLACK).view(np.int64))
_MOST = 1e9  # where nothing is received, a deficit has no bound


def checked_budget(budget: Any) -> Budget | None:
    """The budget as floats, or None where there is none.

    Raises ``ValueError`` for what is neither a number from 0 nor a range ``(low, high)`` of such.

    Examples
    --------
    >>> checked_budget([0, 26])
    (0.0, 26.0)
    """
    if budget is None:
        return None

    is_range = isinstance(budget, Sequence | np.ndarray) and not isinstance(budget, str)
    ends = list(budget) if is_range else [budget]
    is_right = len(ends) == (2 if is_range else 1) and all(_is_amount(each) for each in ends)
    if not is_right or ends[0] > ends[-1]:
        raise ValueError(
            f"budget={budget!r} must be a finite number from 0, or a range (low, high) of such"
        )

    return (float(ends[0]), float(ends[1])) if is_range else float(ends[0])


def _is_amount(value: Any) -> bool:
    is_number = isinstance(value, Real) and not isinstance(value, bool | np.bool_)
    return is_number and isfinite(value) and value >= 0


def range_of(budget: Budget) -> tuple[float, float]:
    """The least and the largest budget of an episode."""
    return budget if isinstance(budget, tuple) else (budget, budget)


def choose_budget(budget: Budget, asked: Any, rng: np.random.Generator | None) -> float:
    """The budget of an episode: what is asked for, else the one there is, else one drawn from the
    range, all equally likely. Randomness is needed for the last alone.

    Raises ``ValueError`` where more is asked for than the largest, up to which optima are known.
    """
    low, high = range_of(budget)
    if asked is not None:
        if not _is_amount(asked) or asked > high:
            raise ValueError(
                f"options: budget={asked!r} must be a number from 0 to {high}, "
                "the largest budget of the task"
            )
        return float(asked)

    return float(rng.uniform(low, high)) if rng and isinstance(budget, tuple) else low


def is_below(budgets: Sequence[float | None], least: float | None) -> bool:
    """Whether one of the budgets is below the least of the task, for which nothing was checked."""
    return least is not None and any(each is not None and each < least for each in budgets)


def payable(cost: Floats) -> Floats:
    """Costs, of any shape, as environments charge them: the nearest multiples of 2**-36, 1e9 at the
    most.

    Examples
    --------
    >>> a, b, c = 0.1, 0.2, 0.3
    >>> a + b + c == c + b + a
    False
    >>> a, b, c = payable(np.array([a, b, c]))
    >>> bool(a + b + c == c + b + a), bool(abs(a - 0.1) < 1e-11)
    (True, True)
    """
    return np.asarray(np.minimum(np.rint(cost / _UNIT) * _UNIT, _MOST))


def cleared(left: Floats) -> Floats:
    """What is left of budgets ``(n,)``, with 0 where they are overdrawn by no more than `SLACK`.

    The array itself where none is, else another.

    Examples
    --------
    >>> cleared(np.array([0.75, -1e-12, -0.5])).tolist()
    [0.75, 0.0, -0.5]
    """
    is_within_slack = left.view(np.int64) <= _SLACK_BITS  # one comparison tells both bounds
    return np.where(is_within_slack, 0.0, left) if np.count_nonzero(is_within_slack) else left


def can_pay(left: ArrayLike, cost: ArrayLike) -> NDArray[np.bool_]:
    """Whether what is left of budgets covers costs; both broadcast to one shape.

    Examples
    --------
    >>> can_pay(1.0, [0.5, 1.0 + 1e-12, 1.5]).tolist()
    [True, True, False]
    """
    return np.asarray(np.subtract(left, cost) >= -SLACK)


def scaled_amount(left: ArrayLike) -> NDArray[np.float32]:
    """What an agent sees of what is left of a budget: left / (1 + abs(left)), from -1 to 1.

    It is 0 where nothing is left, below where more was spent, and tells small amounts apart best.

    Examples
    --------
    >>> scaled_amount([0.0, 1.0, 3.0, -1.0]).tolist()
    [0.0, 0.5, 0.75, -0.5]
    """
    left = np.asarray(left)
    share = np.divide(left, np.abs(left) + _ONE)
    return np.asarray(share.astype(np.float32))
