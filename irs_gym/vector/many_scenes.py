"""`ManyScenes`: the maps of many scenes as one long array, so that n robots move and look around by
a few gathers.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.random_task import Worlds
from irs_gym.grid import MOVE_LENGTHS, MOVES, Cell, flat_cells
from irs_gym.mdp.budget import can_pay
from irs_gym.mdp.dynamics import (
    ACTIONS,
    ends,
    metres_to_go,
    permissions,
    potential,
    reward,
    tabulate,
)
from irs_gym.mdp.packing import (
    BUDGET,
    GOAL,
    MARGIN,
    OBSTACLE,
    ROBOT,
    Packing,
    Parts,
    Rows,
    own_positions,
    scaled_margin,
    vectors_to_goal,
)
from irs_gym.memory import freeze, frozen
from irs_gym.vector.protocols import Outcome, States
from irs_gym.vector.state_code import MOST_PLACES, MoveBits, StateCode, by_code, pack_moves

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_BLOCK = 256  # scenes whose rules are worked out at a time: bounds memory


@dataclass(frozen=True, eq=False)
class ManyScenes:
    """The rules and maps of many worlds: S maps of C cells each, every row and every map with a
    border behind it.

    The border of blocked cells is as wide as the robots see, so that a window never reaches into
    another map. What each method gives for states is described in
    `irs_gym.vector.protocols.TransitionModel`; what a state says, in `StateCode`.
    """

    worlds: Worlds
    packing: Packing
    code: StateCode
    legal: MoveBits  # of S * C cells: which actions are not refused
    violating: MoveBits | None  # likewise, which miss the target; None where none does
    margin: Rows  # (S * C and a border before and behind,): scaled to be seen
    reward: NDArray[np.float64]  # (O * 16,), by offset and code
    is_at_goal: Bools  # (O * 16,), by offset and code
    windows: NDArray[np.void] = field(
        init=False
    )  # (S * C,): all rows of cells as wide as a patch, a view

    def __post_init__(self) -> None:
        freeze(*(each for each in vars(self).values() if isinstance(each, np.ndarray)))

        # Rows overlap in memory: to gather whole rows is twice as fast as to gather their cells.
        side = self.packing.side
        row = np.dtype((np.void, 4 * side))
        windows = np.ndarray(len(self.margin) - side + 1, row, self.margin.data, strides=(4,))
        object.__setattr__(self, "windows", windows)

    def __reduce__(self) -> Any:
        return build_many_scenes, (self.worlds,)

    # --- rules ------------------------------------------------------------------------------------

    def move(self, states: States, actions: Ints) -> Outcome:  # noqa: D102
        places = self.code.places(states)
        codes = self.legal.codes(places, actions)
        entries = self.code.entries(states, codes)
        is_at_goal = self.is_at_goal.take(entries)
        is_terminated = is_at_goal
        cost = None

        next_states = self.code.step(states, codes)
        if self.worlds.task.budget is not None:
            cost = self.cost(next_states)
        elif self.violating is not None:
            is_violation = self.violating.of(places, actions)
            cost = is_violation.astype(np.float64)
            is_terminated = ends(self.worlds.task.rules, is_at_goal, is_violation)

        return Outcome(
            states=next_states,
            reward=self.reward.take(entries),
            moved=self._moved.take(codes),
            is_terminated=is_terminated,
            cost=cost,
            is_at_goal=is_at_goal,
        )

    def action_mask(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.int8]:
        places = self.code.places(states)
        mask = self.legal.of_all(places)  # (n, 8)
        if budget_left is not None and self.worlds.task.on_exhausted == "refuse":
            codes = self.legal.codes(places[:, None], np.arange(ACTIONS))  # (n, 8)
            ahead = self.code.step(states[:, None], codes)
            mask &= can_pay(budget_left[:, None], self.cost(ahead))

        return mask.astype(np.int8)

    # --- observations -----------------------------------------------------------------------------

    def observe(self, states: States, out: Parts | None = None) -> Parts:  # noqa: D102
        out = self.packing.empty(len(states)) if out is None else out
        if self.packing.observation == "map":
            self._observe_maps(states, self.packing.unpack(out))
            return out

        if self.packing.observation == "cell":
            out[0][:, 0] = flat_cells(self.code.cells(states), self.packing.shape)
            return out

        places = self.code.places(states)
        scenes = places // self.code.map_size
        windows = self.windows[places[:, None] + self._rows]  # (n, 2r+1), a row of a patch each
        is_masked = self.packing.observation == "masked"

        return self.packing.encode(
            out,
            patch=windows.view(np.float32),  # (n, (2r+1)**2)
            irs=self.worlds.pool.irs.take(scenes, axis=0),
            own=self._own.take(places - scenes * self.code.map_size, axis=0),
            to_goal=self._to_goal.take(self.code.offsets(states), axis=0),
            action_mask=self.action_mask(states) if is_masked else None,
        )

    def _observe_maps(self, states: States, images: Rows) -> None:
        """Write into images ``(n, 4, X, Y)``."""
        n = np.arange(len(states))
        columns, rows = self.packing.shape
        robots = self.code.decode(states)
        images[:, MARGIN] = self._margins[robots.scene, :columns, :rows]
        images[:, OBSTACLE] = ~self.worlds.pool.free[robots.scene]
        if self.packing.has_budget:
            images[:, BUDGET] = 0.0

        for channel, cells in ((ROBOT, robots.cell), (GOAL, robots.goal)):
            images[:, channel] = 0.0
            images[n, channel, cells[:, 0], cells[:, 1]] = 1.0

    # --- what else there is to say of states ------------------------------------------------------

    def cells(self, states: States) -> Ints:  # noqa: D102
        return self.code.places(states)

    def distance_to_go(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        pool = self.worlds.pool
        scenes, cells, goals = self.code.decode(states)
        if budget_left is not None:
            return self._within(states, flat_cells(cells, pool.shape), budget_left)

        to_go = pool.distance_to_go[scenes, cells[:, 0], cells[:, 1]]

        # The pool knows the way to each scene's own goal; to others, it is worked out.
        for n in np.flatnonzero((goals != pool.goal[scenes]).any(axis=1)).tolist():
            world, goal = self.scene_and_goal(states, n)
            to_go[n] = tabulate(world, goal).distance_to_go[cells[n, 0], cells[n, 1]]

        return np.asarray(to_go)

    def _within(
        self, states: States, cells: Ints, budget_left: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Metres to go from flat cells with what is left of budgets, ``(n,)``."""
        metres = np.empty(len(states))

        for n in range(len(states)):
            world, goal = self.scene_and_goal(states, n)
            metres[n] = metres_to_go(world, goal, cells[n], budget_left[n])

        return metres

    def oracle_distance(  # noqa: D102
        self, states: States, budgets: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        if budgets is None:
            return self.distance_to_go(states)

        pool = self.worlds.pool
        scenes, cells, goals = self.code.decode(states)
        is_own = ((cells == pool.start[scenes]) & (goals == pool.goal[scenes])).all(axis=1)
        metres = np.empty(len(states))
        metres[is_own] = self.worlds.start_fronts.distance(scenes[is_own], budgets[is_own])
        others = np.flatnonzero(~is_own)
        if len(others):
            left = budgets[others] - self.cost(states[others])
            metres[others] = self.distance_to_go(states[others], left)

        return metres

    def cost(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self._cost.take(self.code.places(states))

    def gain_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        cells = self.code.cells(states)
        gains = self.worlds.pool.gain_db[self.code.scenes(states), cells[:, 0], cells[:, 1]]
        return np.asarray(gains)

    def margin_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.gain_db(states) - self.worlds.pool.target_db[self.code.scenes(states)]

    def scene_id(self, states: States) -> NDArray[np.object_]:
        """Names of the scenes."""
        return self._names.take(self.code.scenes(states))

    def scene_and_goal(self, states: States, n: int) -> tuple[Any, Cell]:
        """World and goal of robot n."""
        robot = self.code.decode(states[[n]])
        i, j = robot.goal[0].tolist()
        return self.worlds.world(int(robot.scene[0])), (i, j)

    # --- small tables -----------------------------------------------------------------------------

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Of a map with its border."""
        return self.code.shape

    @cached_property
    def _cost(self) -> NDArray[np.float64]:
        """What cells cost under a budget, ``(S * C,)``; inf in borders."""
        columns, rows = self.packing.shape
        cost = np.full((len(self.worlds), *self.shape), np.inf)
        cost[:, :columns, :rows] = self.worlds.cost

        return frozen(cost.ravel())

    @cached_property
    def _margins(self) -> Rows:
        """The scaled margins as maps with their borders, ``(S, X', Y')``: a view."""
        border = (len(self.margin) - len(self.legal)) // 2
        return self.margin[border : border + len(self.legal)].reshape(-1, *self.shape)

    @cached_property
    def _rows(self) -> Ints:
        """From the first row of a patch to each of them."""
        return frozen(np.arange(self.packing.side) * self.shape[1])

    @cached_property
    def _moved(self) -> NDArray[np.float64]:
        """Metres really travelled, by code."""
        return frozen(by_code(0.0, MOVE_LENGTHS * self.worlds.pool.cell_size))

    @cached_property
    def _own(self) -> Rows:
        """Own position by cell, shape ``(C, 2)``."""
        cells = np.indices(self.shape).reshape(2, -1).T
        return frozen(np.ascontiguousarray(own_positions(cells, self.packing.shape)))

    @cached_property
    def _to_goal(self) -> Rows:
        """Vector to the goal by offset, shape ``(O, 2)``."""
        vectors = vectors_to_goal(self.code.all_offsets, self.packing.shape)
        return frozen(np.ascontiguousarray(vectors))

    @cached_property
    def _names(self) -> NDArray[np.object_]:
        # With a None at the end that is cut off again: objects even where there is but one.
        names = np.array([*self.worlds.pool.names, None], dtype=object)
        return frozen(names[:-1])


@lru_cache(maxsize=2)
def build_many_scenes(worlds: Worlds) -> ManyScenes:
    """Rules and maps of worlds; kept, so that their vector environments share one.

    Raises ``ValueError`` where there are more cells than it can number.
    """
    task = worlds.task
    pool = worlds.pool
    columns, rows = pool.shape
    border = max(task.patch_radius, 1)  # without any, moves would lead from one map to the next
    code = StateCode(shape=(columns + border, rows + border), frame=pool.shape)
    cells = len(pool) * code.map_size
    if cells > MOST_PLACES:
        raise ValueError(
            f"{len(pool)} scenes of {code.shape} cells, borders included, are more than "
            f"{MOST_PLACES} cells"
        )

    # What is seen: a window around a cell of the first map reaches as far back as `before` cells.
    before = task.patch_radius * (code.shape[1] + 1)
    margin = np.full(cells + 2 * before, -1.0, dtype=np.float32)
    seen = margin[before : before + cells].reshape(len(pool), *code.shape)

    # What may be done: nothing in the border, where nobody can be.
    # nothing but refusals, or violations too
    kinds = 2 if task.constraint in ("terminate", "allow") else 1
    moves = np.zeros((kinds, len(pool), *code.shape), dtype=np.uint16)

    for first in range(0, len(pool), _BLOCK):
        block = slice(first, first + _BLOCK)
        gain_db = pool.gain_db[block]
        seen[block, :columns, :rows] = scaled_margin(gain_db, pool.target_db[block, None, None])

        may = permissions(task.constraint, pool.free[block], pool.feasible[block])
        for kind, is_set in zip(moves, may, strict=False):
            kind[block, :columns, :rows] = pack_moves(is_set)

    return ManyScenes(
        worlds=worlds,
        packing=Packing(
            task.observation,
            2 * task.patch_radius + 1,
            pool.irs.shape[1],
            pool.shape,
            has_budget=task.budget is not None,
        ),
        code=code,
        legal=MoveBits(moves[0].ravel()),
        violating=None if kinds == 1 else MoveBits(moves[1].ravel()),
        margin=margin,
        **_rewards(worlds, code),
    )


def _rewards(worlds: Worlds, code: StateCode) -> dict[str, NDArray[Any]]:
    """Rewards of all moves and whether they reach the goal, by offset and code: ``(O * 16,)``."""
    rules = worlds.task.rules
    cell_size = worlds.pool.cell_size
    is_legal = np.array([False, True])
    before = code.all_offsets[:, None, None]  # (O, 1, 1, 2)
    after = before + MOVES[:, None] * is_legal[:, None]  # (O, 8, 2, 2)
    is_at_goal = is_legal & (after == 0).all(axis=-1)  # (O, 8, 2)

    length = MOVE_LENGTHS[:, None] * cell_size
    phi, phi_next = (potential(rules, each, cell_size) for each in (before, after))
    rewards = reward(rules, length, phi, phi_next, is_at_goal)  # (O, 8, 2)

    return {"reward": rewards.ravel(), "is_at_goal": is_at_goal.ravel()}
