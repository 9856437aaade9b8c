"""`gradient_step`: one step down a gradient that is cut where it is too long; its schedules, and
the device that it is taken on.
"""

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


def device_of(name: str) -> str:
    """The device of that name, of which ``"auto"`` is a GPU where there is one; raises
    ``ValueError`` for ``"cuda"`` where there is none.
    """
    has_gpu = torch.cuda.is_available()
    if name == "cuda" and not has_gpu:
        raise ValueError("device='cuda' needs a GPU that PyTorch can use: 'cpu' or 'auto' do not")

    return ("cuda" if has_gpu else "cpu") if name == "auto" else name


def cosine(learning_rate: float, progress: float) -> float:
    """The learning rate when ``progress``, from 0 to 1, of a schedule that falls to zero along a
    cosine is over.
    """
    return learning_rate * 0.5 * (1.0 + math.cos(math.pi * progress))


def linear(config: ProximalConfig, progress: float) -> float:
    """The learning rate of a schedule that falls linearly from one to another."""
    return config.learning_rate + progress * (config.final_learning_rate - config.learning_rate)
