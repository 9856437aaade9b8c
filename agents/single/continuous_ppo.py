"""`ContinuousPpoConfig`: the settings of proximal policy optimisation for headings."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.ppo import PpoConfig


@dataclass(frozen=True, kw_only=True)
class ContinuousPpoConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO where actions are two numbers, drawn about their mean."""

    algorithm: ClassVar[str] = "continuous_ppo"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "log_std_init")
    env_settings: ClassVar[tuple[str, ...]] = ("max_episode_steps",)

    total_timesteps: int = 1_600_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 128
    """Environments that are stepped together."""
    max_episode_steps: int = 64
    """Steps after which a robot is set elsewhere in training: few, so that those that are stuck do
    not make most of what is learned from."""
    net_arch: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers of each network."""
    n_steps: int = 32
    """Steps of each environment between two updates."""
    batch_size: int = 512
    """Transitions in a minibatch; must divide n_envs x n_steps."""
    n_epochs: int = 8
    """Passes over the transitions in an update."""
    gae_lambda: float = 0.95
    """Trade-off between bias and variance in the advantages."""
    signs: bool = True
    """Whether networks are also told which numbers of an observation are at least 0: which cells
    meet the target."""
    ent_coef: float = 0.02
    """Weight of the entropy bonus at the start; it falls linearly, so that headings spread ever
    less."""
    final_ent_coef: float | None = 0.0
    log_std_init: float = -0.5
    """Logarithm of the standard deviation of actions at the start; it is learned."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "max_episode_steps")
        if not isfinite(self.log_std_init):
            raise ValueError(f"log_std_init={self.log_std_init} must be a finite number")
