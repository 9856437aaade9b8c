"""`belief_optimum`: the best that a robot can do that knows which scenes there may be, but not
which of them it is in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.grid import Cell, as_cell, cells_at, checked_cell_size, checked_motion
from irs_gym.memory import check_memory, freeze
from irs_gym.oracle.belief_search import Criterion, Search, State, search_beliefs
from irs_gym.oracle.scene_family import MOST_CELLS, SceneFamily, build_scene_family, patch_of
from irs_gym.oracle.shortest_path import Path, path_length

MOST_RADIUS = 100
# Of a state: the walks from it, of which some are tried; and for each scene, its number in the
# belief and in the key of that.
_STATE_BYTES = 3000
_SCENE_BYTES = 4
_EXACT = 1e-9  # relative: value and bound are sums of floats in another order


@dataclass(frozen=True, eq=False)
class BeliefNode:
    """What a robot does that holds some scenes possible: walk, look, and go on.

    Attributes
    ----------
    scenes
        int64, shape ``(n,)``: the scenes that look as all that it has seen.
    walk
        int64, shape ``(D, 2)``: cells (i, j) from the one that it is in to the goal, or to the
        first from which some of the scenes look different.
    after
        The node for each patch that may be seen there, by the bytes of the labels
        ``(2r+1, 2r+1)``; none at the goal.

    Examples
    --------
    >>> node = BeliefNode(np.array([3]), np.array([[0, 0], [1, 1]]), after={})
    >>> node.is_last
    True
    """

    scenes: NDArray[np.int64]
    walk: NDArray[np.int64]
    after: Mapping[bytes, "BeliefNode"]

    def __post_init__(self) -> None:
        freeze(self.scenes, self.walk)

    @property
    def is_last(self) -> bool:
        """Whether the walk ends in the goal."""
        return not self.after


@dataclass(frozen=True, eq=False)
class BeliefOptimum:
    """A policy for a family of S scenes, what it comes to, and what none exceeds.

    Attributes
    ----------
    criterion
        ``"spl"``: the expected SPL, to be high; ``"distance"``: the expected metres, to be low.
    value
        Of the policy.
    bound
        What no policy exceeds (no policy of fewer metres). Where it is the policy's own value, that
        is the optimum: see `is_exact`.
    distances, oracle_distances
        float64, shape ``(S,)``: metres of the policy in each scene, and of the shortest path.
    weights
        float64, shape ``(S,)``: probabilities of the scenes.
    first
        Where the policy begins: for a start, a goal (cells) and the bytes of the patch around the
        start. The robot knows its goal.
    radius
        Cells that it sees in each direction.
    states
        Beliefs in cells that were looked at.

    Examples
    --------
    >>> feasible = np.ones((1, 3, 2), dtype=bool)  # one scene, which is known
    >>> found = belief_optimum(feasible, (0, 0), (2, 1), 0.5, radius=1)
    >>> found.value, found.is_exact, found.path(0).cells.tolist()
    (1.0, True, [[0, 0], [1, 0], [2, 1]])
    """

    criterion: Criterion
    value: float
    bound: float
    distances: NDArray[np.float64]
    oracle_distances: NDArray[np.float64]
    weights: NDArray[np.float64]
    first: Mapping[tuple[Cell, Cell, bytes], BeliefNode]
    radius: int
    states: int
    _paths: tuple[Path, ...] = field(repr=False)

    def __post_init__(self) -> None:
        freeze(self.distances, self.oracle_distances, self.weights)

    @property
    def is_exact(self) -> bool:
        """Whether the policy is the best, up to the rounding of sums."""
        return abs(self.bound - self.value) <= _EXACT * max(1.0, abs(self.bound))

    @property
    def spl(self) -> NDArray[np.float64]:
        """SPL of the policy in each scene, shape ``(S,)``."""
        return self.oracle_distances / np.maximum(self.distances, self.oracle_distances)

    def path(self, scene: int) -> Path:
        """The policy's path in the scene of that number."""
        return self._paths[scene]


