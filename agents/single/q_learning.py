"""`QLearning`: tabular Q-learning over the cells, which no network should fall behind; and
`QLearningConfig`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.single.config import check_schedule, check_settings
from irs_gym.mdp.codebook_packing import own_states
from irs_gym.mdp.packing import Packing

if TYPE_CHECKING:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import VecEnv


@dataclass(frozen=True, kw_only=True)
class QLearningConfig:
    """Settings of tabular Q-learning."""

    algorithm: ClassVar[str] = "q_learning"

    total_timesteps: int = 400_000
    """Steps of the whole schedule, counted over all environments."""
    n_envs: int = 64
    """Environments that are stepped together."""
    learning_rate: float = 1.0
    """Weight of a new return against the old value, at the start; moves are certain here, so none
    need be averaged.
    """
    final_learning_rate: float = 1.0
    """The same at the end of the schedule."""
    gamma: float = 0.99
    """Discount factor."""
    exploration_initial_eps: float = 1.0
    """Probability of a random move at the start; it falls linearly."""
    exploration_final_eps: float = 0.1
    """Probability of a random move at the end of the schedule."""

    def __post_init__(self) -> None:
        check_schedule(self)
        check_settings(
            self,
            "share",
            "learning_rate",
            "final_learning_rate",
            "exploration_initial_eps",
            "exploration_final_eps",
        )


class QLearning:
    """Watkins's one-step Q-learning, with the methods of a model of Stable-Baselines3.

    Attributes
    ----------
    table
        Values of the eight actions in each flat cell, shape ``(X * Y, 8)``, for the one goal of its
        environment; where the panel has K configurations, of all actions in each state, shape ``(K
        * X * Y, 8 + K)``.
    num_timesteps
        Steps trained so far, over all environments.
    """

    def __init__(
        self,
        table: NDArray[np.float64],
        shape: tuple[int, int],
        config: QLearningConfig | None = None,
        env: VecEnv | None = None,
        seed: int | None = None,
    ) -> None:
        """Hold a table for a grid of that shape; without ``env``, for predictions only."""
        self.table = table
        self.shape = shape
        self.config = config or QLearningConfig()
        self.num_timesteps = 0
        self.logger: Logger | None = None
        self._env = env
        self._seed = seed
        self._rng = np.random.default_rng(seed)
        self._cells: NDArray[np.int64] | None = None  # that the robots are in

    @classmethod
    def build(cls, config: QLearningConfig, env: VecEnv, seed: int) -> QLearning:
        """An empty table to train. ``env`` should hold as many environments as the settings say."""
        shape = env.get_attr("world")[0].feasible.shape
        actions: Any = env.action_space
        return cls(np.zeros(_table_shape(shape, actions.n)), shape, config, env, seed)

    @classmethod
    def of(
        cls, arrays: Mapping[str, NDArray[Any]], shape: tuple[int, int], actions: int = 8
    ) -> QLearning:
        """What acts by the table of a file; raises ``ValueError`` where that is none for a grid of
        that shape and so many actions.
        """
        table = arrays.get("table")
        wanted = _table_shape(shape, actions)
        if (
            set(arrays) != {"table"}
            or table is None
            or table.dtype != np.float64
            or table.shape != wanted
        ):
            held = {name: (each.dtype.name, each.shape) for name, each in arrays.items()}
            raise ValueError(f"it holds {held}, not one table of float64 of shape {wanted}")

        return cls(table, shape)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.int64], Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says."""
        return self._act(
            self._decode(observation), 0.0 if deterministic else self.exploration_rate
        ), state

    def learn(
        self, total_timesteps: int, callback: BaseCallback, reset_num_timesteps: bool = True
    ) -> QLearning:
        """Train for so many steps, on top of those so far unless ``reset_num_timesteps``."""
        env = self.get_env()
        if reset_num_timesteps or self._cells is None:
            self.num_timesteps = 0
            env.seed(self._seed)
            self._cells = self._decode(env.reset())

        end = self.num_timesteps + total_timesteps
        callback.init_callback(self)  # type: ignore[arg-type]  # asks for no more than there is here
        callback.on_training_start({"total_timesteps": end}, {})
        is_going_on = True

        while is_going_on and self.num_timesteps < end:
            callback.on_rollout_start()
            self._step(env, self._cells)
            is_going_on = callback.on_step()

        callback.on_training_end()

        return self

    @property
    def exploration_rate(self) -> float:
        """Probability of a random move."""
        return self._scheduled(
            self.config.exploration_initial_eps, self.config.exploration_final_eps
        )

    @property
    def learning_rate(self) -> float:
        """Weight of a new return."""
        return self._scheduled(self.config.learning_rate, self.config.final_learning_rate)

    def get_env(self) -> VecEnv:
        """The environment that is trained on."""
        if self._env is None:
            raise ValueError("this table was made or loaded without an environment to train on")
        return self._env

    def set_logger(self, logger: Logger) -> None:
        """Log to there from now on."""
        self.logger = logger

    def save(self, file: IO[bytes]) -> None:
        """Write the table as an .npz file."""
        np.savez_compressed(file, table=self.table)

    def _step(self, env: VecEnv, cells: NDArray[np.int64]) -> None:
        """Move each robot once, and set the value of its move to the return that follows it."""
        actions = self._act(cells, self.exploration_rate)
        observation, reward, done, infos = env.step(actions)
        self.num_timesteps += env.num_envs
        self._cells = self._decode(observation)
        ahead = self._cells.copy()

        for i in np.flatnonzero(done):
            ahead[i] = self._decode(infos[i]["terminal_observation"])

        is_over = done & [not info["TimeLimit.truncated"] for info in infos]
        returns = reward + self.config.gamma * np.where(is_over, 0.0, self.table[ahead].max(axis=1))
        self.table[cells, actions] += self.learning_rate * (returns - self.table[cells, actions])

    def _act(self, cells: NDArray[np.int64], epsilon: float) -> NDArray[np.int64]:
        """The action of greatest value, the first of equals, or with the given probability any."""
        is_random = self._rng.random(cells.shape) < epsilon
        return np.where(
            is_random,
            self._rng.integers(self.table.shape[1], size=cells.shape),
            self.table[cells].argmax(axis=-1),
        )

    def _scheduled(self, start: float, end: float) -> float:
        return start + min(self.num_timesteps / self.config.total_timesteps, 1.0) * (end - start)

    def _decode(self, observation: Any) -> NDArray[np.int64]:
        """Flat cells of the robots, or states of robots and panels."""
        configurations = self.table.shape[1] - 8
        if configurations:
            return own_states(observation, self.shape, configurations)

        return Packing.of(observation, self.shape).own_cells(observation)


def _table_shape(shape: tuple[int, int], actions: int) -> tuple[int, int]:
    """States and actions: cells and moves, or those and switches for each configuration."""
    return max(1, actions - 8) * math.prod(shape), actions
