"""`CodebookModel`: the rules of robots that switch the panel's configuration, as tables for gathers
over many robots where they are small enough to keep.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.codebook_rules import CodebookRules
from irs_gym.mdp.packing import Parts
from irs_gym.memory import freeze
from irs_gym.vector.protocols import Outcome, States

LARGEST_TABLES = 2**29  # bytes: what would not fit is computed as it is asked for
_BLOCK = 2**20  # entries of tables that are worked out at a time: bounds memory


@dataclass(frozen=True, eq=False)
class Tables:
    """What each action does in each state: arrays ``(S * A,)``, entry A x state + action."""

    # In one record, as a gather from a large table takes as long however wide its entries are: the
    # next state, or ~ of it where the episode ends, and the reward.
    next_state_and_reward: NDArray[np.complex128]
    cost: NDArray[np.float64] | None  # None where it is always 0
    is_at_goal: NDArray[np.bool_]
    mask: NDArray[np.void]  # (S,), each the int8 (A,) of a state: gathers of records are faster
    to_go: NDArray[np.float64]  # (S,)
    length: NDArray[np.float64]  # (A,): metres that an action counts, if it is not refused

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

        entry = states * self.rules.actions
        entry += actions
        found = tables.next_state_and_reward.take(entry)
        next_states = found.real.astype(np.int64)

        # what ends an episode is told by the sign
        is_terminated = next_states < 0
        if np.count_nonzero(is_terminated):
            next_states = np.where(is_terminated, ~next_states, next_states)

        # what is refused leads nowhere
        moved = tables.length.take(actions)
        moved *= next_states != states

        # where moves are refused, only the goal ends an episode
        is_at_goal = is_terminated if tables.cost is None else tables.is_at_goal.take(entry)

        return Outcome(
            next_states,
            found.imag.copy(),
            moved,
            is_terminated,
            None if tables.cost is None else tables.cost.take(entry),
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
    is_refusing = rules.maps.rules.constraint == "refuse"
    kinds: dict[str, Any] = {
        "next_cell": np.int32,
        "reward": np.float64,
        "is_terminated": np.bool_,
        "is_at_goal": np.bool_,
        "is_refused": np.bool_,
    } | ({} if is_refusing else {"cost": np.float64})
    entries = rules.states * rules.actions
    if entries * sum(np.dtype(kind).itemsize for kind in kinds.values()) > LARGEST_TABLES:
        return None

    columns = {
        name: np.empty((rules.states, rules.actions), dtype=kind) for name, kind in kinds.items()
    }
    block = max(1, _BLOCK // rules.actions)

    for first in range(0, rules.states, block):
        states = np.arange(first, min(first + block, rules.states))
        step = rules.transition(states[:, None], np.arange(rules.actions))
        for name, column in columns.items():
            column[states] = getattr(step, name)

    return Tables(
        next_state_and_reward=_paired(columns),
        cost=None if is_refusing else columns["cost"].ravel(),
        is_at_goal=columns["is_at_goal"].ravel(),
        mask=(~columns["is_refused"]).view(np.dtype((np.void, rules.actions))).ravel(),
        to_go=rules.distance_to_go(np.arange(rules.states)),
        length=rules.lengths,
    )


def _paired(columns: dict[str, NDArray[Any]]) -> NDArray[np.complex128]:
    """Next states and rewards as one table of records; states are whole numbers, and so exact."""
    paired = np.empty(columns["reward"].size, dtype=np.complex128)
    next_state = columns["next_cell"]
    paired.real = np.where(columns["is_terminated"], ~next_state, next_state).ravel()
    paired.imag = columns["reward"].ravel()

    return paired
