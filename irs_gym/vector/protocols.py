"""`TransitionModel` and `EpisodeSampler`: what moves do, and how episodes begin."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.mdp.packing import Parts
from irs_gym.mdp.task import Rules, World

# (n,): where robots are and where they want to go, each as one number. What the number means is the
# transition model's own affair.
States = NDArray[np.int64]
RngOf = Callable[[int], np.random.Generator]  # the randomness of environment i


class Outcome(NamedTuple):
    """What a move of n robots does, arrays ``(n,)`` that nothing else holds on to."""

    states: States
    reward: NDArray[np.float64]  # metres
    moved: NDArray[np.float64]  # metres really travelled
    is_terminated: NDArray[np.bool_]
    cost: NDArray[np.float64] | None  # None where it is always 0
    is_at_goal: NDArray[np.bool_]
    # where moves take time, and may be cut short
    is_refused: NDArray[np.bool_] | None = None
    seconds: NDArray[np.float64] | None = None

    def clear(self, chosen: NDArray[np.int64], states: States) -> None:
        """Undo the move of the chosen robots, which have just begun in the given states."""
        self.states[chosen] = states

        for array in self[1:]:
            if array is not None:
                array[chosen] = 0


class TransitionModel(Protocol):
    """The rules and the maps for states; frozen. What a method returns is the caller's own."""

    def move(self, states: States, actions: NDArray[np.int64]) -> Outcome:
        """What actions do in states."""

    def observe(self, states: States, out: Parts | None = None) -> Parts:
        """Parts of observations in new memory, or written to ``out``; see `Packing.empty`."""

    def cells(self, states: States) -> NDArray[np.int64]:
        """Flat cells; where there are several maps, they lie one above the other."""

    def distance_to_go(
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Metres to the goal, with what is left of budgets ``(n,)`` where there are any."""

    def oracle_distance(
        self, states: States, budgets: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Metres to the goal for robots that begin in the states, and pay for these out of budgets
        ``(n,)`` where there are any.
        """

    def cost(self, states: States) -> NDArray[np.float64]:
        """What the cells of the states cost, where there are budgets."""

    def gain_db(self, states: States) -> NDArray[np.float64]:
        """Expected channel gains in dB."""

    def margin_db(self, states: States) -> NDArray[np.float64]:
        """Gains over the target in dB."""

    def action_mask(
        self, states: States, budget_left: NDArray[np.float64] | None = None
    ) -> NDArray[np.int8]:
        """1 where an action is not refused, ``(n, 8)`` or ``(n, 8 + K)``; where steps that a budget
        cannot pay are refused, with what is left of it ``(n,)``.
        """


class Layout(Protocol):
    """How observations lie in rows; see `irs_gym.mdp.packing.Packing`."""

    @property
    def observation(self) -> str:
        """Their kind."""

    def empty(self, count: int) -> Parts:
        """Memory for the parts of that many rows."""

    def unpack(self, parts: Parts) -> Any:
        """Observations of the parts of rows."""

    def set_budget(self, observation: Any, share: Any) -> None:
        """Write what is left of budgets into observations, where there are any."""


class EpisodeSampler(Protocol):
    """Who starts episodes, and what all of them share."""

    is_random: bool  # whether it draws
    is_violable: bool  # whether an episode that enters a cell below the target is lost
    rules: Rules
    cell_size: float  # metres
    map_shape: tuple[int, int]  # of the maps that `TransitionModel.cells` counts through

    @property
    def packing(self) -> Layout:
        """Layout of the observations."""

    @property
    def transition_model(self) -> TransitionModel:
        """The rules and the maps for the states in use; `begin` may take another one."""

    @property
    def info_values(self) -> Mapping[str, Callable[[Any], NDArray[Any]]]:
        """How each key of the infos is computed from an `irs_gym.vector.infos.Step`."""

    def begin(
        self,
        states: States,
        chosen: NDArray[np.int64],
        options: dict[str, Any] | None,
        rng: RngOf,
        budgets: NDArray[np.float64] | None = None,
    ) -> States:
        """States in which the chosen robots begin anew, with their budgets ``(len(chosen),)`` where
        there are any, and the others stay where they are; in memory of their own.
        """

    def scene_number(self, states: States, i: int) -> int:
        """Number of the scene that robot i is in; 0 where there is one."""

    def scene_and_goal(self, states: States, i: int) -> tuple[World, Cell]:
        """World and goal of robot i."""
