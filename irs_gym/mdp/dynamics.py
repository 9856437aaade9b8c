"""The rules of motion: pure functions over cells and actions of one map or of many, which all
environments and learners call, and `Tables` that hold all their values for one.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import (
    MOVE_LENGTHS,
    MOVES,
    Cell,
    Motion,
    flat_cells,
    legal_moves,
    octile_distance,
)
from irs_gym.mdp.budget import SLACK, range_of
from irs_gym.mdp.task import Constraint, Rules, World
from irs_gym.memory import freeze, frozen
from irs_gym.oracle.budget_to_go import BudgetToGo, budget_to_go, last_within
from irs_gym.oracle.pareto_front import pareto_front
from irs_gym.oracle.shortest_path import Path, descend, distance_to_go, infeasible

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

ACTIONS = len(MOVES)
_ROUNDING = 1e-9  # metres


class Transition(NamedTuple):
    """What actions do in cells: arrays of one shape, or of one value each."""

    next_cell: Any  # flat
    reward: Any  # metres
    moved: Any  # metres really travelled
    is_refused: Any
    cost: Any  # 1.0 where the target is missed; under a budget, that of the cell moved to
    is_terminated: Any
    is_at_goal: Any


def potential(rules: Rules, offsets: Ints, cell_size: float) -> NDArray[np.float64]:
    """Shaping potential in metres, shape ``(...)``: minus the octile distance to the goal, zero
    without shaping.

    ``offsets`` ``(..., 2)``: cells from the goal along x and y.
    """
    return -octile_distance(offsets) * cell_size * rules.shaping


def reward(
    rules: Rules, length: Any, potential_now: Any, potential_next: Any, is_at_goal: Any
) -> Any:
    """Minus the metres of the move, plus the change of the potential, plus the goal's bonus."""
    return -length + (potential_next - potential_now) + rules.goal_bonus * is_at_goal


def permissions(
    constraint: Constraint, free: Bools, feasible: Bools, **motion: Unpack[Motion]
) -> tuple[Bools, Bools]:
    """Which actions are not refused, and which miss the target: both of shape ``(..., X, Y, 8)``.

    A move into a wall, an obstacle or (unless allowed) a cell below the target is refused. Under
    ``"terminate"``, an attempt to enter a cell below the target misses it, under ``"allow"`` and
    ``"budget"`` whatever leads to one or stays in one. Without corner cutting, a diagonal move
    enters both cells beside it as well.

    Parameters
    ----------
    constraint
        What happens at a cell below the target.
    free, feasible
        Cells without an obstacle, and those of them at or above the target, shape ``(..., X, Y)``:
        of one map, or of many.
    motion
        What else `irs_gym.grid.legal_moves` asks of a move.

    Examples
    --------
    >>> from irs_gym.grid import MOVE_NAMES
    >>> free = np.array([[True, True, True]])
    >>> feasible = np.array([[True, True, False]])
    >>> is_legal, _ = permissions("refuse", free, feasible)
    >>> [MOVE_NAMES[n] for n in np.flatnonzero(is_legal[0, 1])]  # (0, 2) lies below the target
    ['S']
    """
    keeps_target = legal_moves(feasible, **motion)
    is_open = keeps_target if constraint == "refuse" else legal_moves(free, **motion)

    return judged(constraint, is_open, keeps_target, feasible[..., None])


def judged(
    constraint: Constraint, is_open: Bools, keeps_target: Bools, is_feasible: Bools
) -> tuple[Bools, Bools]:
    """Which actions are not refused, and which miss the target; see `permissions`.

    Parameters
    ----------
    constraint
        What happens where the target is missed.
    is_open
        Whether an action leads to where a robot can be, of any shape.
    keeps_target
        Whether it leads to where the target is met.
    is_feasible
        Whether the target is met where the robot is before, broadcast against the others.
    """
    if constraint == "refuse":
        return keeps_target, np.zeros_like(keeps_target)
    if constraint == "terminate":
        return keeps_target, is_open & ~keeps_target

    return is_open, np.where(is_open, ~keeps_target, ~is_feasible)


def refused_reward(rules: Rules, actions: Any, cell_size: float) -> Any:
    """Rewards of moves that are refused: their metres, for nothing."""
    return reward(rules, MOVE_LENGTHS[actions] * cell_size, 0.0, 0.0, False)


def next_cells(cells: Ints, actions: Ints, is_legal: Bools, shape: tuple[int, int]) -> Ints:
    """Flat cells that actions lead to from flat cells: of a refused action, the same cell.

    The arguments have one shape, or are broadcast to one; ``shape`` is that of a map. Cells may be
    counted through many maps one behind the other.
    """
    return np.where(is_legal, cells + flat_cells(MOVES, shape)[actions], cells)


