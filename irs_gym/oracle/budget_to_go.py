"""`budget_to_go`: the shortest distance to the goal from every cell with what budget is left."""

from dataclasses import dataclass
from math import inf, isnan
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import Cell, as_cell, cells_at, checked_cell_size
from irs_gym.memory import freeze
from irs_gym.oracle.label_setting import TOLERANCE, checked_costs, labels_to_go, whole_costs
from irs_gym.oracle.shortest_path import Path, flat_cell
from irs_gym.oracle.whole_lengths import true_lengths


@dataclass(frozen=True, eq=False)
class BudgetToGo:
    """For every cell, the Pareto front of the cost and the distance to one goal.

    What a robot pays for the cell it stands in is paid: the cost to go is that of the cells after
    it. The fronts of all cells lie behind each other, in the order of the flat cells.

    Attributes
    ----------
    shape
        Cells ``(X, Y)`` of the map.
    most
        The greatest budget that is answered, or all costs of the map together where that is less;
        costs above it are left out.
    offsets
        int64, shape ``(X * Y + 1,)``: the front of flat cell n are the pairs from ``offsets[n]`` to
        before ``offsets[n + 1]``; there is none where no path meets the budget.
    costs
        float64, shape ``(L,)``, rising within a cell: costs to go.
    distances
        float64, shape ``(L,)``, falling within a cell, in metres: the shortest distance to go at
        each cost.
    after
        int32, shape ``(L,)``: the pair of the next cell that is left after the first move of such a
        path; -1 at the goal.

    Examples
    --------
    >>> import numpy as np
    >>> to_go = budget_to_go(np.array([[0.0, 1.0, 0.0]]), (0, 2), cell_size=0.5, most=1)
    >>> to_go.distance([0, 1], [0.0, 0.0]).tolist()  # the first has the middle cell ahead of it
    [inf, 0.5]
    """

    shape: tuple[int, int]
    most: float
    offsets: NDArray[np.int64]
    costs: NDArray[np.float64]
    distances: NDArray[np.float64]
    after: NDArray[np.int32]

    def __post_init__(self) -> None:
        freeze(self.offsets, self.costs, self.distances, self.after)

    def distance(self, cells: ArrayLike, budget_left: ArrayLike) -> NDArray[np.float64]:
        """Shortest distances to the goal in metres, inf where no path meets the budget.

        ``cells`` are flat cells of any shape, and ``budget_left`` what may be paid for the cells
        after them, of the same shape or one number; negative where it is overdrawn. A cost that
        exceeds it by no more than rounding, 1e-12 of ``most``, meets it.
        """
        pair = self.pair(cells, budget_left)

        return np.where(pair >= 0, self.distances.take(pair, mode="clip"), inf)

    def pair(self, cells: ArrayLike, budget_left: ArrayLike) -> NDArray[np.int64]:
        """The pairs among ``costs`` and ``distances`` that `distance` answers with; -1 for none."""
        budget = np.asarray(budget_left) + TOLERANCE * self.most

        return last_within(self.offsets, self.costs, cells, budget)

    def path(self, cell: Cell, budget_left: float) -> Path | None:
        """A shortest path from a cell to the goal that the budget allows, or None."""
        pair = int(self.pair(flat_cell(np.empty(self.shape, bool), cell, "cell"), budget_left))
        if pair < 0:
            return None

        distance = float(self.distances[pair])
        pairs = []
        while pair >= 0:
            pairs.append(pair)
            pair = int(self.after[pair])

        flat = np.searchsorted(self.offsets, pairs, side="right") - 1

        return Path(distance, cells_at(flat, self.shape))


def last_within(
    offsets: NDArray[np.int64], costs: NDArray[np.float64], cells: ArrayLike, budget: ArrayLike
) -> NDArray[np.int64]:
    """Where the last cost of each cell lies that is at most the budget; -1 where there is none.

    The arrays are those of a `BudgetToGo`, or of many behind each other.
    """
    cells = np.asarray(cells)
    first = offsets[cells]
    low = first
    high = offsets[cells + 1]

    # bisection, for all at once: costs before `low` meet the budget, those from `high` on do not
    for _ in range(int(np.max(high - low, initial=0)).bit_length()):
        middle = (low + high) >> 1
        meets = costs.take(middle, mode="clip") <= budget
        is_open = low < high
        low = np.where(meets & is_open, middle + 1, low)
        high = np.where(meets, high, middle)

    return np.where(low > first, low - 1, -1)


def budget_to_go(
    cost: NDArray[np.float64], goal: Cell, cell_size: float, most: float
) -> BudgetToGo:
    """The Pareto front of cost and distance to the goal from every cell, up to a budget, exactly.

    Parameters
    ----------
    cost
        Shape ``(X, Y)``: what is paid on entering a cell, 0 or more; inf in obstacles.
    goal
        Cell (i, j).
    cell_size
        Edge of a cell in metres.
    most
        The greatest budget that will be asked for, which bounds the work.

    Raises
    ------
    ValueError
        Where ``cost`` is no map of such numbers, ``goal`` no cell of it or an obstacle, or
        ``cell_size`` or ``most`` no number that it can be.

    Examples
    --------
    >>> import numpy as np
    >>> cost = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    >>> to_go = budget_to_go(cost, (0, 2), cell_size=0.5, most=1)
    >>> to_go.distance([0, 0], [0, 1]).round(3).tolist()  # around the cell that costs, and over it
    [1.414, 1.0]
    """
    cost = checked_costs(cost)
    cell_size = checked_cell_size(cell_size)
    most = checked_budget(most, "most")
    goal = as_cell(goal, "goal")
    sink = flat_cell(cost, goal, "goal")
    if np.isinf(cost[goal]):
        raise ValueError(f"goal={goal} lies in an obstacle: its cost is inf")

    finite = cost[np.isfinite(cost)]
    greatest = min(most, float(finite.sum()))
    whole, unit = whole_costs(cost, greatest)
    bound = np.floor(greatest * (1 + TOLERANCE) / unit)
    labels = labels_to_go(whole, sink, lambda labels: labels.costs <= bound)

    # in the order of the cells, and of the costs in each
    order = np.lexsort((labels.costs, labels.cells))
    place = np.empty(len(order) + 1, dtype=np.int32)
    place[order] = np.arange(len(order))
    place[-1] = -1  # after the goal
    counts = np.bincount(labels.cells, minlength=cost.size)

    return BudgetToGo(
        shape=(cost.shape[0], cost.shape[1]),
        most=greatest,
        offsets=np.append(0, np.cumsum(counts)),
        costs=labels.costs[order] * unit,
        distances=true_lengths(labels.lengths[order], cost.size) * cell_size,
        after=place[labels.after[order]],
    )


def checked_budget(budget: Any, name: str = "budget") -> float:
    """A budget; a ``ValueError`` says what is wrong with a number that is none."""
    is_number = isinstance(budget, Real) and not isinstance(budget, bool | np.bool_)
    if not is_number or isnan(budget) or budget < 0:
        raise ValueError(f"{name}={budget!r} must be a number, 0 or more")

    return float(budget)
