"""`MaskablePpoConfig`: PPO that is told which moves are refused, and never draws one."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.ppo import PpoConfig


@dataclass(frozen=True, kw_only=True)
class MaskablePpoConfig(PpoConfig):
    """Settings of sb3-contrib's MaskablePPO: those of PPO."""

    algorithm: ClassVar[str] = "maskable_ppo"
