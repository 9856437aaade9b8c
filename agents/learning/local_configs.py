"""The settings of what learns on many scenes from what one robot sees: by imitation, and by
algorithms of SB3.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from agents.learning.map_configs import MapAgentConfig, ProximalConfig
from agents.learning.robot_batch import RobotBatchConfig
from agents.registry import Algorithm, Generalist, NetworkName
from agents.single.config import check_settings
from agents.single.ppo import PpoConfig

if TYPE_CHECKING:
    from gymnasium import spaces
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
    from torch import nn

    from agents.learning.map_learner import Teacher


@dataclass(frozen=True, kw_only=True)
class ExplorerAgentConfig(MapAgentConfig):
    """Settings of every explorer, and of the robots that it learns with."""

    network: ClassVar[NetworkName] = "explorer"
    network_settings: ClassVar[tuple[str, ...]] = ("width",)

    robots: int = 64
    """Robots on their ways at a time, each in a scene of its own."""
    max_steps: int = 400
    """Steps after which a robot gives up."""
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""
    patch_radius: int = 5
    """Cells that a robot sees in each direction."""
    width: int = 8
    """Channels on the map's own grid."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "robots", "max_steps", "patch_radius")
        check_settings(self, "share", "random_start")

    @property
    def terms(self) -> RobotBatchConfig:
        """How the robots are sent out."""
        return RobotBatchConfig(
            **{each.name: getattr(self, each.name) for each in fields(RobotBatchConfig)}
        )


@dataclass(frozen=True, kw_only=True)
class ExplorerConfig(ExplorerAgentConfig):
    """Settings of the explorer: imitation with a memory of what was seen; the learning rate falls
    along a cosine.
    """

    algorithm: ClassVar[Generalist] = "explorer"

    total_timesteps: int = 192_000
    """Steps of the whole schedule, counted over all robots."""
    learning_rate: float = 2e-3
    n_steps: int = 4
    """Mean number of steps of each robot between two updates."""
    guess_coef: float = 0.5
    """Weight of the error in the guess which unknown cells are feasible, beside the detours."""
    max_grad_norm: float = 1.0
    """Longest gradient, in the Euclidean norm; longer ones are cut."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "total_timesteps", "n_steps")
        check_settings(self, "positive", "max_grad_norm")
        if not 0 <= self.guess_coef < float("inf"):
            raise ValueError(f"guess_coef={self.guess_coef} must not be negative")

    def teacher(self, network: nn.Module, rng: np.random.Generator) -> Teacher:
        """The oracle, on the explorer's own ways."""
        from agents.learning.dagger import Dagger

        return Dagger(self, network, rng)


@dataclass(frozen=True, kw_only=True)
class ExplorerPpoConfig(ExplorerAgentConfig, ProximalConfig):
    """Settings of the explorer that learns by PPO; ``weights`` from imitation are optional."""

    algorithm: ClassVar[Generalist] = "explorer_ppo"

    total_timesteps: int = 200_000
    random_start: float = 0.7
    """Probability of a start drawn among the cells from which the goal can be reached. From the
    scene's start alone, no robot comes upon the longer ways that would teach it what they are
    worth."""
    n_plans: int = 8
    """Plans of each robot between two updates."""
    plan_steps: int = 4
    """Steps that a robot takes by a plan before it makes a new one."""
    n_epochs: int = 2
    learning_rate: float = 5e-4
    final_learning_rate: float = 5e-5
    gamma: float = 1.0
    """Discount factor: with 1, the critic's target is the length of the way itself."""
    ent_coef: float = 0.0
    vf_coef: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "n_plans", "plan_steps")

    def teacher(self, network: nn.Module, rng: np.random.Generator) -> Teacher:
        """PPO alone: it asks no oracle."""
        from agents.learning.explorer_ppo import ExplorerPpo

        return ExplorerPpo(self, network, rng)


@dataclass(frozen=True, kw_only=True)
class Sb3PpoConfig(PpoConfig):
    """Settings of an algorithm of SB3 that learns in `IrsNavRandom-v0`."""

    algorithm: ClassVar[Algorithm | Generalist]
    env_settings: ClassVar[tuple[str, ...]] = ("random_start",)

    gamma: float = 0.98
    ent_coef: float = 0.01
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_share("random_start")

    def policy_kwargs(self) -> dict[str, Any]:
        """With the extractor in front of the networks."""
        return {**super().policy_kwargs(), "features_extractor_class": self.extractor()}

    def extractor(self) -> type[BaseFeaturesExtractor]:
        """What reads the observation."""
        from agents.networks.local_extractor import LocalExtractor

        return LocalExtractor


@dataclass(frozen=True, kw_only=True)
class LocalPpoConfig(Sb3PpoConfig):
    """Settings of Stable-Baselines3's PPO over many scenes, which sees the patch around the robot
    and forgets it.
    """

    algorithm: ClassVar[Algorithm | Generalist] = "local_ppo"

    total_timesteps: int = 2_000_000


@dataclass(frozen=True, kw_only=True)
class RecurrentPpoConfig(Sb3PpoConfig):
    """Settings of sb3-contrib's RecurrentPPO over many scenes: what it has seen is in the state of
    an LSTM.
    """

    algorithm: ClassVar[Algorithm | Generalist] = "recurrent_ppo"
    policy_settings: ClassVar[tuple[str, ...]] = ("net_arch", "lstm_hidden_size")

    total_timesteps: int = 300_000
    net_arch: tuple[int, ...] = (128,)
    batch_size: int = 2048
    n_epochs: int = 4
    lstm_hidden_size: int = 128
    """Numbers in the state of the LSTM."""

    def policy_name(self, space: spaces.Space[Any]) -> str:
        """An LSTM in front of the networks."""
        return "MlpLstmPolicy"

    def features(self, width: int) -> int:
        """The state of the LSTM."""
        return self.lstm_hidden_size


@dataclass(frozen=True, kw_only=True)
class MapPpoConfig(Sb3PpoConfig):
    """Settings of Stable-Baselines3's PPO over many scenes, with a convolutional network over the
    whole map.
    """

    algorithm: ClassVar[Algorithm | Generalist] = "map_ppo"

    total_timesteps: int = 200_000
    n_epochs: int = 3
    learning_rate: float = 5e-4

    def extractor(self) -> type[BaseFeaturesExtractor]:
        """What reads the map."""
        from agents.networks.map_extractor import MapExtractor

        return MapExtractor

    def features(self, width: int) -> int:
        """What the convolutions make of the map."""
        from agents.networks.map_extractor import FEATURES

        return FEATURES
