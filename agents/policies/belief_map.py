"""`BeliefMap`: what robots remember of the maps around them, from observation to observation."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.observation_decoding import unmasked
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
        """With the patches ``(n, 2r+1, 2r+1)`` around the cells ``(n, 2)`` that the robots are in."""
        margin = self.margin.copy()
        margin[_windows(cells, self.radius)] = patches
        return BeliefMap(margin, self.radius)


def patches_of(pool: SceneSet, scenes: Ints, cells: Ints, radius: int) -> Floats:
    """What robots in cells ``(n, 2)`` of scenes ``(n,)`` see, ``(n, 2r+1, 2r+1)``, as the
    environment shows it.
    """
    margin = scaled_margin(pool.gain_db[scenes], pool.target_db[scenes, None, None])
    padded = np.pad(margin, ((0, 0), (radius, radius), (radius, radius)), constant_values=-1.0)
    return np.asarray(padded[_windows(cells, radius)])


def parts_of(observation: Any) -> tuple[Floats, Floats]:
    """Patches ``(n, 2r+1, 2r+1)`` and settings of the IRS ``(n, 3)`` in one local observation or a
    batch.

    Raises
    ------
    ValueError
        Where the observation is no local one: a map, or flat with the phase shifts of `IrsNav-v0`
        between its parts.
    """
    observation = unmasked(observation)
    if isinstance(observation, Mapping):
        patches = np.asarray(observation["gain_patch"])
        settings = np.asarray(observation["irs"])[..., :3]
        return patches.reshape(-1, *patches.shape[-2:]), settings.reshape(-1, 3)

    flat = np.asarray(observation)
    side = isqrt(max(0, flat.shape[-1] - 7))
    if side**2 != flat.shape[-1] - 7 or side % 2 == 0:
        raise ValueError(
            f"observation has {flat.shape[-1]} numbers: a patch of (2r+1)**2, 3 settings of the IRS and 4 of the "
            "position are needed, as IrsNavRandom-v0 has them with observation='flat', and IrsNav-v0 with "
            "irs_phases=False"
        )

    rows = flat.reshape(-1, flat.shape[-1])

    return rows[:, : side**2].reshape(-1, side, side), rows[:, side**2 : side**2 + 3]


def _windows(cells: Ints, radius: int) -> tuple[Ints, Ints, Ints]:
    """Where the patch around each cell ``(n, 2)`` of a map of its own stands in maps with a border."""
    side = np.arange(2 * radius + 1)
    return (
        np.arange(len(cells))[:, None, None],
        cells[:, 0, None, None] + side[:, None],
        cells[:, 1, None, None] + side,
    )
