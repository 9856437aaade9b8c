"""`ContinuousPpoConfig`: the settings of proximal policy optimisation for headings."""

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.ppo import PpoConfig


@dataclass(frozen=True, kw_only=True)
class ContinuousPpoConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO where actions are two numbers, drawn about their mean."""

    algorithm: ClassVar[str] = "continuous_ppo"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "log_std_init")

    total_timesteps: int = 3_000_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 256
    """Environments that are stepped together."""
    max_episode_steps: int = 64
    """Steps after which a robot is set elsewhere in training."""
    final_random_start: float = 0.1
    """Probability of a drawn start in the second half of the schedule, where it is below that of
    the first half, ``random_start`` of the environment: when the side of each obstacle is settled,
    robots go the scene's own way again and again, and learn how closely it can be gone."""
    learning_rate: float = 2e-3
    """Learning rate at the start; it falls linearly."""
    final_learning_rate: float = 2e-5
    """Learning rate at the end of the schedule: where actions hardly spread, larger steps lead a
    policy away from the shortest path again."""
    net_arch: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers of each network."""
    n_steps: int = 32
    """Steps of each environment between two updates."""
    n_epochs: int = 4
    """Passes over the transitions in an update."""
    gae_lambda: float = 0.95
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float = 0.0
    """Weight of the entropy bonus: none, where the schedule says how far actions spread."""
    log_std_init: float = 0.4
    """Logarithm of the standard deviation of actions at the start; it falls linearly. Wide enough
    that actions in all directions go on being drawn until the way round each obstacle is settled:
    later no policy changes sides, since the headings between the two lead into the obstacle."""
    final_log_std: float = -4.0
    """That at the end of the schedule: who is drawn aside beside a wall loses a step there, so that
    a policy keeps away from walls as far as its actions spread."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "share", "final_random_start")
        check_settings(self, "log_std", "log_std_init", "final_log_std")
