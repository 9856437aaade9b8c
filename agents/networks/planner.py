"""`PlanningNetwork`: a small network gives each move its cost, and Dijkstra's algorithm finds the
way.

Built in are the rules and the search: moves into closed cells are barred, and the way is the
cheapest that is left. Learned is what the others cost.
"""

from collections.abc import Callable
from typing import Any, get_args

import numpy as np
import torch
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from torch import Tensor, nn
from torch.nn.functional import pad

from agents.networks.map_network import MapPlan
from agents.registry import Encoding
from irs_gym.grid import MOVES, flat_cells, legal_moves
from irs_gym.mdp.packing import MARGIN_SCALE_DB

MARGIN_SCALES_DB = (5.0, 1.0, 0.2, 0.04, 0.008)
COST = (1.0, 2.0)  # the least and the highest cost of a move
UNREACHED = 1e9
"""Cost to go where no way was found, and cost of moves that are barred."""
FARTHEST = 50.0
"""A move worse than the best by more is no worse to the softmax, which keeps logits finite."""
_ROUNDS_PER_CHECK = 4

Search = Callable[[Tensor, Tensor], Tensor]
"""What gives the least costs to go ``(B, X, Y)``, `UNREACHED` where there is no way, for costs of
the moves ``(B, 8, X, Y)`` and goals, bool ``(B, X, Y)``.
"""


class PlanningNetwork(nn.Module):
    """A value-iteration network in the min-plus algebra, for maps of any size.

    No move leads into an obstacle, off the map, or from a feasible cell into one that is not: that
    is built in, whatever is learned, so that no wall is ever traded for a price. A convolution of
    3 x 3 cells and two of 1 x 1 give each other move in each cell a cost between 1 and 2 (`COST`):
    that is all that is learned, and at first all moves cost the same. With V = 0 at the goal, V =
    min over moves (cost + V of the neighbour), exactly. The logits are - beta (cost + V of the
    neighbour - the least of these).

    So the greedy robot reaches every goal that can be reached, in at most twice as many moves as it
    takes, however little was learned; what is learned makes the way short. Where the goal cannot be
    reached, all moves are alike. From an infeasible cell (as under the constraint ``"allow"``) a
    way may lead on through others until it is out, and never leads in again. Diagonals pass
    corners, as in the paper's eq. (15c): a map does not tell of robots that cannot.

    All is in double precision, so that ways of thousands of moves are told apart, and equal ones
    are equal on any machine.

    Parameters
    ----------
    encoding
        What the costs are learned from. ``"mask"``: the goal and, ready-made, the feasible cells.
        ``"margin"``: the goal, the free cells, and the margin in dB over the target, cut off at
        several scales (`MARGIN_SCALES_DB`) so that a small network can tell its sign. Neither
        changes what is closed.
    width
        Channels of the hidden layers.
    """

    former_weights = {
        "log_costs.0.weight": "it is a planning network of old, which paid for walls in place of "
        "going round them: train it anew"
    }
    """Weights by which files of what this network was before are told, and what to say of them."""

    def __init__(self, encoding: Encoding = "mask", width: int = 16) -> None:
        super().__init__()
        if encoding not in get_args(Encoding):
            raise ValueError(f"encoding={encoding!r} must be one of {get_args(Encoding)}")

        self.encoding = encoding
        planes = 2 if encoding == "mask" else 2 + len(MARGIN_SCALES_DB)
        self.costs = nn.Sequential(
            nn.Conv2d(planes, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 1),
            nn.ReLU(),
            nn.Conv2d(width, len(MOVES), 1),
        )
        self.log_beta = nn.Parameter(torch.tensor(1.0))
        for each in self.costs[-1].parameters():
            nn.init.zeros_(each)  # at first all moves cost the same

        self.double()

    def forward(self, maps: Tensor) -> MapPlan:
        """Plan for maps ``(B, 3, X, Y)`` of `agents.networks.map_network.maps_of`."""
        least, highest = COST
        costs = least + (highest - least) * self.costs(self.encode(maps)).sigmoid()
        is_obstacle = maps[:, 1] > 0
        is_barred = barred_moves(is_obstacle | (maps[:, 0] < 0), is_obstacle)
        found = plan(costs, maps[:, 2] > 0, self.log_beta.exp(), dijkstra_search, is_barred)

        return MapPlan(found.logits.to(maps), found.to_go.to(maps))

    def encode(self, maps: Tensor) -> Tensor:
        """Planes that the costs are learned from, in [0, 1], and 0 where blocked as off the map:
        ``(B, C, X, Y)``.
        """
        margin = maps[:, 0].double()
        goal = maps[:, 2].double()
        if self.encoding == "mask":
            return torch.stack([(margin >= 0).to(margin), goal], dim=1)

        # In units of each scale, from [-1, 1] to [0, 1].
        planes = [
            (margin * (MARGIN_SCALE_DB / scale)).clamp(-1.0, 1.0) * 0.5 + 0.5
            for scale in MARGIN_SCALES_DB
        ]

        return torch.stack([*planes, 1.0 - maps[:, 1].double(), goal], dim=1)


