"""`MaskHead`: scores of actions, to which one learned weight times the action mask is added."""

import torch
from gymnasium import spaces
from torch import Tensor, nn

SCALE = 10.0  # the weight is learned so much faster than others


class MaskHead(nn.Module):
    """The scores of a network plus one weight, learned and 0 at first, times the action mask.

    The mask is among what the network reads, but what it says of one action, a network learns for
    each action and each place anew. One weight for all learns at once that what is refused is not
    worth trying. Nothing is forbidden: it is told, and learned.

    Parameters
    ----------
    scores
        Network from ``(B, D)`` to the scores of ``actions`` actions, of which the first numbers are
        the mask.
    actions
        How many there are.
    """

    def __init__(self, scores: nn.Module, actions: int) -> None:
        super().__init__()
        self.scores = scores
        self.actions = actions
        self.weight = nn.Parameter(torch.zeros(()))

    def forward(self, features: Tensor) -> Tensor:
        """Scores ``(B, actions)``."""
        mask = features[:, : self.actions] - 0.5
        scores: Tensor = self.scores(features)

        return scores + SCALE * self.weight * mask


def check_masked(space: spaces.Space) -> None:  # type: ignore[type-arg]
    """Raise a ``ValueError`` where observations hold no action mask."""
    if not (isinstance(space, spaces.Dict) and "action_mask" in space.spaces):
        raise ValueError(
            "mask_head=True needs observation='masked', which holds the action mask, not what is "
            f"seen as {space}"
        )
