"""`gradient_step`: one step down a gradient that is cut where it is too long."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from agents.learning.map_configs import ProximalConfig


def gradient_step(
    optimizer: torch.optim.Optimizer, loss: Tensor, learning_rate: float, max_grad_norm: float
) -> None:
    """One step of an optimiser at a learning rate; gradients longer than the norm, over all
    parameters, are cut.
    """
    for group in optimizer.param_groups:
        group["lr"] = learning_rate

    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(
        [each for group in optimizer.param_groups for each in group["params"]], max_grad_norm
    )
    optimizer.step()


def cosine(learning_rate: float, progress: float) -> float:
    """The learning rate when ``progress``, from 0 to 1, of a schedule that falls to zero along a
    cosine is over.
    """
    return learning_rate * 0.5 * (1.0 + math.cos(math.pi * progress))


def linear(config: ProximalConfig, progress: float) -> float:
    """The learning rate of a schedule that falls linearly from one to another."""
    return config.learning_rate + progress * (config.final_learning_rate - config.learning_rate)
