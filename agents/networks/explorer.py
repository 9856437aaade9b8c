"""`ExplorerNetwork`: guesses what a robot has not seen, and plans through what it has seen and
guessed.
"""

from copy import deepcopy
from math import exp, log, log1p, sqrt
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import conv2d, pad, pixel_shuffle, pixel_unshuffle, softplus

from agents.compiled import compiled
from agents.networks.map_network import MapPlan
from agents.networks.planner import neighbours, plan
from irs_gym.grid import MOVE_LENGTHS

BLOCKED = 1e6
"""Cost of entering a cell known to be infeasible: more than any way through unknown cells, be it
through all cells of a maze of 160 x 160."""
PRIOR = 130 / 1024
"""Before it has learned, a cell not seen costs its length times 1 + this."""
LEAST_EXTRA = 51 / 1024
MOST_EXTRA = 1.0
"""Whatever is learned, a cell not seen costs its length times 1 + something between these: what
holds in some factories can do no more harm than that in others."""
KNOWN_EXTRA = 0.125
"""A cell seen to be feasible costs its length times 1 + something between 0 and this: enough to
choose among ways of nearly the same length."""

_PLANES = 8  # what the network sees of each cell
_BLOCK = 2  # cells a side of the blocks that are one place each to the convolutions
_DILATIONS = (1, 2, 4, 2, 1)  # in blocks, so that an answer depends on cells up to 23 away

# What is read out before it has learned: a logit, the logarithm of a caution by which it makes the
# prior, and a preference.
_FIRST_LOGIT = 1.0
_FIRST_CAUTION = (PRIOR - LEAST_EXTRA) / log1p(exp(-_FIRST_LOGIT))
_FIRST_PREFERENCE = -2.0
_MOST_LOG_CAUTION = 20.0  # keeps its exponential finite
_ANSWERS = 3  # for each cell
_FIRST_ANSWER = torch.tensor([_FIRST_LOGIT, log(_FIRST_CAUTION), _FIRST_PREFERENCE])

# But for learning, all numbers are whole multiples of such steps.
_VALUE_STEPS = 128.0  # in 1
_LARGEST_VALUE = 16.0
_WEIGHT_STEPS = 512.0
_LARGEST_WEIGHT = 8.0  # and bias
_PRICE_STEPS = 1024
_EXACT = 2.0**24  # up to so many steps a sum is exact in single precision, in whatever order

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Kernel = tuple[Tensor, Tensor]
"""Weights ``(O, C, 3, 3)`` and biases ``(O,)`` of a convolution."""


