"""The settings of explorers, which learn on many scenes from what one robot sees: by imitation, and
by PPO.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Literal

from agents.learning.map_configs import check_network_settings, check_proximal
from agents.single.config import check_settings

Device = Literal["cpu", "cuda", "auto"]


@dataclass(frozen=True, kw_only=True)
class RobotBatchConfig:
    """How n robots are sent out.

    Attributes
    ----------
    robots
        n, each in a scene of its own.
    patch_radius
        Cells that a robot sees in each direction.
    max_steps
        Steps after which it gives up.
    random_start
        Probability of a start drawn among the cells from which the goal can be reached.
    """

    robots: int
    patch_radius: int
    max_steps: int
    random_start: float


@dataclass(frozen=True, kw_only=True)
class ExplorerConfig:
    """Settings of the explorer: imitation with a memory of what was seen; the learning rate falls
    along a cosine.
    """

    algorithm: ClassVar[str] = "explorer"
    network_settings: ClassVar[tuple[str, ...]] = ("width",)

    weights: Path | None = None
    """Run folder, or file, of a trained network of the same settings to begin with; None to begin
    anew.
    """
    learning_rate: float = 2e-3
    """Learning rate at the start."""
    robots: int = 64
    """Robots on their ways at a time, each in a scene of its own."""
    max_steps: int = 400
    """Steps after which a robot gives up."""
    random_start: float = 0.3
    """Probability of a start drawn among the cells from which the goal can be reached."""
    patch_radius: int = 5
    """Cells that a robot sees in each direction."""
    width: int = 16
    """Channels of the network's hidden layers."""
    trust: float = 1.0
    """Share of what it has learned that it acts on; with 0 it is as before it has learned."""
    device: Device = "cpu"
    """Where the network learns: ``"auto"`` is a GPU where there is one. Robots move on the CPU."""
    total_timesteps: int = 384_000
    """Steps of the whole schedule, counted over all robots."""
    n_steps: int = 4
    """Mean number of steps of each robot between two updates."""
    guess_coef: float = 0.5
    """Weight of the error in the guess which unknown cells are feasible, beside the detours."""
    max_grad_norm: float = 1.0
    """Longest gradient, in the Euclidean norm; longer ones are cut."""

    def __post_init__(self) -> None:
        check_settings(self, "positive", "learning_rate")
        check_network_settings(self)
        check_settings(self, "whole", "robots", "max_steps", "patch_radius")
        check_settings(self, "share", "random_start", "trust")
        check_settings(self, "whole", "total_timesteps", "n_steps")
        check_settings(self, "positive", "max_grad_norm")
        check_settings(self, "weight", "guess_coef")

    @property
    def terms(self) -> RobotBatchConfig:
        """How the robots are sent out."""
        return _terms_of(self)


@dataclass(frozen=True, kw_only=True)
class ExplorerPpoConfig:
    """Settings of the explorer that learns by PPO; ``weights`` from imitation are optional."""

    algorithm: ClassVar[str] = "explorer_ppo"
    network_settings: ClassVar[tuple[str, ...]] = ("width",)

    weights: Path | None = None
    """Run folder, or file, of a trained network of the same settings to begin with; None to begin
    anew.
    """
    learning_rate: float = 3e-4
    """Learning rate at the start."""
    total_timesteps: int = 256_000
    """Steps of the whole schedule, counted over all robots."""
    n_epochs: int = 2
    """Passes over a rollout in an update."""
    final_learning_rate: float = 3e-5
    """Learning rate at the end of the schedule; it falls linearly."""
    gamma: float = 1.0
    """Discount factor: with 1, the critic's target is the length of the way itself."""
    gae_lambda: float = 0.95
    """Trade-off between bias and variance in the advantages."""
    ent_coef: float = 0.0
    """Weight of the entropy bonus at the start; it falls linearly to zero."""
    vf_coef: float = 0.05
    """Weight of the critic's error. The smaller it is, the more prices are learned from which moves
    were good, and the less from how long ways were."""
    clip_range: float = 0.2
    """Largest change of an action's probability ratio that is rewarded."""
    max_grad_norm: float = 0.5
    """Longest gradient, in the Euclidean norm; longer ones are cut."""
    robots: int = 64
    """Robots on their ways at a time, each in a scene of its own."""
    max_steps: int = 400
    """Steps after which a robot gives up."""
    random_start: float = 0.7
    """Probability of a start drawn among the cells from which the goal can be reached. From the
    scene's start alone, no robot comes upon the longer ways that would teach it what they are
    worth."""
    patch_radius: int = 5
    """Cells that a robot sees in each direction."""
    width: int = 16
    """Channels of the network's hidden layers."""
    trust: float = 1.0
    """Share of what it has learned that it acts on; with 0 it is as before it has learned."""
    device: Device = "cpu"
    """Where the network learns: ``"auto"`` is a GPU where there is one. Robots move on the CPU."""
    n_plans: int = 8
    """Plans of each robot between two updates."""
    plan_steps: int = 4
    """Steps that a robot takes by a plan before it makes a new one."""

    def __post_init__(self) -> None:
        check_settings(self, "positive", "learning_rate")
        check_network_settings(self)
        check_proximal(self)
        check_settings(self, "whole", "robots", "max_steps", "patch_radius")
        check_settings(self, "share", "random_start", "trust")
        check_settings(self, "whole", "n_plans", "plan_steps")

    @property
    def terms(self) -> RobotBatchConfig:
        """How the robots are sent out."""
        return _terms_of(self)


def _terms_of(config: Any) -> RobotBatchConfig:
    return RobotBatchConfig(
        **{each.name: getattr(config, each.name) for each in fields(RobotBatchConfig)}
    )
