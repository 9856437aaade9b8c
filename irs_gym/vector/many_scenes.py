"""`ManyScenes`: the maps of many scenes as one long array, so that n robots move and look around by
a few gathers.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.datasets.random_task import Worlds
from irs_gym.grid import MOVE_LENGTHS, MOVES, Cell
from irs_gym.mdp.dynamics import ACTIONS, ends, permissions, potential, reward, tabulate
from irs_gym.mdp.packing import (
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

Ints = NDArray[np.int64]

# A state holds two numbers: its low 32 bits are the place, a cell of a map; the others are the
# offset from the goal.
_PLACE = 2**32 - 1
_OFFSET = 32
# Of the place, the upper 4 bits are 0: shifted by this, an offset makes room for one of 16 codes, 2
# x action + legal.
_ENTRY = 28
_BLOCK = 256  # scenes whose rules are worked out at a time: bounds memory


@dataclass(frozen=True, eq=False)
class ManyScenes:
    """The ground of many worlds: S maps of C cells each, every row and every map with a border
    behind it.

    The border of blocked cells is as wide as the robots see, so that a window never reaches into
    another map. What each method gives for states is described in
    `irs_gym.vector.protocols.TransitionModel`.
    """

    worlds: Worlds
    packing: Packing
    shape: tuple[int, int]  # of a map with its border
    legal: NDArray[
        np.uint16
    ]  # (S * C,): 8 times the byte whose bits tell which actions are not refused
    violating: (
        NDArray[np.uint16] | None
    )  # (S * C,): likewise, which actions miss the target; None where none does
    margin: Rows  # (S * C and a border before and behind,): scaled to be seen
    reward: NDArray[np.float64]  # by offset and code
    is_at_goal: NDArray[np.bool_]  # by offset and code
    windows: NDArray[np.void] = field(
        init=False
    )  # (S * C,): all rows of cells as wide as a patch, a view

    def __post_init__(self) -> None:
        freeze(*(each for each in vars(self).values() if isinstance(each, np.ndarray)))
        # Rows overlap in memory: to gather whole rows is twice as fast as to gather their cells.
        row = np.dtype((np.void, 4 * self.packing.side))
        windows = np.ndarray(
            len(self.margin) - self.packing.side + 1, row, self.margin.data, strides=(4,)
        )
        object.__setattr__(self, "windows", windows)

    def __reduce__(self) -> Any:
        return build_many_scenes, (self.worlds,)

    # --- states -----------------------------------------------------------------------------------

    def states_of(self, scenes: Ints, cells: Ints, goals: Ints) -> States:
        """States of robots: numbers of their scenes ``(n,)``, cells and goals ``(n, 2)``."""
        places = scenes * self._size + cells @ np.array([self.shape[1], 1])
        offsets = (cells - goals + self._centre) @ np.array([self._breadth, 1])
        return np.asarray((offsets << _OFFSET) | places)

    def scenes(self, states: States) -> Ints:
        """Numbers of the scenes."""
        return (states & _PLACE) // self._size

    def goals(self, states: States) -> Ints:
        """Goals (i, j), shape ``(n, 2)``."""
        offsets = np.stack(np.divmod(states >> _OFFSET, self._breadth), axis=-1) - self._centre
        return self._cells(states) - offsets

    def _cells(self, states: States) -> Ints:
        """Cells (i, j), shape ``(n, 2)``."""
        i, j = np.divmod(states & _PLACE, self.shape[1])
        return np.stack([i % self.shape[0], j], axis=-1)

    # --- ground -----------------------------------------------------------------------------------

    def move(self, states: States, actions: Ints) -> Outcome:  # noqa: D102
        places = states & _PLACE
        codes = _CODES.take(self.legal.take(places) + actions)
        entries = (states >> _ENTRY) + codes
        is_at_goal = is_terminated = self.is_at_goal.take(entries)
        cost = None
        if self.violating is not None:
            is_violation = _BITS.take(self.violating.take(places) + actions)
            cost = is_violation.astype(np.float64)
            is_terminated = ends(self.worlds.task.rules, is_at_goal, is_violation)

        return Outcome(
            states + self._steps.take(codes),
            self.reward.take(entries),
            self._moved.take(codes),
            is_terminated,
            cost,
            is_at_goal,
        )

    def observe(self, states: States, out: Parts | None = None) -> Parts:  # noqa: D102
        out = self.packing.empty(len(states)) if out is None else out
        if self.packing.observation == "map":
            self._observe_maps(states, self.packing.unpack(out))
            return out

        if self.packing.observation == "cell":
            out[0][:, 0] = self._cells(states) @ np.array([self.packing.shape[1], 1])
            return out

        places = states & _PLACE
        scenes = places // self._size
        windows = self.windows[places[:, None] + self._rows]  # (n, 2r+1), a row of a patch each
        is_masked = self.packing.observation == "masked"

        return self.packing.encode(
            out,
            patch=windows.view(np.float32),  # (n, (2r+1)**2)
            irs=self.worlds.pool.irs.take(scenes, axis=0),
            own=self._own.take(places - scenes * self._size, axis=0),
            to_goal=self._to_goal.take(states >> _OFFSET, axis=0),
            action_mask=self.action_mask(states) if is_masked else None,
        )

    def _observe_maps(self, states: States, images: Rows) -> None:
        """Write into images ``(n, 4, X, Y)``."""
        each = np.arange(len(states))
        scenes = self.scenes(states)
        columns, rows = self.packing.shape

        before = len(self.margin) - len(self.legal)
        margin = self.margin[before // 2 : before // 2 + len(self.legal)].reshape(-1, *self.shape)
        images[:, MARGIN] = margin[scenes, :columns, :rows]
        images[:, OBSTACLE] = ~self.worlds.pool.free[scenes]

        for channel, cells in ((ROBOT, self._cells(states)), (GOAL, self.goals(states))):
            images[:, channel] = 0.0
            images[each, channel, cells[:, 0], cells[:, 1]] = 1.0

    def cells(self, states: States) -> Ints:  # noqa: D102
        return states & _PLACE

    def distance_to_go(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        pool = self.worlds.pool
        scenes = self.scenes(states)
        goals = self.goals(states)
        cells = self._cells(states)
        to_go = pool.distance_to_go[scenes, cells[:, 0], cells[:, 1]]

        for n in np.flatnonzero((goals != pool.goal[scenes]).any(axis=1)).tolist():
            world, goal = self.scene_and_goal(states, n)
            to_go[n] = tabulate(world, goal).distance_to_go[cells[n, 0], cells[n, 1]]

        return np.asarray(to_go)

    def gain_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        cells = self._cells(states)
        return np.asarray(self.worlds.pool.gain_db[self.scenes(states), cells[:, 0], cells[:, 1]])

    def margin_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.gain_db(states) - self.worlds.pool.target_db[self.scenes(states)]

    def action_mask(self, states: States) -> NDArray[np.int8]:  # noqa: D102
        entries = self.legal.take(states & _PLACE)[:, None] + np.arange(ACTIONS)
        return _BITS.take(entries).astype(np.int8)

    def scene_id(self, states: States) -> NDArray[np.object_]:
        """Names of the scenes."""
        return self._names.take(self.scenes(states))

    def scene_and_goal(self, states: States, n: int) -> tuple[Any, Cell]:
        """World and goal of robot n."""
        i, j = self.goals(states[[n]])[0].tolist()
        return self.worlds.world(int(self.scenes(states[[n]])[0])), (i, j)

    # --- small tables -----------------------------------------------------------------------------

    @cached_property
    def _size(self) -> int:
        """Cells of a map with its border, C."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def _breadth(self) -> int:
        """Offsets from the goal along y that there are."""
        return 2 * self.packing.shape[1] - 1

    @cached_property
    def _centre(self) -> Ints:
        """Numbers of an offset of 0, shape ``(2,)``."""
        return frozen(np.array(self.packing.shape) - 1)

    @cached_property
    def _rows(self) -> Ints:
        """From the first row of a patch to each of them."""
        return frozen(np.arange(self.packing.side) * self.shape[1])

    @cached_property
    def _steps(self) -> Ints:
        """What to add to a state, by code."""
        steps = (MOVES @ np.array([self._breadth, 1]) << _OFFSET) + MOVES @ np.array(
            [self.shape[1], 1]
        )
        return frozen(np.stack([np.zeros_like(steps), steps], axis=-1).ravel())

    @cached_property
    def _moved(self) -> NDArray[np.float64]:
        """Metres really travelled, by code."""
        lengths = MOVE_LENGTHS * self.worlds.pool.cell_size
        return frozen(np.stack([np.zeros(ACTIONS), lengths], axis=-1).ravel())

    @cached_property
    def _own(self) -> Rows:
        """Own position by cell, shape ``(C, 2)``."""
        cells = np.indices(self.shape).reshape(2, -1).T
        return frozen(np.ascontiguousarray(own_positions(cells, self.packing.shape)))

    @cached_property
    def _to_goal(self) -> Rows:
        """Vector to the goal by offset, shape ``(O, 2)``."""
        return frozen(
            np.ascontiguousarray(vectors_to_goal(_offsets(self.packing.shape), self.packing.shape))
        )

    @cached_property
    def _names(self) -> NDArray[np.object_]:
        names = np.array(
            [*self.worlds.pool.names, None], dtype=object
        )  # objects even where there is but one
        return frozen(names[:-1])


