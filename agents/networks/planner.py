"""`PlanningNetwork`: a small network gives each move its cost, and a dynamic programme finds the
way.

The dynamic programme is built in: only what the moves cost is learned.
"""

from typing import Any, get_args

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from agents.networks.map_network import MapPlan
from agents.registry import Encoding
from irs_gym.grid import MOVES, flat_cells
from irs_gym.mdp.packing import MARGIN_SCALE_DB

MARGIN_SCALES_DB = (5.0, 1.0, 0.2, 0.04, 0.008)
LOG_COST = (-2.0, 9.0)  # natural logarithms of the least and the highest cost of a move
UNREACHED = 1e9
"""Cost to go where no way was found: any cost added to it is lost in float32, so none leaks."""
FARTHEST = 50.0
"""A move worse than the best by more is no worse to the softmax, which keeps logits finite."""
_ROUNDS_PER_CHECK = 4


class PlanningNetwork(nn.Module):
    """A value-iteration network in the min-plus algebra, for maps of any size.

    A convolution of 3 x 3 cells and two of 1 x 1 give each of the 8 moves in each cell a positive
    cost. With V = 0 at the goal, V <- min over moves (cost + V of the neighbour) is repeated until
    nothing changes, with no way off the map. The logits are - beta (cost + V of the neighbour - the
    least of these).

    Parameters
    ----------
    encoding
        What the costs are learned from. ``"mask"``: the goal and, ready-made, the feasible cells.
        ``"margin"``: the goal, the free cells, and the margin in dB over the target, cut off at
        several scales (`MARGIN_SCALES_DB`) so that a small network can tell its sign; the threshold
        itself is learned.
    width
        Channels of the hidden layers.
    """

    def __init__(self, encoding: Encoding = "mask", width: int = 16) -> None:
        super().__init__()
        if encoding not in get_args(Encoding):
            raise ValueError(f"encoding={encoding!r} must be one of {get_args(Encoding)}")

        self.encoding = encoding
        planes = 2 if encoding == "mask" else 2 + len(MARGIN_SCALES_DB)
        self.log_costs = nn.Sequential(
            nn.Conv2d(planes, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 1),
            nn.ReLU(),
            nn.Conv2d(width, len(MOVES), 1),
        )
        self.log_beta = nn.Parameter(torch.tensor(1.0))

    def forward(self, maps: Tensor, rounds: int | None = None) -> MapPlan:
        """Plan for maps ``(B, 3, X, Y)`` of `agents.networks.map_network.maps_of`.

        ``rounds`` bounds the rounds of value iteration; by default they end when nothing changes
        any more.
        """
        costs = self.log_costs(self.encode(maps)).clamp(*LOG_COST).exp()
        return plan(costs, maps[:, 2] > 0, self.log_beta.exp(), rounds)

    def encode(self, maps: Tensor) -> Tensor:
        """Planes that the costs are learned from, in [0, 1], and 0 where blocked as off the map:
        ``(B, C, X, Y)``.
        """
        margin = maps[:, 0]
        goal = maps[:, 2]
        if self.encoding == "mask":
            return torch.stack([(margin >= 0).to(maps), goal], dim=1)

        # In units of each scale, from [-1, 1] to [0, 1].
        planes = [
            (margin * (MARGIN_SCALE_DB / scale)).clamp(-1.0, 1.0) * 0.5 + 0.5
            for scale in MARGIN_SCALES_DB
        ]

        return torch.stack([*planes, 1.0 - maps[:, 1], goal], dim=1)


def plan(
    costs: Tensor, is_goal: Tensor, beta: Tensor | float = 1.0, rounds: int | None = None
) -> MapPlan:
    """Plan for given costs of the moves ``(B, 8, X, Y)`` and goals, bool ``(B, X, Y)``."""
    # V of each cell, (B, X, Y), and cost + V of the neighbour of each move, (B, 8, X, Y).
    to_go: Tensor = _CostToGo.apply(costs, is_goal, rounds)  # type: ignore[no-untyped-call]
    ahead = costs + torch.stack(neighbours(pad(to_go, (1, 1, 1, 1), value=UNREACHED)), dim=1)
    worse = (ahead - ahead.amin(dim=1, keepdim=True)).clamp(max=FARTHEST)

    return MapPlan(-beta * worse, to_go)


class _CostToGo(torch.autograd.Function):
    """Least cost from each cell to the goal, and its exact gradient.

    The cost to go is the sum of the costs along the best path, so its gradient is the number of
    best paths that run over a move, each weighted by the gradient that comes in where it begins.
    """

    @staticmethod
    def forward(ctx: Any, costs: Tensor, is_goal: Tensor, rounds: int | None) -> Tensor:
        # V is 0 at the goal and out of reach elsewhere; the border off the map stays out of reach.
        by_move = costs.transpose(0, 1).contiguous()  # (8, B, X, Y)
        padded = pad(torch.where(is_goal, 0.0, UNREACHED).to(costs), (1, 1, 1, 1), value=UNREACHED)
        to_go = padded[:, 1:-1, 1:-1]  # (B, X, Y), a view
        views = neighbours(padded)
        most = is_goal[0].numel() if rounds is None else rounds  # a best path visits no cell twice

        for done in range(1, most + 1):
            before = to_go.clone() if done % _ROUNDS_PER_CHECK == 0 else None
            # In place, so that it goes as far as a round on a copy would, or farther.
            for cost, neighbour in zip(by_move, views, strict=True):
                torch.minimum(to_go, cost + neighbour, out=to_go)

            if before is not None and torch.equal(before, to_go):
                break

        # Where the best paths lead, and where they end: for the gradient.
        if ctx.needs_input_grad[0]:
            best = torch.stack(
                [cost + each for cost, each in zip(by_move, views, strict=True)]
            ).argmin(dim=0)
            ctx.save_for_backward(best, is_goal | (to_go >= UNREACHED))

        return to_go.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        best, is_end = ctx.saved_tensors
        cells = best.numel()
        steps = torch.from_numpy(flat_cells(MOVES, best.shape[1:])).to(best.device)
        here = torch.arange(cells, device=best.device).view_as(best)
        ahead = torch.where(is_end, cells, here + steps[best]).flatten()
        ahead = torch.cat([ahead, ahead.new_full((1,), cells)])  # paths end in an extra cell
        through = torch.cat([gradient.flatten(), gradient.new_zeros(1)])

        # In round k each cell hands all that it has gathered to the cell 2**k moves ahead.
        for _ in range(cells.bit_length()):
            if bool((ahead == cells).all()):
                break

            through = through.index_add(0, ahead, through)
            through[cells] = 0.0
            ahead = ahead[ahead]

        weight = through[:cells].view_as(best).masked_fill(is_end, 0.0)
        batch, *shape = best.shape
        costs = gradient.new_zeros(batch, len(MOVES), *shape).scatter_(
            1, best[:, None], weight[:, None]
        )

        return costs, None, None


def neighbours(padded: Tensor) -> list[Tensor]:
    """Views of maps with a border of one cell, ``(B, X + 2, Y + 2)``: for each move, the values
    where it leads, ``(B, X, Y)``. As `irs_gym.grid.neighbours`, without a copy.
    """
    columns = padded.shape[1] - 2
    rows = padded.shape[2] - 2
    return [
        padded[:, 1 + di : columns + 1 + di, 1 + dj : rows + 1 + dj] for di, dj in MOVES.tolist()
    ]
