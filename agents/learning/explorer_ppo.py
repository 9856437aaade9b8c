"""`ExplorerPpo`: an explorer learns by PPO alone, with no oracle: its reward is that of the
environment, in cells.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.local_configs import ExplorerPpoConfig
from agents.learning.optim import gradient_step, linear
from agents.learning.ppo_loss import (
    GOAL_BONUS,
    WayCritic,
    clipped_loss,
    generalized_advantages,
    normalized,
    sample_actions,
)
from agents.learning.robot_batch import RobotBatch
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS, octile_distance

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]

_FARTHEST = 400.0  # cells: the way to go is worth no more to the critic, through however unlikely cells it leads


class Stage(NamedTuple):
    """What n robots knew when they planned, and the k steps that they took by that plan; waiting
    robots took fewer.
    """

    known: tuple[Tensor, Tensor, Tensor]  # of `RobotBatch.known`
    cells: Ints  # (k, n), flat
    octile: Floats  # (k, n), cells to the goal without obstacles
    actions: Ints  # (k, n)
    old_log_probs: Floats  # (k, n), logarithms of their probabilities
    values: Floats  # (k, n)
    rewards: Floats  # (k, n)
    not_done: Floats  # (k, n), 0 where the episode is over after the step
    took: NDArray[np.bool_]  # (k, n), whether the robot did not wait


class ExplorerPpo:
    """PPO over what robots remember: they plan for what they have seen, take some steps by that
    plan, and plan anew.

    The critic reads the way to go off the plan, so that what the unknown costs is learned from how
    far the way really was, too.
    """

    def __init__(
        self, config: ExplorerPpoConfig, network: nn.Module, rng: np.random.Generator
    ) -> None:
        self.config = config
        self.network = network
        self._rng = rng
        self.critic = WayCritic()
        self._optimizer = torch.optim.Adam(
            [*network.parameters(), *self.critic.parameters()], config.learning_rate
        )
        self._expedition: RobotBatch | None = None

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """One rollout and its epochs, counted in steps of robots; see
        `agents.learning.map_learner.Teacher`.
        """
        config = self.config
        if self._expedition is None:
            self._expedition = RobotBatch(config.terms, pool, self._rng)

        with torch.no_grad():
            stages = [self._advance(pool, self._expedition) for _ in range(config.n_plans)]
            values_ahead = self._values_here(pool, self._expedition)

        advantages, targets = self._estimate(stages, values_ahead)
        took = np.stack([each.took for each in stages])  # (plans, k, n)
        scaled = torch.zeros(took.shape)
        scaled[torch.from_numpy(took)] = normalized(advantages[took])
        rate = linear(config, progress)

        for _ in range(config.n_epochs):
            for number in self._rng.permutation(len(stages)).tolist():
                loss, seen = self._loss(stages[number], scaled[number], targets[number], progress)
                gradient_step(self._optimizer, loss, rate, config.max_grad_norm)

        return int(took.sum()), seen

    def _advance(self, pool: SceneSet, robots: RobotBatch) -> Stage:
        """Plan, and take some steps by the plan."""
        config = self.config
        known = robots.known(pool)
        log_probabilities, to_go = self._ask(known)
        n = np.arange(config.robots)
        shape = (config.plan_steps, config.robots)
        cells, actions = np.zeros((2, *shape), dtype=np.int64)
        octile, old_log_probs, values, rewards, not_done = np.zeros((5, *shape), dtype=np.float32)
        took = np.zeros(shape, dtype=bool)
        waits = np.zeros(config.robots, dtype=bool)

        for k, uniform in enumerate(self._rng.random(shape, dtype=np.float32)):
            cells[k], octile[k], took[k] = _flat(robots, pool), _octile(robots, pool), ~waits
            here = log_probabilities[n, cells[k]]
            actions[k] = sample_actions(here.exp().numpy(), uniform)
            old_log_probs[k] = here.numpy()[n, actions[k]]
            values[k] = self._value(to_go[n, cells[k]], octile[k]).numpy()
            goals = pool.goal[robots.scenes]
            arrival = robots.move(pool, actions[k], waits)
            progress = octile[k] - octile_distance(arrival.cells - goals)
            rewards[k] = progress - MOVE_LENGTHS[actions[k]] + GOAL_BONUS * arrival.is_there
            not_done[k] = ~arrival.is_over
            waits = waits | arrival.is_over

        return Stage(known, cells, octile, actions, old_log_probs, values, rewards, not_done, took)

    def _estimate(self, stages: list[Stage], values_ahead: Floats) -> tuple[Floats, Floats]:
        """Advantages and targets of the critic, ``(plans, k, n)``; those of steps not taken mean
        nothing.
        """
        values, rewards, not_done = (
            np.concatenate([getattr(each, name) for each in stages])
            for name in ("values", "rewards", "not_done")
        )
        next_values = np.concatenate([values[1:], values_ahead[None]])
        td_errors = rewards + self.config.gamma * not_done * next_values - values
        found = generalized_advantages(
            td_errors, not_done, self.config.gamma * self.config.gae_lambda
        )
        shape = len(stages), self.config.plan_steps, self.config.robots

        return found.reshape(shape), (found + values).reshape(shape)

    def _loss(
        self, stage: Stage, advantages: Tensor, targets: Floats, progress: float
    ) -> tuple[Tensor, dict[str, float]]:
        took = stage.took
        n = np.broadcast_to(np.arange(self.config.robots), stage.took.shape)
        all_log_probabilities, to_go = self._ask(stage.known)
        robots = torch.from_numpy(n[took])
        cells = torch.from_numpy(stage.cells[took])
        values = self._value(to_go[robots, cells], stage.octile[took])

        return clipped_loss(
            self.config,
            progress,
            all_log_probabilities[robots, cells],
            stage.actions[took],
            torch.from_numpy(stage.old_log_probs[took]),
            advantages[torch.from_numpy(took)],
            values,
            targets[took],
        )

    def _ask(self, known: tuple[Tensor, Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of moves ``(n, X * Y, 8)``, and the way to go ``(n, X *
        Y)``, in cells.
        """
        found = self.network(*known).plan
        return found.logits.flatten(2).movedim(1, -1).log_softmax(dim=-1), found.to_go.flatten(1)

    def _value(self, to_go: Tensor, octile: Floats) -> Tensor:
        return self.critic.values(to_go.clamp(max=_FARTHEST), torch.from_numpy(octile))

    def _values_here(self, pool: SceneSet, robots: RobotBatch) -> Floats:
        _, to_go = self._ask(robots.known(pool))
        here = to_go[np.arange(self.config.robots), _flat(robots, pool)]
        return np.asarray(self._value(here, _octile(robots, pool)).numpy())


def _flat(robots: RobotBatch, pool: SceneSet) -> Ints:
    return np.asarray(robots.cells @ [pool.shape[1], 1])


def _octile(robots: RobotBatch, pool: SceneSet) -> Floats:
    return octile_distance(robots.cells - pool.goal[robots.scenes]).astype(np.float32)
