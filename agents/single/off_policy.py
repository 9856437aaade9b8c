"""`OffPolicyConfig`: the settings that learners from remembered headings have in common."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_schedule, check_settings, check_widths


@dataclass(frozen=True, kw_only=True)
class OffPolicyConfig:
    """Settings that Stable-Baselines3's SAC and TD3 share."""

    algorithm: ClassVar[str]
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch",)
    env_settings: ClassVar[tuple[str, ...]] = ("max_episode_steps",)

    total_timesteps: int = 80_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    learning_rate: float = 1e-3
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float = 1e-4
    """Learning rate at the end of the schedule."""
    gamma: float = 0.98
    """Discount factor."""
    max_episode_steps: int = 64
    """Steps after which a robot is set elsewhere in training: few, so that those that are stuck do
    not make most of what is learned from."""
    net_arch: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of each network."""
    signs: bool = False
    """Whether networks are also told which numbers of an observation are at least 0: which cells
    meet the target."""
    batch_size: int = 256
    """Transitions in a minibatch."""
    train_freq: int = 1
    """Steps of each environment between two updates."""
    gradient_steps: int = 16
    """Minibatches in an update."""
    buffer_size: int = 80_000
    """Transitions that are remembered."""
    learning_starts: int = 8_000
    """Steps before the first update."""
    tau: float = 0.01
    """Share of the networks that the target networks take over in an update."""

    def __post_init__(self) -> None:
        check_schedule(self)
        check_widths(self)
        check_settings(self, "whole", "batch_size", "train_freq", "gradient_steps", "buffer_size")
        check_settings(self, "whole", "max_episode_steps")
        check_settings(self, "share", "tau")
        if self.learning_starts < 0:
            raise ValueError(f"learning_starts={self.learning_starts} must not be negative")

        if self.buffer_size < self.n_envs:
            raise ValueError(
                f"buffer_size={self.buffer_size} must be at least n_envs = {self.n_envs}"
            )
