"""`ContinuousModel`: the rules of many robots that go anywhere on the floor, number for number
those of `irs_gym.mdp.continuous_rules.Site`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.budget import payable
from irs_gym.mdp.continuous_ends import ContinuousEnds, oracle_distances
from irs_gym.mdp.continuous_maps import ContinuousMaps, quarter
from irs_gym.mdp.continuous_rules import NEVER, cell_judge, is_plain, step_reward
from irs_gym.mdp.exact_field import ExactField, exact_field
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.packing import Packing, Parts, scaled_margin
from irs_gym.mdp.segment import BELOW, Walks, snapped_many, walk_many
from irs_gym.memory import frozen
from irs_gym.vector.protocols import Outcome

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Records = NDArray[Any]

# A state: where a robot is and where it wants to go, in cells, in which scene, the padded cell that
# counts as its own, counted through all maps, and whether the goal is seen from all of its disc.
STATE = np.dtype(
    [
        ("at", "f8", 2),
        ("goal", "f8", 2),
        ("scene", "i8"),
        ("cell", "i8"),
        ("is_plain", "?"),
    ],
    align=True,
)
_ROUNDING = 1e-6  # cells


@dataclass(frozen=True, eq=False)
class ContinuousModel:
    """The rules and the maps; what each method gives for states is described in
    `irs_gym.vector.protocols.TransitionModel`.
    """

    maps: ContinuousMaps

    def __reduce__(self) -> Any:
        return model_of, (self.maps,)

    def state(self, ends: ContinuousEnds) -> Any:
        """State in which an episode begins, as a record ``()``."""
        plain = is_plain(self.maps, ends.scene, ends.goal)
        base = ends.scene * self.maps.padded_size
        cell = base + cell_judge(self.maps, ends.scene).cell(*ends.start)
        return np.array((ends.start, ends.goal, ends.scene, cell, plain), dtype=STATE)

    # --- rules ------------------------------------------------------------------------------------

    def move(self, states: Records, actions: NDArray[Any]) -> Outcome:
        """What headings ``(2, n)``, none longer than 1, do in states."""
        maps = self.maps
        start = np.ascontiguousarray(states["at"].T)  # (2, n)
        goal = np.ascontiguousarray(states["goal"].T)
        bases = self._bases(states)
        target = snapped_many(start + actions * maps.reach)
        delta = target - start
        was = start - goal
        before = was[0] * was[0] + was[1] * was[1]  # squared, (n,)

        # who may come to the goal at all, and where it is entered, if its centre can be seen there
        near = np.flatnonzero(before <= (maps.radius + maps.reach + _ROUNDING) ** 2)
        until = np.ones(len(states))
        entered = np.full(len(near), NEVER)
        if near.size:
            entered = entrances(was[:, near], delta[:, near], maps.radius)
            at = start[:, near] + entered * delta[:, near]
            is_seen = self._sees_goal(states[near], at, entered <= 1.0)
            entered = np.where(is_seen, entered, NEVER)
            until[near] = np.minimum(entered, 1.0)

        share, at, blocked, paid = walks = self._walk(states["cell"], bases, start, target, until)
        is_still = (delta[0] == 0.0) & (delta[1] == 0.0)
        if is_still.any():
            _stay(walks, start, is_still, 1.0)
            blocked[is_still] = -1
            entered[is_still[near]] = 1.5  # who stays does not arrive

        is_refused = blocked >= 0
        if maps.on_refused == "stay":
            _stay(walks, start, is_refused, 0.0)

        # who has entered the goal, or has come where its centre is seen
        off = at - goal
        away = off[0] * off[0] + off[1] * off[1]  # squared
        is_at_goal = np.zeros(len(states), dtype=bool)
        if near.size:
            is_inside = (entered == NEVER) & (away[near] <= maps.radius * maps.radius)
            is_inside = self._sees_goal(states[near], at[:, near], is_inside)
            is_at_goal[near] = ((entered <= 1.0) & ~is_refused[near]) | is_inside

        used = np.where(is_at_goal, share, 1.0) if near.size else np.ones(len(states))
        cost = None
        is_violation = None
        if self._rate is not None:
            # who is stopped stands there for the rest of the time, and who stays for all of it
            stood = np.where(is_still, 1.0, used - share)
            standing = np.flatnonzero(stood > 0.0)
            paid[standing] += stood[standing] * self._rates(at[:, standing], bases[standing])
            cost = paid * maps.time_step
            cost = cost if maps.rules.budget is None else payable(cost)
        elif maps.rules.constraint == "terminate":
            is_violation = (blocked == BELOW) & ~is_at_goal
            cost = is_violation.astype(np.float64)

        step = at - start
        next_states = states.copy()
        next_states["at"] = at.T
        next_states["cell"] = self._flat_cells(at, bases)

        return Outcome(
            states=next_states,
            reward=step_reward(maps, used, np.sqrt(before), np.sqrt(away), is_at_goal),
            moved=np.sqrt(step[0] * step[0] + step[1] * step[1]) * maps.cell_size,
            is_terminated=is_at_goal if is_violation is None else is_at_goal | is_violation,
            cost=cost,
            is_at_goal=is_at_goal,
            is_refused=is_refused,
            seconds=used * maps.time_step,
        )

    def refuse(self, outcome: Outcome, chosen: Ints) -> None:
        """Write what comes of steps that a budget refuses: the robots stay for the time step, for
        nothing.
        """
        assert outcome.is_refused is not None
        assert outcome.seconds is not None
        outcome.reward[chosen] = step_reward(self.maps, 1.0, 0.0, 0.0, False)
        outcome.is_refused[chosen] = True
        outcome.seconds[chosen] = self.maps.time_step

    def _sees_goal(self, states: Records, at: Floats, is_asked: Bools) -> Bools:
        """Of the robots that ask, which ones see the goal's centre from points ``(2, n)``."""
        is_seen: Bools = is_asked & states["is_plain"]
        asked = np.flatnonzero(is_asked & ~states["is_plain"])
        if asked.size:
            goal = np.ascontiguousarray(states["goal"][asked].T)
            is_seen[asked] = self._sees(self._bases(states[asked]), at[:, asked], goal)

        return is_seen

    def _walk(self, cells: Ints, bases: Ints, start: Floats, end: Floats, until: Floats) -> Walks:
        """How far robots come from start to end, ``(2, n)``, or to a share of that, ``(n,)``."""
        if self.maps.field == "exact":
            parts = [
                (robots, field.walk_many(start[:, robots], end[:, robots], until[robots]))
                for field, robots in self._fields(bases)
            ]
            walks = Walks(until, end, np.full(len(until), -1), np.zeros(len(until)))
            for robots, some in parts:
                for array, its in zip(walks, some, strict=True):
                    array[..., robots] = its

            return walks

        is_clear = (self._clear.take(cells) >> quarter(*(end - start)) & 1).astype(bool)
        near = np.flatnonzero(~(is_clear & (until == 1.0)))
        walks = Walks(until, end, np.full(len(until), -1), np.zeros(len(until)))
        if near.size:
            some = walk_many(
                self._kinds,
                self._rate,
                self.maps.width,
                bases[near],
                start[:, near],
                end[:, near],
                until[near],
            )
            for array, its in zip(walks, some, strict=True):
                array[..., near] = its

        return walks

    def _sees(self, bases: Ints, at: Floats, goal: Floats) -> Bools:
        """Whether the straight lines from points to goals, ``(2, n)`` each, may be gone."""
        if self.maps.field == "exact":
            is_seen = np.empty(len(bases), dtype=bool)
            for field, robots in self._fields(bases):
                is_seen[robots] = field.see(at[:, robots], goal[:, robots])

            return is_seen

        ones = np.ones(len(bases))
        walks = walk_many(self._seen, None, self.maps.width, bases, at, goal, ones)
        return np.asarray((walks.share == 1.0) | (at == goal).all(axis=0))

    def _rates(self, at: Floats, bases: Ints) -> Floats:
        """What a second costs at points ``(2, n)``."""
        if self.maps.field != "exact":
            assert self._rate is not None
            return self._rate.take(self._flat_cells(at, bases))

        rates = np.empty(len(bases))
        for field, robots in self._fields(bases):
            rates[robots] = field.rates(field.gains_db(at[:, robots].T))

        return rates

    def _fields(self, bases: Ints) -> Iterator[tuple[ExactField, Ints]]:
        """The exact field of each scene in use, and the robots that are there."""
        for base in np.unique(bases).tolist():
            scene = base // self.maps.padded_size
            yield exact_field(self.maps, scene), np.flatnonzero(bases == base)

    # --- where robots are -------------------------------------------------------------------------

    def cells(self, states: Records) -> NDArray[Any]:
        """Points in cells, x + jy, ``(n,)``."""
        return np.ascontiguousarray(states["at"]).view(np.complex128)[:, 0]

    def scenes(self, states: Records) -> Ints:
        """Numbers of the scenes."""
        return np.array(states["scene"])

    def metres(self, states: Records) -> Floats:
        """Points ``(2, n)`` in metres."""
        origins = self._origins.take(states["scene"], axis=1)
        return np.asarray(states["at"].T * self.maps.cell_size + origins)

    def _bases(self, states: Records) -> Ints:
        """Where the padded maps of the scenes begin, ``(n,)``."""
        return np.asarray(states["scene"] * self.maps.padded_size)

    def _flat_cells(self, at: Floats, bases: Ints) -> Ints:
        """The padded cells that count as the robots', counted through all maps: of those that one
        touches, the one of the highest gain.
        """
        width = self.maps.width
        floors = np.floor(at)
        whole = floors.astype(np.int64)
        flat = bases + (whole[0] + 1) * width + whole[1] + 1
        is_on = floors == at  # (2, n)
        if not is_on.any():
            return np.asarray(flat)

        some = np.flatnonzero(is_on.any(axis=0))
        on_x, on_y = is_on[:, some]
        touched = flat[some] - np.array([[0], [width], [1], [width + 1]])  # (4, m)
        can_be = np.stack([np.ones_like(on_x), on_x, on_y, on_x & on_y])
        rank = np.where(can_be, self._rank.take(np.maximum(touched, 0)), -np.inf)
        flat[some] = touched[rank.argmax(axis=0), np.arange(len(some))]

        return np.asarray(flat)

    def _own_cells(self, states: Records) -> tuple[Ints, Ints, Ints]:
        """Scenes and cells i, j of the robots."""
        flat = states["cell"] - self._bases(states)
        i, j = np.divmod(flat, self.maps.width)

        return states["scene"], i - 1, j - 1

    # --- observations -----------------------------------------------------------------------------

    def observe(self, states: Records, out: Parts | None = None) -> Parts:  # noqa: D102
        packing = self.packing
        out = packing.empty(len(states)) if out is None else out
        if self._table is not None:
            flat = self._unpadded.take(states["cell"])
            for table, part in zip(self._table, out, strict=True):
                table.take(flat, axis=0, out=part, mode="clip")
        else:
            self._observe_rows(*self._own_cells(states), out)

        # as `irs_gym.mdp.packing.own_positions` and `vectors_to_goal` of cells
        position = out[-1][:, -4:]
        position[:, :2] = 2.0 * states["at"] / self.maps.shape - 1.0
        position[:, 2:] = (states["goal"] - states["at"]) / self.maps.shape

        return out

    def _observe_rows(self, scenes: Ints, i: Ints, j: Ints, out: Parts) -> None:
        """Write all but positions, without a table of all that there is to see."""
        maps = self.maps
        nowhere = np.zeros((len(scenes), 2))
        if maps.irs is not None:
            patch = self._windows[scenes, i, j].reshape(len(scenes), -1)
            self.packing.encode(
                out, patch=patch, irs=maps.irs[scenes], own=nowhere, to_goal=nowhere
            )
            return

        world = maps.world(0)
        rows = np.empty((len(scenes), self.packing.width), dtype=np.float32)
        rows = build_observer(world, world.goal).rows(i * maps.shape[1] + j, rows)
        for part, its in zip(out, self.packing.split(rows), strict=True):
            part[:] = its

    # --- what else there is to say of states ------------------------------------------------------

    def gain_db(self, states: Records) -> Floats:  # noqa: D102
        if self.maps.field != "exact":
            return np.asarray(self.maps.gain_db[self._own_cells(states)])

        gains = np.empty(len(states))
        for field, robots in self._fields(self._bases(states)):
            gains[robots] = field.gains_db(states["at"][robots])

        return gains

    def margin_db(self, states: Records) -> Floats:  # noqa: D102
        return self.gain_db(states) - self.maps.target_db.take(states["scene"])

    def distance_to_go(self, states: Records, budget_left: Floats | None = None) -> Floats:
        """Metres to the goals' discs; see `irs_gym.mdp.continuous_ends.oracle_distances`."""
        metres = np.empty(len(states))
        ends = states[["goal", "scene"]]
        _, first, number = np.unique(ends, return_index=True, return_inverse=True)

        for n, one in enumerate(first.tolist()):
            here = np.flatnonzero(number == n)
            x, y = states["goal"][one].tolist()
            scene = int(states["scene"][one])
            metres[here] = oracle_distances(self.maps, scene, states["at"][here], (x, y))

        return metres

    def oracle_distance(  # noqa: D102
        self, states: Records, budgets: Floats | None = None
    ) -> Floats:
        return self.distance_to_go(states)

    def cost(self, states: Records) -> Floats:
        """Nothing is paid for a start, which takes no time."""
        return np.zeros(len(states))

    def action_mask(self, states: Records, budget_left: Floats | None = None) -> NDArray[np.int8]:
        """No heading is masked: shape ``(n, 0)``."""
        return np.zeros((len(states), 0), dtype=np.int8)

    # --- arrays of all maps -----------------------------------------------------------------------

    @cached_property
    def packing(self) -> Packing:
        """Layout of observations."""
        world = self.maps.world(0)
        return build_observer(world, world.goal).packing

    @cached_property
    def _kinds(self) -> NDArray[np.uint8]:
        return self.maps.kinds.ravel()

    @cached_property
    def _clear(self) -> NDArray[np.uint8]:
        return self.maps.clear.ravel()

    @cached_property
    def _seen(self) -> NDArray[np.uint8]:
        return self.maps.reachable_kinds.ravel()

    @cached_property
    def _rank(self) -> Floats:
        return self.maps.rank.ravel()

    @cached_property
    def _rate(self) -> Floats | None:
        return None if self.maps.rate is None else self.maps.rate.ravel()

    @cached_property
    def _origins(self) -> Floats:
        """Lower left corners of the maps in metres, ``(2, S)``."""
        corners = [self.maps.grid(n).origin for n in range(len(self.maps))]
        return frozen(np.ascontiguousarray(np.array(corners).T))

    @cached_property
    def _table(self) -> Parts | None:
        """Parts of the observations of all cells, where there is one scene and they are kept."""
        world = self.maps.world(0)
        table = build_observer(world, world.goal).table
        if self.maps.has_many_scenes or table is None:
            return None

        return tuple(frozen(np.ascontiguousarray(each)) for each in self.packing.split(table))

    @cached_property
    def _unpadded(self) -> Ints:
        """The flat cell of each padded one of a map; 0 for those of the border."""
        flat = np.zeros((self.maps.shape[0] + 2, self.maps.width), dtype=np.int64)
        flat[1:-1, 1:-1] = np.arange(self.maps.gain_db[0].size).reshape(self.maps.shape)

        return frozen(flat.ravel())

    @cached_property
    def _windows(self) -> NDArray[np.float32]:
        """The margins around each cell, ``(S, X, Y, 2r+1, 2r+1)``: a view."""
        side = self.packing.side
        margin = scaled_margin(self.maps.gain_db, self.maps.target_db[:, None, None])
        around = ((0, 0), (side // 2, side // 2), (side // 2, side // 2))
        bordered = np.pad(margin, around, constant_values=-1.0)

        return np.lib.stride_tricks.sliding_window_view(bordered, (side, side), axis=(1, 2))


def entrances(start: Floats, delta: Floats, radius: float) -> Floats:
    """`irs_gym.mdp.continuous_rules.entrance` of segments ``(2, n)``."""
    beyond = start[0] * start[0] + start[1] * start[1] - radius * radius
    towards = -(start[0] * delta[0] + start[1] * delta[1])
    under = towards * towards - (delta[0] * delta[0] + delta[1] * delta[1]) * beyond
    comes = (towards > 0.0) & (under >= 0.0) & (beyond > 0.0)
    share = np.full(len(beyond), NEVER)
    some = np.flatnonzero(comes)
    share[some] = beyond[some] / (towards[some] + np.sqrt(under[some]))
    share[share > 1.0] = NEVER
    share[beyond <= 0.0] = 0.0

    return share


def _stay(walks: Walks, start: Floats, chosen: Bools, share: float) -> None:
    """Write that robots come nowhere, for nothing, in a share of their step."""
    walks.share[chosen] = share
    walks.at[:, chosen] = start[:, chosen]
    walks.paid[chosen] = 0.0


@lru_cache(maxsize=4)
def model_of(maps: ContinuousMaps) -> ContinuousModel:
    """Model of maps; kept, so that vector environments of the same task share one."""
    return ContinuousModel(maps)
