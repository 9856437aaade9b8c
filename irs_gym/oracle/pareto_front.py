"""`pareto_front`: all trade-offs between the cost and the distance of a path, exactly."""

from dataclasses import dataclass
from math import fsum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from irs_gym.grid import MOVE_LENGTHS, Cell, as_cell, cells_at, checked_cell_size
from irs_gym.memory import freeze
from irs_gym.oracle.budget_to_go import checked_budget
from irs_gym.oracle.label_setting import (
    TOLERANCE,
    Labels,
    Numbers,
    checked_costs,
    labels_to_go,
    whole_costs,
)
from irs_gym.oracle.shortest_path import (
    Path,
    edges,
    flat_cell,
    path_length,
    shortest_path,
)
from irs_gym.oracle.whole_lengths import whole_lengths

_COLLINEAR = 1e-9  # relative: a corner of the hull lies at least so far below its neighbours' chord


@dataclass(frozen=True, eq=False)
class Front:
    """Pareto front of the paths from start to goal: none costs less and is as short, or as cheap
    and shorter.

    Attributes
    ----------
    costs
        float64, shape ``(N,)``, rising: the sum of the costs of a path's cells, with that of the
        start.
    distances
        float64, shape ``(N,)``, falling, in metres: the shortest distance at each cost.
    cells
        int64, shape ``(C, 2)``: the cells (i, j) of one path for each point, from start to goal,
        path after path.
    ends
        int64, shape ``(N,)``: where each path ends among ``cells``.

    Examples
    --------
    >>> import numpy as np
    >>> cost = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    >>> front = pareto_front(cost, (0, 0), (0, 2), cell_size=0.5)
    >>> front.within(0.5).cells.tolist()  # around the cell that costs
    [[0, 0], [1, 1], [0, 2]]
    >>> front.expected_distance(0.5).round(3)  # over it, every other time
    np.float64(1.207)
    """

    costs: NDArray[np.float64]
    distances: NDArray[np.float64]
    cells: NDArray[np.int64]
    ends: NDArray[np.int64]

    def __post_init__(self) -> None:
        freeze(self.costs, self.distances, self.cells, self.ends)

    def path(self, n: int) -> Path:
        """The path of point n; counted from the end where it is negative, as in a list.

        Raises ``IndexError`` where there is no such point.
        """
        point = range(len(self.costs))[n]
        begin = self.ends[point - 1] if point else 0

        return Path(float(self.distances[point]), self.cells[begin : self.ends[point]])

    def within(self, budget: float) -> Path:
        """The shortest path whose total cost is at most the budget.

        A cost that exceeds the budget by no more than rounding, 1e-12 of it, is within it. Raises
        ``ValueError`` where no path meets the budget, or it is negative or NaN.
        """
        budget = checked_budget(budget)
        point = int(np.searchsorted(self.costs, budget * (1 + TOLERANCE), side="right")) - 1
        if point < 0:
            raise ValueError(
                f"budget={budget} is met by no path: the least cost is {self.costs[0]}"
            )

        return self.path(point)

    def hull(self) -> "Front":
        """The corners of the lower convex hull: what a randomised policy can do at its best.

        The optimum over all randomised policies, of the expected distance with a bound on the
        expected cost, is a mixture of the paths of two neighbouring corners: see
        `expected_distance`.
        """
        corners: list[int] = []
        reach = (self.costs[-1] - self.costs[0]) * (self.distances[0] - self.distances[-1])

        # from the left, and back over corners that the next point makes none (Andrew's chain)
        for point in range(len(self.costs)):
            while (
                len(corners) > 1
                and self._depth(corners[-2], corners[-1], point) <= _COLLINEAR * reach
            ):
                corners.pop()
            corners.append(point)

        paths = [self.path(corner).cells for corner in corners]

        return Front(
            self.costs[corners],
            self.distances[corners],
            np.concatenate(paths),
            np.cumsum([len(path) for path in paths]),
        )

    def expected_distance(self, budget: ArrayLike) -> NDArray[np.float64]:
        """Shortest expected distances in metres of randomised policies whose expected cost is at
        most the budget: the hull, between its corners a mixture of two paths.

        Any shape, the same is returned; inf where no path meets the budget. Raises ``ValueError``
        where a budget is negative or NaN.
        """
        budgets = np.asarray(budget)
        if budgets.dtype.kind not in "iuf" or not np.all(budgets >= 0):
            raise ValueError(f"budget={budget!r} must be numbers, 0 or more")

        hull = self.hull()
        distances = np.interp(budgets, hull.costs, hull.distances)

        return np.where(budgets * (1 + TOLERANCE) >= self.costs[0], distances, np.inf)

    def _depth(self, first: int, middle: int, last: int) -> float:
        """How far the middle point lies below the chord of the others, as an area."""
        run = self.costs[[middle, last]] - self.costs[first]
        rise = self.distances[[middle, last]] - self.distances[first]

        return float(run[0] * rise[1] - run[1] * rise[0])


