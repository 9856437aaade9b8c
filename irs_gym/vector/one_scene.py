"""`OneScene`: the tables of several goals one behind the other, packed for gathers over many
robots.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.mdp.budget import can_pay
from irs_gym.mdp.dynamics import ACTIONS, metres_to_go, tabulate
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.packing import Packing, Parts, Rows
from irs_gym.mdp.task import World
from irs_gym.memory import freeze
from irs_gym.vector.protocols import Outcome, States


@dataclass(frozen=True, eq=False)
class OneScene:
    """The rules and the map of one world, for the goals in use.

    A state is a flat cell plus ``X * Y`` times the number of its goal: S states, 8 actions. The
    entry of a state and an action in a table is 8 times the state plus the action.

    What each method gives for states is described in `irs_gym.vector.protocols.TransitionModel`.
    """

    world: World
    goals: tuple[Cell, ...]
    next_state: NDArray[np.int64]  # (S * 8,)
    reward: NDArray[np.float64]  # (S * 8,)
    moved: NDArray[np.float64]  # (S * 8,): metres really travelled
    move_cost: NDArray[np.float64] | None  # (S * 8,), None where it is always 0
    is_terminated: NDArray[np.bool_]  # (S * 8,)
    is_at_goal: NDArray[np.bool_]  # (S * 8,)
    mask: NDArray[np.int8]  # (S, 8)
    to_go: NDArray[np.float64]  # (S,)
    gain: NDArray[np.float64]  # (S,)
    margin: NDArray[np.float64]  # (S,)
    observations: Parts | None  # parts of (S, D), where they are small enough to keep

    def __post_init__(self) -> None:
        arrays = (*vars(self).values(), *(self.observations or ()))
        freeze(*(each for each in arrays if isinstance(each, np.ndarray)))

    @cached_property
    def _goal(self) -> int:
        """Flat cell of the first goal, which is its state."""
        return self.world.radio_map.grid.flat(self.goals[0])

    @cached_property
    def _is_blank(self) -> tuple[bool, ...]:
        """Whether each part of the observations is 0 in all states, as what is left of budgets is
        until it is written.
        """
        return tuple(not table.any() for table in self.observations or ())

    def first_state(self, goal: Cell) -> int:
        """State of the cell (0, 0) for a goal."""
        return self.goals.index(goal) * self.world.feasible.size

    def move(self, states: States, actions: NDArray[np.int64]) -> Outcome:  # noqa: D102
        entry = states * ACTIONS
        entry += actions
        next_states = self.next_state.take(entry)

        # Nothing but the goal ends an episode, unless that a cell lies below the target does; to
        # compare with one goal is faster than to gather.
        is_at_goal = (
            next_states == self._goal if len(self.goals) == 1 else self.is_at_goal.take(entry)
        )
        ends_below = self.world.rules.constraint == "terminate"
        is_terminated = self.is_terminated.take(entry) if ends_below else is_at_goal
        cost = None
        if self.world.rules.constraint == "budget":  # by the cell: an eighth of `move_cost`
            cost = self.cost(next_states)
        elif self.move_cost is not None:
            cost = self.move_cost.take(entry)

        return Outcome(
            next_states,
            self.reward.take(entry),
            self.moved.take(entry),
            is_terminated,
            cost,
            is_at_goal,
        )

    def observe(self, states: States, out: Parts | None = None) -> Parts:  # noqa: D102
        if self.observations is not None and out is None:
            return tuple(
                [
                    np.zeros((len(states), table.shape[1]), table.dtype)
                    if is_blank
                    else table.take(states, axis=0)
                    for table, is_blank in zip(self.observations, self._is_blank, strict=True)
                ]
            )

        if self.observations is not None and out is not None:
            # "clip" is the fast mode of a gather into an array; states come from the tables and are
            # in range.
            for table, part in zip(self.observations, out, strict=True):
                table.take(states, axis=0, out=part, mode="clip")

            return out

        packing = build_observer(self.world, self.goals[0]).packing
        out = packing.empty(len(states)) if out is None else out
        self._observe_by_goal(states, packing, out)

        return out

    def _observe_by_goal(self, states: States, packing: Packing, out: Parts) -> None:
        """Write what is seen, without a table of all that there is to see: goal by goal."""
        numbers, cells = np.divmod(states, self.world.feasible.size)  # (n,) each

        for number, goal in enumerate(self.goals):
            here = numbers == number
            rows = np.empty((int(np.count_nonzero(here)), packing.width), dtype=np.float32)
            rows = build_observer(self.world, goal).rows(cells[here], rows)

            for part, its in zip(out, packing.split(rows), strict=True):
                part[here] = its

    def cells(self, states: States) -> States:  # noqa: D102
        return states % self.world.feasible.size if len(self.goals) > 1 else states

    def distance_to_go(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        if budget_left is None:
            return self.to_go.take(states)

        metres = np.empty(len(states))
        numbers, cells = np.divmod(states, self.world.feasible.size)  # (n,) each

        for number, goal in enumerate(self.goals):
            here = numbers == number
            metres[here] = metres_to_go(self.world, goal, cells[here], budget_left[here])

        return metres

    def oracle_distance(  # noqa: D102
        self, states: States, budgets: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        if budgets is None:
            return self.distance_to_go(states)
        if (budgets == self._usual_budget).all():
            return self._from_start.take(states)

        return self.distance_to_go(states, budgets - self.cost(states))

    @cached_property
    def _usual_budget(self) -> float:
        """The least budget: with most tasks the only one."""
        budget = self.world.rules.least_budget
        return np.nan if budget is None else budget

    @cached_property
    def _from_start(self) -> NDArray[np.float64]:
        """Metres to go for robots that begin in the states with the usual budget, ``(S,)``."""
        states = np.arange(len(self.to_go))
        return self.distance_to_go(states, self._usual_budget - self.cost(states))

    def cost(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        assert self.world.cost is not None
        return np.asarray(self.world.cost.take(self.cells(states)))

    def gain_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.gain.take(states)

    def margin_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.margin.take(states)

    def action_mask(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.int8]:
        mask = self.mask.take(states, axis=0)
        if budget_left is not None and self.world.rules.on_exhausted == "refuse":
            assert self.move_cost is not None
            cost = self.move_cost.reshape(-1, ACTIONS).take(states, axis=0)  # (n, 8)
            mask &= can_pay(budget_left[:, None], cost)

        return mask


def build_one_scene(world: World, goals: tuple[Cell, ...]) -> OneScene:
    """Tables of a world for the goals; a goal that was used before costs no run of Dijkstra."""
    tables = [tabulate(world, goal) for goal in goals]
    size = world.feasible.size
    next_states = [each.transition["next_cell"] + n * size for n, each in enumerate(tables)]

    packing = build_observer(world, goals[0]).packing
    observed = [build_observer(world, goal).table for goal in goals]
    is_tabulated = all(each is not None for each in observed)
    is_refusing = world.rules.constraint == "refuse"

    return OneScene(
        world=world,
        goals=goals,
        next_state=_join(next_states),
        reward=_join([each.transition["reward"] for each in tables]),
        moved=_join([each.transition["moved"] for each in tables]),
        move_cost=None if is_refusing else _join([each.transition["cost"] for each in tables]),
        is_terminated=_join([each.transition["is_terminated"] for each in tables]),
        is_at_goal=_join([each.transition["is_at_goal"] for each in tables]),
        mask=_join([each.action_mask for each in tables]),
        to_go=_join([each.cell["distance_to_go"] for each in tables]),
        gain=_join([each.cell["gain_db"] for each in tables]),
        margin=_join([each.cell["margin_db"] for each in tables]),
        observations=_parts(packing, _join(observed)) if is_tabulated else None,
    )


def _parts(packing: Packing, rows: Rows) -> Parts:
    """Rows taken apart, each part in memory of its own: gathers are faster."""
    return tuple(np.ascontiguousarray(each) for each in packing.split(rows))


def _join(parts: list[Any]) -> Any:
    """Tables of several goals one behind the other."""
    return np.ascontiguousarray(parts[0]) if len(parts) == 1 else np.concatenate(parts)
