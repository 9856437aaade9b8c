"""The settings of networks that learn on many scenes and see the whole map: each a frozen
dataclass, made by `ImitationConfig` or `WholeMapPpoConfig`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from agents.registry import Encoding
from agents.single.config import check_settings


class MapAgentConfig(Protocol):
    """What the settings of all networks that learn on many scenes have in common."""

    algorithm: ClassVar[str]
    network_settings: ClassVar[tuple[str, ...]]
    """Fields that are handed on to the network."""

    @property
    def weights(self) -> Path | None:
        """Run folder, or file, of a trained network of the same settings to begin with."""
        ...

    @property
    def total_timesteps(self) -> int:
        """Length of the schedule in what the learner counts."""
        ...


class ProximalConfig(Protocol):
    """What PPO of our own reads of its settings."""

    @property
    def learning_rate(self) -> float: ...  # noqa: D102
    @property
    def final_learning_rate(self) -> float: ...  # noqa: D102
    @property
    def ent_coef(self) -> float: ...  # noqa: D102
    @property
    def vf_coef(self) -> float: ...  # noqa: D102
    @property
    def clip_range(self) -> float: ...  # noqa: D102


def network_settings(config: MapAgentConfig) -> dict[str, Any]:
    """What makes the network of these settings."""
    return {name: getattr(config, name) for name in config.network_settings}


def check_network_settings(config: MapAgentConfig) -> None:
    """Raise a ``ValueError`` that names a size of the network that is no positive integer."""
    sizes = [name for name, each in network_settings(config).items() if isinstance(each, int)]
    check_settings(config, "whole", *sizes)


def check_proximal(config: ProximalConfig) -> None:
    """Raise a ``ValueError`` that names a setting of PPO that is out of its range."""
    check_settings(config, "whole", "total_timesteps", "n_epochs")
    check_settings(config, "positive", "final_learning_rate", "clip_range", "max_grad_norm")
    check_settings(config, "share", "gamma", "gae_lambda")
    check_settings(config, "weight", "ent_coef", "vf_coef")


@dataclass(frozen=True, kw_only=True)
class ImitationConfig:
    """Settings of imitation with Adam; the learning rate falls to zero along a cosine."""

    algorithm: ClassVar[str]
    network_settings: ClassVar[tuple[str, ...]]

    weights: Path | None = None
    """Run folder, or file, of a trained network of the same settings to begin with; None to begin
    anew.
    """
    learning_rate: float = 4e-3
    """Learning rate at the start."""
    total_scenes: int
    """Scenes of the whole schedule, counted as often as they are seen."""
    batch_scenes: int = 16
    """Scenes in a batch: each gives a label for every cell from which its goal can be reached."""
    to_go_coef: float = 0.0
    """Weight of the error in the estimated way to go, in units of 40 cells, beside that of the
    moves.
    """
    max_grad_norm: float = 1.0
    """Longest gradient, in the Euclidean norm; longer ones are cut."""

    def __post_init__(self) -> None:
        check_settings(self, "positive", "learning_rate")
        check_network_settings(self)
        check_settings(self, "whole", "total_scenes", "batch_scenes")
        check_settings(self, "positive", "max_grad_norm")
        check_settings(self, "weight", "to_go_coef")

    @property
    def total_timesteps(self) -> int:
        """Scenes of the whole schedule."""
        return self.total_scenes


@dataclass(frozen=True, kw_only=True)
class PlannerConfig(ImitationConfig):
    """Settings of the planning network that learns by imitation."""

    algorithm: ClassVar[str] = "planner"
    network_settings: ClassVar[tuple[str, ...]] = ("encoding", "width")

    total_scenes: int = 9_600
    encoding: Encoding = "mask"
    """What the costs are learned from: the ready "mask" of feasible cells, or the "margin" in dB
    over the target.
    """
    width: int = 16
    """Channels of the network that gives the costs."""


@dataclass(frozen=True, kw_only=True)
class UNetConfig(ImitationConfig):
    """Settings of the U-Net that learns by imitation."""

    algorithm: ClassVar[str] = "unet"
    network_settings: ClassVar[tuple[str, ...]] = ("width", "passes")

    total_scenes: int = 60_000
    learning_rate: float = 2e-3
    to_go_coef: float = 0.5
    width: int = 16
    """Channels on the map's own grid."""
    passes: int = 6
    """Times that the network's core is passed."""


@dataclass(frozen=True, kw_only=True)
class VinConfig(ImitationConfig):
    """Settings of the published value-iteration network that learns by imitation."""

    algorithm: ClassVar[str] = "vin"
    network_settings: ClassVar[tuple[str, ...]] = ("rounds", "actions", "width")

    total_scenes: int = 12_000
    learning_rate: float = 2e-3
    rounds: int = 60
    """Rounds of value iteration."""
    actions: int = 10
    """Abstract actions."""
    width: int = 150
    """Channels of the network that gives the rewards."""


@dataclass(frozen=True, kw_only=True)
class WholeMapPpoConfig:
    """Settings of PPO by scene, for networks that answer for all cells of a map."""

    algorithm: ClassVar[str]
    network_settings: ClassVar[tuple[str, ...]]

    weights: Path | None = None
    """Run folder, or file, of a trained network of the same settings to begin with; None to begin
    anew.
    """
    learning_rate: float = 4e-3
    """Learning rate at the start."""
    total_timesteps: int
    """Steps of the whole schedule, counted over all robots."""
    n_epochs: int = 4
    """Passes over a rollout in an update."""
    final_learning_rate: float = 2e-4
    """Learning rate at the end of the schedule; it falls linearly."""
    gamma: float = 0.99
    """Discount factor."""
    gae_lambda: float = 0.95
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float = 0.02
    """Weight of the entropy bonus at the start; it falls linearly to zero."""
    vf_coef: float = 0.5
    """Weight of the critic's error."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""
    max_grad_norm: float = 0.5
    """Longest gradient, in the Euclidean norm; longer ones are cut."""
    scenes: int = 16
    """Scenes in a rollout."""
    robots: int = 16
    """Robots in each, with random starts."""
    n_steps: int = 32
    """Steps of each robot between two updates."""

    def __post_init__(self) -> None:
        check_settings(self, "positive", "learning_rate")
        check_network_settings(self)
        check_proximal(self)
        check_settings(self, "whole", "scenes", "robots", "n_steps")


@dataclass(frozen=True, kw_only=True)
class PlannerPpoConfig(WholeMapPpoConfig):
    """Settings of the planning network that learns by PPO alone."""

    algorithm: ClassVar[str] = "planner_ppo"
    network_settings: ClassVar[tuple[str, ...]] = ("encoding", "width")

    total_timesteps: int = 1_000_000
    encoding: Encoding = "mask"
    """What the costs are learned from: the ready "mask" of feasible cells, or the "margin" in dB
    over the target.
    """
    width: int = 16
    """Channels of the network that gives the costs."""


@dataclass(frozen=True, kw_only=True)
class UNetPpoConfig(WholeMapPpoConfig):
    """Settings of the U-Net that learns by PPO; give it ``weights`` from imitation to begin
    with.
    """

    algorithm: ClassVar[str] = "unet_ppo"
    network_settings: ClassVar[tuple[str, ...]] = ("width", "passes")

    total_timesteps: int = 1_000_000
    learning_rate: float = 3e-4
    final_learning_rate: float = 3e-5
    ent_coef: float = 0.005
    width: int = 16
    """Channels on the map's own grid."""
    passes: int = 6
    """Times that the network's core is passed."""
