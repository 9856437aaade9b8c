"""`PlaceExtractor`: where the robot is, as waves over the floor."""

from math import pi
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

WAVES = 96
SPREAD = 4.0  # standard deviation of waves over half of the room, along each side
_POSITION = 4  # numbers: own position, and the vector to the goal


class PlaceExtractor(BaseFeaturesExtractor):
    """Random Fourier features of a robot's position on the floor, and the position itself with the
    vector to the goal. Nothing is learned here, and nothing else is read of the observation.

    On one map all that there is to know follows from the position. But of two numbers alone, a
    network learns to tell one side of a wall from the other very slowly; of sines and cosines, in
    random directions and of random lengths, at once (Rahimi and Recht, 2007, "Random features for
    large-scale kernel machines"; Tancik et al., 2020, "Fourier features let networks learn high
    frequency functions in low dimensional domains").
    """

    waves: Tensor

    def __init__(
        self,
        observation_space: spaces.Box | spaces.Dict,
        features_dim: int = _POSITION + 2 * WAVES,
    ) -> None:
        super().__init__(observation_space, features_dim)
        of_the_project = torch.Generator().manual_seed(0)
        waves = torch.randn(2, (features_dim - _POSITION) // 2, generator=of_the_project)
        self.register_buffer("waves", 2 * pi * SPREAD * waves)

    def forward(self, observations: Any) -> Tensor:
        """Features ``(B, D)`` of observations ``(B, C)``, or of dicts of such."""
        is_dict = isinstance(observations, dict)
        position = observations["position"] if is_dict else observations[:, -_POSITION:]
        phases = position[:, :2] @ self.waves  # (B, WAVES)

        return torch.cat([position, phases.sin(), phases.cos()], dim=1)