def barred_moves(is_closed: Tensor, is_obstacle: Tensor | None = None) -> Tensor:
    """Moves that no plan takes, bool ``(B, 8, X, Y)``: those off the map and into closed cells
    ``(B, X, Y)``.

    With obstacles, which are closed as well, those between two closed cells that are none are not
    barred: they lead a robot out that stands in one.
    """
    leads_to = torch.stack(neighbours(pad(is_closed, (1, 1, 1, 1), value=True)), dim=1)
    if is_obstacle is None:
        return leads_to

    hits = torch.stack(neighbours(pad(is_obstacle, (1, 1, 1, 1), value=True)), dim=1)
    return hits | (leads_to & ~is_closed[:, None])


def value_iteration(costs: Tensor, is_goal: Tensor, rounds: int | None = None) -> Tensor:
    """A `Search` of all maps at once: quick where ways are short.

    ``rounds`` bounds the rounds; by default they end when nothing changes any more.
    """
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

    return to_go.clone()


def dijkstra_search(costs: Tensor, is_goal: Tensor) -> Tensor:
    """A `Search` in double precision, map by map: quick however long the ways are."""
    batch, _, *shape = costs.shape
    columns, rows = shape
    each = costs.double().permute(0, 2, 3, 1).reshape(-1, len(MOVES)).numpy()  # (B * X * Y, 8)
    on_map = np.tile(legal_moves(np.ones((columns, rows), dtype=bool)).reshape(-1, 8), (batch, 1))
    is_open = on_map & (each < UNREACHED)

    # From the goals backwards, over the moves turned round.
    cells = np.arange(len(each))
    first = np.concatenate([[0], is_open.sum(axis=1).cumsum()])
    ahead = (cells[:, None] + flat_cells(MOVES, (columns, rows)))[is_open]
    graph = csr_array((each[is_open], ahead, first), shape=(len(cells),) * 2)
    goals = cells[is_goal.flatten().numpy()]
    if not len(goals):
        return torch.full_like(is_goal, UNREACHED, dtype=costs.dtype)

    found = dijkstra(graph.T, indices=goals, min_only=True)

    return torch.from_numpy(found.clip(max=UNREACHED)).to(costs).view(batch, columns, rows)


def plan(
    costs: Tensor,
    is_goal: Tensor,
    beta: Tensor | float = 1.0,
    search: Search = value_iteration,
    is_barred: Tensor | None = None,
) -> MapPlan:
    """Plan for given costs of the moves ``(B, 8, X, Y)``, all of them positive, and goals, bool
    ``(B, X, Y)``.

    Parameters
    ----------
    search
        What finds the costs to go: `value_iteration`, or `dijkstra_search`.
    is_barred
        Moves that are never made, whatever they cost: bool ``(B, 8, X, Y)``, as `barred_moves` has
        them. Those off the map need not be told.
    """
    if is_barred is not None:
        costs = costs.masked_fill(is_barred, UNREACHED)

    # V of each cell, (B, X, Y), and cost + V of the neighbour of each move, (B, 8, X, Y).
    to_go: Tensor = _CostToGo.apply(costs, is_goal, search)  # type: ignore[no-untyped-call]
    ahead = costs + torch.stack(neighbours(pad(to_go, (1, 1, 1, 1), value=UNREACHED)), dim=1)
    ahead = ahead.clamp(max=UNREACHED)  # of moves that lead to no goal, none is better
    worse = (ahead - ahead.amin(dim=1, keepdim=True)).clamp(max=FARTHEST)

    return MapPlan(-beta * worse, to_go)


class _CostToGo(torch.autograd.Function):
    """Least cost from each cell to the goal, and its exact gradient.

    The cost to go is the sum of the costs along the best path, so its gradient is the number of
    best paths that run over a move, each weighted by the gradient that comes in where it begins.
    """

    @staticmethod
    def forward(ctx: Any, costs: Tensor, is_goal: Tensor, search: Search) -> Tensor:
        to_go = search(costs, is_goal)

        # Where the best paths lead, and where they end: for the gradient.
        if ctx.needs_input_grad[0]:
            views = neighbours(pad(to_go, (1, 1, 1, 1), value=UNREACHED))
            best = (costs + torch.stack(views, dim=1)).argmin(dim=1)
            ctx.save_for_backward(best, is_goal | (to_go >= UNREACHED))

        return to_go

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
