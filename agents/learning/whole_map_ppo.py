"""`WholeMapPpo`: proximal policy optimisation over many scenes, a forward pass for each scene.

Stable-Baselines3's PPO would ask the network for a whole map at every transition, mix scenes within
its minibatches, and hand over a dict for every robot and step. Here a rollout is a few gathers from
tables, and an epoch one pass over the scenes of the rollout. Objective and estimator are the same.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.map_configs import WholeMapPpoConfig
from agents.learning.optim import gradient_step, linear
from agents.learning.ppo_loss import (
    GOAL_BONUS,
    WayCritic,
    clipped_loss,
    generalized_advantages,
    normalized,
    sample_actions,
)
from agents.networks.map_network import maps_of
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import MOVE_LENGTHS, MOVES, octile_distance


class Rollout(NamedTuple):
    """Transitions of N robots over T steps, shape ``(T, N)``."""

    cell: NDArray[np.int64]  # flat, over all scenes of the rollout
    action: NDArray[np.int64]
    advantages: NDArray[np.float32]
    returns: NDArray[np.float32]


class TransitionTables(NamedTuple):
    """The environment's rules for some scenes, over flat cells of all of them: shape ``(G * X * Y,
    8)``.
    """

    ahead: NDArray[np.int64]  # flat cell that a move leads to
    reward: NDArray[np.float32]  # in cells
    is_over: NDArray[np.bool_]
    octile: NDArray[np.float32]  # (G * X * Y,), cells to the goal without obstacles


class WholeMapPpo:
    """PPO that uses of the oracle nothing but whether the goal can be reached, for the random
    starts.

    The environment does the same.
    """

    def __init__(
        self, config: WholeMapPpoConfig, network: nn.Module, rng: np.random.Generator
    ) -> None:
        self.config = config
        self.network = network
        self._rng = rng
        self.critic = WayCritic()
        self._optimizer = torch.optim.Adam(
            [*network.parameters(), *self.critic.parameters()], config.learning_rate
        )

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """One rollout and its epochs, counted in steps of robots; see
        `agents.learning.map_learner.Teacher`.
        """
        config = self.config
        scenes = self._rng.choice(len(pool), min(config.scenes, len(pool)), replace=False)
        maps = maps_of(pool, scenes)
        rules = transition_tables_of(pool, scenes)

        with torch.no_grad():
            log_probabilities, values = self._ask(maps, rules)

        starts = self._draw_starts(pool, scenes)
        rollout = self._roll_out(rules, starts, log_probabilities.exp().numpy(), values.numpy())
        old_log_probs = log_probabilities[rollout.cell, rollout.action]
        advantages = normalized(rollout.advantages)
        rate = linear(config, progress)

        for _ in range(config.n_epochs):
            log_probabilities, values = self._ask(maps, rules)
            there = log_probabilities[rollout.cell], values[rollout.cell]
            loss, seen = clipped_loss(
                config,
                progress,
                there[0],
                rollout.action,
                old_log_probs,
                advantages,
                there[1],
                rollout.returns,
            )
            gradient_step(self._optimizer, loss, rate, config.max_grad_norm)

        return rollout.cell.size, seen

    def _ask(self, maps: Tensor, rules: TransitionTables) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of moves ``(cells, 8)``, and values ``(cells,)`` in
        cells.
        """
        plan = self.network(maps)
        log_probabilities = plan.logits.movedim(1, -1).reshape(-1, len(MOVES)).log_softmax(dim=-1)
        return log_probabilities, self.critic.values(
            plan.to_go.flatten(), torch.from_numpy(rules.octile)
        )

    def _draw_starts(self, pool: SceneSet, scenes: NDArray[np.int64]) -> NDArray[np.int64]:
        """A start for each step of each robot, ``(T + 1, N)``: the environment's random start,
        should it be needed.
        """
        config = self.config
        cells = pool.shape[0] * pool.shape[1]
        draws = []

        for n, scene in enumerate(scenes):
            can_start = np.isfinite(pool.distance_to_go[scene]) & (pool.distance_to_go[scene] > 0)
            draws.append(
                n * cells
                + self._rng.choice(np.flatnonzero(can_start), (config.n_steps + 1, config.robots))
            )

        return np.concatenate(draws, axis=1)

    def _roll_out(
        self,
        rules: TransitionTables,
        starts: NDArray[np.int64],
        probabilities: NDArray[np.float32],
        values: NDArray[np.float32],
    ) -> Rollout:
        cells, actions = np.empty((2, *starts[1:].shape), dtype=np.int64)
        rewards, not_done = np.empty((2, *cells.shape), dtype=np.float32)
        ahead = np.empty_like(cells)
        here = starts[0]

        for t, uniform in enumerate(self._rng.random(cells.shape, dtype=np.float32)):
            cells[t] = here
            action = sample_actions(probabilities[here], uniform)
            actions[t], rewards[t] = action, rules.reward[here, action]
            ahead[t], is_over = rules.ahead[here, action], rules.is_over[here, action]
            not_done[t], here = ~is_over, np.where(is_over, starts[t + 1], ahead[t])

        td_errors = rewards + self.config.gamma * not_done * values[ahead] - values[cells]
        advantages = generalized_advantages(
            td_errors, not_done, self.config.gamma * self.config.gae_lambda
        )

        return Rollout(cells, actions, advantages, advantages + values[cells])


def transition_tables_of(pool: SceneSet, scenes: NDArray[np.int64]) -> TransitionTables:
    """Moves and rewards of `irs_gym.mdp.dynamics.transition` where cells below the target are
    refused, in cells.
    """
    feasible = pool.feasible[scenes]
    columns, rows = pool.shape
    padded = np.pad(feasible, ((0, 0), (1, 1), (1, 1)))
    is_legal = np.stack(
        [padded[:, 1 + di : columns + 1 + di, 1 + dj : rows + 1 + dj] for di, dj in MOVES], axis=-1
    )
    is_legal = is_legal.reshape(-1, len(MOVES))
    here = np.arange(len(is_legal))[:, None]
    ahead = np.where(is_legal, here + MOVES @ [rows, 1], here)
    places = np.indices(pool.shape).transpose(1, 2, 0)
    octile = octile_distance(places - pool.goal[scenes][:, None, None]).ravel().astype(np.float32)
    goals = np.arange(len(scenes)) * columns * rows + pool.goal[scenes] @ [rows, 1]
    is_over = is_legal & np.isin(ahead, goals)
    reward = octile[:, None] - octile[ahead] - MOVE_LENGTHS + GOAL_BONUS * is_over

    return TransitionTables(ahead, reward.astype(np.float32), is_over, octile)
