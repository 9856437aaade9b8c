"""PPO's estimator and objective, and the critic of agents that plan: what its learners over many
scenes share.

Schulman et al. 2016 (arXiv 1506.02438) and 2017 (arXiv 1707.06347). Lengths are in cells.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.learning.map_configs import ProximalConfig
from agents.rollout.rules import RULES
from irs_gym.datasets.generator import CELL_SIZE

Floats = NDArray[np.float32]

_UNIT = 20.0  # cells: lengths are divided by this for the critic


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
            # A bonus in cells of the usual size: only where the critic begins, since it is learned.
            self.bias.fill_(RULES.goal_bonus / CELL_SIZE)

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
    advantages = np.zeros_like(td_errors)
    running = np.zeros(td_errors.shape[1], dtype=np.float32)

    # Backwards, A(t) = delta(t) + decay * A(t + 1), cut off where an episode ends (eq. 16 of GAE).
    for t in reversed(range(len(td_errors))):
        running = td_errors[t] + decay * not_done[t] * running
        advantages[t] = running

    return advantages


def normalized(advantages: Floats) -> Tensor:
    """With mean 0 and standard deviation 1."""
    values = torch.from_numpy(advantages)
    return (values - values.mean()) / (values.std() + 1e-8)


def clipped_loss(
    config: ProximalConfig,
    progress: float,
    log_probs: Tensor,
    actions: NDArray[np.int64],
    old_log_probs: Tensor,
    advantages: Tensor,
    values: Tensor,
    returns: Floats,
) -> tuple[Tensor, dict[str, float]]:
    """PPO's loss, and what to log of it.

    Parameters
    ----------
    log_probs
        Logarithms of the probabilities of the moves as they are now, shape ``(..., 8)``; that of
        all other arrays is ``(...)``.
    old_log_probs
        Logarithms of the probabilities of the actions when they were drawn.
    """
    # The policy: ratios beyond the clip range gain nothing more (eq. 7 of PPO).
    taken = torch.from_numpy(actions).to(log_probs.device)[..., None]
    new_log_probs = log_probs.gather(-1, taken)[..., 0]
    ratio = (new_log_probs - old_log_probs).exp()
    clipped = ratio.clamp(1.0 - config.clip_range, 1.0 + config.clip_range)
    policy_objective = torch.minimum(ratio * advantages, clipped * advantages).mean()

    # The critic: over the variance, so that its weight is the same however long the ways are.
    target = torch.from_numpy(returns).to(values.device)
    value_loss = (values - target).square().mean() / (target.var() + 1.0)

    # Entropy keeps the policy from settling early: its weight falls to zero.
    entropy = -(log_probs.exp() * log_probs).sum(dim=-1).mean()

    loss = (
        -policy_objective
        + config.vf_coef * value_loss
        - config.ent_coef * (1.0 - progress) * entropy
    )

    return loss, {"loss": loss.item(), "value_error": value_loss.item(), "entropy": entropy.item()}


def sample_actions(probabilities: Floats, uniform: Floats) -> NDArray[np.int64]:
    """Actions drawn with probabilities ``(n, 8)`` by uniform numbers ``(n,)``."""
    cumulated = probabilities.cumsum(axis=1)  # (n, 8); the last is 1 but for rounding
    return np.asarray((cumulated < uniform[:, None] * cumulated[:, -1:]).sum(axis=1))
