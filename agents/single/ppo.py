"""`PpoConfig`: the settings of proximal policy optimisation, and the model that they make."""

from dataclasses import dataclass
from typing import ClassVar

from agents.registry import Algorithm
from agents.single.config import NetworkConfig


@dataclass(frozen=True, kw_only=True)
class PpoConfig(NetworkConfig):
    """Settings of Stable-Baselines3's PPO."""

    algorithm: ClassVar[Algorithm] = "ppo"

    total_timesteps: int = 2_400_000
    learning_rate: float = 1e-3
    final_learning_rate: float = 5e-5
    gamma: float = 0.98
    """Discount factor: nearer to 1, failures far away drown what a detour of 2 % costs."""
    net_arch: tuple[int, ...] = (128, 128)
    n_steps: int = 64
    """Steps of each environment between two updates."""
    batch_size: int = 1024
    """Transitions in a minibatch; must divide n_envs x n_steps."""
    n_epochs: int = 6
    """Passes over the transitions in an update."""
    gae_lambda: float = 0.98
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float = 0.05
    """Weight of the entropy bonus: with less, the policy may settle on a route that is a little too
    long.
    """
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_whole("n_steps", "n_epochs")
        self._check_positive("clip_range")
        self._check_share("gae_lambda")
        if self.batch_size < 2 or self.n_envs * self.n_steps % self.batch_size:
            raise ValueError(
                f"batch_size={self.batch_size} must be 2 or more and divide n_envs * n_steps = "
                f"{self.n_envs} * {self.n_steps}, so that no minibatch is cut short"
            )
        if not 0 <= self.ent_coef < float("inf"):
            raise ValueError(f"ent_coef={self.ent_coef} must not be negative")
