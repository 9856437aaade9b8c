"""`ValueIterationNetwork`: the value-iteration network of Tamar et al. (2016), as a baseline."""

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

from agents.networks.map_network import MapPlan
from irs_gym.grid import MOVES

_DISCOUNT = 0.95  # that the transitions begin with


class ValueIterationNetwork(nn.Module):
    """Written from the description in the paper (NIPS 2016, section 4 and figure 2).

    A network gives each cell a reward r. Then Q = convolution of r and V over 3 x 3 cells, one
    channel for each abstract action, and V = the greatest Q, K times over with the same weights. A
    linear layer reads the logits of the moves off a cell's Q, in all cells at once.

    Parameters
    ----------
    rounds
        K, for maps of 40 x 40 cells; larger maps get more in proportion.
    actions
        Abstract actions.
    width
        Channels of the reward's hidden layer; 150 in the paper.
    """

    def __init__(self, rounds: int = 60, actions: int = 10, width: int = 150) -> None:
        super().__init__()
        self.rounds = rounds
        self.reward = nn.Sequential(
            nn.Conv2d(4, width, 3, padding=1), nn.Conv2d(width, 1, 1, bias=False)
        )
        self.transition = nn.Parameter(_moves(actions))
        self.read_out = nn.Conv2d(actions, len(MOVES), 1)

    def forward(self, maps: Tensor) -> MapPlan:
        """Plan for maps ``(B, 3, X, Y)`` of `agents.networks.map_network.maps_of`."""
        is_feasible = (maps[:, :1] >= 0).to(maps)
        reward = self.reward(torch.cat([is_feasible, maps], dim=1))  # (B, 1, X, Y)

        # Q <- convolution of r and V, V <- max over the actions of Q.
        values = torch.zeros_like(reward)

        for _ in range(max(self.rounds, self.rounds * max(maps.shape[-2:]) // 40)):
            qualities = conv2d(torch.cat([reward, values], dim=1), self.transition, padding=1)
            values = qualities.amax(dim=1, keepdim=True)

        return MapPlan(self.read_out(qualities), -values[:, 0])


def _moves(actions: int) -> Tensor:
    """Transitions to begin with, ``(actions, 2, 3, 3)``: each action is one of the eight moves.

    From small random numbers, as in the paper, values die out on their way over K rounds, and
    gradients with them.
    """
    transition = torch.randn(actions, 2, 3, 3) * 0.01
    transition[:, 0, 1, 1] += 1.0  # the reward of the cell itself

    for action in range(actions):
        di, dj = MOVES[action % len(MOVES)].tolist()
        transition[action, 1, 1 + di, 1 + dj] += _DISCOUNT

    return transition
