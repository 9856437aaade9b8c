"""The rules of a robot that also switches the panel's configuration: `CodebookMaps`, all that a
task fixes, and `CodebookRules` over its states, each a configuration and a cell.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVE_LENGTHS, Cell, Grid, Motion, as_cell, cells_at, flat_cells
from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.dynamics import (
    ACTIONS,
    Transition,
    draw_start,
    draws_start,
    ends,
    judged,
    next_cells,
    permissions,
    potential,
    reward,
    start_cells,
)
from irs_gym.mdp.packing import Parts, own_positions, scaled_margin, vectors_to_goal
from irs_gym.mdp.robot import PAPER_ROBOT
from irs_gym.mdp.task import Rules, Task, World, is_integer
from irs_gym.memory import check_memory, freeze, frozen
from irs_gym.oracle.joint import joint_distance_to_go, joint_infeasible
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STATE_BYTES = 150  # of maps, distances and permissions for each configuration of each cell
_ENTRY_BYTES = 120  # of a state and an action in a table of transitions, with what it is made of


@dataclass(frozen=True, eq=False)
class CodebookMaps:
    """S scenes with the maps of their K configurations, on one frame of X x Y cells; nothing in it
    ever changes.
    """

    rules: Rules
    switch_cost: float  # metres
    names: tuple[str, ...]
    scenes: tuple[Scene, ...]  # with the elements that the task asks for
    target_db: Floats  # (S,)
    gain_db: Floats  # (S, K, X, Y), -inf in obstacles
    to_go: Floats  # (S, K, X, Y): metres to the scene's own goal, switches included
    irs: NDArray[np.float32]  # (S, K, 3 + N): what is told of the IRS as configured, in [-1, 1]
    start: Ints  # (S, 2)
    goal: Ints  # (S, 2)
    cell_size: float
    source: tuple[Callable[..., "CodebookMaps"], tuple[Any, ...]] = field(repr=False)
    """A call that gives it again."""
    passable: Bools | None = field(default=None, repr=False)
    """The moves that the robot's body can make, ``(S, X, Y, 8)``; None: all."""

    def __post_init__(self) -> None:
        freeze(*(each for each in vars(self).values() if isinstance(each, np.ndarray)))

    def __reduce__(self) -> Any:
        return self.source

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def configurations(self) -> int:
        """K."""
        return int(self.gain_db.shape[1])

    @cached_property
    def shape(self) -> tuple[int, int]:
        """The frame (X, Y)."""
        return self.gain_db.shape[2], self.gain_db.shape[3]

    @cached_property
    def size(self) -> int:
        """Cells of the frame, C."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def free(self) -> Bools:
        """Cells that a robot can enter, whatever the target, ``(S, X, Y)``."""
        return frozen(np.isfinite(self.gain_db[:, 0]))

    @cached_property
    def feasible(self) -> Bools:
        """Free cells at or above the target under each configuration, ``(S, K, X, Y)``."""
        is_met = self.gain_db >= self.target_db[:, None, None, None]
        return frozen(self.free[:, None] & is_met)

    @cached_property
    def strongest(self) -> Ints:
        """The configuration of the highest gain in each cell, the first of equals, ``(S, X, Y)``:
        an episode begins in that of its start.
        """
        return frozen(self.gain_db.argmax(axis=1))

    def motion(self, scenes: Any) -> Motion:
        """What is asked of a move besides a free cell in scenes of those numbers, or in all that an
        index of ``passable`` tells: arguments of `irs_gym.grid.legal_moves`.
        """
        passable = None if self.passable is None else self.passable[scenes]
        return {"corner_cutting": self.rules.robot.corner_cutting, "passable": passable}

    @cached_property
    def permissions(self) -> tuple[Bools, Bools]:
        """Which moves are not refused, and which miss the target, ``(S * K * C, 8)`` each."""
        free = np.broadcast_to(self.free[:, None], self.feasible.shape)
        motion = self.motion(np.s_[:, None])  # the same under all configurations
        may = permissions(self.rules.constraint, free, self.feasible, **motion)
        legal, violating = (frozen(each.reshape(-1, ACTIONS)) for each in may)

        return legal, violating

    @cached_property
    def windows(self) -> NDArray[np.void]:
        """What robots see around themselves, of each cell the scaled margins of a patch in one
        piece, ``(S * K * Y * (X + 2r),)`` and a few more: a view of strips as wide as a patch,
        ``(S * K, Y, X + 2r, 2r + 1)``, in which the rows of a patch follow each other.

        To gather whole patches is ten times as fast as to gather their cells, and a table of all
        would take 2r + 1 times the memory.
        """
        radius = self.rules.patch_radius
        side = 2 * radius + 1
        around = ((0, 0), (radius, radius), (radius, radius))
        padded = np.pad(self._scaled.reshape(-1, *self.shape), around, constant_values=-1.0)
        columns = np.lib.stride_tricks.sliding_window_view(padded, side, axis=2)
        strips = frozen(np.ascontiguousarray(columns.swapaxes(1, 2)))
        patch = np.dtype((np.void, 4 * side**2))

        return np.ndarray(strips.size // side - side + 1, patch, strips.data, strides=(4 * side,))

    @cached_property
    def windows_of(self) -> Ints:
        """Number of the window of each cell of each map, ``(S * K * C,)``."""
        length = self.shape[0] + 2 * self.rules.patch_radius
        i, j = np.divmod(np.arange(self.size), self.shape[1])
        maps = np.arange(len(self) * self.configurations)[:, None] * (self.shape[1] * length)

        return frozen((maps + j * length + i).ravel())

    @cached_property
    def gains(self) -> NDArray[np.float32]:
        """Scaled margins of all configurations in each cell, ``(S * C, K)``."""
        by_cell = np.moveaxis(self._scaled, 1, -1).reshape(-1, self.configurations)
        return frozen(np.ascontiguousarray(by_cell))

    @property
    def _scaled(self) -> NDArray[np.float32]:
        return scaled_margin(self.gain_db, self.target_db[:, None, None, None])

    def grid(self, scene: int) -> Grid:
        """The cells of a scene, on the frame."""
        return Grid(self.shape, self.cell_size, self.scenes[scene].room.lower)

    def own_goal(self, scene: int) -> Cell:
        """Goal of a scene."""
        return self._ends[1][scene]

    def own_start(self, scene: int) -> Cell:
        """Start of a scene."""
        return self._ends[0][scene]

    @cached_property
    def _ends(self) -> tuple[list[Cell], list[Cell]]:
        return [(i, j) for i, j in self.start.tolist()], [(i, j) for i, j in self.goal.tolist()]

    @cached_property
    def fingerprint(self) -> bytes:
        """8 bytes that tell maps and rules apart; see `irs_gym.mdp.task.World.fingerprint`."""
        rules = self.rules
        said: tuple[Any, ...] = (
            rules.constraint,
            bool(rules.shaping),
            float(rules.goal_bonus),
            self.switch_cost,
        )
        if rules.robot != PAPER_ROBOT:  # who is not mentioned
            said = (*said, repr(rules.robot))

        place = repr((self.gain_db.shape, float(self.cell_size), said)).encode()
        arrays = self.target_db.tobytes() + self.gain_db.tobytes()

        return blake2b(place + arrays, digest_size=8).digest()


def check_maps_memory(scenes: int, configurations: int, shape: tuple[int, int], asked: str) -> None:
    """Refuse maps that would take too much memory, before any is made."""
    states = float(scenes) * configurations * shape[0] * shape[1]
    check_memory(
        f"{asked}: {configurations} configurations of {scenes} maps of {shape[0]} x {shape[1]} "
        "cells",
        _STATE_BYTES * states,
    )


def to_go_of(maps: CodebookMaps, scene: int, goal: Cell) -> Floats:
    """Metres to a goal in a scene, switches included, ``(K, X, Y)``; +inf where it cannot be
    reached.
    """
    return maps.to_go[scene] if goal == maps.own_goal(scene) else _to_go(maps, scene, goal)


@lru_cache(maxsize=64)
def _to_go(maps: CodebookMaps, scene: int, goal: Cell) -> Floats:
    """As `to_go_of`, for another goal than the scene's; kept, so that it costs nothing again."""
    return frozen(
        joint_distance_to_go(
            maps.gain_db[scene],
            float(maps.target_db[scene]),
            goal,
            maps.cell_size,
            maps.switch_cost,
            **maps.motion(scene),
        )
    )


