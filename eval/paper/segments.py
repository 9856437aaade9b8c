"""`Dips`: moves between feasible cells on whose way the gain falls below the target."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.paper.study import Scheme, Study
from irs_gym.grid import MOVES

POINTS = 41  # looked at along each move, both ends included


@dataclass(frozen=True)
class Dips:
    """How many moves there are, how many dip below the target, and how far below the worst falls in
    dB.
    """

    moves: int
    dips: int
    deepest_db: float


def dips_of_map(study: Study, scheme: Scheme, target_db: float) -> Dips:
    """Of all moves between two feasible cells, each way counted once. Continuous phases follow the
    robot.
    """
    feasible = study.radio_map(scheme).feasible(target_db)
    cells = np.argwhere(feasible)

    # the other four moves lead back
    both = np.concatenate([np.stack([cells, cells + move], axis=1) for move in MOVES[:4]])
    on_map = np.all((both[:, 1] >= 0) & (both[:, 1] < feasible.shape), axis=1)
    both = both[on_map]

    return _dips(study, scheme, target_db, both[feasible[tuple(both[:, 1].T)]])


def dips_of_path(study: Study, scheme: Scheme, target_db: float) -> Dips:
    """Of the oracle's path."""
    path = study.path(scheme, target_db)
    cells = np.zeros((0, 2), dtype=np.int64) if path is None else path.cells
    return _dips(study, scheme, target_db, np.stack([cells[:-1], cells[1:]], axis=1))


def _dips(study: Study, scheme: Scheme, target_db: float, moves: NDArray[np.int64]) -> Dips:
    """Of moves ``(n, 2, 2)`` between cells."""
    centres = study.scene.grid(study.cell_size).centres()
    ends = centres[moves[..., 0], moves[..., 1]]  # (n, 2, 2)
    share = np.linspace(0, 1, POINTS)[:, None]
    points = ends[:, :1] * (1 - share) + ends[:, 1:] * share  # (n, POINTS, 2)
    lowest = study.gain_at(points, scheme).min(axis=1)

    # the ends are feasible: rounding must not make them dip
    is_dip = lowest < target_db - 1e-9

    return Dips(len(moves), int(is_dip.sum()), float(target_db - lowest.min(initial=target_db)))
