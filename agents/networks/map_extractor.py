"""`MapExtractor`: a convolutional network that SB3's policies put in front of their own over the
map observation.
"""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

FEATURES = 256


class MapExtractor(BaseFeaturesExtractor):
    """Three convolutions, each on a grid twice as coarse, and a linear layer; SB3's own wants
    pictures of bytes.
    """

    def __init__(self, observation_space: spaces.Box, features_dim: int = FEATURES) -> None:
        super().__init__(observation_space, features_dim)
        layers: list[nn.Module] = []

        for channels, width in ((observation_space.shape[0], 16), (16, 32), (32, 32)):
            layers += [nn.Conv2d(channels, width, 3, stride=2, padding=1), nn.ReLU()]

        self.convolutions = nn.Sequential(*layers, nn.Flatten())
        with torch.no_grad():
            size = self.convolutions(torch.zeros(1, *observation_space.shape)).shape[1]

        self.linear = nn.Sequential(nn.Linear(size, features_dim), nn.ReLU())

    def forward(self, observations: Any) -> Tensor:
        """Features ``(B, D)`` of maps ``(B, 4, X, Y)``."""
        features: Tensor = self.linear(self.convolutions(observations))
        return features
