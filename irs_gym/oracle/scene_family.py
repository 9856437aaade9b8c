"""`SceneFamily`: what a robot may do and sees in each of S scenes that it cannot tell apart yet."""

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from irs_gym.grid import MOVES, cells_at, flat_cells, legal_moves, neighbours
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.whole_lengths import true_lengths, whole_lengths

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Scenes = NDArray[np.integer[Any]]
"""Numbers of scenes, shape ``(n,)``, rising; of few bytes, as many beliefs are held at once."""

MOST_CELLS = 4096  # of a map: with more, whole lengths of walks would not be exact
_CELL_BYTES = 120  # for each cell of each scene, at the most
_SEARCH_PASSES = 100  # passes over a map that one run of Dijkstra is as long as


@dataclass(frozen=True, eq=False)
class SceneFamily:
    """S scenes of one shape (X, Y) as graphs over their N = X * Y flat cells, with one list of E
    moves for all.

    Attributes
    ----------
    shape
        Cells (X, Y).
    start, goal
        int64, shape ``(S,)``: flat cells.
    weights
        float64, shape ``(S,)``: probabilities.
    seen
        int64, shape ``(S, N)``: of each cell, a number for what is seen there, equal for scenes
        that look alike from it.
    legal
        bool, shape ``(S, E)``: the moves that there are.
    to_go
        float64, shape ``(S, N)``: cells to the scene's goal; +inf where it cannot be reached.
    rows, ahead
        Moves out of cell n are those from ``rows[n]`` to before ``rows[n + 1]``; each leads to its
        cell of ``ahead`` ``(E,)``.
    lengths
        float64, shape ``(E,)``: of moves, whole numbers; see
        `irs_gym.oracle.whole_lengths.whole_lengths`.
    """

    shape: tuple[int, int]
    start: Ints
    goal: Ints
    weights: Floats
    seen: Ints
    legal: Bools
    to_go: Floats
    rows: Ints
    ahead: Ints
    lengths: Floats

    def __post_init__(self) -> None:
        freeze(self.start, self.goal, self.weights, self.seen, self.legal, self.to_go)
        freeze(self.rows, self.ahead, self.lengths)

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def oracle_length(self) -> Floats:
        """Cells of the shortest path from each start, shape ``(S,)``."""
        return np.asarray(self.to_go[np.arange(len(self)), self.start])

    def alike(self, scenes: Scenes, cell: int) -> list[Scenes]:
        """The scenes ``(n,)`` in parts that look alike from a cell."""
        kind = self.seen[scenes, cell]
        return [scenes[kind == each] for each in np.unique(kind)]

    def telling_cells(self, scenes: Scenes) -> Bools:
        """Cells ``(N,)`` that a walk ends in: the goal, and those that tell some of the scenes
        apart.
        """
        seen = self.seen[scenes]  # (n, N)
        tells = (seen != seen[0]).any(axis=0)
        tells[self.goal[scenes[0]]] = True

        return np.asarray(tells)

    def moves_out_of(self, scenes: Scenes, cells: Bools) -> Bools:
        """Moves ``(E,)`` out of some cells ``(N,)`` that there are in all those scenes."""
        is_there = self.legal[scenes[0]] if len(scenes) == 1 else self.legal[scenes].all(axis=0)
        return np.asarray(is_there & np.repeat(cells, np.diff(self.rows)))

    def lengths_from(self, cell: int, moves: Bools) -> Floats:
        """Whole lengths ``(N,)`` of shortest walks from a cell over those moves ``(E,)``; +inf
        where none leads.
        """
        found: Floats = dijkstra(self._graph(moves), indices=cell)
        return found

    def walk(self, start: int, end: int, moves: Bools) -> Ints:
        """The flat cells ``(D,)`` of a shortest walk over those moves ``(E,)``."""
        _, before = dijkstra(self._graph(moves), indices=start, return_predecessors=True)
        cells = [end]
        while cells[-1] != start:
            cells.append(int(before[cells[-1]]))

        return np.array(cells[::-1], dtype=np.int64)

    def true_lengths(self, whole: Any) -> Floats:
        """Cells a + b sqrt(2) of whole lengths; see `irs_gym.oracle.whole_lengths.true_lengths`."""
        return true_lengths(whole, walked_cells(self.shape))

    def _graph(self, moves: Bools) -> Any:
        rows = np.concatenate([[0], np.cumsum(moves)])[self.rows]
        size = len(self.rows) - 1
        return csr_array((self.lengths[moves], self.ahead[moves], rows), shape=(size, size))


