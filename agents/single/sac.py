"""`SacConfig`: the settings of the soft actor-critic."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.off_policy import OffPolicyConfig


@dataclass(frozen=True, kw_only=True)
class SacConfig(OffPolicyConfig):
    """Settings of Stable-Baselines3's SAC, whose weight of the entropy is learned."""

    algorithm: ClassVar[str] = "sac"

    target_entropy: float = -4.0
    """Entropy of actions that the weight is learned to keep: below -2, one a dimension, they spread
    less."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "finite", "target_entropy")