def ends(rules: Rules, is_at_goal: Any, is_violation: Any) -> Any:
    """Whether the episode ends: at the goal, and under ``"terminate"`` where the target is missed.

    That a budget is exhausted depends on more than a cell and an action, and is told elsewhere.
    """
    return is_at_goal | is_violation if rules.constraint == "terminate" else is_at_goal


def transition(world: World, goal: Cell) -> Transition:
    """The transition of every cell and action, arrays of shape ``(X * Y, 8)``."""
    return transitions(
        world.rules,
        world.radio_map.free[None],
        world.feasible[None],
        np.array([goal]),
        world.radio_map.grid.cell_size,
        cost=None if world.cost is None else world.cost[None],
        **world.motion,
    )


def transitions(
    rules: Rules,
    free: Bools,
    feasible: Bools,
    goals: Ints,
    cell_size: float,
    precision: type[np.floating[Any]] = np.float64,
    cost: NDArray[np.float64] | None = None,
    **motion: Unpack[Motion],
) -> Transition:
    """The transition of every cell and action of S maps, arrays of shape ``(S * X * Y, 8)``.

    A refused move leaves the robot where it is and costs the move all the same.

    Parameters
    ----------
    rules
        Those that the maps have in common.
    free, feasible
        Cells without an obstacle, and those of them at or above the target, shape ``(S, X, Y)``.
    goals
        Cells (i, j), shape ``(S, 2)``.
    cell_size
        Edge of a cell in metres.
    precision
        That of the shaping potential.
    cost
        What each cell costs, shape ``(S, X, Y)``; by default 1 where the target is missed.
    motion
        What else `irs_gym.grid.legal_moves` asks of a move.

    Returns
    -------
    Flat cells are counted through all maps, one behind the other.
    """
    maps, *shape = free.shape
    columns, rows = shape
    cells = np.arange(free.size)[:, None]
    is_legal, is_violation = (
        each.reshape(-1, ACTIONS)
        for each in permissions(rules.constraint, free, feasible, **motion)
    )  # (S * X * Y, 8)
    next_cell = next_cells(cells, np.arange(ACTIONS), is_legal, (columns, rows))

    # A legal move never leaves its map, so that it can only arrive at that map's own goal.
    goal_cells = np.arange(maps) * (columns * rows) + flat_cells(goals, (columns, rows))  # (S,)
    is_there = next_cell.reshape(maps, -1) == goal_cells[:, None]
    is_at_goal = is_legal & is_there.reshape(-1, ACTIONS)

    offsets = _cells((columns, rows)) - goals[:, None]  # (S, X * Y, 2)
    phi = potential(rules, offsets, cell_size).astype(precision).ravel()
    length = np.broadcast_to(MOVE_LENGTHS * cell_size, is_legal.shape)

    return Transition(
        next_cell=next_cell,
        reward=reward(rules, length, phi[cells], phi[next_cell], is_at_goal),
        moved=np.where(is_legal, length, 0.0),
        is_refused=~is_legal,
        cost=is_violation.astype(np.float64) if cost is None else cost.ravel()[next_cell],
        is_terminated=ends(rules, is_at_goal, is_violation),
        is_at_goal=is_at_goal,
    )


def transition_table(world: World, goal: Cell) -> Transition:
    """As `transition`, but for the goal: there an episode is over, so each action stays, for
    nothing, and ends it.
    """
    table = transition(world, goal)
    here = world.radio_map.grid.flat(goal)
    over = Transition(here, 0.0, 0.0, False, 0.0, True, True)

    for column, value in zip(table, over, strict=True):
        column[here] = value

    return table


def _cells(shape: tuple[int, int]) -> Ints:
    """All cells (i, j), shape ``(X * Y, 2)``."""
    return np.indices(shape).transpose(1, 2, 0).reshape(-1, 2)


def action_mask(world: World) -> NDArray[np.int8]:
    """1 where an action is not refused, shape ``(X * Y, 8)``."""
    is_legal, _ = permissions(
        world.rules.constraint, world.radio_map.free, world.feasible, **world.motion
    )
    return is_legal.reshape(-1, ACTIONS).astype(np.int8)


def start_cells(to_go: NDArray[np.float64], goal: Cell) -> Ints:
    """Cells, as flat indices, that a random start is drawn from: the goal can be reached, and is
    not yet.
    """
    can_reach = np.isfinite(to_go)
    can_reach[goal] = False
    return np.flatnonzero(can_reach)


@dataclass(frozen=True, eq=False)
class Tables:
    """All values of the rules for one world and goal, over flat cells, for environments to gather
    from.
    """

    world: World
    goal: Cell
    transition: NDArray[np.void]  # (X * Y * 8,), records of the fields of `Transition`
    cell: NDArray[np.void]  # (X * Y,), records of distance_to_go in metres, gain_db and margin_db
    action_mask: NDArray[np.int8]  # (X * Y, 8)
    distance_to_go: NDArray[np.float64]  # (X, Y), metres
    starts: Ints  # flat indices

    def __post_init__(self) -> None:
        freeze(self.transition, self.cell, self.action_mask, self.distance_to_go, self.starts)

    def __reduce__(self) -> Any:
        return tabulate, (self.world, self.goal)


