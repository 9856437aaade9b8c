"""`ExplorerNetwork`: guesses what a robot has not seen, and plans through what it has seen and
guessed.
"""

import math
from copy import deepcopy
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import normalize, pad

from agents.networks.map_network import MapPlan
from agents.networks.planner import neighbours, plan
from irs_gym.grid import MOVE_LENGTHS

BLOCKED = 1e6
"""Cost of entering a cell known to be infeasible: more than any way through unknown cells, be it
through all cells of a maze of 160 x 160."""
_PLANES = 8  # what the network sees of each cell
_DILATIONS = (1, 2, 4, 8, 4, 2, 1)  # so that an answer depends on cells up to 23 away
PRIOR = 0.126928  # softplus(-2)
"""Before it has learned, a cell not seen costs its length times 1 + this."""
LEAST_EXTRA = 0.05
MOST_EXTRA = 1.0
"""Whatever is learned, a cell not seen costs its length times 1 + something between these: what
holds in some factories can do no more harm than that in others."""


class Prices(NamedTuple):
    """What the network says of the cells of maps seen in part, before it plans."""

    cost: Tensor  # (B, X, Y), of entering a cell
    is_goal: Tensor  # bool (B, X, Y)
    feasible: Tensor  # (B, X, Y): logits that cells are feasible


class Guess(NamedTuple):
    """What the network says of maps seen in part."""

    plan: MapPlan
    feasible: Tensor  # (B, X, Y): logits that cells are feasible, learned in those not seen


class ExplorerNetwork(nn.Module):
    """Convolutions give each cell that was not seen a cost, and a dynamic programme finds the way.

    A move costs its length in cells into a cell seen to be feasible, `BLOCKED` into another that
    was seen, and its length times 1 + c into one that was not, where c between `LEAST_EXTRA` and
    `MOST_EXTRA` is learned, and `PRIOR` to begin with. With c = 0 throughout it would be what
    optimistic replanning computes: what is learned is how much to distrust the unknown, and where.

    It sees nothing that tells one kind of factory from another: neither how large a map is or how
    far the goal, but in which direction, nor the IRS, but what it does to the margins.

    Parameters
    ----------
    width
        Channels of the hidden layers.
    """

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        self.first = nn.Conv2d(_PLANES, width, 3, padding=1)
        self.layers = nn.ModuleList(
            nn.Conv2d(width, width, 3, padding=step, dilation=step) for step in _DILATIONS
        )
        self.read_out = nn.Conv2d(width, 2, 1)

        # It begins near optimism: every cell costs little more than its length, most are feasible.
        assert self.read_out.bias is not None  # as it is asked for above
        with torch.no_grad():
            self.read_out.weight[0].zero_()
            self.read_out.bias.copy_(torch.tensor([0.0, 1.0]))

        # Sharp from the start: otherwise prices rise for no more than to make draws surer.
        self.log_beta = nn.Parameter(torch.tensor(2.0))

    def forward(self, margin: Tensor, goals: Tensor) -> Guess:
        """Plan for what was seen.

        Parameters
        ----------
        margin
            Scaled margins over the target ``(B, X, Y)``, NaN where not seen.
        goals
            Flat cells ``(B,)``.
        """
        prices = self.prices(margin, goals)
        return Guess(self.plan(prices.cost, prices.is_goal), prices.feasible)

    def tempered(self, share: float) -> "ExplorerNetwork":
        """A copy whose prices lie between those before it has learned, at a share of 0, and its
        own, at 1.
        """
        other = deepcopy(self)
        assert other.read_out.bias is not None
        with torch.no_grad():
            other.read_out.weight[0] *= share
            other.read_out.bias[0] *= share

        return other

    def plan(self, cost: Tensor, is_goal: Tensor) -> MapPlan:
        """Plan for given costs of the cells; a map's plan is the same in any batch."""
        return plan(costs_of_moves(cost), is_goal, self.log_beta.exp())

    def prices(self, margin: Tensor, goals: Tensor) -> Prices:
        """What cells cost, of the arguments of `forward`."""
        columns, rows = margin.shape[1:]
        is_known = ~margin.isnan()  # (B, X, Y), as the others
        is_feasible = is_known & (margin >= 0)
        is_blocked = is_known & (margin < 0)
        nowhere = torch.zeros_like(is_known).flatten(1)  # (B, X * Y)
        is_goal = nowhere.scatter_(1, goals[:, None], 1).view_as(is_known)

        # What the network sees; the ones tell the map from what lies around it.
        planes = torch.stack(
            [
                is_known,
                margin.nan_to_num(0.0),
                is_feasible,
                is_blocked,
                is_goal,
                torch.ones_like(is_known),
            ],
            dim=1,
        )  # (B, 6, X, Y)
        planes = torch.cat([planes, _directions(goals, (columns, rows))], dim=1)  # (B, 8, X, Y)
        answer = self._guess(planes)  # (B, 2, X, Y)

        # A cell that was seen costs what it is known to, another what is guessed.
        first = math.log((PRIOR - LEAST_EXTRA) / (MOST_EXTRA - PRIOR))
        share = (first + answer[:, 0]).sigmoid()
        extra = LEAST_EXTRA + (MOST_EXTRA - LEAST_EXTRA) * share
        cost = torch.where(is_known, 1.0, 1.0 + extra).masked_fill(is_blocked, BLOCKED)

        return Prices(cost, is_goal, answer[:, 1])

    def _guess(self, planes: Tensor) -> Tensor:
        found = self.first(planes).relu()
        for layer in self.layers:
            found = found + layer(found).relu()
        answer: Tensor = self.read_out(found)

        return answer


def _directions(goals: Tensor, shape: tuple[int, int]) -> Tensor:
    """Where the goals lie from each cell: x and y of a vector of length 1, ``(B, 2, X, Y)``; of
    length 0 at the goal.
    """
    i = torch.arange(shape[0], device=goals.device)[:, None]  # (X, 1)
    j = torch.arange(shape[1], device=goals.device)  # (Y,)
    along_x = ((goals // shape[1])[:, None, None] - i).expand(-1, *shape)
    along_y = ((goals % shape[1])[:, None, None] - j).expand(-1, *shape)

    return normalize(torch.stack([along_x, along_y], dim=1).float(), dim=1)


def costs_of_moves(cost: Tensor) -> Tensor:
    """Costs of the 8 moves ``(B, 8, X, Y)``: their lengths times what the cells ahead cost, ``(B,
    X, Y)``.
    """
    ahead = neighbours(pad(cost, (1, 1, 1, 1), value=BLOCKED))
    each = zip(MOVE_LENGTHS.tolist(), ahead, strict=True)

    return torch.stack([length * cost_ahead for length, cost_ahead in each], dim=1)