# By 8 x byte + action: whether that bit of the byte is set, and the code, 2 x action + bit.
_BITS = (np.arange(256)[:, None] >> np.arange(ACTIONS) & 1).astype(bool).ravel()
_CODES = np.tile(2 * np.arange(ACTIONS), 256) + _BITS


@lru_cache(maxsize=2)
def build_many_scenes(worlds: Worlds) -> ManyScenes:
    """Atlas of worlds; kept, so that their vector environments share one.

    Raises ``ValueError`` where there are more cells than it can number.
    """
    task = worlds.task
    pool = worlds.pool
    border = max(task.patch_radius, 1)  # without any, moves would lead from one map to the next
    shape = (pool.shape[0] + border, pool.shape[1] + border)
    cells = len(pool) * shape[0] * shape[1]
    if cells > 2**_ENTRY:
        raise ValueError(
            f"{len(pool)} scenes of {shape} cells, borders included, are more than {2**_ENTRY} cells"
        )

    before = task.patch_radius * (shape[1] + 1)
    margin = np.full(cells + 2 * before, -1.0, dtype=np.float32)
    seen = margin[before : before + cells].reshape(len(pool), *shape)
    legal = np.empty(
        (1 if task.constraint == "refuse" else 2, len(pool), shape[0] * shape[1]), dtype=np.uint16
    )

    for first in range(0, len(pool), _BLOCK):
        block = slice(first, first + _BLOCK)
        here = scaled_margin(pool.gain_db[block], pool.target_db[block, None, None])
        seen[block, : pool.shape[0], : pool.shape[1]] = here
        free, feasible = (_bordered(each[block], shape) for each in (pool.free, pool.feasible))

        for kind, may in zip(legal, permissions(task.constraint, free, feasible), strict=False):
            kind[block] = np.packbits(may, axis=-1, bitorder="little").reshape(
                -1, shape[0] * shape[1]
            )

    legal *= ACTIONS
    packing = Packing(task.observation, 2 * task.patch_radius + 1, pool.irs.shape[1], pool.shape)

    return ManyScenes(
        worlds=worlds,
        packing=packing,
        shape=shape,
        legal=legal[0].ravel(),
        violating=None if task.constraint == "refuse" else legal[1].ravel(),
        margin=margin,
        **_rewards(worlds),
    )