@lru_cache(maxsize=8)
def tabulate(world: World, goal: Cell) -> Tables:
    """Tables of a world for one goal, with one run of Dijkstra; kept, so the same goal costs
    nothing again.
    """
    grid = world.radio_map.grid
    to_go = world.to_go if goal == world.goal else None
    if to_go is None:
        to_go = distance_to_go(world.feasible, goal, grid.cell_size, **world.motion)

    gain_db = world.radio_map.gain_db

    return Tables(
        world=world,
        goal=goal,
        transition=_records(**transition(world, goal)._asdict()),
        cell=_records(distance_to_go=to_go, gain_db=gain_db, margin_db=gain_db - world.target_db),
        action_mask=action_mask(world),
        distance_to_go=to_go,
        starts=start_cells(to_go, goal),
    )


def _records(**columns: NDArray[Any]) -> NDArray[np.void]:
    """The columns as one array of records: a record is gathered, or turned to Python's own types,
    in one go.
    """
    records = np.empty(
        next(iter(columns.values())).size,
        dtype=[(name, each.dtype) for name, each in columns.items()],
    )

    for name, each in columns.items():
        records[name] = each.ravel()

    return records


@lru_cache(maxsize=32)
def budget_to_go_of(world: World, goal: Cell) -> BudgetToGo:
    """Metres to go of a world with a budget, from every cell and for all that may be left of it;
    kept, so the same goal costs nothing again.
    """
    assert world.cost is not None
    assert world.rules.budget is not None
    _, largest = range_of(world.rules.budget)

    return budget_to_go(
        world.cost, goal, world.radio_map.grid.cell_size, largest + SLACK, **world.motion
    )


def metres_to_go(
    world: World, goal: Cell, cells: int | Ints, left: Any = None
) -> NDArray[np.float64]:
    """Metres of the shortest way to the goal that the rules allow; inf where there is none.

    Parameters
    ----------
    cells
        Flat, any shape.
    left
        What is left of the budget, where the rules hold one; same shape.
    """
    if left is None:
        return np.asarray(tabulate(world, goal).distance_to_go.take(cells))

    fronts = budget_to_go_of(world, goal)

    point = last_within(fronts.offsets, fronts.costs, cells, np.asarray(left) + SLACK)

    return np.where(point >= 0, fronts.distances.take(point, mode="clip"), np.inf)


def oracle_path(world: World, start: Cell, goal: Cell, budget: float | None = None) -> Path:
    """The shortest path that the rules allow, within the budget where there is one."""
    if budget is None:
        to_go = tabulate(world, goal).distance_to_go
        is_legal = legal_moves(world.feasible, **world.motion)
        return descend(to_go, start, world.radio_map.grid.cell_size, is_legal)

    left = budget - float(paid_at_start(world, world.radio_map.grid.flat(start)))
    path = budget_to_go_of(world, goal).path(start, left + SLACK)
    if path is None:
        raise ValueError(f"budget={budget} cannot be kept from start={start} to goal={goal}")

    return path


def optimal_moves_within(world: World, goal: Cell, cell: int, left: float) -> Ints:
    """Actions that begin a shortest way from a flat cell with what is left of the budget, in
    ascending order; none at the goal and where it cannot be reached.
    """
    assert world.cost is not None
    grid = world.radio_map.grid
    is_legal = legal_moves(world.radio_map.free, **world.motion)[grid.cell_at(cell)]  # (8,)
    actions = np.flatnonzero(is_legal) if cell != grid.flat(goal) else np.array([], dtype=np.int64)
    ahead = cell + flat_cells(MOVES[actions], grid.shape)
    then = metres_to_go(world, goal, ahead, left - world.cost.take(ahead))
    length = then + MOVE_LENGTHS[actions] * grid.cell_size
    best = metres_to_go(world, goal, cell, left)

    # different lengths differ by far more than the rounding of their sums
    return np.asarray(actions[np.isfinite(length) & (length <= best + _ROUNDING)])


def paid_at_start(world: World, cells: int | Ints) -> NDArray[np.float64] | float:
    """What a robot pays for the flat cells that it starts in; 0 without a budget."""
    return 0.0 if world.cost is None else world.cost.take(cells)


@lru_cache(maxsize=8)
def starts_of(world: World, goal: Cell, budget: float | None) -> Ints:
    """Flat cells that a random start is drawn from: the goal can be reached, within the budget
    where there is one, and is not yet.
    """
    if budget is None:
        return tabulate(world, goal).starts

    cells = np.arange(world.feasible.size)
    to_go = metres_to_go(world, goal, cells, budget - paid_at_start(world, cells))  # (X * Y,)

    return frozen(start_cells(to_go.reshape(world.feasible.shape), goal))


