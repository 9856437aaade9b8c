"""`MaskActorCriticPolicy` and `MaskDqnPolicy`: policies of Stable-Baselines3 that score actions
with a `MaskHead`.
"""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import CategoricalDistribution
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.dqn.policies import MultiInputPolicy, QNetwork
from torch import Tensor, nn

from agents.networks.mask_head import MaskHead, check_masked


class MaskActorCriticPolicy(MultiInputActorCriticPolicy):
    """That of PPO. Raises ``ValueError`` for observations without an action mask, which its
    features begin with.
    """

    action_space: spaces.Discrete

    def __init__(self, observation_space: spaces.Dict, *args: Any, **settings: Any) -> None:
        check_masked(observation_space)
        super().__init__(observation_space, *args, **settings)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _MaskKeeper(
            int(self.action_space.n),
            self.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        )

    def _build(self, lr_schedule: Any) -> None:
        self.action_dist = _MaskCategorical(int(self.action_space.n))
        super()._build(lr_schedule)


class MaskDqnPolicy(MultiInputPolicy):
    """That of DQN; likewise."""

    def __init__(self, observation_space: spaces.Dict, *args: Any, **settings: Any) -> None:
        check_masked(observation_space)
        super().__init__(observation_space, *args, **settings)

    def make_q_net(self) -> QNetwork:
        """The network of values, or that of targets."""
        network = super().make_q_net()
        head = MaskHead(network.q_net, int(network.action_space.n))
        network.q_net = nn.Sequential(head).to(self.device)

        return network


class _MaskKeeper(MlpExtractor):
    """Keeps the mask in front of what the policy's hidden layers make of the features."""

    def __init__(self, actions: int, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.actions = actions
        self.latent_dim_pi += actions

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        return torch.cat([features[:, : self.actions], super().forward_actor(features)], dim=1)


class _MaskCategorical(CategoricalDistribution):
    def proba_distribution_net(self, latent_dim: int) -> nn.Module:
        return MaskHead(super().proba_distribution_net(latent_dim), self.action_dim)
