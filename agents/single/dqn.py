"""`DqnConfig`: the settings of deep Q-learning."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_schedule, check_settings, check_widths


@dataclass(frozen=True, kw_only=True)
class DqnConfig:
    """Settings of Stable-Baselines3's DQN."""

    algorithm: ClassVar[str] = "dqn"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch",)
    env_settings: ClassVar[tuple[str, ...]] = ("max_episode_steps",)

    total_timesteps: int = 150_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    max_episode_steps: int = 400
    """Steps after which a robot is set elsewhere in training; see `agents.single.ppo.PpoConfig`."""
    learning_rate: float = 1e-3
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float = 1e-5
    """Learning rate at the end of the schedule."""
    gamma: float = 0.98
    """Discount factor: nearer to 1, the values that a narrow choice must tell apart span a wider
    range.
    """
    net_arch: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of each network."""
    signs: bool = False
    """Whether networks are also told which numbers of an observation are at least 0: which cells
    and configurations meet the target."""
    mask_head: bool = False
    """Whether one learned weight times the action mask is added to the scores of actions; needs
    ``observation="masked"``."""
    n_steps: int = 1
    """Rewards that a return adds up before the value of the state thereafter: with more, random
    moves among them make narrow passages look worse than they are, and the agent settles on a
    longer route."""
    batch_size: int = 512
    """Transitions in a minibatch."""
    train_freq: int = 1
    """Steps of each environment between two updates."""
    gradient_steps: int = 4
    """Minibatches in an update."""
    buffer_size: int = 100_000
    """Transitions that are remembered."""
    learning_starts: int = 2_000
    """Steps before the first update."""
    target_update_interval: int = 1_280
    """Steps between two copies of the network to the target network."""
    exploration_initial_eps: float = 1.0
    """Probability of a random move at the start; it falls linearly."""
    exploration_final_eps: float = 0.05
    """Probability of a random move at the end of the fall and thereafter."""
    exploration_fraction: float = 0.3
    """Share of the schedule over which it falls."""

    def __post_init__(self) -> None:
        check_schedule(self)
        check_widths(self)
        check_settings(self, "whole", "max_episode_steps", "n_steps", "batch_size")
        check_settings(self, "whole", "train_freq", "gradient_steps")
        check_settings(self, "whole", "buffer_size", "target_update_interval")
        check_settings(
            self,
            "share",
            "exploration_initial_eps",
            "exploration_final_eps",
            "exploration_fraction",
        )
        if self.learning_starts < 0:
            raise ValueError(f"learning_starts={self.learning_starts} must not be negative")

        if self.buffer_size < self.n_envs * self.n_steps:
            raise ValueError(
                f"buffer_size={self.buffer_size} must be at least n_envs * n_steps = "
                f"{self.n_envs} * {self.n_steps}"
            )
