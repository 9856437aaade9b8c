"""`whole_lengths`: whole numbers that stand for the lengths of moves, so that sums are exact."""

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_CELLS = 36_000_000  # of a map, see `whole_lengths`


def whole_lengths(cells: int) -> tuple[int, int]:
    """Whole numbers (q, p) that stand for the lengths 1 and sqrt(2) of the moves on a map of so
    many cells.

    With them, the lengths of two paths are equal or in order exactly as the true ones are. p/q is a
    convergent of sqrt(2), so q sqrt(2) is within 1/(2q) of p; q > 2 cells, so a difference a + b
    sqrt(2) of two lengths has abs(b) < q/2. If it is not 0, it is at least 1 / (abs(a) + abs(b)
    sqrt(2)), and a q + b p less than 1/4 away from q times that, which is more. Sums are exact in
    float64 up to 2**53: enough for `MOST_CELLS`, 36 million.
    """
    q = 1
    p = 1

    # p/q = 1/1, 3/2, 7/5, 17/12 ...
    while q <= 2 * cells:
        q, p = q + p, 2 * q + p

    return q, p


def true_length(whole: float, cells: int) -> float:
    """Length in cells, a + b sqrt(2), of a whole length a q + b p."""
    return float(true_lengths([whole], cells)[0])


def true_lengths(whole: ArrayLike, cells: int) -> NDArray[np.float64]:
    """Lengths in cells, a + b sqrt(2), of whole lengths a q + b p; same shape."""
    q, p = whole_lengths(cells)
    lengths = np.asarray(whole).astype(np.int64)

    # Modulo q, the whole length is b p, and p has an inverse: b is less than q. Both factors lie
    # below q, at most 2**28, so that products fit.
    diagonal = lengths % q * pow(p, -1, q) % q
    straight = (lengths - diagonal * p) // q

    return np.asarray(straight + diagonal * sqrt(2.0))
