"""`LocalExtractor`: what an observation of the patch tells, on scales that a small network can
read.
"""

from math import isqrt
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

FRAME = 40.0  # cells: sides of the frame that vectors to the goal are scaled to in most splits
SCALES = (1.0, 3.0, 10.0, 40.0)  # cells at which the vector to the goal is cut off


class LocalExtractor(BaseFeaturesExtractor):
    """Adds to a flat observation which cells in view are feasible, and the vector to the goal at
    several scales.

    As they are, a cell at the target and one just below it differ by nothing that could be seen,
    and so do the goal and the cells beside it. Nothing is learned here.
    """

    def __init__(self, observation_space: spaces.Box) -> None:
        width = observation_space.shape[0]
        self.cells = isqrt(width - 7) ** 2
        super().__init__(observation_space, width + self.cells + 2 * len(SCALES) + 2)

    def forward(self, observations: Any) -> Tensor:
        """Features ``(B, D)`` of flat observations ``(B, C)``."""
        to_goal = observations[:, -2:] * FRAME
        direction = to_goal / to_goal.norm(dim=1, keepdim=True).clamp(min=1.0)
        scaled = [(to_goal / scale).clamp(-1.0, 1.0) for scale in SCALES]
        is_feasible = (observations[:, : self.cells] >= 0).to(observations)

        return torch.cat([observations, is_feasible, direction, *scaled], dim=1)
