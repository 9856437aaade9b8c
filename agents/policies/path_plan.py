"""`plan_paths`: cheapest paths over maps of which every cell has a cost, in compiled code."""

from heapq import heappop, heappush
from math import inf, prod, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.compiled import compiled
from irs_gym.grid import MOVE_LENGTHS, MOVES

Bools = NDArray[np.bool_]
Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int64]
Moves = NDArray[np.int8]

OFF_PATH = -1
"""In place of a move, in a cell that a path does not depend on."""
WATCHED = -2
"""In place of a move, in a cell that a path depends on, though it makes no move there."""
_DIAGONAL = sqrt(2.0) - 1.0  # cells: what a diagonal move is longer by than a straight one
_MARGIN = 1.001  # sums lose less by rounding, and ties less


def plan_paths(
    cost: Floats, starts: Ints, goals: Ints, corner_cutting: bool = True, tie: float = 0.0
) -> Moves:
    """A cheapest path over each map, by the first of the best moves in each of its cells.

    A move is worth its length times what the cell ahead costs, and what it costs to go from there.
    These are sums from the goal outward in the precision of the costs, as Dijkstra's algorithm has
    them to the last digit, worked out in those cells alone that may lie on a path cheap enough (A*,
    Hart et al. 1968).

    Parameters
    ----------
    cost
        Of entering each cell, shape ``(n, X, Y)``: 1 at the least, infinite where it is closed. The
        start need not be open.
    starts, goals
        Flat cells ``(n,)``. From the goal, a path leads out of it and back.
    corner_cutting
        As in `irs_gym.grid.legal_moves`.
    tie
        Moves that are worth as much more than the best are as good.

    Returns
    -------
    Shape ``(n, X * Y)``: moves in the cells of the paths, `WATCHED` in others that these depend on
    (the goal and, without corner cutting, those beside diagonal moves), and `OFF_PATH` in the rest.
    Where no path leads to the goal, its only move is 0, in the start.

    Raises
    ------
    ValueError
        Where a start or a goal is not on the map.
    """
    size = prod(cost.shape[1:])
    for name, cells in (("starts", starts), ("goals", goals)):
        if np.any(is_off := (cells < 0) | (cells >= size)):
            raise ValueError(
                f"{name}: cell {cells[is_off][0]} is not on a map of {cost.shape[1:]} cells, which "
                f"are numbered from 0 to {size - 1}"
            )

    return _plan_paths(cost, starts, goals, corner_cutting, tie)


@compiled
def are_cut_off(moves: Moves, cells: Ints, is_closed: Bools) -> Bools:
    """Whether paths lead on through closed cells, before they first leave what is in view and in no
    more than 2r + 1 moves.

    Parameters
    ----------
    moves
        Of `plan_paths`, but as maps ``(n, X, Y)``.
    cells
        Flat cells ``(n,)`` of the paths: where robots are.
    is_closed
        Shape ``(n, 2r+1, 2r+1)``: the closed cells around them.

    Returns
    -------
    Shape ``(n,)``.
    """
    count, side, _ = is_closed.shape
    result = np.zeros(count, dtype=np.bool_)

    for n in range(count):
        if not is_closed[n].any():
            continue

        cell = divmod(cells[n], moves.shape[2])
        at = (side // 2, side // 2)  # in the view
        for _ in range(side):
            move = moves[n][cell]
            if move < 0:
                break

            cell, at = _ahead(cell, move), _ahead(at, move)
            if not _is_on_map(at, is_closed.shape[1:]):
                break
            if is_closed[n][at]:
                result[n] = True
                break

    return result


@compiled
def _plan_paths(cost: Floats, starts: Ints, goals: Ints, corner_cutting: bool, tie: float) -> Moves:
    count, columns, rows = cost.shape
    moves = np.full((count, columns, rows), OFF_PATH, dtype=np.int8)
    lengths = MOVE_LENGTHS.astype(cost.dtype)

    for n in range(count):
        start = divmod(starts[n], rows)
        goal = divmod(goals[n], rows)
        to_go = _search(cost[n], start, goal, corner_cutting, lengths)
        _follow(moves[n], to_go, cost[n], start, goal, corner_cutting, lengths, tie)

    return moves.reshape(count, -1)


@compiled
def _search(
    cost: Floats,
    start: tuple[int, int],
    goal: tuple[int, int],
    corner_cutting: bool,
    lengths: Floats,
) -> Floats:
    """Costs to go ``(X, Y)``, exact in all cells that may lie on a cheapest path."""
    to_go = np.full_like(cost, inf)
    to_go[goal] = 0.0
    least = inf  # of all ways out of the start
    heap = [(_octile(goal, start), goal)]

    while heap:
        bound, here = heappop(heap)
        if bound > least * _MARGIN:
            break
        if bound > to_go[here] + _octile(here, start):
            continue  # it is known by now to cost less

        for move in range(8):
            cell = (here[0] - MOVES[move, 0], here[1] - MOVES[move, 1])
            if not _is_on_map(cell, cost.shape):
                continue

            worth = _worth(cell, move, cost, to_go, corner_cutting, lengths)
            if cell == start:
                least = min(least, worth)
            if worth < to_go[cell] and (cost[cell] < inf or cell == start):
                to_go[cell] = worth
                heappush(heap, (to_go[cell] + _octile(cell, start), cell))

    return to_go


@compiled
def _follow(
    moves: Moves,
    to_go: Floats,
    cost: Floats,
    start: tuple[int, int],
    goal: tuple[int, int],
    corner_cutting: bool,
    lengths: Floats,
    tie: float,
) -> None:
    """Write down a path by its moves ``(X, Y)``."""
    here = start
    worth = np.empty(8)

    for _ in range(cost.size):
        least = inf
        for move in range(8):
            worth[move] = _worth(here, move, cost, to_go, corner_cutting, lengths)
            if not np.isnan(worth[move]):
                least = min(least, worth[move])
        if least == inf:
            moves[here] = 0
            return

        move = 0
        while not worth[move] <= least + tie:
            move += 1

        moves[here] = move
        ahead = _ahead(here, move)
        if not corner_cutting:
            for beside in ((here[0], ahead[1]), (ahead[0], here[1])):
                if moves[beside] == OFF_PATH:
                    moves[beside] = WATCHED
        if ahead == goal:
            break
        here = ahead

    if moves[goal] == OFF_PATH:
        moves[goal] = WATCHED


@compiled
def _worth(
    cell: tuple[int, int],
    move: int,
    cost: Floats,
    to_go: Floats,
    corner_cutting: bool,
    lengths: Floats,
) -> float:
    """What it costs to go from a cell by a move, infinite where that is not possible."""
    ahead = _ahead(cell, move)
    if not _is_on_map(ahead, cost.shape):
        return inf
    is_cut = move % 2 == 1 and not corner_cutting
    if is_cut and max(cost[cell[0], ahead[1]], cost[ahead[0], cell[1]]) == inf:
        return inf

    return float(lengths[move] * cost[ahead] + to_go[ahead])


@compiled
def _ahead(cell: tuple[int, int], move: int) -> tuple[int, int]:
    return cell[0] + MOVES[move, 0], cell[1] + MOVES[move, 1]


@compiled
def _is_on_map(cell: tuple[int, int], shape: tuple[int, int]) -> bool:
    return 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1]


@compiled
def _octile(one: tuple[int, int], other: tuple[int, int]) -> float:
    """`irs_gym.grid.octile_distance` of two cells, which compiled code cannot call."""
    apart = abs(one[0] - other[0]), abs(one[1] - other[1])
    return max(apart) + _DIAGONAL * min(apart)
