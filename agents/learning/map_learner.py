"""`MapLearner`: a network over maps that learns on a pool of scenes."""

from __future__ import annotations

from copy import deepcopy
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from torch import nn

from agents.learning.map_configs import MapAgentConfig, network_settings
from agents.networks.explorer import ExplorerNetwork
from agents.networks.map_network import FILE_BYTES, build_network, unpack_network
from agents.policies.explorer_policy import Explorer
from agents.policies.map_policy import MapPolicy
from agents.registry import ALGORITHMS, learner_class
from agents.runs.run_folder import Run
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.files import as_path, read_file

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
        self.teacher: Teacher = learner_class(config.algorithm)(
            config, first_network(config), np.random.default_rng(seed)
        )
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

            if self.logger is not None:
                for name, value in seen.items():
                    self.logger.record(f"train/{name}", value)

            is_going_on = callback.on_step()

        callback.on_training_end()

        return self

    @property
    def policy(self) -> MapPolicy | Explorer:
        """What acts by the network as it is now."""
        network = _on_cpu(self.teacher.network)
        settings = network_settings(self.config)
        if isinstance(network, ExplorerNetwork):
            trust: float = self.config.trust  # type: ignore[attr-defined]  # as explorers have it
            return Explorer(settings, network.tempered(trust))

        return MapPolicy(ALGORITHMS[self.config.algorithm].network_name, settings, network)

    def set_logger(self, logger: Logger) -> None:
        """Log to there from now on."""
        self.logger = logger

    def save(self, file: IO[bytes]) -> None:
        """Write the policy's file."""
        self.policy.save(file)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "pool": None}


def _on_cpu(network: nn.Module) -> nn.Module:
    """The network itself where it is on the CPU, else a copy there."""
    is_there = all(each.device.type == "cpu" for each in network.parameters())
    return network if is_there else deepcopy(network).cpu()


def first_network(config: MapAgentConfig) -> nn.Module:
    """The network to begin with; raises ``ValueError`` where ``weights`` do not fit."""
    name = ALGORITHMS[config.algorithm].network_name
    settings = network_settings(config)
    if config.weights is None:
        return build_network(name, settings)

    weights = as_path(config.weights, "weights")
    content = Run.open(weights).read_model() if weights.is_dir() else read_file(weights, FILE_BYTES)
    found_name, found_settings, network = unpack_network(content)
    if (found_name, found_settings) != (name, settings):
        raise ValueError(
            f"weights={str(config.weights)!r} hold {found_name} {found_settings}, "
            f"not {name} {settings}"
        )

    return network