def belief_optimum(
    feasible: NDArray[np.bool_],
    start: ArrayLike,
    goal: ArrayLike,
    cell_size: float,
    *,
    radius: int,
    criterion: Criterion = "spl",
    weights: ArrayLike | None = None,
    labels: NDArray[Any] | None = None,
    corner_cutting: bool = True,
    max_states: int = 100_000,
) -> BeliefOptimum:
    """The best policy of a robot that knows a list of S scenes and how likely each is, and sees of
    its own scene what is around it; exact.

    The robot knows its cell and its goal. In each cell it stands in it sees the labels of the cells
    up to ``radius`` away in each direction, as `IrsNavRandom-v0` shows them; what it has seen it
    remembers. So no policy over such observations exceeds the optimum, however it was made: what is
    missing to it is what a policy could still gain. An agent that sees margins in dB sees more than
    feasibility, and has another optimum: ``labels`` says what is seen.

    This is a partially observable decision process whose observations are certain, so that a belief
    is the set of scenes that are left, and beliefs only shrink. It is solved by AO* search
    (Nilsson, 1980), with the robot that knows everything from there on as the bound. SPL does not
    add up along a path, and there the length so far is part of the state: a + b sqrt(2), as a whole
    number.

    Parameters
    ----------
    feasible
        Shape ``(S, X, Y)``; maps smaller than the others are padded with False.
    start, goal
        Cells (i, j), of all scenes or of each: shape ``(2,)`` or ``(S, 2)``.
    cell_size
        Edge of a cell in metres.
    radius
        Cells that are seen in each direction, 1 or more: with 0, a robot would also learn from
        moves that are refused.
    criterion
        What is best: the highest expected ``"spl"`` (Anderson et al., 2018), or the lowest expected
        ``"distance"``.
    weights
        Probabilities of the scenes, or numbers in proportion, shape ``(S,)``; equal by default.
    labels
        What a cell shows, shape ``(S, X, Y)`` of whole numbers or bools. By default, whether it is
        feasible, which any labels show besides.
    corner_cutting
        As in `irs_gym.shortest_path`.
    max_states
        Beliefs in cells to look at; where these are not enough, the policy may not be the best, and
        ``bound`` says what none exceeds.

    Raises
    ------
    ValueError
        Where an argument is out of its range, or a goal cannot be reached: the message names the
        scene. `irs_gym.memory.MemoryLimitError` where it would take too much memory or work.

    Examples
    --------
    A wall between start and goal, with its door at the left end or at the right: once in two the
    robot looks at the wrong end first.

    >>> feasible = np.ones((2, 7, 3), dtype=bool)
    >>> feasible[:, :, 1] = False
    >>> feasible[0, 0, 1] = feasible[1, 6, 1] = True
    >>> found = belief_optimum(feasible, (3, 0), (3, 2), 1.0, radius=1)
    >>> found.distances.round(3).tolist(), round(found.value, 3)
    ([6.828, 10.828], 0.815)
    >>> found.path(1).cells[:5].tolist()
    [[3, 0], [2, 0], [1, 0], [2, 0], [3, 0]]
    """
    feasible = _checked_maps(feasible)
    scenes, columns, rows = feasible.shape
    shape = (columns, rows)
    cell_size = checked_cell_size(cell_size)
    starts = _checked_ends(start, "start", scenes, shape)
    goals = _checked_ends(goal, "goal", scenes, shape)
    likely = _checked_weights(weights, scenes)
    shown = feasible if labels is None else _checked_labels(labels, feasible.shape)
    checked_motion(corner_cutting, None, shape)
    if criterion not in get_args(Criterion):
        raise ValueError(f"criterion={criterion!r} must be one of {get_args(Criterion)}")

    radius = _checked_whole(radius, "radius", 1, MOST_RADIUS)
    max_states = _checked_whole(max_states, "max_states", 1, None)
    asked = f"max_states={max_states}: states of beliefs over {scenes} scenes"
    check_memory(asked, float(max_states) * (_STATE_BYTES + _SCENE_BYTES * scenes))

    family = build_scene_family(feasible, starts, goals, likely, shown, radius, corner_cutting)
    _check_reached(family)
    search = search_beliefs(family, criterion, max_states)

    return _optimum(family, search, criterion, shown, radius, cell_size)


def _optimum(
    family: SceneFamily,
    search: Search,
    criterion: Criterion,
    shown: NDArray[Any],
    radius: int,
    cell_size: float,
) -> BeliefOptimum:
    nodes, paths = _nodes(family, search.roots, shown, radius)
    first = {}
    for root in search.roots:
        one = int(root.scenes[0])
        ends = cells_at(np.array([root.cell, family.goal[one]]), family.shape)  # (2, 2)
        start, goal = (as_cell(each, "end") for each in ends.tolist())
        patch = patch_of(shown[one], root.cell, radius).tobytes()
        first[start, goal, patch] = nodes[id(root)]

    walked = [_joined(paths[n], cell_size) for n in range(len(family))]
    distances = np.array([path.distance for path in walked])
    oracle = family.oracle_length * cell_size
    if criterion == "spl":
        value = float((oracle / np.maximum(distances, oracle)) @ family.weights)
        bound = search.bound
    else:
        value = float(distances @ family.weights)
        bound = -search.bound * cell_size

    return BeliefOptimum(
        criterion=criterion,
        value=value,
        bound=bound,
        distances=distances,
        oracle_distances=oracle,
        weights=family.weights,
        first=first,
        radius=radius,
        states=search.states,
        _paths=tuple(walked),
    )