@lru_cache(maxsize=64)
def configuration_world(maps: CodebookMaps, scene: int, configuration: int) -> World:
    """The world of `IrsNav-v0` with the map of one configuration that never changes."""
    target_db = float(maps.target_db[scene])
    built = maps.scenes[scene]
    rules = {name: getattr(maps.rules, name) for name in Rules.__dataclass_fields__}
    irs = maps.irs[scene, configuration]

    return World(
        task=Task(target_db=target_db, cell_size=maps.cell_size, scene=built, **rules),
        target_db=target_db,
        scene=built,
        radio_map=RadioMap(maps.gain_db[scene, configuration], grid=maps.grid(scene)),
        start=maps.own_start(scene),
        goal=maps.own_goal(scene),
        feasible=maps.feasible[scene, configuration],
        irs=np.broadcast_to(irs, (*maps.shape, len(irs))),
        source=(configuration_world, (maps, scene, configuration)),
        passable=maps.motion(scene)["passable"],
    )


@lru_cache(maxsize=8)
def reach_world(maps: CodebookMaps, scene: int) -> World:
    """The world of `IrsNav-v0` with the highest gain that any configuration gives in each cell:
    what the codebook reaches.
    """
    world = configuration_world(maps, scene, 0)
    gain_db = maps.gain_db[scene].max(axis=0)  # (X, Y)

    return replace(
        world,
        radio_map=RadioMap(gain_db, grid=maps.grid(scene)),
        feasible=maps.feasible[scene].any(axis=0),
        source=(reach_world, (maps, scene)),
    )