def choose_start(
    world: World, goal: Cell, rng: np.random.Generator, budget: float | None = None
) -> Cell:
    """The world's start; with the probability that its task says, one drawn among the cells that
    lead to the goal, within the budget where there is one.
    """
    if not draws_start(world.rules.random_start, rng):
        return world.start

    check_cell(world, "goal", goal)
    starts = starts_of(world, goal, budget)
    if not len(starts):
        within = "" if budget is None else f" and budget={budget}"
        raise ValueError(
            f"goal={goal} cannot be reached from any other cell at "
            f"target_db={world.target_db}{within}"
        )

    return world.radio_map.grid.cell_at(draw_start(starts, rng))


def draws_start(probability: float, rng: np.random.Generator) -> bool:
    """Whether the start of this episode is a drawn one."""
    return bool(probability and (probability == 1 or rng.random() < probability))


def draw_start(starts: Ints, rng: np.random.Generator) -> int:
    """One of the flat cells, all equally likely."""
    return int(starts[rng.integers(len(starts))])


def check_cell(world: World, name: str, cell: Cell) -> None:
    """Refuse a cell off the map or where the robot cannot be; the ``ValueError`` names it."""
    world.rules.robot.check_cell(name, cell, world.radio_map.free)


def tables_for(world: World, start: Cell, goal: Cell, budget: float | None = None) -> Tables:
    """Tables for an episode from start to goal, refused before any work where there can be none.

    Raises
    ------
    ValueError
        Where an end lies off the map or in an obstacle, the two are one, or no feasible path joins
        them; the message then gives the highest feasible target. Or where none keeps the budget;
        the message then gives the least cost.
    """
    check_cell(world, "start", start)
    check_cell(world, "goal", goal)
    if start == goal:
        raise ValueError(f"start={start} must differ from the goal")

    if budget is not None:
        _check_budget(world, start, goal, budget)
        return tabulate(world, goal)

    tables = tabulate(world, goal)
    if not np.isfinite(tables.distance_to_go[start]):
        raise ValueError(
            infeasible(world.radio_map.gain_db, start, goal, world.target_db, **world.motion)
        )

    return tables


def _check_budget(world: World, start: Cell, goal: Cell, budget: float) -> None:
    here = world.radio_map.grid.flat(start)
    paid = paid_at_start(world, here)
    if np.isfinite(metres_to_go(world, goal, here, budget - paid)):
        return

    # raises a `ValueError` where no path joins the two, whatever the budget
    assert world.cost is not None
    cell_size = world.radio_map.grid.cell_size
    front = pareto_front(world.cost, start, goal, cell_size, **world.motion)
    raise ValueError(
        f"budget={budget} cannot be kept from start={start} to goal={goal}: "
        f"the least {world.rules.cost} cost of a path is {front.costs[0]:.9g}"
    )


def check_task(world: World) -> None:
    """Refuse a world whose own start and goal cannot be joined, or where giving up would pay.

    Raises
    ------
    ValueError
        As `tables_for` and `check_bonus`.
    """
    # the least budget is the hardest to keep, and leaves the longest way
    budget = world.rules.least_budget
    tables_for(world, world.start, world.goal, budget)
    start = world.radio_map.grid.flat(world.start)
    left = None if budget is None else budget - paid_at_start(world, start)

    check_bonus(
        world.rules,
        float(metres_to_go(world, world.goal, start, left)),
        np.subtract(world.start, world.goal),
        world.radio_map.grid.cell_size,
    )


def check_bonus(rules: Rules, distance: float, offset: Ints, cell_size: float) -> None:
    """Refuse a goal's bonus with which giving up would pay.

    Parameters
    ----------
    distance
        Of the shortest feasible path in metres.
    offset
        Shape ``(2,)``: cells from the goal to the start.

    Raises
    ------
    ValueError
        Where violations, or an exhausted budget, end the episode, and to end it at once returns
        more than the path.
    """
    ways_out = {
        "terminate": ("constraint='terminate'", "a violation"),
        "budget": ("on_exhausted='terminate'", "an exhausted budget"),
    }
    is_endable = rules.constraint in ways_out and rules.on_exhausted == "terminate"
    detour = distance + float(potential(rules, offset, cell_size))
    if is_endable and detour >= rules.goal_bonus:
        rule, way_out = ways_out[rules.constraint]
        raise ValueError(
            f"goal_bonus={rules.goal_bonus} is too small for {rule}: to end the "
            f"episode by {way_out} would pay more than the detour of {detour:.3f} m, so a bonus "
            "above that is needed"
        )
