"""PPO's estimator and objective, and the critic of agents that plan: what its learners over many
scenes share.

Schulman et al. 2016 (arXiv 1506.02438) and 2017 (arXiv 1707.06347). Lengths are in cells.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.map_configs import ProximalConfig

Floats = NDArray[np.float32]

GOAL_BONUS = 20.0  # the environment's 10 m
_UNIT = 20.0


class WayCritic(nn.Linear):
    """A value that is an affine function of the agent's own estimate of the way to go, and of the
    octile distance.

    It begins with what the values were if the estimate was right: the bonus at the goal, and what
    shaping still pays more than the way takes.
    """

    def __init__(self) -> None:
        super().__init__(2, 1)
        with torch.no_grad():
            self.weight.copy_(torch.tensor([[-_UNIT, _UNIT]]))
            self.bias.fill_(GOAL_BONUS)

    def values(self, to_go: Tensor, octile: Tensor) -> Tensor:
        """Values, in the shape of both arguments."""
        found: Tensor = self(torch.stack([to_go, octile], dim=-1) / _UNIT)[..., 0]
        return found


def generalized_advantages(td_errors: Floats, not_done: Floats, decay: float) -> Floats:
    """Generalised advantage estimates from temporal-difference errors in the order of time.

    Parameters
    ----------
    td_errors
        Reward and discounted value ahead less the value, shape ``(T, N)``.
    not_done
        0 where the episode is over after the step, else 1, shape ``(T, N)``.
    decay
        The discount times lambda.
    """
    found = np.zeros_like(td_errors)
    running = np.zeros(td_errors.shape[1], dtype=np.float32)

    for t in reversed(range(len(td_errors))):
        running = td_errors[t] + decay * not_done[t] * running
        found[t] = running

    return found


def normalized(advantages: Floats) -> Tensor:
    """With mean 0 and standard deviation 1."""
    found = torch.from_numpy(advantages)
    return (found - found.mean()) / (found.std() + 1e-8)


def clipped_loss(
    config: ProximalConfig,
    progress: float,
    log_probabilities: Tensor,
    actions: NDArray[np.int64],
    old_log_probs: Tensor,
    advantages: Tensor,
    values: Tensor,
    targets: Floats,
) -> tuple[Tensor, dict[str, float]]:
    """PPO's loss, and what to log of it.

    Parameters
    ----------
    log_probabilities
        Of the moves as they are now, shape ``(..., 8)``; that of all other arrays is ``(...)``.
    old_log_probs
        Logarithms of the probabilities of the actions when they were drawn.
    """
    new_log_probs = log_probabilities.gather(-1, torch.from_numpy(actions)[..., None])[..., 0]
    ratio = (new_log_probs - old_log_probs).exp()
    clip = config.clip_range
    policy_objective = torch.minimum(
        ratio * advantages, ratio.clamp(1.0 - clip, 1.0 + clip) * advantages
    ).mean()
    target = torch.from_numpy(targets)
    value_loss = (values - target).square().mean() / (target.var() + 1.0)
    entropy = -(log_probabilities.exp() * log_probabilities).sum(dim=-1).mean()
    loss = (
        -policy_objective
        + config.vf_coef * value_loss
        - config.ent_coef * (1.0 - progress) * entropy
    )

    return loss, {"loss": loss.item(), "value_error": value_loss.item(), "entropy": entropy.item()}


def sample_actions(probabilities: Floats, uniform: Floats) -> NDArray[np.int64]:
    """Actions drawn with probabilities ``(n, 8)`` by uniform numbers ``(n,)``."""
    cumulated = probabilities.cumsum(axis=1)
    return np.asarray((cumulated < uniform[:, None] * cumulated[:, -1:]).sum(axis=1))
