"""`Td3Config`: the settings of the twin delayed policy gradient."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.off_policy import OffPolicyConfig


@dataclass(frozen=True, kw_only=True)
class Td3Config(OffPolicyConfig):
    """Settings of Stable-Baselines3's TD3."""

    algorithm: ClassVar[str] = "td3"

    action_noise: float = 0.2
    """Standard deviation of what is added to actions in training."""
    target_policy_noise: float = 0.1
    """Standard deviation of what is added to the actions whose values are learned from: values near
    walls are those of a robot that strays so far."""
    target_noise_clip: float = 0.25
    """Most of that."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "weight", "action_noise", "target_policy_noise", "target_noise_clip")
