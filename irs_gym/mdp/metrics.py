"""How well an episode went, against the exact optimum: SPL, soft SPL and the ratio of distances."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def spl(is_success: ArrayLike, oracle_distance: ArrayLike, distance: ArrayLike) -> Floats:
    """Success weighted by path length (Anderson et al., 2018, eq. 1), from 0 to 1.

    Parameters
    ----------
    is_success
        Whether each episode reached its goal without missing the target, any shape.
    oracle_distance
        Metres of the shortest feasible path from its start, above 0, same shape.
    distance
        Metres travelled, same shape.

    Examples
    --------
    >>> spl([True, True, False], [10.0, 10.0, 10.0], [10.0, 12.5, 10.0]).tolist()
    [1.0, 0.8, 0.0]
    """
    return soft_spl(np.asarray(is_success, dtype=np.float64), oracle_distance, distance)


def soft_spl(progress: ArrayLike, oracle_distance: ArrayLike, distance: ArrayLike) -> Floats:
    """Progress weighted by path length (Datta et al., 2020), from 0 to 1: `spl` with the progress
    for the success.

    ``progress`` is the share of the way to the goal that was made, from 0 to 1.

    Examples
    --------
    >>> soft_spl([1.0, 0.5], [10.0, 10.0], [12.5, 8.0]).tolist()
    [0.8, 0.5]
    """
    shortest = np.asarray(oracle_distance, dtype=np.float64)

    # The oracle's distance at least: lengths are sums of floats, and an optimal path may come out a
    # rounding shorter than the oracle's.
    longer = np.maximum(shortest, distance)

    return np.asarray(np.asarray(progress) * shortest / longer)


def distance_ratio(
    is_success: ArrayLike, oracle_distance: ArrayLike, distance: ArrayLike
) -> Floats:
    """Metres travelled over the shortest way; NaN where there was no success, as the distance says
    nothing there. Shapes as for `spl`.

    Examples
    --------
    >>> distance_ratio([True, False], [10.0, 10.0], [12.5, 10.0]).tolist()
    [1.25, nan]
    """
    ratio = np.asarray(distance, dtype=np.float64) / np.asarray(oracle_distance, dtype=np.float64)

    return np.asarray(np.where(is_success, ratio, np.nan))
