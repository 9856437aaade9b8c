"""`CodebookModel`: the rules of robots that switch the panel's configuration, as tables for gathers
over many robots where they are small enough to keep.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.codebook_rules import CodebookRules
from irs_gym.mdp.packing import Parts
from irs_gym.memory import freeze, frozen
from irs_gym.vector.protocols import Outcome, States

LARGEST_TABLES = 2**29  # bytes: what would not fit is computed as it is asked for
_BLOCK = 2**20  # entries of tables that are worked out at a time: bounds memory
_ENTRY_BYTES = 15  # of a state and an action, with what they are made of


@dataclass(frozen=True, eq=False)
class Tables:
    """What each action does in each state: one of O outcomes, and what these are."""

    # A few hundred outcomes are all that there are, and stay in the processor's nearest cache: only
    # one small number is gathered from far away.
    outcome: NDArray[np.integer]  # (S * A,), entry A x state + action
    offset: NDArray[np.int64]  # (O,), from a state to the next
    reward: NDArray[np.float64]  # (O,)
    moved: NDArray[np.float64]  # (O,), metres that count
    first_end: NDArray[np.integer]  # (), the number of the first of those that end an episode
    cost: NDArray[np.float64] | None  # (O,), None where it is always 0
    is_at_goal: NDArray[np.bool_]  # (O,)
    mask: NDArray[np.void]  # (S,), each the int8 (A,) of a state: gathers of records are faster
    to_go: NDArray[np.float64]  # (S,)

    def __post_init__(self) -> None:
        freeze(*(each for each in vars(self).values() if isinstance(each, np.ndarray)))


@dataclass(frozen=True, eq=False)
class CodebookModel:
    """The rules and the maps for the scenes and goals in use.

    What each method gives for states is described in `irs_gym.vector.protocols.TransitionModel`;
    what a state says, in `irs_gym.mdp.codebook_rules.CodebookRules`.
    """

    rules: CodebookRules
    tables: Tables | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tables", _tabulated(self.rules))

    def __reduce__(self) -> Any:
        return model_of, (self.rules,)

    @cached_property
    def _stride(self) -> NDArray[np.int64]:
        """Actions of a state, as an array ``()``: a step multiplies by it faster than by an int."""
        return frozen(np.array(self.rules.actions))

    @property
    def packing(self) -> CodebookPacking:
        """Layout of observations."""
        return self.rules.packing

    def move(self, states: States, actions: NDArray[np.int64]) -> Outcome:  # noqa: D102
        tables = self.tables
        if tables is None:
            step = self.rules.transition(states, actions)
            is_refusing = self.rules.maps.rules.constraint == "refuse"
            return Outcome(
                step.next_cell,
                step.reward,
                step.moved,
                step.is_terminated,
                None if is_refusing else step.cost,
                step.is_at_goal,
            )

        entry = np.multiply(states, self._stride)
        entry += actions
        found = tables.outcome.take(entry)
        is_terminated = found >= tables.first_end
        outcome = found.astype(np.intp)
        next_states = tables.offset.take(outcome)
        next_states += states

        # where moves are refused, only the goal ends an episode
        is_at_goal = is_terminated if tables.cost is None else tables.is_at_goal.take(outcome)

        return Outcome(
            next_states,
            tables.reward.take(outcome),
            tables.moved.take(outcome),
            is_terminated,
            None if tables.cost is None else tables.cost.take(outcome),
            is_at_goal,
        )

    def observe(self, states: States, out: Parts | None = None) -> Parts:  # noqa: D102
        return self.rules.observe(states, out)

    def cells(self, states: States) -> States:  # noqa: D102
        return states

    def distance_to_go(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        if self.tables is None:
            return self.rules.distance_to_go(states)
        return self.tables.to_go.take(states)

    def oracle_distance(  # noqa: D102
        self, states: States, budgets: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        return self.distance_to_go(states)

    def cost(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return np.zeros(len(states))  # there are no budgets

    def gain_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.rules.gain_db(states)

    def margin_db(self, states: States) -> NDArray[np.float64]:  # noqa: D102
        return self.rules.margin_db(states)

    def action_mask(  # noqa: D102
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.int8]:
        if self.tables is None:
            return self.rules.action_mask(states)
        return self.tables.mask.take(states).view(np.int8).reshape(len(states), -1)

    def configuration(self, states: States) -> NDArray[np.int64]:
        """Numbers of the present configurations."""
        return self.rules.configuration(states)


@lru_cache(maxsize=4)
def model_of(rules: CodebookRules) -> CodebookModel:
    """Model of rules; kept, so that vector environments of the same task share one."""
    return CodebookModel(rules)


def _tabulated(rules: CodebookRules) -> Tables | None:
    """Tables of all states and actions; None where they would be too large to keep."""
    shape = (rules.states, rules.actions)
    if prod(shape) * _ENTRY_BYTES > LARGEST_TABLES:
        return None

    outcome = np.empty(shape, dtype=np.int32)
    is_legal = np.empty(shape, dtype=bool)
    found: list[list[NDArray[Any]]] = []  # columns of the outcomes, block by block
    count = 0
    block = max(1, _BLOCK // rules.actions)

    for first in range(0, rules.states, block):
        states = np.arange(first, min(first + block, rules.states))[:, None]
        step = rules.transition(states, np.arange(rules.actions))
        offset = step.next_cell - states
        # those that end an episode come last
        kinds = (step.is_terminated, offset, step.reward, step.moved, step.cost, step.is_at_goal)
        numbers, columns = _numbered([each.ravel() for each in kinds])

        outcome[states[:, 0]] = (numbers + count).reshape(offset.shape)
        is_legal[states[:, 0]] = ~step.is_refused
        found.append(columns)
        count += len(columns[0])

    # blocks have outcomes in common
    joined = [np.concatenate(each) for each in zip(*found, strict=True)]
    numbers, (is_terminated, offset, reward, moved, cost, is_at_goal) = _numbered(joined)
    smallest = np.min_scalar_type(len(offset))

    return Tables(
        outcome=numbers.astype(smallest).take(outcome.ravel()),
        offset=offset,
        reward=reward,
        moved=moved,
        first_end=np.array(np.count_nonzero(~is_terminated), dtype=smallest),
        cost=None if rules.maps.rules.constraint == "refuse" else cost,
        is_at_goal=is_at_goal,
        mask=is_legal.view(np.dtype((np.void, rules.actions))).ravel(),
        to_go=rules.distance_to_go(np.arange(rules.states)),
    )


def _numbered(columns: list[NDArray[Any]]) -> tuple[NDArray[np.int64], list[NDArray[Any]]]:
    """The number of each row of columns ``(n,)`` among those that differ, and the columns of these,
    in the order of the first column, then of the second ...

    Numbers differ where a bit does.

    >>> numbers, columns = _numbered([np.array([5, 5, 7, 5]), np.array([0.5, 0.0, 0.0, 0.5])])
    >>> numbers.tolist(), columns[0].tolist(), columns[1].tolist()
    ([1, 0, 2, 1], [5, 5, 7], [0.0, 0.5, 0.0])
    """
    numbers = np.zeros(len(columns[0]), dtype=np.int64)

    for column in columns:
        bits = column.view(np.int64) if column.dtype.kind == "f" else column
        values = np.unique(bits)
        numbers = numbers * len(values) + np.searchsorted(values, bits)

        # of all pairs of a number so far and a value, those that there are
        is_used = np.zeros(int(numbers.max()) + 1, dtype=bool)
        is_used[numbers] = True
        numbers = (np.cumsum(is_used) - 1).take(numbers)

    row = np.empty(int(numbers.max()) + 1, dtype=np.int64)  # one of each
    row[numbers] = np.arange(len(numbers))

    return numbers, [each[row] for each in columns]
