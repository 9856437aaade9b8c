"""`Imitation`: a network over maps learns all optimal moves of all cells from the oracle."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.map_configs import ImitationConfig
from agents.learning.optim import cosine, gradient_step
from agents.learning.symmetry import SYMMETRIES, turn, turn_moves
from agents.networks.map_network import maps_of
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.oracle.shortest_path import optimal_moves

_FAR = 40.0  # cells: an error in the way to go of so many weighs as much as 1


def imitation_loss(logits: Tensor, is_optimal: Tensor) -> Tensor:
    """Minus the logarithm of the probability of all optimal moves together, mean over the cells
    that have any.

    Both arguments have the shape ``(B, 8, X, Y)``.
    """
    is_labelled = is_optimal.any(dim=1)  # (B, X, Y)
    every = logits.movedim(1, -1)[is_labelled]  # (labelled cells, 8)
    right = logits.masked_fill(~is_optimal, -torch.inf).movedim(1, -1)[is_labelled]

    return (every.logsumexp(dim=-1) - right.logsumexp(dim=-1)).mean()


class Imitation:
    """Draws scenes without replacement until all were seen, each batch under one of the eight
    symmetries.
    """

    def __init__(
        self, config: ImitationConfig, network: nn.Module, rng: np.random.Generator
    ) -> None:
        self.config = config
        self.network = network
        self._rng = rng
        self._optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
        self._waiting = np.zeros(0, dtype=np.int64)  # scenes not seen yet in this round

    def update(self, pool: SceneSet, progress: float) -> tuple[int, dict[str, float]]:
        """One batch, counted in scenes; see `agents.learning.map_learner.Teacher`."""
        scenes = self._draw(len(pool))
        symmetry = int(self._rng.choice(SYMMETRIES))
        metres = pool.distance_to_go[scenes]  # (B, X, Y)
        is_optimal = torch.from_numpy(optimal_moves(metres, pool.cell_size))  # (B, 8, X, Y)

        plan = self.network(turn(maps_of(pool, scenes), symmetry))
        loss = imitation_loss(plan.logits, turn_moves(is_optimal, symmetry))

        # Beside the moves, how far the goal is, where it can be reached.
        if self.config.to_go_coef:
            to_go = turn(torch.from_numpy(metres / pool.cell_size), symmetry)
            can_reach = to_go.isfinite()
            error = (plan.to_go[can_reach] - to_go[can_reach].to(plan.to_go)).abs().mean() / _FAR
            loss = loss + self.config.to_go_coef * error

        rate = cosine(self.config.learning_rate, progress)
        gradient_step(self._optimizer, loss, rate, self.config.max_grad_norm)

        return len(scenes), {"loss": loss.item()}

    def _draw(self, scenes: int) -> NDArray[np.int64]:
        """Numbers of the next batch of so many scenes; what is left of a round and too few is
        dropped.
        """
        batch = min(self.config.batch_scenes, scenes)
        if len(self._waiting) < batch:
            self._waiting = self._rng.permutation(scenes)

        drawn = self._waiting[:batch]
        self._waiting = self._waiting[batch:]

        return drawn