def _bordered(maps: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Maps ``(S, X, Y)`` with borders, one above the other: shape ``(S * X', Y')``."""
    tall = np.zeros((len(maps), *shape), dtype=bool)
    tall[:, : maps.shape[1], : maps.shape[2]] = maps
    return tall.reshape(-1, shape[1])


def _offsets(shape: tuple[int, int]) -> Ints:
    """All offsets from a goal that there can be on a map, in the order of their numbers: shape
    ``(O, 2)``.
    """
    columns, rows = shape
    return np.asarray(
        np.indices((2 * columns - 1, 2 * rows - 1)).reshape(2, -1).T - [columns - 1, rows - 1]
    )


def _rewards(worlds: Worlds) -> dict[str, NDArray[Any]]:
    """Rewards of all moves and whether they reach the goal, by offset and code."""
    rules = worlds.task.rules
    cell_size = worlds.pool.cell_size
    offsets = _offsets(worlds.pool.shape)[:, None, None]
    is_legal = np.array([False, True])
    after = offsets + MOVES[:, None] * is_legal[:, None]  # (O, 8, 2, 2)
    is_at_goal = is_legal & (after == 0).all(axis=-1)
    now, then = (potential(rules, each, cell_size) for each in (offsets, after))
    rewards = reward(rules, MOVE_LENGTHS[:, None] * cell_size, now, then, is_at_goal)

    return {"reward": rewards.ravel(), "is_at_goal": is_at_goal.ravel()}
