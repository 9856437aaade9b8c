"""`BoundedPolicy`: the policy of Stable-Baselines3's PPO, whose mean action keeps to the bounds."""

from typing import Any

from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn


class BoundedPolicy(ActorCriticPolicy):
    """Its mean is a tanh: one far beyond the bounds would be clipped to them, and so would all that
    is drawn about it, which leaves nothing to learn from. How far actions spread is not learned:
    the schedule says it.
    """

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Sequential(self.action_net, nn.Tanh())
        self.log_std.requires_grad_(False)