class Kernels(NamedTuple):
    """What the convolutions multiply by: weights, and the biases of all but the last."""

    first: Kernel  # (W, 8, 6, 6), of what is seen
    hidden: list[Kernel]  # (W, W, 3, 3) each
    answer: Kernel  # (12, W, 3, 3), of what was found
    own: Tensor  # (12, 8, 6, 6), of what is seen there


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
    """Convolutions give each cell a cost, and a dynamic programme finds the way.

    A move costs its length in cells times what the cell ahead does: `BLOCKED` where it was seen to
    be infeasible, 1 and up to `KNOWN_EXTRA` where it was seen to be feasible, and 1 + c where it
    was not seen, with c between `LEAST_EXTRA` and `MOST_EXTRA`, and `PRIOR` to begin with. With
    nothing above 1 it would be what optimistic replanning computes. What is learned is how likely
    unseen cells are to be feasible, how much to heed that, and which known cells to prefer.

    It sees nothing that tells one kind of factory from another: neither how large a map is or how
    far the goal, but in which direction, nor the IRS, but what it does to the margins.

    Its places are blocks of cells, but all cells of a block are read out alike: otherwise it would
    learn checkerboards of prices, in which diagonal moves cost less than straight ones.

    Once it has learned (``eval()``), what convolutions multiply and add up are whole numbers of
    steps so few that no sum is rounded. So prices are the same to the last digit in any batch and
    on any machine.

    Parameters
    ----------
    width
        Channels of the hidden layers.
    """

    former_weights = {
        "layers.6.weight": "it is an explorer of old, which saw each cell by itself: train it anew",
        "read_out.weight": "it is an explorer of old, which read out each place in a block by "
        "itself: train it anew",
    }
    """As `agents.networks.planner.PlanningNetwork.former_weights`."""

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        self.first = nn.Conv2d(_PLANES * _BLOCK**2, width, 3, padding=1)
        self.layers = nn.ModuleList(
            nn.Conv2d(width, width, 3, padding=step, dilation=step) for step in _DILATIONS
        )
        self.answer = nn.Conv2d(width + _PLANES, _ANSWERS, 3, padding=1)

        # It begins near optimism: every cell is as likely to be feasible, and costs a little more.
        assert self.answer.bias is not None  # as it is asked for above
        nn.init.zeros_(self.answer.weight)
        with torch.no_grad():
            self.answer.bias.copy_(_FIRST_ANSWER)

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
        """A copy that reads out what lies between its answers before it has learned, at a share of
        0, and its own, at 1.
        """
        other = deepcopy(self)
        assert other.answer.bias is not None
        with torch.no_grad():
            other.answer.weight *= share
            other.answer.bias.lerp_(_FIRST_ANSWER, 1.0 - share)

        return other

    def plan(self, cost: Tensor, is_goal: Tensor) -> MapPlan:
        """Plan for given costs of the cells; a map's plan is the same in any batch."""
        return plan(costs_of_moves(cost), is_goal, self.log_beta.exp())

    def kernels(self) -> Kernels:
        """What the convolutions multiply by; but for learning, rounded."""
        # All cells are read out alike, so that none costs less for its place in a block.
        weight, bias = _kernel_of(self.answer)  # (3, width + 8, 3, 3), for cells
        each = _of_blocks(weight[:, :-_PLANES])  # for each cell of a block, which all are alike
        alike = each.view(len(each), -1, _BLOCK**2, 3, 3).sum(dim=2)
        own = _of_blocks(weight[:, -_PLANES:])
        whole = torch.cat([alike, own], dim=1)  # (12, width + 32, 3, 3)
        last = whole, bias.repeat_interleave(_BLOCK**2)

        kernels = [_kernel_of(self.first), *map(_kernel_of, self.layers), last]
        if not self.training:
            kernels = [_exact(*each) for each in kernels]

        # What multiplies cells by their places in a block, as kernels that go from block to block.
        (weight, bias), *hidden, (whole, last_bias) = kernels
        found, own = whole.tensor_split([alike.shape[1]], dim=1)

        return Kernels(
            first=(pixel_shuffle(weight, _BLOCK), bias),
            hidden=hidden,
            answer=(found, last_bias),
            own=pixel_shuffle(own, _BLOCK),
        )

    def prices(self, margin: Tensor, goals: Tensor, kernels: Kernels | None = None) -> Prices:
        """What cells cost, of the arguments of `forward`.

        Who asks often may hand in `kernels`, which take as long to make for one map as for many.
        """
        columns, rows = margin.shape[1:]
        seen = _planes(margin.cpu().contiguous().numpy(), goals.cpu().numpy())
        planes = torch.from_numpy(seen).to(margin.device).permute(0, 3, 1, 2)
        answers = self._guess(planes, kernels or self.kernels())[..., :columns, :rows]
        feasible, log_caution, preference = answers.double().unbind(1)  # (B, X, Y), as the others

        is_known = ~margin.isnan()
        is_goal = torch.zeros_like(is_known)
        is_goal.view(len(goals), -1).scatter_(1, goals[:, None], True)

        # A cell not seen costs the more the less likely it is, one that was a little more or less.
        surprise = softplus(-feasible)  # in nats, were it feasible
        caution = log_caution.clamp(max=_MOST_LOG_CAUTION).exp()
        unknown = (LEAST_EXTRA + caution * surprise).clamp(max=MOST_EXTRA)
        extra = torch.where(is_known, KNOWN_EXTRA * preference.sigmoid(), unknown)
        extra = extra if self.training else _in_steps(extra, _PRICE_STEPS, MOST_EXTRA)
        cost = (1.0 + extra.float()).masked_fill(margin < 0, BLOCKED)

        return Prices(cost, is_goal, answers[:, 0])

    def _guess(self, planes: Tensor, kernels: Kernels) -> Tensor:
        """What the convolutions say of each cell, ``(B, 3, X, Y)``, of planes ``(B, 8, X, Y)``."""
        seen = self._rounded(planes * self._unit)

        # From cells to blocks, a step each, and those around them: (B, W, X / 2, Y / 2).
        found = self._rounded(conv2d(seen, *kernels.first, stride=_BLOCK, padding=_BLOCK).relu_())
        for step, kernel in zip(_DILATIONS, kernels.hidden, strict=True):
            change = conv2d(found, *kernel, padding=step, dilation=step)
            found = self._rounded(found + change.relu_())

        answers = conv2d(found, *kernels.answer, padding=1)
        answers += conv2d(seen, kernels.own, stride=_BLOCK, padding=_BLOCK)
        answers /= self._unit

        return pixel_shuffle(answers, _BLOCK)

    @property
    def _unit(self) -> float:
        """How much 1 is to the convolutions: but for learning, they count steps."""
        return 1.0 if self.training else _VALUE_STEPS

    def _rounded(self, values: Tensor) -> Tensor:
        """Cut off and rounded to whole steps, in place; but for learning, as they are."""
        most = _LARGEST_VALUE * _VALUE_STEPS
        return values if self.training else values.clamp_(-most, most).round_()


