"""Fading: `RicianFading` in closed form or `MeasuredFading` of histograms, which tell how often
each cell's instantaneous gain lies below a threshold.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import i0e

from irs_gym.memory import freeze
from irs_gym.units import Floats, db_to_linear, linear_to_db

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)  # on [-1, 1]
_BLOCK = 2**12  # cells in work at a time, with some arrays of cells x nodes
_STEADY = 1e-30  # of the power: with less scatter than this the gain is one number
_LARGEST_DB = 1000
_ROUNDING = 1e-9  # of the sum of a histogram


@dataclass(frozen=True, eq=False)
class RicianFading:
    """Of each cell, a line-of-sight part of fixed power and a complex Gaussian scattered part.

    Attributes
    ----------
    los_gain
        float64, shape ``(..., X, Y)``, read-only: abs(h + w^T theta)^2 of Lemma 1, linear.
    scattered_gain
        Same shape: tau of Lemma 1, linear. Both are 0 where nothing is received.

    Raises
    ------
    ValueError
        Where they are no arrays of one shape, or a gain is negative, NaN or infinite.

    Examples
    --------
    Without a line of sight, the gain is exponentially distributed:

    >>> fading = RicianFading(los_gain=np.zeros((1, 1)), scattered_gain=np.full((1, 1), 1e-6))
    >>> bool(np.isclose(fading.outage(-60.0), 1 - np.exp(-1)))
    True
    """

    los_gain: Floats
    scattered_gain: Floats

    def __post_init__(self) -> None:
        for each in fields(self):
            object.__setattr__(self, each.name, _gains(getattr(self, each.name), each.name))

        if self.los_gain.shape != self.scattered_gain.shape:
            raise ValueError(
                f"los_gain has the shape {self.los_gain.shape}, "
                f"scattered_gain {self.scattered_gain.shape}"
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """The cells ``(..., X, Y)``."""
        return self.los_gain.shape

    def outage(self, threshold_db: ArrayLike) -> Floats:
        """Probability that the instantaneous gain abs(c)^2 lies below a threshold, shape ``(..., X,
        Y)``.

        With A^2 the line-of-sight gain, tau the scattered one and x the threshold, 2 abs(c)^2 / tau
        is noncentral chi-square with two degrees of freedom:

            P(abs(c)^2 < x) = F(2 x / tau; 2, 2 A^2 / tau) = 1 - Q_1(sqrt(2 A^2 / tau),
                                                                      sqrt(2 x / tau)).

        It is 1 where nothing is received, and a step where nothing is scattered. Correct to about
        12 digits, in both tails. ``threshold_db`` must broadcast to the cells.
        """
        # no number is larger than 3,000 dB; and of an array, as one power may round as many do not
        capped_db = np.minimum(np.atleast_1d(threshold_db), 3000.0)
        threshold = np.broadcast_to(db_to_linear(capped_db), self.shape).ravel()  # x
        los = self.los_gain.ravel()
        scattered = self.scattered_gain.ravel()

        # a step, and always where nothing is received
        outage = np.where(los < threshold, 1.0, 0.0)
        outage[(los == 0) & (scattered == 0)] = 1.0
        fades = np.flatnonzero(scattered > _STEADY * np.maximum(los, threshold))

        for first in range(0, len(fades), _BLOCK):
            cells = fades[first : first + _BLOCK]
            tau = scattered[cells]
            outage[cells] = _noncentral_chi_square(
                2 * (threshold[cells] / tau), 2 * (los[cells] / tau)
            )

        return outage.reshape(self.shape)


@dataclass(frozen=True, eq=False)
class MeasuredFading:
    """Of each cell, how often each level was received.

    Attributes
    ----------
    levels_db
        float64, shape ``(B,)``, increasing, read-only: the levels.
    shares
        float64, shape ``(X, Y, B)``, read-only: the share of each. What they lack of 1 was received
        below the lowest level, or not at all.

    Raises
    ------
    ValueError
        Where levels do not increase, or shares of a cell are negative or add up to more than 1.

    Examples
    --------
    >>> fading = MeasuredFading(np.array([-80.0, -70.0]), np.array([[[0.25, 0.5]]]))
    >>> fading.outage(-80.0).tolist(), fading.outage(-75.0).tolist(), fading.outage(0.0).tolist()
    ([[0.25]], [[0.5]], [[1.0]])
    """

    levels_db: Floats
    shares: Floats

    def __post_init__(self) -> None:
        levels = _numbers(self.levels_db, "levels_db")
        shares = _numbers(self.shares, "shares")
        is_row = levels.ndim == 1 and levels.size > 0 and (np.abs(levels) <= _LARGEST_DB).all()
        if not is_row or not (np.diff(levels) > 0).all():
            raise ValueError(
                f"levels_db must be a row of increasing numbers of dB, none beyond {_LARGEST_DB}"
            )
        if shares.ndim != 3 or shares.shape[2] != len(levels):
            raise ValueError(
                f"shares has the shape {shares.shape}, and must be (X, Y, {len(levels)})"
            )
        if (shares < 0).any() or (shares.sum(axis=2) > 1 + _ROUNDING).any():
            raise ValueError("shares of a cell must not be negative, nor add up to more than 1")

        freeze(levels, shares)
        object.__setattr__(self, "levels_db", levels)
        object.__setattr__(self, "shares", shares)

    @property
    def shape(self) -> tuple[int, ...]:
        """The cells ``(X, Y)``."""
        return self.shares.shape[:2]

    @property
    def mean_gain_db(self) -> Floats:
        """Mean power of each cell in dB, shape ``(X, Y)``; -inf where nothing was received."""
        return linear_to_db(self.shares @ db_to_linear(self.levels_db))

    def outage(self, threshold_db: ArrayLike) -> Floats:
        """Share of each cell's histogram that lies below a threshold, shape ``(X, Y)``."""
        above = self.levels_db >= np.asarray(threshold_db)[..., None]  # (B,) or (X, Y, B)
        outage = 1.0 - (self.shares * above).sum(axis=-1)

        return np.where(outage < _ROUNDING, 0.0, outage)


