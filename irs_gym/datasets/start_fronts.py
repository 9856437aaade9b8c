"""`StartFronts`: for each scene, what its own start has to pay for which distance."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.budget import can_pay
from irs_gym.mdp.dynamics import budget_to_go_of, paid_at_start
from irs_gym.mdp.task import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class StartFronts:
    """The Pareto fronts of cost and distance from the starts of S scenes to their goals.

    Each is worked out where it is first asked for, in some 10 ms, and kept.
    """

    def __init__(self, count: int, world: Callable[[int], World]) -> None:
        """Fronts of that many worlds, which are asked for by their number."""
        self._world = world
        self._is_known = np.zeros(count, dtype=bool)
        # (S, P), points of rising cost; inf behind the last
        self._costs = np.full((count, 1), np.inf)
        self._distances = np.full((count, 1), np.inf)

    def distance(self, scenes: Ints, budgets: Floats) -> Floats:
        """Metres of the shortest paths within budgets, ``(n,)`` as both; inf where there is none.

        ``scenes`` are numbers of scenes; a budget pays for the start as well.
        """
        for number in np.unique(scenes[~self._is_known[scenes]]).tolist():
            self._learn(number)

        is_within = can_pay(budgets[:, None], self._costs[scenes])  # (n, P)
        last = np.count_nonzero(is_within, axis=1) - 1  # (n,), -1 where no point is
        metres = self._distances[scenes, last]

        return np.where(last >= 0, metres, np.inf)

    def _learn(self, number: int) -> None:
        world = self._world(number)
        start = world.radio_map.grid.flat(world.start)
        fronts = budget_to_go_of(world, world.goal)
        front = slice(fronts.offsets[start], fronts.offsets[start + 1])
        costs = fronts.costs[front] + paid_at_start(world, start)

        missing = len(costs) - self._costs.shape[1]
        if missing > 0:
            behind = ((0, 0), (0, missing))
            self._costs = np.pad(self._costs, behind, constant_values=np.inf)
            self._distances = np.pad(self._distances, behind, constant_values=np.inf)

        self._costs[number, : len(costs)] = costs
        self._distances[number, : len(costs)] = fronts.distances[front]
        self._is_known[number] = True
