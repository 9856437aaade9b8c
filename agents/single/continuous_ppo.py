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
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "log_std_init", "squash_output")
    env_settings: ClassVar[tuple[str, ...]] = ("max_episode_steps",)

    total_timesteps: int = 1_600_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 128
    """Environments that are stepped together."""
    max_episode_steps: int = 32
    """Steps after which a robot is set elsewhere in training: few, so that those that are stuck do
    not make most of what is learned from."""
    net_arch: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers of each network."""
    batch_size: int = 2048
    """Transitions in a minibatch; must divide n_envs x n_steps."""
    ent_coef: float = 0.0
    """Weight of the entropy bonus: none, so that headings spread ever less."""
    use_sde: bool = True
    """Whether the noise of actions is a function of what is seen (gSDE), so that a robot drifts one
    way for a while."""
    sde_sample_freq: int = 8
    """Steps between two draws of that function."""
    log_std_init: float = -2.0
    """Logarithm of the standard deviation of the noise at the start, for each feature with gSDE; it
    is learned."""
    squash_output: bool = True
    """Whether actions are squashed by tanh: a mean far beyond the bounds would be clipped, and not
    come back. Needs gSDE."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "max_episode_steps", "sde_sample_freq")
        if self.squash_output and not self.use_sde:
            raise ValueError("squash_output=True needs use_sde=True")
        if not isfinite(self.log_std_init):
            raise ValueError(f"log_std_init={self.log_std_init} must be a finite number")
