"""The settings of networks that learn on many scenes: `MapAgentConfig`, and one for each that sees
the whole map.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from agents.registry import Encoding, Generalist, NetworkName
from agents.single.config import check_settings

if TYPE_CHECKING:
    from torch import nn

    from agents.learning.map_learner import MapLearner, Teacher
    from irs_gym.datasets.scene_set import SceneSet


@dataclass(frozen=True, kw_only=True)
class MapAgentConfig:
    """Settings of every learner whose network answers for all cells of a map; the defaults of each
    are the tuned ones.

    Each has ``total_timesteps``, the length of its schedule in what its `Teacher` counts.

    Raises ``ValueError`` where a value is out of its range; the message names the field.
    """

    algorithm: ClassVar[Generalist]
    network: ClassVar[NetworkName]
    network_settings: ClassVar[tuple[str, ...]]  # fields that are handed on to the network

    weights: Path | None = None
    """Run folder, or file, of a trained network of the same settings to begin with; None to begin
    anew.
    """
    learning_rate: float
    """Learning rate at the start."""

    def __post_init__(self) -> None:
        check_settings(self, "positive", "learning_rate")
        check_settings(
            self, "whole", *(name for name, value in self.shape.items() if isinstance(value, int))
        )

    def teacher(self, network: nn.Module, rng: np.random.Generator) -> Teacher:
        """What improves the network."""
        raise NotImplementedError

    @property
    def shape(self) -> dict[str, Any]:
        """Settings of the network."""
        return {name: getattr(self, name) for name in self.network_settings}

    def build(self, pool: SceneSet, seed: int) -> MapLearner:
        """The learner, untrained; raises ``ValueError`` where ``weights`` do not fit."""
        from agents.learning.map_learner import MapLearner

        return MapLearner(self, pool, seed)

    def build_network(self) -> nn.Module:
        """The network to begin with."""
        from agents.networks.map_network import build_network, unpack_network
        from agents.runs.run_folder import Run

        if self.weights is None:
            return build_network(self.network, self.shape)

        content = (
            Run.open(self.weights).read_model()
            if self.weights.is_dir()
            else self.weights.read_bytes()
        )
        name, shape, network = unpack_network(content)
        if (name, shape) != (self.network, self.shape):
            raise ValueError(
                f"weights={str(self.weights)!r} hold {name} {shape}, not {self.network} {self.shape}"
            )

        return network


@dataclass(frozen=True, kw_only=True)
class ImitationConfig(MapAgentConfig):
    """Settings of imitation with Adam; the learning rate falls to zero along a cosine."""

    learning_rate: float = 4e-3
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
        super().__post_init__()
        check_settings(self, "whole", "total_scenes", "batch_scenes")
        check_settings(self, "positive", "max_grad_norm")
        if not 0 <= self.to_go_coef < float("inf"):
            raise ValueError(f"to_go_coef={self.to_go_coef} must not be negative")

    @property
    def total_timesteps(self) -> int:
        """Scenes of the whole schedule."""
        return self.total_scenes

    def teacher(self, network: nn.Module, rng: np.random.Generator) -> Teacher:
        """The oracle."""
        from agents.learning.imitation import Imitation

        return Imitation(self, network, rng)


@dataclass(frozen=True, kw_only=True)
class ProximalConfig(MapAgentConfig):
    """Settings of PPO of our own, for networks that answer for all cells of a map."""

    total_timesteps: int
    """Steps of the whole schedule, counted over all robots."""
    n_epochs: int = 4
    """Passes over a rollout in an update."""
    final_learning_rate: float
    """Learning rate at the end of the schedule; it falls linearly."""
    gamma: float = 0.99
    """Discount factor."""
    gae_lambda: float = 0.95
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float
    """Weight of the entropy bonus at the start; it falls linearly to zero."""
    vf_coef: float = 0.5
    """Weight of the critic's error."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""
    max_grad_norm: float = 0.5
    """Longest gradient, in the Euclidean norm; longer ones are cut."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "total_timesteps", "n_epochs")
        check_settings(self, "positive", "final_learning_rate", "clip_range", "max_grad_norm")
        check_settings(self, "share", "gamma", "gae_lambda")

        for name in ("ent_coef", "vf_coef"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name}={getattr(self, name)} must not be negative")


@dataclass(frozen=True, kw_only=True)
class WholeMapPpoConfig(ProximalConfig):
    """Settings of PPO by scene."""

    scenes: int = 16
    """Scenes in a rollout."""
    robots: int = 16
    """Robots in each, with random starts."""
    n_steps: int = 32
    """Steps of each robot between two updates."""
    learning_rate: float = 4e-3
    final_learning_rate: float = 2e-4
    ent_coef: float = 0.02

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "scenes", "robots", "n_steps")

    def teacher(self, network: nn.Module, rng: np.random.Generator) -> Teacher:
        """PPO alone: it asks no oracle."""
        from agents.learning.whole_map_ppo import WholeMapPpo

        return WholeMapPpo(self, network, rng)


@dataclass(frozen=True, kw_only=True)
class PlannerConfig(ImitationConfig):
    """Settings of the planning network that learns by imitation."""

    algorithm: ClassVar[Generalist] = "planner"
    network: ClassVar[NetworkName] = "planner"
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

    algorithm: ClassVar[Generalist] = "unet"
    network: ClassVar[NetworkName] = "unet"
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

    algorithm: ClassVar[Generalist] = "vin"
    network: ClassVar[NetworkName] = "vin"
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
class PlannerPpoConfig(WholeMapPpoConfig):
    """Settings of the planning network that learns by PPO alone."""

    algorithm: ClassVar[Generalist] = "planner_ppo"
    network: ClassVar[NetworkName] = "planner"
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
    """Settings of the U-Net that learns by PPO; give it ``weights`` from imitation to begin with."""

    algorithm: ClassVar[Generalist] = "unet_ppo"
    network: ClassVar[NetworkName] = "unet"
    network_settings: ClassVar[tuple[str, ...]] = ("width", "passes")

    total_timesteps: int = 1_000_000
    learning_rate: float = 3e-4
    final_learning_rate: float = 3e-5
    ent_coef: float = 0.005
    width: int = 16
    """Channels on the map's own grid."""
    passes: int = 6
    """Times that the network's core is passed."""
