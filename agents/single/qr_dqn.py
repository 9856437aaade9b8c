"""`QrDqnConfig`: deep Q-learning of the quantiles of returns in place of their means."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.dqn import DqnConfig


@dataclass(frozen=True, kw_only=True)
class QrDqnConfig(DqnConfig):
    """Settings of sb3-contrib's QR-DQN: those of DQN, and the number of quantiles."""

    algorithm: ClassVar[str] = "qr_dqn"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "n_quantiles")

    n_quantiles: int = 20
    """Quantiles of each action's return."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "n_quantiles")