def pareto_front(cost: NDArray[np.float64], start: Cell, goal: Cell, cell_size: float) -> Front:
    """The Pareto front of cost and distance over all paths from start to goal, exactly.

    Lengths are compared as a + b sqrt(2), and costs as whole numbers of a unit, a power of two that
    is about 2**-50 of the cost of a shortest path: whole costs are exact, and the order in which
    costs are added up makes no difference. What is returned is added up anew, by `math.fsum`; of
    two points whose costs differ by rounding alone, 1e-12 of them, the shorter stays.

    Parameters
    ----------
    cost
        Shape ``(X, Y)``: what is paid on entering a cell, and for the start; 0 or more, inf in
        obstacles. Moves are those of `irs_gym.grid.legal_moves`.
    start, goal
        Cells (i, j).
    cell_size
        Edge of a cell in metres.

    Raises
    ------
    ValueError
        Where ``cost`` is no map of such numbers, an end no cell of it or an obstacle, ``cell_size``
        not positive, or where no path leads from start to goal.

    Examples
    --------
    >>> import numpy as np
    >>> cost = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    >>> front = pareto_front(cost, (0, 0), (0, 2), cell_size=0.5)
    >>> front.costs.tolist(), front.distances.round(3).tolist()
    ([0.0, 1.0], [1.414, 1.0])
    """
    cost = checked_costs(cost)
    cell_size = checked_cell_size(cell_size)
    start = as_cell(start, "start")
    goal = as_cell(goal, "goal")
    source = flat_cell(cost, start, "start")
    sink = flat_cell(cost, goal, "goal")
    for name, cell in (("start", start), ("goal", goal)):
        if np.isinf(cost[cell]):
            raise ValueError(f"{name}={cell} lies in an obstacle: its cost is inf")

    shortest = shortest_path(np.isfinite(cost), start, goal, cell_size)
    if shortest is None:
        raise ValueError(f"no path leads from start={start} to goal={goal} around the obstacles")

    # no path of the front costs more than a shortest one
    whole, _ = whole_costs(cost, _sum(cost, shortest.cells))
    labels = labels_to_go(whole, sink, _Bounds(whole, source))

    # those of the start, sorted by length: the shortest first
    paths: list[NDArray[np.int64]] = []
    costs: list[float] = []
    for path in _paths(labels, np.flatnonzero(labels.cells == source), cost.shape):
        total = _sum(cost, path)
        if not costs or total < costs[-1] * (1 - TOLERANCE):
            paths.append(path)
            costs.append(total)

    # and the cheapest first
    paths.reverse()

    return Front(
        costs=np.array(costs[::-1]),
        distances=np.array([path_length(path, cell_size) for path in paths]),
        cells=np.concatenate(paths),
        ends=np.cumsum([len(path) for path in paths]),
    )


