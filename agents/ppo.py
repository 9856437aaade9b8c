"""`PpoConfig`: the settings of proximal policy optimisation, and the model that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from gymnasium import spaces

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv


@dataclass(frozen=True)
class PpoConfig:
    """Settings of Stable-Baselines3's PPO under its own names; the defaults are the tuned ones.

    Raises ``ValueError`` where a value is out of its range; the message names the field.
    """

    algorithm: ClassVar[str] = "ppo"

    total_timesteps: int = 1_200_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    n_steps: int = 64
    """Steps of each environment between two updates."""
    batch_size: int = 1024
    """Transitions in a minibatch; must divide n_envs x n_steps."""
    n_epochs: int = 6
    """Passes over the transitions in an update."""
    learning_rate: float = 1e-3
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float = 5e-5
    """Learning rate at the end of the schedule."""
    gamma: float = 0.98
    """Discount factor: nearer to 1, failures far away drown what a detour of 2 % costs."""
    gae_lambda: float = 0.98
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float = 0.02
    """Weight of the entropy bonus: with less, the policy settles too early on a longer route."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""
    net_arch: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers, of policy and value function each."""

    def __post_init__(self) -> None:
        for name in ("total_timesteps", "n_envs", "n_steps", "n_epochs"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}={getattr(self, name)} must be a positive integer")
        if self.batch_size < 2 or self.n_envs * self.n_steps % self.batch_size:
            raise ValueError(
                f"batch_size={self.batch_size} must be 2 or more and divide n_envs * n_steps = "
                f"{self.n_envs} * {self.n_steps}, so that no minibatch is cut short"
            )
        for name in ("learning_rate", "final_learning_rate", "clip_range"):
            if not 0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name}={getattr(self, name)} must be a positive number")
        for name in ("gamma", "gae_lambda"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}={getattr(self, name)} must be a number from 0 to 1")
        if not 0 <= self.ent_coef < float("inf"):
            raise ValueError(f"ent_coef={self.ent_coef} must not be negative")
        if any(width < 1 for width in self.net_arch):
            raise ValueError(f"net_arch={self.net_arch} must hold positive widths")

    def build(self, env: VecEnv, seed: int) -> PPO:
        """The model, untrained. ``env`` should hold `n_envs` environments."""
        from stable_baselines3 import PPO
        from stable_baselines3.common.utils import LinearSchedule

        return PPO(
            "MultiInputPolicy" if isinstance(env.observation_space, spaces.Dict) else "MlpPolicy",
            env,
            learning_rate=LinearSchedule(self.learning_rate, self.final_learning_rate, 1.0),
            n_steps=self.n_steps,
            batch_size=self.batch_size,
            n_epochs=self.n_epochs,
            gamma=self.gamma,
            gae_lambda=self.gae_lambda,
            ent_coef=self.ent_coef,
            clip_range=self.clip_range,
            policy_kwargs={"net_arch": list(self.net_arch)},
            seed=seed,
            device="cpu",  # faster than a GPU for networks this small
        )