def walked_cells(shape: tuple[int, int]) -> int:
    """More moves than a robot makes that walks to what tells scenes apart, and on from there: it
    does so N times at the most, and each time over no more than N cells.
    """
    return (shape[0] * shape[1]) ** 2


def build_scene_family(
    feasible: Bools,
    start: Ints,
    goal: Ints,
    weights: Floats,
    labels: NDArray[Any],
    radius: int,
    corner_cutting: bool,
) -> SceneFamily:
    """The family of maps ``(S, X, Y)``, with starts and goals ``(S, 2)``.

    ``labels`` ``(S, X, Y)`` are what each cell shows besides whether it is feasible.
    """
    scenes, columns, rows = feasible.shape
    shape = (columns, rows)
    cells = columns * rows
    asked = f"feasible: {scenes} scenes of {columns} x {rows} cells"
    check_memory(
        asked,
        held=float(scenes * cells * (_CELL_BYTES + (2 * radius + 1) ** 2)),
        passed=float(scenes * cells * _CELL_BYTES * _SEARCH_PASSES),
    )

    # all moves on the map, in the order of their cells
    number = np.arange(cells).reshape(shape)
    there = neighbours(number, -1).reshape(cells, len(MOVES))  # (N, 8)
    on_map = there >= 0
    whole = np.where(np.arange(len(MOVES)) % 2 == 0, *whole_lengths(walked_cells(shape)))
    legal = legal_moves(feasible, corner_cutting) & feasible[..., None]  # (S, X, Y, 8)

    family = SceneFamily(
        shape=shape,
        start=flat_cells(start, shape),
        goal=flat_cells(goal, shape),
        weights=weights / weights.sum(),
        seen=_seen(feasible, labels, radius),
        legal=legal.reshape(scenes, cells, len(MOVES))[:, on_map],
        to_go=np.full((scenes, cells), inf),
        rows=np.concatenate([[0], np.cumsum(on_map.sum(axis=1))]),
        ahead=there[on_map],
        lengths=np.broadcast_to(whole, there.shape)[on_map].astype(np.float64),
    )

    # moves are symmetric, so distances from the goal are distances to it
    to_go = np.full((scenes, cells), inf)
    for n in range(scenes):
        found = family.lengths_from(int(family.goal[n]), family.legal[n])
        is_near = np.isfinite(found)
        to_go[n, is_near] = family.true_lengths(found[is_near])

    return SceneFamily(**{**vars(family), "to_go": to_go})


def patch_of(labels: NDArray[Any], cell: int, radius: int) -> NDArray[Any]:
    """What is around a flat cell of a map ``(X, Y)``, of the shape ``(2r+1, 2r+1)``; zeros off the
    map.
    """
    i, j = cells_at(np.array(cell), labels.shape).tolist()
    padded = np.pad(labels, radius)
    return padded[i : i + 2 * radius + 1, j : j + 2 * radius + 1]


def _seen(feasible: Bools, labels: NDArray[Any], radius: int) -> Ints:
    """Numbers ``(S, N)`` of what the patch around each cell shows."""
    _, number = np.unique(labels, return_inverse=True)
    shown = 2 * number.reshape(feasible.shape) + feasible  # (S, X, Y)
    scenes, columns, rows = shown.shape
    smallest = np.min_scalar_type(int(shown.max()))
    padded = np.pad(shown.astype(smallest), ((0, 0), (radius, radius), (radius, radius)))
    side = 2 * radius + 1
    seen = np.empty((scenes, columns * rows), dtype=np.int64)

    for cell, (i, j) in enumerate(np.ndindex(columns, rows)):
        patches = np.ascontiguousarray(padded[:, i : i + side, j : j + side]).reshape(scenes, -1)
        as_bytes = patches.view(np.dtype((np.void, patches.shape[1] * patches.itemsize))).ravel()
        seen[:, cell] = np.unique(as_bytes, return_inverse=True)[1].ravel()

    return seen
