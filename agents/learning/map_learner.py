"""`MapLearner`: a network over maps that learns on a pool of scenes."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from torch import nn

from agents.learning.map_configs import MapAgentConfig
from agents.policies.explorer_policy import Explorer
from agents.policies.map_policy import MapPolicy
from irs_gym.datasets.scene_set import SceneSet

if TYPE_CHECKING:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger


class Teacher(Protocol):
    """What improves a network: imitation, or reinforcement learning."""

    network: nn.Module

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """Improve it once, with ``progress`` in [0, 1] through the schedule; returns steps taken,
        and what to log.
        """
        ...


class MapLearner:
    """Has the methods of a model of Stable-Baselines3 that training asks for.

    Attributes
    ----------
    pool
        What is learned on; not kept in a checkpoint, but handed in anew.
    num_timesteps
        Steps so far, in what the teacher counts.
    """

    def __init__(self, config: MapAgentConfig, pool: SceneSet, seed: int) -> None:
        torch.manual_seed(seed)
        self.config = config
        self.pool = pool
        self.num_timesteps = 0
        self.teacher = config.teacher(config.build_network(), np.random.default_rng(seed))
        self.logger: Logger | None = None

    def learn(
        self, total_timesteps: int, callback: BaseCallback, reset_num_timesteps: bool = True
    ) -> MapLearner:
        """Train for so many steps, on top of those so far unless ``reset_num_timesteps``."""
        self.num_timesteps = 0 if reset_num_timesteps else self.num_timesteps
        end = self.num_timesteps + total_timesteps
        callback.init_callback(self)  # type: ignore[arg-type]  # asks for no more than there is here
        callback.on_training_start({"total_timesteps": end}, {})
        is_going_on = True

        while is_going_on and self.num_timesteps < end:
            callback.on_rollout_start()
            self.teacher.network.train()
            steps, seen = self.teacher.update(
                self.pool, min(1.0, self.num_timesteps / self.config.total_timesteps)
            )
            self.num_timesteps += steps

            for name, value in seen.items() if self.logger else ():
                self.logger.record(f"train/{name}", value)

            is_going_on = callback.on_step()

        callback.on_training_end()

        return self

    @property
    def policy(self) -> MapPolicy | Explorer:
        """What acts by the network as it is now."""
        network = self.teacher.network
        name = self.config.network
        shape = self.config.shape

        return Explorer(shape, network) if name == "explorer" else MapPolicy(name, shape, network)

    def set_logger(self, logger: Logger) -> None:
        """Log to there from now on."""
        self.logger = logger

    def save(self, file: IO[bytes]) -> None:
        """Write the policy's file."""
        self.policy.save(file)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "pool": None}