# --- where episodes begin -------------------------------------------------------------------------


@dataclass(frozen=True)
class Ends:
    """Where an episode begins and ends."""

    scene: int
    configuration: int
    start: Cell
    goal: Cell


def choose_ends(
    maps: CodebookMaps, scene: int, given: Mapping[str, Any], rng: Callable[[], Any]
) -> Ends:
    """The ends given as ``start``, ``goal`` and ``configuration``; else the scene's own goal, and a
    start as the task says: the scene's in the configuration of the highest gain there, or a cell
    drawn among those that lead to the goal, and then a configuration among those that do so there.

    ``rng`` gives the generator to draw from, where there is anything to draw.

    Raises
    ------
    ValueError
        Where an end lies off the map or in an obstacle, the two are one, there is no such
        configuration, or no feasible path joins them; the message then gives the highest feasible
        target.
    """
    goal = given.get("goal") or maps.own_goal(scene)
    start = given.get("start")
    configuration = given.get("configuration")
    random_start = maps.rules.random_start
    if start is not None or not random_start or not draws_start(random_start, rng()):
        own = maps.own_start(scene) if start is None else start
        return _checked_ends(maps, scene, own, goal, configuration)

    # the first ends are checked, and those that are drawn are known to be joined
    _check_cell(maps, scene, "goal", goal)
    starts = _starts(maps, scene, goal, configuration)
    if not len(starts):
        raise ValueError(
            f"goal={goal} cannot be reached from any other cell at "
            f"target_db={float(maps.target_db[scene])}"
        )

    cell = draw_start(starts, rng())
    leading = np.isfinite(to_go_of(maps, scene, goal).reshape(maps.configurations, -1)[:, cell])
    first = draw_start(np.flatnonzero(leading), rng()) if configuration is None else configuration
    i, j = divmod(cell, maps.shape[1])

    return Ends(scene, int(first), (i, j), goal)


@lru_cache(maxsize=4096)
def _checked_ends(
    maps: CodebookMaps, scene: int, start: Cell, goal: Cell, configuration: Any
) -> Ends:
    """The ends, if they can be joined; kept, so that the same ones cost nothing again."""
    _check_cell(maps, scene, "start", start)
    _check_cell(maps, scene, "goal", goal)
    if start == goal:
        raise ValueError(f"start={start} must differ from the goal")

    strongest = int(maps.strongest[(scene, *start)])
    first = strongest if configuration is None else _checked_configuration(maps, configuration)
    if not np.isfinite(to_go_of(maps, scene, goal)[(first, *start)]):
        said = (maps.gain_db[scene], start, goal, float(maps.target_db[scene]), first)
        raise ValueError(joint_infeasible(*said, **maps.motion(scene)))

    return Ends(scene, first, start, goal)