def _kernel_of(layer: nn.Module) -> Kernel:
    assert isinstance(layer, nn.Conv2d)
    assert layer.bias is not None  # as no layer is without one
    return layer.weight, layer.bias


def _of_blocks(kernel: Tensor) -> Tensor:
    """The kernel ``(4 O, 4 C, 3, 3)`` that does to blocks what one of ``(O, C, 3, 3)`` does to
    cells.
    """
    each = [pad(kernel, (1 + j, 2 - j, 1 + i, 2 - i)) for i in range(2) for j in range(2)]
    cells = torch.stack(each, dim=1).flatten(0, 1)  # (4 O, C, 6, 6), around each cell of a block
    return pixel_unshuffle(cells, _BLOCK)


@compiled
def _planes(margin: Floats, goals: Ints) -> Floats:
    """What the network sees of each cell of maps ``(B, X, Y)``, in the precision of the margins.

    The shape is ``(B, X, Y, 8)``, with cells off the map that make blocks whole: convolutions take
    a third of the time where channels lie side by side in memory. The channels: whether it is
    known, its margin, whether it is feasible, closed, the goal, on the map; and where the goal is.
    """
    count, columns, rows = margin.shape
    shape = (count, columns + columns % _BLOCK, rows + rows % _BLOCK, _PLANES)
    planes = np.zeros(shape, margin.dtype)

    for n in range(count):
        goal_i, goal_j = divmod(goals[n], rows)

        for i in range(columns):
            for j in range(rows):
                sees = planes[n, i, j]
                sees[5] = 1.0

                value = margin[n, i, j]
                if not np.isnan(value):
                    sees[0] = 1.0
                    sees[1] = value
                    sees[2 if value >= 0.0 else 3] = 1.0

                # A vector of length 1, and of length 0 at the goal.
                length = np.float32(sqrt((goal_i - i) ** 2 + (goal_j - j) ** 2))
                if length == 0.0:
                    sees[4] = 1.0
                else:
                    sees[6] = np.float32((goal_i - i) / length)
                    sees[7] = np.float32((goal_j - j) / length)

    return planes


def _exact(weight: Tensor, bias: Tensor) -> Kernel:
    """A kernel ``(O, C, 3, 3)`` and its bias, in steps of values, rounded so that no sum of rounded
    values is: the larger they are, the coarser.
    """
    steps = _WEIGHT_STEPS
    while True:
        rounded = _in_steps(weight, steps, _LARGEST_WEIGHT)
        most = rounded.abs().flatten(1).sum(dim=1) * _LARGEST_VALUE + _LARGEST_WEIGHT
        if most.max() * _VALUE_STEPS * steps <= _EXACT:
            bias = _in_steps(bias, steps * _VALUE_STEPS, _LARGEST_WEIGHT)
            return rounded, bias * _VALUE_STEPS
        steps /= 2


def _in_steps(values: Tensor, steps: float, largest: float) -> Tensor:
    """Values cut off at the largest, and rounded to whole steps, so many of which are 1."""
    return (values.clamp(-largest, largest) * steps).round_() / steps


def costs_of_moves(cost: Tensor) -> Tensor:
    """Costs of the 8 moves ``(B, 8, X, Y)``: their lengths times what the cells ahead cost, ``(B,
    X, Y)``.
    """
    ahead = neighbours(pad(cost, (1, 1, 1, 1), value=BLOCKED))
    each = zip(MOVE_LENGTHS.tolist(), ahead, strict=True)

    return torch.stack([length * cost_ahead for length, cost_ahead in each], dim=1)
