"""The rules of motion: pure, batched functions over cells and actions, and `Tables` that hold all their values."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, MOVES, Cell, legal_moves, octile_distance
from irs_gym.oracle import distance_to_go, infeasible
from irs_gym.task import World

ACTIONS = len(MOVES)


class Transition(NamedTuple):
    """What actions do in cells: arrays of one shape, or of one value each."""

    next_cell: Any  # flat index
    reward: Any  # metres
    moved: Any  # metres really travelled
    is_refused: Any
    cost: Any  # 1.0 where the target is missed
    is_terminated: Any
    is_at_goal: Any


def potential(world: World, goal: Cell) -> NDArray[np.float64]:
    """Shaping potential in metres, shape ``(X, Y)``: minus the octile distance to the goal, zero without shaping."""
    grid = world.radio_map.grid
    offsets = np.indices(grid.shape).transpose(1, 2, 0) - np.array(goal)
    return -octile_distance(offsets) * grid.cell_size * world.task.shaping


def transition(world: World, goal: Cell) -> Transition:
    """The transition of every cell and action, arrays of shape ``(X * Y, 8)``.

    A move into a wall, an obstacle or (unless allowed) a cell below the target leaves the robot where it is and
    costs the move all the same. Under ``"terminate"``, an attempt to enter a cell below the target also ends the
    episode. The reward is minus the metres of the move, plus the change of the potential, plus the goal's bonus.
    """
    task, grid = world.task, world.radio_map.grid
    cells = np.arange(world.feasible.size)[:, None]
    is_legal = action_mask(world).astype(bool)
    next_cell = np.where(is_legal, cells + MOVES @ np.array([grid.shape[1], 1]), cells)
    length = np.broadcast_to(MOVE_LENGTHS * grid.cell_size, is_legal.shape)
    is_at_goal = is_legal & (next_cell == np.ravel_multi_index(goal, grid.shape))

    is_violation = np.zeros_like(is_legal)
    if task.constraint == "terminate":
        is_violation = legal_moves(world.radio_map.free).reshape(is_legal.shape) & ~is_legal
    elif task.constraint == "allow":
        is_violation = ~world.feasible.ravel()[next_cell]

    phi = potential(world, goal).ravel()
    reward = -length + (phi[next_cell] - phi[cells]) + task.goal_bonus * is_at_goal
    ends = is_at_goal | (is_violation & (task.constraint == "terminate"))
    moved = np.where(is_legal, length, 0.0)
    return Transition(next_cell, reward, moved, ~is_legal, is_violation.astype(np.float64), ends, is_at_goal)


def action_mask(world: World) -> NDArray[np.int8]:
    """1 where an action is not refused, shape ``(X * Y, 8)``."""
    return legal_moves(world.enterable).reshape(-1, ACTIONS).astype(np.int8)


def start_cells(to_go: NDArray[np.float64], goal: Cell) -> NDArray[np.int64]:
    """Cells, as flat indices, that a random start is drawn from: the goal can be reached, and is not yet."""
    can_reach = np.isfinite(to_go)
    can_reach[goal] = False
    return np.flatnonzero(can_reach)


@dataclass(frozen=True, eq=False)
class Tables:
    """All values of the rules for one world and goal, over flat cells, for environments to gather from."""

    world: World
    goal: Cell
    transition: NDArray[np.void]  # (X * Y * 8,), records of the fields of `Transition`
    cell: NDArray[np.void]  # (X * Y,), records of distance_to_go in metres, gain_db and margin_db
    action_mask: NDArray[np.int8]  # (X * Y, 8)
    distance_to_go: NDArray[np.float64]  # (X, Y), metres
    starts: NDArray[np.int64]  # flat indices

    def __reduce__(self) -> Any:
        return tabulate, (self.world, self.goal)


@lru_cache(maxsize=8)
def tabulate(world: World, goal: Cell) -> Tables:
    """Tables of a world for one goal, with one run of Dijkstra; kept, so the same goal costs nothing again."""
    grid = world.radio_map.grid
    to_go = distance_to_go(world.feasible, goal, grid.cell_size)
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
    """The columns as one array of records: a record is gathered, or turned to Python's own types, in one go."""
    records = np.empty(next(iter(columns.values())).size, dtype=[(name, each.dtype) for name, each in columns.items()])
    for name, each in columns.items():
        records[name] = each.ravel()
    return records


def draw_start(world: World, goal: Cell, rng: np.random.Generator) -> Cell:
    """A start drawn among the cells from which the goal can be reached, never the goal itself."""
    check_cell(world, "goal", goal)
    starts = tabulate(world, goal).starts
    if not len(starts):
        raise ValueError(f"goal={goal} cannot be reached from any other cell at target_db={world.target_db}")
    i, j = divmod(int(starts[rng.integers(len(starts))]), world.feasible.shape[1])
    return i, j


def check_cell(world: World, name: str, cell: Cell) -> None:
    """Refuse a cell off the map or in an obstacle; the ``ValueError`` names it."""
    if not world.radio_map.grid.has(cell):
        raise ValueError(f"{name}={cell} lies off the map of {world.radio_map.grid.shape} cells")
    if not world.radio_map.free[cell]:
        raise ValueError(f"{name}={cell} lies in an obstacle")


def tables_for(world: World, start: Cell, goal: Cell) -> Tables:
    """Tables for an episode from start to goal, refused before any work where there can be none.

    Raises
    ------
    ValueError
        Where an end lies off the map or in an obstacle, the two are one, or no feasible path joins them; the message
        then gives the highest feasible target.
    """
    check_cell(world, "start", start)
    check_cell(world, "goal", goal)
    if start == goal:
        raise ValueError(f"start={start} must differ from the goal")
    tables = tabulate(world, goal)
    if not np.isfinite(tables.distance_to_go[start]):
        raise ValueError(infeasible(world.radio_map.gain_db, start, goal, world.target_db))
    return tables


def check_task(world: World) -> None:
    """Refuse a world whose own start and goal cannot be joined, or where giving up would pay.

    Raises
    ------
    ValueError
        As `tables_for`; and where violations end the episode and one at once returns more than the oracle's path.
    """
    tables, bonus = tables_for(world, world.start, world.goal), world.task.goal_bonus
    detour = float(tables.distance_to_go[world.start] + potential(world, world.goal)[world.start])
    if world.task.constraint == "terminate" and detour >= bonus:
        raise ValueError(
            f"goal_bonus={bonus} is too small for constraint='terminate': to end the episode by a violation would pay "
            f"more than the detour of {detour:.3f} m, so a bonus above that is needed"
        )
