"""Conversions between decibels and linear power ratios, and the wavelength of a carrier."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

SPEED_OF_LIGHT = 299_792_458.0  # m/s, exact by the definition of the metre

Floats = NDArray[np.float64]


def db_to_linear(value_db: ArrayLike) -> Floats:
    """Power ratio of a value in dB: ``10 ** (value_db / 10)``, same shape.

    Examples
    --------
    >>> db_to_linear([0.0, 20.0, -10.0]).tolist()
    [1.0, 100.0, 0.1]
    """
    return np.asarray(10.0 ** (np.asarray(value_db, dtype=np.float64) / 10.0))


def linear_to_db(ratio: ArrayLike) -> Floats:
    """Value in dB of a power ratio, same shape; a ratio of 0 gives -inf without a warning.

    Examples
    --------
    >>> linear_to_db([1.0, 100.0, 0.0]).tolist()
    [0.0, 20.0, -inf]
    """
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(np.asarray(ratio, dtype=np.float64)))


def wavelength_m(carrier_ghz: float) -> float:
    """Wavelength in metres of a carrier in GHz.

    Examples
    --------
    >>> wavelength_m(2.0)
    0.149896229
    """
    return SPEED_OF_LIGHT / (carrier_ghz * 1e9)
