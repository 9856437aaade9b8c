"""`Labels`: what the oracle says of every action in every cell, exactly."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, Cell, legal_moves
from irs_gym.mdp.dynamics import tabulate
from irs_gym.mdp.task import World
from irs_gym.memory import freeze
from irs_gym.oracle.shortest_path import optimal_moves


@dataclass(frozen=True, eq=False)
class Labels:
    """What the oracle says of C flat cells, where cells below the target refuse the robot.

    Attributes
    ----------
    is_optimal
        Bool, shape ``(C, 8)``: whether an action begins a shortest way to the goal; none does at
        the goal.
    regret
        float64, shape ``(C, 8)``: metres that an action loses against the best, V(s) - Q(s, a)
        undiscounted: its length and the way that is left after it, less the way that is left
        before. A refused move loses its own length, as the reward has it. NaN where the goal cannot
        be reached.
    """

    is_optimal: NDArray[np.bool_]
    regret: NDArray[np.float64]

    def __post_init__(self) -> None:
        freeze(self.is_optimal, self.regret)


@lru_cache(maxsize=8)
def labels_of(world: World, goal: Cell) -> Labels:
    """Labels of a world for a goal; kept, so the same goal costs nothing again.

    Raises ``ValueError`` where the rules let a robot into cells below the target: distances to go
    are then not what is left to do.
    """
    if world.rules.constraint != "refuse":
        raise ValueError(f"constraint={world.rules.constraint!r}: labels are of 'refuse' alone")

    tables = tabulate(world, goal)
    cell_size = world.radio_map.grid.cell_size
    legal = legal_moves(world.feasible, **world.motion)
    is_optimal = optimal_moves(tables.distance_to_go[None], cell_size, legal[None])[0]
    is_optimal = is_optimal.reshape(8, -1).T  # (C, 8)

    to_go = tables.distance_to_go.ravel()  # (C,)
    to_go = np.where(np.isfinite(to_go), to_go, np.nan)
    ahead = to_go[tables.transition["next_cell"].reshape(-1, 8)]  # (C, 8)
    regret = MOVE_LENGTHS * cell_size + ahead - to_go[:, None]

    # The best lose nothing, whatever the rounding of sums.
    return Labels(is_optimal, np.where(is_optimal, 0.0, regret))
