"""`ahead`: the values of the cells that the eight moves lead to."""

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVES

Floats = NDArray[np.float64]


def ahead(values: Floats) -> Floats:
    """Values ``(X, Y)`` of the cells that the eight moves lead to, shape ``(X, Y, 8)``; +inf off
    the map.
    """
    columns, rows = values.shape
    padded = np.pad(values, 1, constant_values=np.inf)
    return np.stack(
        [padded[1 + di : columns + 1 + di, 1 + dj : rows + 1 + dj] for di, dj in MOVES], axis=-1
    )
