"""What an observation tells: the cells of robot and goal, and which cells around the robot are
feasible.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import flat_cells

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def decode(observation: Any, shape: tuple[int, int]) -> tuple[Ints, Ints]:
    """Flat cells of the robot and of the goal that observations tell, one array each with the shape
    of the batch.

    Parameters
    ----------
    observation
        One observation or a batch, as a dict, flat, masked, or a map.
    shape
        Of the grid, ``(X, Y)``.

    Raises
    ------
    ValueError
        Where the observation is a cell alone, which tells no goal.
    """
    observation = unmasked(observation)
    if is_cell(observation):
        raise ValueError(
            "observation='cell' tells no goal: this policy needs 'dict', 'flat', 'masked' or 'map'"
        )

    if not isinstance(observation, Mapping) and observation.shape[-3:] == (4, *shape):
        ends = observation[..., 2:, :, :]
        flat = ends.reshape(*ends.shape[:-2], -1).argmax(axis=-1)
        return flat[..., 0], flat[..., 1]

    position = (
        observation["position"] if isinstance(observation, Mapping) else observation[..., -4:]
    )
    position = np.asarray(position, dtype=np.float64)
    robot = np.rint((position[..., :2] + 1.0) / 2.0 * shape - 0.5).astype(np.int64)
    goal = robot + np.rint(position[..., 2:] * shape).astype(np.int64)

    return flat_cells(robot, shape), flat_cells(goal, shape)


def seen_feasible(observation: Any, radius: int | None) -> Bools:
    """Which of the cells in view are at or above the target.

    Parameters
    ----------
    observation
        One observation or a batch.
    radius
        Of the patch in a dict, flat or masked observation, r; None for a map.

    Returns
    -------
    Shape ``(..., 2r+1, 2r+1)``, the robot in the middle; of a map ``(..., X, Y)``.
    """
    observation = unmasked(observation)
    if radius is None:
        margin = observation[..., 0, :, :]
    elif isinstance(observation, Mapping):
        margin = observation["gain_patch"]
    else:
        side = 2 * radius + 1
        margin = observation[..., : side**2].reshape(*observation.shape[:-1], side, side)

    return np.asarray(margin >= 0.0)


def is_cell(observation: Any) -> bool:
    """Whether an observation or a batch tells flat cells and nothing else."""
    return not isinstance(observation, Mapping) and np.issubdtype(
        np.asarray(observation).dtype, np.integer
    )


def unmasked(observation: Any) -> Any:
    """The flat observation beside an action mask; any other as it is."""
    is_masked = isinstance(observation, Mapping) and "action_mask" in observation
    return observation["observation"] if is_masked else observation