Fading = RicianFading | MeasuredFading


def fading_of(arrays: Mapping[str, Any]) -> Fading | None:
    """The fading of which arrays, or lists, are named so; None where there is none among them.

    A ``ValueError`` tells what is missing or wrong.
    """
    for kind in (RicianFading, MeasuredFading):
        names = [each.name for each in fields(kind)]
        given = [name for name in names if name in arrays]
        if given == names:
            return kind(**{name: arrays[name] for name in names})
        if given:
            missing = ", ".join(name for name in names if name not in given)
            raise ValueError(f"{', '.join(given)} without {missing} tells no fading")

    return None


def checked_threshold(value: Any, name: str) -> float:
    """A threshold in dB; a ``ValueError`` names the field where it is no finite number."""
    is_number = isinstance(value, Real) and not isinstance(value, bool | np.bool_)
    if not (is_number and isfinite(value)):
        raise ValueError(f"{name}={value!r} must be a finite number of dB")

    return float(value)


def _numbers(values: Any, name: str) -> Floats:
    """A copy of finite real numbers."""
    try:
        array = np.array(values)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"{name} is no array: {error}") from None

    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise ValueError(f"{name} must hold finite real numbers")

    return array.astype(np.float64, copy=False)


def _gains(values: Any, name: str) -> Floats:
    array = _numbers(values, name)
    if (array < 0).any():
        raise ValueError(f"{name} holds a negative gain: it is linear, no number of dB")

    freeze(array)
    return array


def _noncentral_chi_square(x: Floats, noncentrality: Floats) -> Floats:
    """F(x; 2, noncentrality), each of the shape ``(n,)``.

    With a^2 the noncentrality and b^2 = x, F is the integral from 0 to b of the density

        f(u) = u exp(-(u - a)^2 / 2) exp(-a u) I_0(a u),

    or 1 minus that from b on. Each is integrated from b to where f has fallen to 1e-17 of its
    value there, by Gauss and Legendre's rule.
    """
    # scipy.stats.ncx2 loses all digits of probabilities below 1e-100, takes 5 ms for one at a
    # noncentrality of 1e10, and gives NaN at 1e14.
    a = np.sqrt(noncentrality)  # (n,)
    b = np.sqrt(x)  # (n,)
    beyond = (noncentrality - b * b) / np.maximum(a + b, 1e-150)  # (n,): a - b, to its last digits
    downwards = (b <= a) | (b < 2)
    width = 80 / (np.abs(beyond) + np.sqrt(beyond**2 + 80))  # (n,)
    width = np.where(downwards, np.minimum(width, b), width)

    away = width[:, None] * (_NODES + 1) / 2  # (n, nodes): from b
    sign = np.where(downwards, 1.0, -1.0)[:, None]
    u = b[:, None] - sign * away
    density = u * np.exp(-((beyond[:, None] + sign * away) ** 2) / 2) * i0e(a[:, None] * u)
    # no matrix product, which rounds by the number of cells
    integral = width / 2 * (density * _WEIGHTS).sum(axis=1)  # (n,)

    return np.asarray(np.clip(np.where(downwards, integral, 1 - integral), 0.0, 1.0))