def _nodes(
    family: SceneFamily, roots: Sequence[State], shown: NDArray[Any], radius: int
) -> tuple[dict[int, BeliefNode], list[list[NDArray[np.int64]]]]:
    """The nodes of the best policy by the ids of their states, and the walks of each scene."""
    states = list(roots)
    for state in states:  # which grows meanwhile
        states += [] if state.is_sure else state.after.get(state.best, [])

    # From large beliefs to small: walks of a scene come in order, and backwards each node after
    # those that it leads to.
    states.sort(key=lambda each: -len(each.scenes))
    ends = [_end(family, state) for state in states]
    walks = [_walk(family, state, end) for state, end in zip(states, ends, strict=True)]
    paths: list[list[NDArray[np.int64]]] = [[] for _ in range(len(family))]
    for state, walk in zip(states, walks, strict=True):
        for scene in state.scenes.tolist():
            paths[scene].append(walk)

    nodes: dict[int, BeliefNode] = {}
    for state, end, walk in reversed(list(zip(states, ends, walks, strict=True))):
        after = [] if state.is_sure else state.after.get(state.best, [])
        patches = [patch_of(shown[each.scenes[0]], end, radius).tobytes() for each in after]
        each_node = [nodes[id(each)] for each in after]
        nodes[id(state)] = BeliefNode(
            state.scenes.astype(np.int64), walk, dict(zip(patches, each_node, strict=True))
        )

    return nodes, paths


def _end(family: SceneFamily, state: State) -> int:
    """The flat cell that the best walk of a state leads to."""
    return int(family.goal[state.scenes[0]] if state.is_sure else state.ends[state.best])


def _walk(family: SceneFamily, state: State, end: int) -> NDArray[np.int64]:
    """The cells ``(D, 2)`` of the best walk of a state."""
    if state.is_sure:
        moves = family.moves_out_of(state.scenes, np.ones(family.to_go.shape[1], dtype=bool))
    else:
        moves = family.moves_out_of(state.scenes[:1], ~family.telling_cells(state.scenes))

    return cells_at(family.walk(state.cell, end, moves), family.shape)


def _joined(walks: list[NDArray[np.int64]], cell_size: float) -> Path:
    """Walks as one path: each begins where the one before it ends."""
    cells = np.concatenate([walks[0][:1], *(walk[1:] for walk in walks)])
    return Path(path_length(cells, cell_size), cells)


# --- checks ---------------------------------------------------------------------------------------


def _checked_maps(feasible: Any) -> NDArray[np.bool_]:
    try:
        maps = np.asarray(feasible)
    except ValueError as error:  # rows of unequal lengths
        raise ValueError(f"feasible is no array: {error}") from None

    if maps.dtype != bool or maps.ndim != 3 or not maps.size:
        raise ValueError(
            f"feasible has the shape {maps.shape} and the type {maps.dtype}, "
            "but bools of S maps are needed: (S, X, Y)"
        )
    if maps[0].size > MOST_CELLS:
        raise ValueError(
            f"feasible has maps of {maps.shape[1]} x {maps.shape[2]} cells: more than {MOST_CELLS} "
            "have too many beliefs"
        )

    return maps


def _checked_ends(ends: Any, name: str, scenes: int, shape: tuple[int, int]) -> NDArray[np.int64]:
    try:
        cells = np.asarray(ends)
    except ValueError:
        cells = np.empty(0)

    if cells.dtype.kind not in "iu" or cells.shape not in ((2,), (scenes, 2)):
        raise ValueError(
            f"{name}={ends!r} must be a cell (i, j) of two integers, or one for each of the "
            f"{scenes} scenes"
        )
    if (cells < 0).any() or (cells >= shape).any():
        raise ValueError(f"{name} lies off the map of {shape} cells")

    return np.broadcast_to(cells, (scenes, 2)).astype(np.int64)


def _checked_weights(weights: Any, scenes: int) -> NDArray[np.float64]:
    if weights is None:
        return np.ones(scenes)

    try:
        likely = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError):
        likely = np.empty(0)

    if likely.shape != (scenes,) or not ((likely > 0) & (likely < inf)).all():
        raise ValueError(f"weights must be a positive number for each of the {scenes} scenes")

    return np.asarray(likely / likely.max())


def _checked_labels(labels: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    shown = np.asarray(labels)
    if shown.dtype.kind not in "biu" or shown.shape != shape:
        raise ValueError(
            f"labels has the shape {shown.shape} and the type {shown.dtype}, "
            f"but a whole number or bool for each cell is needed: {shape}"
        )
    return shown


def _checked_whole(value: Any, name: str, least: int, most: int | None) -> int:
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        wanted = f"from {least}" + ("" if most is None else f" to {most}")
        raise ValueError(f"{name}={value!r} must be an integer {wanted}")

    return int(value)


def _check_reached(family: SceneFamily) -> None:
    lost = np.flatnonzero(~np.isfinite(family.oracle_length))
    if len(lost):
        raise ValueError(f"feasible: in scene {lost[0]} the goal cannot be reached from the start")

    same = np.flatnonzero(family.start == family.goal)
    if len(same):
        raise ValueError(f"start: in scene {same[0]} it is the goal")
