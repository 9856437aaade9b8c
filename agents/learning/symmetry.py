"""`turn`: a map, or moves over it, under one of the eight symmetries of the square."""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from irs_gym.grid import MOVES

# bit 0: i runs the other way, bit 1: j does, bit 2: i and j are exchanged first
SYMMETRIES = range(8)


def turn(maps: Tensor, symmetry: int) -> Tensor:
    """Maps ``(..., X, Y)`` under a symmetry: ``(..., X, Y)``, or ``(..., Y, X)`` from 4 on."""
    if symmetry & 4:
        maps = maps.transpose(-2, -1)

    axes = [axis for axis, bit in ((-2, 1), (-1, 2)) if symmetry & bit]
    return maps.flip(axes) if axes else maps.contiguous()


def turn_moves(of_moves: Tensor, symmetry: int) -> Tensor:
    """What is said of each move in each cell, ``(B, 8, X, Y)``, under a symmetry."""
    return turn(of_moves[:, sources(symmetry)], symmetry)


def sources(symmetry: int) -> Sequence[int]:
    """For each of the eight moves, the move that the symmetry makes into it."""
    moves = MOVES[:, ::-1] if symmetry & 4 else MOVES
    turned = moves * [-1 if symmetry & 1 else 1, -1 if symmetry & 2 else 1]
    return [int(np.flatnonzero((turned == move).all(axis=1))[0]) for move in MOVES]
