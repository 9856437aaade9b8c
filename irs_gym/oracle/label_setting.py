"""`labels_to_go`: for every cell, all pairs of cost and length to the goal that none outdoes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import frexp, ldexp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, MOVES, flat_cells, legal_moves
from irs_gym.memory import check_memory
from irs_gym.oracle.shortest_path import Integers
from irs_gym.oracle.whole_lengths import MOST_CELLS, whole_lengths

Numbers = NDArray[np.float64]

# A sum of costs is within a budget that it exceeds by no more than this share: rounding.
TOLERANCE = 1e-12

_BITS = 50  # of the greatest cost that a path may have: sums of whole costs stay below 2**53
_LARGEST = 1e100  # of a cell's cost: sums over paths stay finite

# At the most: of a cell, in the graph of the moves and searches in it; and of a label.
_CELL_BYTES = 1000
_LABEL_BYTES = 60


@dataclass(frozen=True, eq=False)
class Labels:
    """Paths to the goal.

    Attributes
    ----------
    cells
        Shape ``(L,)``: flat cells that they begin in.
    costs
        float64, shape ``(L,)``, whole numbers: the sum over the cells after the first.
    lengths
        float64, shape ``(L,)``, whole numbers of `whole_lengths`.
    after
        Shape ``(L,)``: the label that is left after the first move; -1 at the goal.
    """

    cells: Integers
    costs: Numbers
    lengths: Numbers
    after: Integers

    def __getitem__(self, which: NDArray[Any]) -> "Labels":
        """Those of a mask, or of indices."""
        return Labels(self.cells[which], self.costs[which], self.lengths[which], self.after[which])

    @staticmethod
    def joined(parts: list["Labels"]) -> "Labels":
        """One after the other."""
        return Labels(
            np.concatenate([part.cells for part in parts]),
            np.concatenate([part.costs for part in parts]),
            np.concatenate([part.lengths for part in parts]),
            np.concatenate([part.after for part in parts]),
        )


def labels_to_go(
    whole_costs: Numbers, goal: int, worth: Callable[[Labels], NDArray[np.bool_]]
) -> Labels:
    """For each cell, the paths to the goal that no other is at most as long and as cheap as.

    Label setting with two criteria, from the goal outwards: labels are settled in the order of
    their length, and outdone if a settled one of their cell costs no more, so that all that a cell
    needs to remember is its least cost, as in BOA* (Hernández Ulloa et al., 2020). As no move is
    shorter than 1, labels whose lengths share their whole part never lead to each other: each such
    bucket is settled at once.

    Parameters
    ----------
    whole_costs
        Shape ``(X, Y)``, whole numbers that are paid on entering a cell; inf in obstacles.
    goal
        Flat cell.
    worth
        Which of the labels that are reached are worth to be settled, bools. It must keep all that
        others which are wanted go on from.
    """
    cells = whole_costs.size
    straight, diagonal = whole_lengths(cells)
    move_lengths = np.where(MOVE_LENGTHS == 1, straight, diagonal).astype(np.float64)  # (8,)
    neighbours_of = _neighbours_of(np.isfinite(whole_costs))  # (8, X * Y)
    enter = whole_costs.ravel()  # (X * Y,)

    # of the labels that are settled; nothing is cheaper than what lies off the map
    least = np.append(np.full(cells, np.inf), -np.inf)  # (X * Y + 1,)

    settled: list[Labels] = []
    count = 0
    origin = Labels(np.array([goal]), np.zeros(1), np.zeros(1), np.array([-1]))
    waiting = {0: [origin]}  # by the whole part of the length, in cells

    while waiting:
        bucket = min(waiting)
        labels = Labels.joined(waiting.pop(bucket))
        labels = labels[labels.costs < least[labels.cells]]
        labels = labels[worth(labels)]
        labels = labels[_undominated(labels, straight)]

        # sorted by length within a cell: the last and cheapest stays
        least[labels.cells] = labels.costs
        settled.append(
            replace(
                labels, cells=labels.cells.astype(np.int32), after=labels.after.astype(np.int32)
            )
        )

        # Back by all moves: who comes from there pays for the cell of the label.
        before = neighbours_of[:, labels.cells]  # (8, n)
        costs = labels.costs + enter[labels.cells]  # (n,)
        is_cheaper = costs < least[before]
        move, label = np.nonzero(is_cheaper)
        lengths = labels.lengths[label] + move_lengths[move]
        reached = Labels(before[is_cheaper], costs[label], lengths, count + label)

        # a move of 1 ends in the next bucket, one of sqrt(2) in that or the one after it
        in_next = reached.lengths < (bucket + 2) * straight
        for later, which in ((bucket + 1, in_next), (bucket + 2, ~in_next)):
            if which.any():
                waiting.setdefault(later, []).append(reached[which])

        count += len(labels.cells)
        check_memory("cost: the paths that none outdoes", _LABEL_BYTES * count)

    return Labels.joined(settled)


def whole_costs(cost: Numbers, greatest: float) -> tuple[Numbers, float]:
    """Costs as whole numbers, whose sums are exact in any order, and the unit that they count.

    The unit is a power of two, a share of about 2**-50 of the greatest sum that is of interest:
    whole costs and short binary fractions stay what they are, others are rounded. What alone costs
    more than the greatest sum costs some number above it.
    """
    unit = max(ldexp(1.0, frexp(greatest)[1] - _BITS), np.finfo(np.float64).tiny)
    with np.errstate(over="ignore"):
        whole = np.minimum(np.rint(cost / unit), 2.0 ** (_BITS + 1))

    return np.where(np.isfinite(cost), whole, np.inf), unit


def checked_costs(cost: object) -> Numbers:
    """An array ``(X, Y)`` of costs, inf in obstacles; a ``ValueError`` says what is wrong with it.

    Costs are paid on entering a cell, and can be neither negative nor NaN.
    """
    try:
        array = np.asarray(cost)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"cost is no array: {error}") from None

    if array.dtype.kind not in "iufb":
        raise ValueError(f"cost holds values of the type {array.dtype}, not real numbers")
    if array.ndim != 2 or not array.size:
        raise ValueError(f"cost has the shape {array.shape}, but a map has two axes (X, Y)")
    if array.size > MOST_CELLS:
        raise ValueError(
            f"cost has {array.size} cells, and lengths are exact on maps up to {MOST_CELLS}"
        )

    shape = " x ".join(map(str, array.shape))
    check_memory(f"cost: work on a map of {shape} cells", _CELL_BYTES * array.size)

    costs = array.astype(np.float64)
    if not np.all(costs >= 0):
        raise ValueError(
            "cost holds NaN or negative numbers: each cell must cost 0 or more, inf where blocked"
        )
    if np.any(np.isfinite(costs) & (costs > _LARGEST)):
        raise ValueError(f"cost holds finite numbers beyond {_LARGEST}; blocked cells are inf")

    return costs


# --- the steps of the search ----------------------------------------------------------------------


def _neighbours_of(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Where moves lead and come from, flat cells ``(8, X * Y)``; X * Y, one past the last, for
    illegal ones.
    """
    here = np.arange(free.size).reshape(free.shape)  # (X, Y)
    there = here[..., None] + flat_cells(MOVES, free.shape)  # (X, Y, 8)
    legal = np.where(legal_moves(free), there, free.size)

    return np.ascontiguousarray(legal.reshape(free.size, len(MOVES)).T)


def _undominated(labels: Labels, straight: int) -> NDArray[np.int64]:
    """Which labels of one bucket no other one of their cell is as good as, sorted by cell and
    length.

    Of equal ones the first stays.
    """
    # Each move has brought labels in this order, so that a stable sort has little to do.
    keys = labels.cells * straight + labels.lengths.astype(np.int64) % straight
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    cells = labels.cells[order]
    costs = labels.costs[order]

    # the least cost of a cell up to each of its labels, over stretches that double
    least = costs.copy()
    stretch = 1
    while stretch < len(cells):
        is_same = cells[stretch:] == cells[:-stretch]
        if not is_same.any():
            break
        least[stretch:][is_same] = np.minimum(least[stretch:], least[:-stretch])[is_same]
        stretch *= 2

    is_cheaper = np.ones(len(cells), dtype=bool)
    is_cheaper[1:] = (cells[1:] != cells[:-1]) | (costs[1:] < least[:-1])

    # of equal length, the last of these is the cheapest
    order = order[is_cheaper]
    keys = keys[is_cheaper]
    is_last = np.ones(len(order), dtype=bool)
    is_last[:-1] = keys[1:] != keys[:-1]

    return np.asarray(order[is_last])
