"""`BoundedPolicy`: the policy of Stable-Baselines3's PPO, whose mean action keeps to the disc of
radius 1.
"""

from typing import Any

from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor, nn


class BoundedPolicy(ActorCriticPolicy):
    """A mean far beyond the disc would be clipped to it, and so would all that is drawn about it,
    which leaves nothing to learn from. How far actions spread is not learned: the schedule says it.
    """

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = Disc(self.action_net)
        self.log_std.requires_grad_(False)


class Disc(nn.Module):
    """Points of a network ``(B, 2)``, those outside the unit disc moved to its border.

    A heading on the border turns as easily as any other. A tanh of each coordinate has corners,
    headings of 45 degrees, where both are flat: a policy that comes there does not turn again.
    """

    def __init__(self, points: nn.Module) -> None:
        super().__init__()
        self.points = points

    def forward(self, latent: Tensor) -> Tensor:  # noqa: D102
        points: Tensor = self.points(latent)
        length: Tensor = points.norm(dim=-1, keepdim=True)

        return points / length.clamp(min=1.0)
