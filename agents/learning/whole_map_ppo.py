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
    WayCritic,
    clipped_loss,
    generalized_advantages,
    normalized,
    sample_actions,
)
from agents.networks.map_network import maps_of
from agents.rollout.rules import RULES
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.grid import octile_distance
from irs_gym.mdp.dynamics import ACTIONS, start_cells, transitions


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

        # One pass over the scenes says what all robots will do there, whichever cells they enter.
        with torch.no_grad():
            log_probs, values = self._ask(maps, rules)

        starts = self._draw_starts(pool, scenes)
        rollout = self._roll_out(rules, starts, log_probs.exp().numpy(), values.numpy())
        old_log_probs = log_probs[rollout.cell, rollout.action]  # (T, N)
        advantages = normalized(rollout.advantages)
        rate = linear(config, progress)

        for _ in range(config.n_epochs):
            log_probs, values = self._ask(maps, rules)
            loss, figures = clipped_loss(
                config,
                progress,
                log_probs[rollout.cell],
                rollout.action,
                old_log_probs,
                advantages,
                values[rollout.cell],
                rollout.returns,
            )
            gradient_step(self._optimizer, loss, rate, config.max_grad_norm)

        return rollout.cell.size, figures

    def _ask(self, maps: Tensor, rules: TransitionTables) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of moves ``(cells, 8)``, and values ``(cells,)`` in
        cells.
        """
        plan = self.network(maps)
        logits = plan.logits.movedim(1, -1).reshape(-1, ACTIONS)  # (G * X * Y, 8)
        values = self.critic.values(plan.to_go.flatten(), torch.from_numpy(rules.octile))

        return logits.log_softmax(dim=-1), values

    def _draw_starts(self, pool: SceneSet, scenes: NDArray[np.int64]) -> NDArray[np.int64]:
        """A start for each step of each robot, ``(T + 1, N)``: the environment's random start,
        should it be needed.
        """
        shape = self.config.n_steps + 1, self.config.robots
        cells = pool.shape[0] * pool.shape[1]
        drawn = []

        for n, scene in enumerate(scenes):
            can_start = start_cells(pool.distance_to_go[scene], tuple(pool.goal[scene].tolist()))
            drawn.append(n * cells + self._rng.choice(can_start, shape))

        return np.concatenate(drawn, axis=1)

    def _roll_out(
        self,
        rules: TransitionTables,
        starts: NDArray[np.int64],
        probabilities: NDArray[np.float32],
        values: NDArray[np.float32],
    ) -> Rollout:
        """Moves drawn for all robots at once; who is at the goal goes on from the next start."""
        shape = starts[1:].shape  # (T, N)
        cells, actions, ahead = np.empty((3, *shape), dtype=np.int64)
        rewards, not_done = np.empty((2, *shape), dtype=np.float32)
        here = starts[0]

        for t, uniform in enumerate(self._rng.random(shape, dtype=np.float32)):
            action = sample_actions(probabilities[here], uniform)
            is_over = rules.is_over[here, action]

            cells[t] = here
            actions[t] = action
            rewards[t] = rules.reward[here, action]
            ahead[t] = rules.ahead[here, action]
            not_done[t] = ~is_over

            here = np.where(is_over, starts[t + 1], ahead[t])

        td_errors = rewards + self.config.gamma * not_done * values[ahead] - values[cells]
        decay = self.config.gamma * self.config.gae_lambda
        advantages = generalized_advantages(td_errors, not_done, decay)

        return Rollout(cells, actions, advantages, advantages + values[cells])


def transition_tables_of(pool: SceneSet, scenes: NDArray[np.int64]) -> TransitionTables:
    """The rules of the environment in scenes of a pool, with lengths in cells."""
    goals = pool.goal[scenes]
    rules = transitions(
        RULES,
        pool.free[scenes],
        pool.feasible[scenes],
        goals,
        pool.cell_size,
        np.float32,
        **pool.motion(scenes),
    )
    cells = np.indices(pool.shape).transpose(1, 2, 0)  # (X, Y, 2)
    octile = octile_distance(cells - goals[:, None, None])  # (G, X, Y)

    return TransitionTables(
        ahead=rules.next_cell,
        reward=(rules.reward / pool.cell_size).astype(np.float32),
        is_over=rules.is_terminated,
        octile=octile.ravel().astype(np.float32),
    )