def _sum(cost: Numbers, path: NDArray[np.int64]) -> float:
    return fsum(cost[path[:, 0], path[:, 1]].tolist())


def _paths(
    labels: Labels, points: NDArray[np.int64], shape: tuple[int, ...]
) -> list[NDArray[np.int64]]:
    """The cells of the paths of those labels ``(D, 2)``, from the start to the goal."""
    paths = []
    for point in points:
        path = [point]
        while labels.after[path[-1]] >= 0:
            path.append(labels.after[path[-1]])
        paths.append(cells_at(labels.cells[path].astype(np.int64), (shape[0], shape[1])))

    return paths


class _Bounds:
    """Which labels may lie on a path of the front: a bound from the start, a staircase from above.

    Each label can be completed in two ways: by the cheapest path from the start, the shortest of
    them, and by the shortest, the cheapest of them. Their costs and lengths are known points, of
    which the undominated ones make a staircase. A label that lies above it even with the least cost
    and the least length that any path from the start has is of no use.
    """

    def __init__(self, whole: Numbers, source: int) -> None:
        rows, to, moves = edges(np.isfinite(whole))
        lengths = np.where(MOVE_LENGTHS == 1, *whole_lengths(whole.size)).astype(np.float64)[moves]
        costs = whole.ravel()[to]
        first = np.repeat(np.arange(whole.size), np.diff(rows))  # (moves,)

        def from_start(weights: Numbers, which: NDArray[np.bool_] | None = None) -> Numbers:
            kept = slice(None) if which is None else which
            ends = (first[kept], to[kept])
            graph = csr_array((weights[kept], ends), shape=(whole.size,) * 2)
            return np.asarray(dijkstra(graph, indices=source))

        # lower bounds, (X * Y,), and upper ones along the moves that keep to the lower ones
        self.length = from_start(lengths)
        self.cost = from_start(costs)
        with np.errstate(invalid="ignore"):  # inf - inf where the start cannot be reached
            is_shortest = self.length[to] - self.length[first] == lengths
            is_cheapest = self.cost[to] - self.cost[first] == costs
        self.cost_of_shortest = from_start(costs, is_shortest)
        self.length_of_cheapest = from_start(lengths, is_cheapest)

        # the staircase: costs rise and lengths fall; the first step lies left of all costs
        self.steps = (np.array([-np.inf]), np.array([np.inf]))

    def __call__(self, labels: Labels) -> NDArray[np.bool_]:
        is_useful = self._is_below(
            labels.costs + self.cost[labels.cells], labels.lengths + self.length[labels.cells]
        )
        self._learn(labels[is_useful])

        return is_useful

    def _is_below(self, costs: Numbers, lengths: Numbers) -> NDArray[np.bool_]:
        """Whether no known point is better than these, (n,); one that is equal is not."""
        step = np.searchsorted(self.steps[0], costs, side="right") - 1
        known = self.steps[1][step]

        return np.asarray((lengths < known) | ((lengths == known) & (costs == self.steps[0][step])))

    def _learn(self, labels: Labels) -> None:
        """Add the two completions of each label to the staircase."""
        cells = labels.cells
        costs = np.append(
            labels.costs + self.cost[cells], labels.costs + self.cost_of_shortest[cells]
        )
        lengths = np.append(
            labels.lengths + self.length_of_cheapest[cells], labels.lengths + self.length[cells]
        )
        is_new = self._is_below(costs, lengths)

        # of all points, sorted by cost, those that are shorter than all before them
        costs = np.append(self.steps[0], costs[is_new])
        lengths = np.append(self.steps[1], lengths[is_new])
        order = np.lexsort((lengths, costs))
        costs = costs[order]
        lengths = lengths[order]
        is_step = np.append(True, lengths[1:] < np.minimum.accumulate(lengths)[:-1])
        self.steps = (costs[is_step], lengths[is_step])
