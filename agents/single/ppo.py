"""`PpoConfig`: the settings of proximal policy optimisation."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_schedule, check_settings, check_widths


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Settings of Stable-Baselines3's PPO."""

    algorithm: ClassVar[str] = "ppo"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch",)
    env_settings: ClassVar[tuple[str, ...]] = ("max_episode_steps",)

    total_timesteps: int = 2_400_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    max_episode_steps: int = 400
    """Steps after which a robot is set elsewhere in training; with ``random_start``, the fewer, the
    more evenly robots are spread over the floor, and the sooner a way is found that chance alone
    hardly ever takes."""
    learning_rate: float = 1e-3
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float = 5e-5
    """Learning rate at the end of the schedule."""
    gamma: float = 0.98
    """Discount factor: nearer to 1, failures far away drown what a detour of 2 % costs."""
    net_arch: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of each network."""
    signs: bool = False
    """Whether networks are also told which numbers of an observation are at least 0: which cells
    and configurations meet the target."""
    mask_head: bool = False
    """Whether one learned weight times the action mask is added to the scores of actions; needs
    ``observation="masked"``."""
    n_steps: int = 64
    """Steps of each environment between two updates."""
    batch_size: int = 1024
    """Transitions in a minibatch; must divide n_envs x n_steps."""
    n_epochs: int = 6
    """Passes over the transitions in an update."""
    gae_lambda: float = 0.98
    """Trade-off between bias and variance in the advantages."""
    normalize_advantage: bool = True
    """Whether advantages are divided by their spread in a minibatch. As a policy settles, that
    spread falls, and the entropy bonus weighs ever less against a metre; without it the bonus keeps
    its worth, and an action that would save something goes on being tried.
    """
    ent_coef: float = 0.05
    """Weight of the entropy bonus: with less, the policy may settle on a route that is a little too
    long. In metres where advantages are not normalised.
    """
    final_ent_coef: float | None = None
    """Weight of the entropy bonus at the end of the schedule, to which it falls linearly; None
    where it stays as it is."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""

    def __post_init__(self) -> None:
        check_schedule(self)
        check_widths(self)
        check_settings(self, "whole", "max_episode_steps", "n_steps", "n_epochs")
        check_settings(self, "positive", "clip_range")
        check_settings(self, "share", "gae_lambda")
        if self.batch_size < 2 or self.n_envs * self.n_steps % self.batch_size:
            raise ValueError(
                f"batch_size={self.batch_size} must be 2 or more and divide n_envs * n_steps = "
                f"{self.n_envs} * {self.n_steps}, so that no minibatch is cut short"
            )
        check_settings(self, "weight", "ent_coef")
        if self.final_ent_coef is not None:
            check_settings(self, "weight", "final_ent_coef")
