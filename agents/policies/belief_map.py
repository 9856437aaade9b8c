"""`BeliefMap`: what robots remember of the maps around them, from observation to observation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.scene_set import SceneSet
from irs_gym.mdp.packing import scaled_margin

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

UNKNOWN = np.float32(np.nan)


@dataclass(frozen=True, eq=False)
class BeliefMap:
    """Scaled margins over the target that n robots have seen, NaN where they have not looked.

    Attributes
    ----------
    margin
        float32, shape ``(n, X + 2r, Y + 2r)``: the map of each with a border as wide as its robot
        sees.
    radius
        r, cells that a robot sees in each direction.
    """

    margin: Floats
    radius: int

    @classmethod
    def nothing(cls, robots: int, shape: tuple[int, int], radius: int) -> "BeliefMap":
        """The memory of robots that have not looked yet, over maps of that shape (X, Y)."""
        border = 2 * radius
        return cls(np.full((robots, shape[0] + border, shape[1] + border), UNKNOWN), radius)

    @property
    def maps(self) -> Floats:
        """The maps without their border, ``(n, X, Y)``: a view."""
        inner = slice(self.radius, -self.radius or None)
        return self.margin[:, inner, inner]

    def forget(self, robots: NDArray[Any]) -> "BeliefMap":
        """Nothing seen by these robots."""
        margin = self.margin.copy()
        margin[robots] = UNKNOWN
        return BeliefMap(margin, self.radius)

    def look(self, cells: Ints, patches: Floats) -> "BeliefMap":
        """With the patches ``(n, 2r+1, 2r+1)`` around the robots' cells ``(n, 2)``."""
        margin = self.margin.copy()
        margin[windows(cells, self.radius)] = patches
        return BeliefMap(margin, self.radius)


def patches_of(pool: SceneSet, scenes: Ints, cells: Ints, radius: int) -> Floats:
    """What robots in cells ``(n, 2)`` of scenes ``(n,)`` see, ``(n, 2r+1, 2r+1)``, as the
    environment shows it.
    """
    return np.asarray(padded_margin(pool, scenes, radius)[windows(cells, radius)])


def padded_margin(pool: SceneSet, scenes: Any, radius: int) -> Floats:
    """Scaled margins of some scenes of a pool with a border as wide as a robot sees, ``(n, X + 2r,
    Y + 2r)``.
    """
    margin = scaled_margin(pool.gain_db[scenes], pool.target_db[scenes, None, None])  # (n, X, Y)

    # Off the map there is nothing but obstacles.
    border = ((0, 0), (radius, radius), (radius, radius))
    return np.pad(margin, border, constant_values=-1.0)


def windows(cells: Ints, radius: int) -> tuple[Ints, Ints, Ints]:
    """Where the patch around each cell ``(n, 2)`` stands in maps with a border, one map a cell:
    indices that make ``(n, 2r+1, 2r+1)``.
    """
    side = np.arange(2 * radius + 1)
    number = np.arange(len(cells))[:, None, None]  # (n, 1, 1)
    i = cells[:, 0, None, None] + side[:, None]  # (n, 2r+1, 1)
    j = cells[:, 1, None, None] + side  # (n, 1, 2r+1)

    return number, i, j
