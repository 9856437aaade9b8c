"""`SignExtractor`: which numbers of an observation are at least 0, on top of the numbers."""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

SCALES = (1.0, 3.0, 10.0, 40.0)  # the vector to the goal is magnified by so much, and cut off at 1
UNITS = 32  # of a budget, each told by itself


class SignExtractor(BaseFeaturesExtractor):
    """Adds to an observation, packed as ``"flat"``, which of its numbers are at least 0, and the
    vector to the goal at several scales. Nothing is learned here.

    A cell at the target and one just below it differ by a thousandth in what is seen, and by all in
    what the rules allow; so do two configurations of the panel, and a robot at the goal and one
    beside it. Where a dict holds what is left of a budget, it adds how much of each of its first
    `UNITS` units is left, from 0 to 1: for the last unit and the one before it, other ways may be
    open. Raises ``ValueError`` for a space of another kind.
    """

    def __init__(self, observation_space: spaces.Box | spaces.Dict) -> None:
        is_flat = isinstance(observation_space, spaces.Box) and len(observation_space.shape) == 1
        if not (is_flat or isinstance(observation_space, spaces.Dict)):
            raise ValueError(
                "signs=True needs observation='flat', 'dict' or 'masked', not what is seen as "
                f"{observation_space}"
            )

        width = spaces.flatdim(observation_space)
        parts = observation_space.spaces if isinstance(observation_space, spaces.Dict) else {}
        mask = spaces.flatdim(parts["action_mask"]) if "action_mask" in parts else 0
        units = UNITS if "budget" in parts else 0

        super().__init__(observation_space, width + (width - mask) + 2 * len(SCALES) + units)

    def forward(self, observations: Any) -> Tensor:
        """Features ``(B, D)`` of observations ``(B, C)``, or of dicts of such in any shape."""
        parts = [observations]
        if isinstance(observations, dict):
            parts = [observations[key].flatten(1) for key in sorted(observations)]

        # an action mask comes first by its name, and has no signs to tell
        has_mask = isinstance(observations, dict) and "action_mask" in observations
        numbers = parts[1:] if has_mask else parts
        signs = [(each >= 0).to(each) for each in numbers]

        # at the end of the last, whatever the kind of observation
        to_goal = numbers[-1][:, -2:]  # (B, 2), over the size of the room
        scaled = [(to_goal * scale).clamp(-1.0, 1.0) for scale in SCALES]

        # what is seen of a budget is left / (1 + left), of `irs_gym.mdp.budget.scaled_amount`
        units = []
        if isinstance(observations, dict) and "budget" in observations:
            share = observations["budget"].flatten(1).clamp(0.0, 0.999)  # (B, 1)
            left = share / (1.0 - share)
            units = [(left - torch.arange(UNITS).to(left)).clamp(0.0, 1.0)]

        return torch.cat([*parts, *signs, *scaled, *units], dim=1)