@lru_cache(maxsize=64)
def _starts(maps: CodebookMaps, scene: int, goal: Cell, configuration: Any) -> Ints:
    """Flat cells that a random start is drawn from: those from which some configuration leads to
    the goal, or the one given.
    """
    to_go = to_go_of(maps, scene, goal)
    if configuration is not None:
        to_go = to_go[_checked_configuration(maps, configuration)][None]

    return frozen(start_cells(to_go.min(axis=0), goal))


def _checked_configuration(maps: CodebookMaps, configuration: Any) -> int:
    if not is_integer(configuration) or not 0 <= configuration < maps.configurations:
        raise ValueError(
            f"configuration={configuration!r} must be a number from 0 to {maps.configurations - 1}"
        )
    return int(configuration)


def _check_cell(maps: CodebookMaps, scene: int, name: str, cell: Cell) -> None:
    maps.rules.robot.check_cell(name, as_cell(cell, name), maps.free[scene])


# --- states ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CodebookRules:
    """The rules for P pairs of a scene and a goal in use.

    A state is one whole number: flat cell + C x (configuration + K x number of the pair). Actions
    are the eight moves, then a switch into each configuration. The arguments of the methods are of
    one shape, or are broadcast to one.

    Examples
    --------
    A robot between two cells, under a configuration that reaches the first and one that reaches
    both:

    >>> from irs_gym.radio.scene import load_scene
    >>> maps = CodebookMaps(
    ...     rules=Task().rules,
    ...     switch_cost=0.5,
    ...     names=("corridor",),
    ...     scenes=(load_scene("paper"),),
    ...     target_db=np.array([-61.0]),
    ...     gain_db=np.array([[[[-60.0], [-62.0]], [[-60.5], [-60.5]]]]),
    ...     to_go=np.array([[[[1.0], [np.inf]], [[0.5], [0.0]]]]),
    ...     irs=np.zeros((1, 2, 3), dtype=np.float32),
    ...     start=np.array([[0, 0]]),
    ...     goal=np.array([[1, 0]]),
    ...     cell_size=0.5,
    ...     source=(CodebookMaps, ()),
    ... )
    >>> rules = CodebookRules(maps, scenes=np.array([0]), goals=np.array([[1, 0]]))
    >>> rules.action_mask(np.array([0])).tolist()  # no move east, but a switch to the second
    [[0, 0, 0, 0, 0, 0, 0, 0, 0, 1]]
    >>> float(rules.distance_to_go(np.array([0]))[0])
    1.0
    """

    maps: CodebookMaps
    scenes: Ints  # (P,)
    goals: Ints  # (P, 2)

    def __post_init__(self) -> None:
        freeze(self.scenes, self.goals)

    @classmethod
    def of(cls, maps: CodebookMaps, pairs: Sequence[tuple[int, Cell]]) -> "CodebookRules":
        """Rules for pairs of a scene and a goal."""
        scenes, goals = zip(*pairs, strict=True)
        return cls(maps, np.array(scenes), np.array(goals))

    def __reduce__(self) -> Any:
        return _rules_again, (self.maps, self.pairs)

    @cached_property
    def pairs(self) -> tuple[tuple[int, Cell], ...]:
        """Scene and goal of each."""
        goals = [(i, j) for i, j in self.goals.tolist()]
        return tuple(zip(self.scenes.tolist(), goals, strict=True))

    @cached_property
    def numbers(self) -> dict[tuple[int, Cell], int]:
        """Number of each pair."""
        return {each: number for number, each in enumerate(self.pairs)}

    @cached_property
    def packing(self) -> CodebookPacking:
        """Layout of observations."""
        rules = self.maps.rules
        return CodebookPacking(
            observation=rules.observation,
            side=2 * rules.patch_radius + 1,
            settings=self.maps.irs.shape[-1],
            shape=self.maps.shape,
            configurations=self.maps.configurations,
        )

    @cached_property
    def actions(self) -> int:
        """Moves and switches, 8 + K."""
        return ACTIONS + self.maps.configurations

    @cached_property
    def lengths(self) -> Floats:
        """Metres that each action counts, ``(8 + K,)``."""
        switches = np.full(self.maps.configurations, self.maps.switch_cost)
        return frozen(np.concatenate([MOVE_LENGTHS * self.maps.cell_size, switches]))

    @property
    def states(self) -> int:
        """How many there are, P x K x C."""
        return len(self.scenes) * self.maps.configurations * self.maps.size

    # --- numbers of states ------------------------------------------------------------------------

    def state(self, pair: Any, configuration: Any, cell: Any) -> Any:
        """Number of a state; cells are flat."""
        return cell + self.maps.size * (configuration + self.maps.configurations * pair)

    def decode(self, states: Ints) -> tuple[Ints, Ints, Ints]:
        """Pair, configuration and flat cell of states: undoes `state`."""
        # by a known divisor, `//` is three times as fast as `divmod`
        maps = states // self.maps.size
        cell = states - maps * self.maps.size
        pair = maps // self.maps.configurations if len(self.scenes) > 1 else np.zeros_like(maps)

        return pair, maps - pair * self.maps.configurations, cell

    def _places(self, states: Ints) -> Ints:
        """Rows of a table of all configurations of all cells of all scenes."""
        if self._is_own:
            return states

        pair, rest = np.divmod(states, self.maps.configurations * self.maps.size)
        return np.asarray(rest + self.scenes[pair] * self.maps.configurations * self.maps.size)

    @cached_property
    def _is_single(self) -> bool:
        """Whether there is one scene, with one goal in use."""
        return len(self.scenes) == 1 and self._is_own

    @cached_property
    def _is_own(self) -> bool:
        """Whether pairs are numbered as scenes are."""
        return np.array_equal(self.scenes, np.arange(len(self.maps)))

    # --- what actions do --------------------------------------------------------------------------

    def permitted(self, states: Ints, actions: Ints) -> tuple[Bools, Bools]:
        """Which actions are not refused, and which miss the target; see
        `irs_gym.mdp.dynamics.permissions`.

        A switch is in place: it leads to the same cell under another configuration. One into the
        present configuration leads nowhere, and is refused.
        """
        maps = self.maps
        _, present, cell = self.decode(states)
        place = self._places(states)
        is_switch = actions >= ACTIONS
        chosen = np.where(is_switch, actions - ACTIONS, present)
        other = place + (chosen - present) * maps.size

        feasible = maps.feasible.ravel()
        is_open = (chosen != present) & maps.free.ravel()[self._cells(states, cell)]
        keeps_target = is_open & feasible[other]
        switch = judged(maps.rules.constraint, is_open, keeps_target, feasible[place])

        move = np.where(is_switch, 0, actions)
        is_legal, is_violation = (
            np.where(is_switch, its, table[place, move])
            for its, table in zip(switch, maps.permissions, strict=True)
        )

        return is_legal, is_violation

    def transition(self, states: Ints, actions: Ints) -> Transition:
        """What actions do in states; ``next_cell`` holds states. ``moved`` is what counts as
        metres: a switch moves the robot by its cost.
        """
        maps = self.maps
        rules = maps.rules
        is_legal, is_violation = self.permitted(states, actions)
        pair, present, cell = self.decode(states)
        is_switch = actions >= ACTIONS
        chosen = np.where(is_switch, actions - ACTIONS, present)
        move = np.where(is_switch, 0, actions)

        moves = next_cells(states, move, is_legal, maps.shape)
        switches = np.where(is_legal, states + (chosen - present) * maps.size, states)
        next_states = np.where(is_switch, switches, moves)
        next_cell = np.where(is_switch, cell, cell + moves - states)

        is_at_goal = is_legal & (next_cell == self._goal_cells[pair])
        length = self.lengths[actions]
        phi = self._potential[pair, cell]
        phi_next = self._potential[pair, next_cell]

        return Transition(
            next_cell=next_states,
            reward=reward(rules, length, phi, phi_next, is_at_goal),
            moved=np.where(is_legal, length, 0.0),
            is_refused=~is_legal,
            cost=is_violation.astype(np.float64),
            is_terminated=ends(rules, is_at_goal, is_violation),
            is_at_goal=is_at_goal,
        )

    def action_mask(self, states: Ints) -> NDArray[np.int8]:
        """1 where an action is not refused, ``(..., 8 + K)``."""
        return self.permitted(states[..., None], np.arange(self.actions))[0].astype(np.int8)

    def table(self) -> Transition:
        """The transition of every state and action, arrays ``(P * K * C, 8 + K)``; at the goal each
        action stays for nothing and ends the episode.

        Raises ``MemoryLimitError``, a ``ValueError``, where it would take too much memory.
        """
        check_memory(
            f"codebook: the table of {self.states} states and {self.actions} actions",
            float(self.states) * self.actions * _ENTRY_BYTES,
        )
        states = np.arange(self.states)
        table = self.transition(states[:, None], np.arange(self.actions))
        pair, _, cell = self.decode(states)
        here = np.flatnonzero(cell == self._goal_cells[pair])
        over = Transition(here[:, None], 0.0, 0.0, False, 0.0, True, True)

        for column, value in zip(table, over, strict=True):
            column[here] = value

        return table

    def optimal_actions(self, state: int) -> Ints:
        """All actions that begin a path of least cost, in ascending order; none at the goal and
        where it cannot be reached.
        """
        here = float(self.distance_to_go(np.array([state]))[0])
        if not 0 < here < np.inf:
            return np.empty(0, dtype=np.int64)

        step = self.transition(np.full(self.actions, state), np.arange(self.actions))
        ahead = self.distance_to_go(step.next_cell) + step.moved
        is_best = ~step.is_refused & (ahead - here <= here * 1e-9)

        return np.flatnonzero(is_best)

    # --- what there is to say of states -----------------------------------------------------------

    def distance_to_go(self, states: Ints) -> Floats:
        """Metres to the goal, switches included; inf where it cannot be reached."""
        to_go = self.maps.to_go.ravel()[self._places(states)]

        # The maps know the way to each scene's own goal; to others, it is worked out.
        for number in self._others:
            i, j = self.goals[number].tolist()
            its = to_go_of(self.maps, int(self.scenes[number]), (i, j)).ravel()
            pair, configuration, cell = self.decode(states)
            rows = configuration * self.maps.size + cell
            to_go = np.where(pair == number, its[rows], to_go)

        return np.asarray(to_go)

    def gain_db(self, states: Ints) -> Floats:
        """Expected channel gains under the present configurations, in dB."""
        return np.asarray(self.maps.gain_db.ravel()[self._places(states)])

    def margin_db(self, states: Ints) -> Floats:
        """Gains over the target in dB."""
        return self.gain_db(states) - self.maps.target_db[self.scenes[self.decode(states)[0]]]

    def scene_of(self, states: Ints) -> Ints:
        """Numbers of the scenes."""
        return np.asarray(self.scenes[self.decode(states)[0]])

    def configuration(self, states: Ints) -> Ints:
        """Numbers of the present configurations."""
        return self.decode(states)[1]

    def observe(self, states: Ints, out: Parts | None = None) -> Parts:
        """What n robots see, as the parts of n rows, in new memory or written to ``out``; see
        `CodebookPacking`.
        """
        packing = self.packing
        if packing.observation == "dict" and out is None:
            return self._seen(states)

        out = packing.empty(len(states)) if out is None else out
        if packing.observation == "cell":
            out[0][:, 0] = states % (self.maps.configurations * self.maps.size)
            return out

        for view, seen in zip(packing.views(out).values(), self._seen(states), strict=True):
            view[:] = seen

        if packing.observation == "masked":
            out[1][:] = self.action_mask(states)

        return out

    def _seen(self, states: Ints) -> Parts:
        """The fields of observations, in the order of `CodebookPacking.fields`."""
        maps = self.maps
        if self._is_single:  # the numbers of all that there is are the same
            place = configuration = np.floor_divide(states, self._size)
            row = goal_row = np.subtract(states, configuration * self._size)
        else:
            pair, configuration, cell = self.decode(states)
            place = configuration + self.scenes.take(pair) * maps.configurations
            row = cell + self.scenes.take(pair) * maps.size
            goal_row = cell + pair * maps.size

        patch = maps.windows[maps.windows_of.take(self._places(states))].view(np.float32)

        return (
            self._one_hot.take(configuration, axis=0),
            patch.reshape(len(states), -1),
            maps.gains.take(row, axis=0),
            self._irs_of(place),
            self._positions.take(goal_row).view(np.float32).reshape(len(states), 4),
        )

    # --- small tables -----------------------------------------------------------------------------

    def _cells(self, states: Ints, cell: Ints) -> Ints:
        """Flat cells counted through all scenes."""
        return np.asarray(cell + self.scene_of(states) * self.maps.size)

    @cached_property
    def _others(self) -> list[int]:
        """Pairs whose goal is not their scene's own."""
        is_other = (self.goals != self.maps.goal[self.scenes]).any(axis=1)
        return [int(number) for number in np.flatnonzero(is_other)]

    @cached_property
    def _one_hot(self) -> NDArray[np.float32]:
        """1 at the number of each configuration, ``(K, K)``."""
        return frozen(np.eye(self.maps.configurations, dtype=np.float32))

    @cached_property
    def _irs(self) -> NDArray[np.float32]:
        """What is told of the IRS, ``(S * K, 3 + N)``."""
        return self.maps.irs.reshape(-1, self.maps.irs.shape[-1])

    @cached_property
    def _size(self) -> Ints:
        """C, as an array ``()``: faster to compute with than an int."""
        return frozen(np.array(self.maps.size))

    def _irs_of(self, places: Ints) -> NDArray[np.float32]:
        """What is told of the IRS in those rows ``(n,)`` of `_irs`, ``(n, 3 + N)``."""
        if self._has_one_irs:  # nearly always, unless phases are told
            return _repeated_irs(self.maps, len(places)).copy()

        return self._irs.take(places, axis=0)

    @cached_property
    def _has_one_irs(self) -> bool:
        """Whether all that is told of the IRS is the same everywhere."""
        return bool((self._irs == self._irs[0]).all())

    @cached_property
    def _positions(self) -> NDArray[np.void]:
        """Own position and vector to the goal, 4 numbers each, ``(P * C,)``."""
        shape = self.maps.shape
        cells = np.indices(shape).reshape(2, -1).T  # (C, 2)
        to_goal = vectors_to_goal(cells - self.goals[:, None], shape)  # (P, C, 2)
        own = np.broadcast_to(own_positions(cells, shape), to_goal.shape)

        position = np.ascontiguousarray(np.concatenate([own, to_goal], axis=-1).reshape(-1, 4))

        return frozen(position.view(np.dtype((np.void, 16))).ravel())

    @cached_property
    def _goal_cells(self) -> Ints:
        """Flat cell of each pair's goal, ``(P,)``."""
        return frozen(flat_cells(self.goals, self.maps.shape))

    @cached_property
    def _potential(self) -> Floats:
        """Shaping potential, ``(P, C)``."""
        cells = np.indices(self.maps.shape).transpose(1, 2, 0).reshape(-1, 2)
        offsets = cells - self.goals[:, None]  # (P, C, 2)
        return frozen(potential(self.maps.rules, offsets, self.maps.cell_size))


def switch_cells(states: Ints, maps: CodebookMaps) -> Ints:
    """Cells (i, j) where the panel is switched along the states ``(T,)`` of an episode, ``(n,
    2)``.
    """
    configurations, cells = np.divmod(states, maps.size)
    is_switch = np.diff(configurations) != 0  # (T - 1,)
    return cells_at(cells[1:][is_switch], maps.shape)


@lru_cache(maxsize=8)
def _repeated_irs(maps: CodebookMaps, count: int) -> NDArray[np.float32]:
    """What is told of the IRS in the first configuration, so many times, ``(count, 3 + N)``: a copy
    is several times as fast as a gather.
    """
    return frozen(np.repeat(maps.irs[0, :1], count, axis=0))


@lru_cache(maxsize=8)
def own_rules(maps: CodebookMaps) -> CodebookRules:
    """Rules for all scenes with their own goals; kept, so that environments share them."""
    return CodebookRules(maps, np.arange(len(maps)), maps.goal)


def _rules_again(maps: CodebookMaps, pairs: tuple[tuple[int, Cell], ...]) -> CodebookRules:
    own = own_rules(maps)
    return own if pairs == own.pairs else CodebookRules.of(maps, pairs)
