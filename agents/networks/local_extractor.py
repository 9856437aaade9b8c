"""`LocalExtractor`: what an observation of the patch tells, on scales that a small network can
read.
"""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

from irs_gym.mdp.packing import Packing

FRAME = 40  # cells: sides of the frame that vectors to the goal are scaled to in most splits
SCALES = (1.0, 3.0, 10.0, 40.0)  # cells at which the vector to the goal is cut off


class LocalExtractor(BaseFeaturesExtractor):
    """Adds to a flat observation which cells in view are feasible, and the vector to the goal at
    several scales.

    As they are, a cell at the target and one just below it differ by nothing that could be seen,
    and so do the goal and the cells beside it. Nothing is learned here.
    """

    def __init__(self, observation_space: spaces.Box) -> None:
        width = observation_space.shape[0]
        self.packing = Packing.of_width(width, (FRAME, FRAME))
        cells = self.packing.side**2
        super().__init__(observation_space, width + cells + 2 + 2 * len(SCALES))

    def forward(self, observations: Any) -> Tensor:
        """Features ``(B, D)`` of flat observations ``(B, C)``."""
        is_feasible = (observations[:, self.packing.patch] >= 0).to(observations)  # (B, (2r+1)**2)

        # In cells, as `irs_gym.mdp.packing.vectors_to_goal` has scaled them to the frame.
        to_goal = observations[:, self.packing.to_goal] * FRAME  # (B, 2)

        # Shorter than 1 at the goal alone, which has no direction.
        direction = to_goal / to_goal.norm(dim=1, keepdim=True).clamp(min=1.0)  # (B, 2)
        scaled = [(to_goal / scale).clamp(-1.0, 1.0) for scale in SCALES]

        return torch.cat([observations, is_feasible, direction, *scaled], dim=1)
