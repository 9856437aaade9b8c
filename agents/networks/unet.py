"""`UNet`: a convolutional network that refines its answer over several passes from fine to coarse
and back.
"""

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, pad

from agents.networks.map_network import MapPlan
from irs_gym.grid import MOVES

_GROUPS = 8  # of channels that are normalised together
_FACTOR = 8  # sides of the maps are padded to multiples of this many cells
_UNIT = 40.0  # cells to go in the unit of the network's estimate


class UNet(nn.Module):
    """A U-Net whose core, on a grid twice as coarse as the map, is passed several times with the
    same weights.

    A way around obstacles is longer than a single pass can follow; each pass sees the map anew
    beside what the passes before it have found. Nothing in it is made for shortest paths.

    Parameters
    ----------
    width
        Channels on the map's own grid, a multiple of 8; twice as many on the coarser ones.
    passes
        Times that the core is passed, for maps of 40 x 40 cells; larger maps get more in
        proportion.
    """

    def __init__(self, width: int = 16, passes: int = 6) -> None:
        super().__init__()
        self.passes = passes
        wide = 2 * width
        if width % _GROUPS:
            raise ValueError(f"width={width} must be a multiple of {_GROUPS}, the groups of a norm")

        self.stem = nn.Sequential(conv_block(4, width), conv_block(width, width))
        self.enter = conv_block(width, wide, stride=2)
        self.begin = conv_block(2 * wide, wide)
        self.down = nn.ModuleList(
            [conv_block(wide, wide, stride=2), conv_block(wide, wide, stride=2)]
        )
        self.deep = conv_block(wide, wide)
        self.up = nn.ModuleList([conv_block(2 * wide, wide), conv_block(2 * wide, wide)])
        self.finish = nn.Conv2d(wide, wide, 3, padding=1)
        self.leave = nn.Sequential(
            conv_block(wide + width, 2 * width), conv_block(2 * width, 2 * width)
        )
        self.read_out = nn.Conv2d(2 * width, len(MOVES) + 1, 1)

    def forward(self, maps: Tensor) -> MapPlan:
        """Plan for maps ``(B, 3, X, Y)`` of `agents.networks.map_network.maps_of`."""
        columns, rows = maps.shape[-2:]
        margin = maps[:, :1]
        obstacle = maps[:, 1:2]

        # Feasible cells, the margin where there is one, obstacle and goal.
        is_feasible = (margin >= 0).to(maps)
        planes = torch.cat([is_feasible, margin * (1.0 - obstacle), maps[:, 1:]], dim=1)
        fine = self.stem(pad(planes, (0, -rows % _FACTOR, 0, -columns % _FACTOR)))

        # Each pass adds to what the passes before it have found, on a grid twice as coarse.
        seen = self.enter(fine)
        state = torch.zeros_like(seen)

        for _ in range(max(self.passes, self.passes * max(columns, rows) // 40)):
            state = state + self._pass(torch.cat([state, seen], dim=1))

        answer = self.read_out(self.leave(torch.cat([double_conv(state), fine], dim=1)))[
            ..., :columns, :rows
        ]

        return MapPlan(answer[:, :-1], _UNIT * answer[:, -1])

    def _pass(self, seen: Tensor) -> Tensor:
        half = self.begin(seen)
        quarter = self.down[0](half)
        eighth = self.deep(self.down[1](quarter))
        quarter = self.up[0](torch.cat([quarter, double_conv(eighth)], dim=1))

        passed: Tensor = self.finish(self.up[1](torch.cat([half, double_conv(quarter)], dim=1)))

        return passed


def conv_block(channels: int, width: int, stride: int = 1) -> nn.Sequential:
    """A convolution over 3 x 3 cells with its normalisation and activation."""
    convolution = nn.Conv2d(channels, width, 3, stride=stride, padding=1, bias=False)
    return nn.Sequential(convolution, nn.GroupNorm(_GROUPS, width), nn.ReLU())


def double_conv(maps: Tensor) -> Tensor:
    """Maps on a grid twice as fine."""
    return interpolate(maps, scale_factor=2.0, mode="nearest")
