"""`ExplorerPpo`: an explorer learns by PPO alone, with no oracle: its reward is that of the
environment, in cells.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.local_configs import ExplorerPpoConfig
from agents.learning.optim import device_of, gradient_step, linear
from agents.learning.ppo_loss import (
    WayCritic,
    clipped_loss,
    generalized_advantages,
    normalized,
    sample_actions,
)
from agents.learning.robot_batch import RobotBatch
from agents.rollout.rules import RULES
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS, flat_cells, octile_distance
from irs_gym.mdp.dynamics import potential, reward

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Known = tuple[Tensor, Tensor]  # of `RobotBatch.known`

# Cells: the way to go is worth no more to the critic, through however unlikely cells it leads.
_FARTHEST = 400.0


class Stage(NamedTuple):
    """What n robots knew when they planned, and the k steps that they took by that plan.

    Robots whose episodes ended on the way wait for the next plan, and so took fewer.
    """

    known: Known
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
        self.device = device_of(config.device)
        self.network = network.to(self.device)
        self._rng = rng
        self.critic = WayCritic().to(self.device)
        self._optimizer = torch.optim.Adam(
            [*network.parameters(), *self.critic.parameters()], config.learning_rate
        )
        self._robots: RobotBatch | None = None  # under way from the first update on

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """One rollout and its epochs, counted in steps of robots; see
        `agents.learning.map_learner.Teacher`.
        """
        config = self.config
        if self._robots is None:
            self._robots = RobotBatch(config.terms, pool, self._rng, self.device)

        # The rollout: all robots plan n_plans times, and walk after each plan.
        with torch.no_grad():
            stages = [self._advance(pool, self._robots) for _ in range(config.n_plans)]
            values_ahead = self._values_here(pool, self._robots)

        advantages, returns = self._estimate(stages, values_ahead)

        # Mean and deviation are those of the steps taken; the others count for nothing below.
        took = np.stack([each.took for each in stages])  # (plans, k, n)
        scaled = torch.zeros(took.shape)
        scaled[torch.from_numpy(took)] = normalized(advantages[took])
        rate = linear(config, progress)

        # A minibatch is a stage: its maps are planned for once, for all steps taken by that plan.
        for _ in range(config.n_epochs):
            for number in self._rng.permutation(len(stages)).tolist():
                loss, figures = self._loss(
                    stages[number], scaled[number], returns[number], progress
                )
                gradient_step(self._optimizer, loss, rate, config.max_grad_norm)

        return int(took.sum()), figures

    def _advance(self, pool: SceneSet, robots: RobotBatch) -> Stage:
        """Plan, and take some steps by the plan."""
        config = self.config
        known = robots.known(pool)
        log_probs, to_go = self._ask(known)

        n = np.arange(config.robots)
        shape = (config.plan_steps, config.robots)  # (k, n)
        cells, actions = np.zeros((2, *shape), dtype=np.int64)
        octile, old_log_probs, values, rewards, not_done = np.zeros((5, *shape), dtype=np.float32)
        took = np.zeros(shape, dtype=bool)
        waits = np.zeros(config.robots, dtype=bool)

        for k, uniform in enumerate(self._rng.random(shape, dtype=np.float32)):
            cells[k] = _flat(robots, pool)
            octile[k] = _octile(robots, pool)
            took[k] = ~waits

            # Draw by the plan that all k steps have in common.
            here = log_probs[n, cells[k]].cpu()  # (n, 8)
            actions[k] = sample_actions(here.exp().numpy(), uniform)
            old_log_probs[k] = here.numpy()[n, actions[k]]
            values[k] = self._value(to_go[n, cells[k]], octile[k]).cpu().numpy()

            rewards[k], is_over = _move(robots, pool, actions[k], waits)
            not_done[k] = ~is_over

            # Who begins anew has no plan of its own yet.
            waits = waits | is_over

        return Stage(known, cells, octile, actions, old_log_probs, values, rewards, not_done, took)

    def _estimate(self, stages: list[Stage], values_ahead: Floats) -> tuple[Floats, Floats]:
        """Advantages and returns, ``(plans, k, n)``; those of steps not taken mean nothing."""
        # The stages follow upon one another in time: (plans * k, n).
        values = np.concatenate([each.values for each in stages])
        rewards = np.concatenate([each.rewards for each in stages])
        not_done = np.concatenate([each.not_done for each in stages])

        gamma = self.config.gamma
        next_values = np.concatenate([values[1:], values_ahead[None]])
        td_errors = rewards + gamma * not_done * next_values - values
        advantages = generalized_advantages(td_errors, not_done, gamma * self.config.gae_lambda)
        shape = len(stages), self.config.plan_steps, self.config.robots

        return advantages.reshape(shape), (advantages + values).reshape(shape)

    def _loss(
        self, stage: Stage, advantages: Tensor, returns: Floats, progress: float
    ) -> tuple[Tensor, dict[str, float]]:
        """PPO's loss over the steps that were taken, by the network as it is now."""
        took = stage.took  # (k, n); what is picked by it below has the shape (steps taken,)
        log_probs, to_go = self._ask(stage.known)
        n = np.broadcast_to(np.arange(self.config.robots), took.shape)
        robots = torch.from_numpy(n[took]).to(self.device)
        cells = torch.from_numpy(stage.cells[took]).to(self.device)
        values = self._value(to_go[robots, cells], stage.octile[took])

        return clipped_loss(
            self.config,
            progress,
            log_probs[robots, cells],
            stage.actions[took],
            torch.from_numpy(stage.old_log_probs[took]).to(self.device),
            advantages[torch.from_numpy(took)].to(self.device),
            values,
            returns[took],
        )

    def _ask(self, known: Known) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of moves ``(n, X * Y, 8)``, and the way to go
        ``(n, X * Y)``, in cells.
        """
        plan = self.network(*known).plan
        logits = plan.logits.flatten(2).movedim(1, -1)  # (n, X * Y, 8)

        return logits.log_softmax(dim=-1), plan.to_go.flatten(1)

    def _value(self, to_go: Tensor, octile: Floats) -> Tensor:
        return self.critic.values(
            to_go.clamp(max=_FARTHEST), torch.from_numpy(octile).to(self.device)
        )

    def _values_here(self, pool: SceneSet, robots: RobotBatch) -> Floats:
        """Values of where the robots are now, ``(n,)``."""
        _, to_go = self._ask(robots.known(pool))
        here = to_go[np.arange(self.config.robots), _flat(robots, pool)]
        return np.asarray(self._value(here, _octile(robots, pool)).cpu().numpy())


def _move(
    robots: RobotBatch, pool: SceneSet, actions: Ints, waits: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Move once: the environment's rewards in cells, and whether the episodes are over, ``(n,)``.

    What it says of robots that wait means nothing.
    """
    goals = pool.goal[robots.scenes]  # of the scenes that the robots are in before the move
    phi = potential(RULES, robots.cells - goals, pool.cell_size).astype(np.float32)

    step = robots.move(pool, actions, waits)
    phi_next = potential(RULES, step.cells - goals, pool.cell_size)
    length = MOVE_LENGTHS[actions] * pool.cell_size
    metres = reward(RULES, length, phi, phi_next, step.is_there)

    return metres / pool.cell_size, step.is_over


def _flat(robots: RobotBatch, pool: SceneSet) -> Ints:
    """Flat cells that the robots are in, ``(n,)``."""
    return flat_cells(robots.cells, pool.shape)


def _octile(robots: RobotBatch, pool: SceneSet) -> Floats:
    """Cells from the robots to their goals without obstacles, ``(n,)``."""
    return octile_distance(robots.cells - pool.goal[robots.scenes]).astype(np.float32)
