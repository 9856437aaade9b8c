"""The settings of algorithms of Stable-Baselines3 and sb3-contrib that learn in
`IrsNavRandom-v0`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from agents.single.config import check_settings
from agents.single.ppo import PpoConfig


@dataclass(frozen=True, kw_only=True)
class LocalPpoConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO over many scenes, which sees the patch around the robot
    and forgets it.
    """

    algorithm: ClassVar[str] = "local_ppo"
    env_settings: ClassVar[tuple[str, ...]] = (*PpoConfig.env_settings, "random_start")

    total_timesteps: int = 20_000_000
    n_envs: int = 256
    gamma: float = 0.98
    batch_size: int = 4096
    ent_coef: float = 0.01
    final_ent_coef: float | None = 0.001
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_of_many_scenes(self)


@dataclass(frozen=True, kw_only=True)
class RecurrentPpoConfig(PpoConfig):
    """Settings of sb3-contrib's RecurrentPPO over many scenes: what it has seen is in the state of
    an LSTM.
    """

    algorithm: ClassVar[str] = "recurrent_ppo"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "lstm_hidden_size")
    env_settings: ClassVar[tuple[str, ...]] = (*PpoConfig.env_settings, "random_start")

    total_timesteps: int = 10_000_000
    n_envs: int = 256
    gamma: float = 0.98
    net_arch: tuple[int, ...] = (128,)
    batch_size: int = 4096
    n_epochs: int = 3
    ent_coef: float = 0.01
    final_ent_coef: float | None = 0.001
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""
    lstm_hidden_size: int = 128
    """Numbers in the state of the LSTM."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_of_many_scenes(self)


@dataclass(frozen=True, kw_only=True)
class MapPpoConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO over many scenes, with a convolutional network over the
    whole map.
    """

    algorithm: ClassVar[str] = "map_ppo"
    env_settings: ClassVar[tuple[str, ...]] = (*PpoConfig.env_settings, "random_start")

    total_timesteps: int = 200_000
    learning_rate: float = 5e-4
    gamma: float = 0.98
    n_epochs: int = 3
    ent_coef: float = 0.01
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_of_many_scenes(self)


def _check_of_many_scenes(settings: LocalPpoConfig | RecurrentPpoConfig | MapPpoConfig) -> None:
    """Raise a ``ValueError`` that names what is out of its range."""
    check_settings(settings, "share", "random_start")
    if settings.signs:
        raise ValueError(
            f"signs=True is for agents of one scene: {settings.algorithm} has a way of its own to "
            "read what it observes"
        )
