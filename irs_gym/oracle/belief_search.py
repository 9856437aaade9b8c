"""`search_beliefs`: the best policy of a robot that does not know which of S scenes it is in, by
AO* search over what it still holds possible.

A state is the set of scenes that look as all that was seen so far (the belief), and the cell. A
move to a cell from which all of them look alike tells nothing: among such cells the robot walks the
shortest way, to the goal or to a cell that tells some of them apart, from which it goes on with a
smaller belief. Beliefs only shrink, so states form no circle.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from irs_gym.oracle.scene_family import SceneFamily, Scenes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Criterion = Literal["spl", "distance"]

_TIE = 1e-12  # values that differ by less count as equal: they are sums of floats


@dataclass(slots=True, eq=False)
class State:
    """A belief in a cell, what can be done there, and a bound on what comes of it.

    Attributes
    ----------
    scenes
        Shape ``(n,)``: those that are still possible.
    cell
        Flat.
    walked
        Whole length of the walk so far, and 0 where the criterion does not ask for it.
    value
        What no policy from here exceeds: the part of the expected score that these scenes make.
    is_solved
        Whether the best policy comes to `value`.
    is_sure
        Whether that is to walk a way that there is in all the scenes, whatever is seen.
    """

    scenes: Scenes
    cell: int
    walked: int
    value: float
    is_solved: bool
    is_sure: bool
    # of the walks that can be chosen; empty before the state is expanded
    ends: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # (A,), flat cells
    steps: Floats = field(default_factory=lambda: np.empty(0))  # (A,), whole lengths
    values: Floats = field(default_factory=lambda: np.empty(0))  # (A,), what none exceeds
    best: int = 0
    after: dict[int, list["State"]] = field(default_factory=dict)  # of the walks tried so far


@dataclass(frozen=True, eq=False)
class Search:
    """What a search came to.

    Attributes
    ----------
    roots
        The states after the first look, one for each thing that may be seen.
    bound
        What no policy's expected score exceeds.
    states
        How many were expanded.
    """

    roots: tuple[State, ...]
    bound: float
    states: int


def search_beliefs(family: SceneFamily, criterion: Criterion, max_states: int) -> Search:
    """Expand states until the best policy is found, or so many were.

    In the second case the policy that the bounds point at is completed, so that it can be played,
    and may not be the best. Scores are expected SPL, or minus the expected length in cells.
    """
    searcher = _Searcher(family, criterion)
    roots = searcher.first_states()
    total = sum(root.value for root in roots)

    for root in roots:
        while not root.is_solved and searcher.expanded < max_states:
            searcher.improve(root, max_states)

    bound = sum(root.value for root in roots)
    if not all(root.is_solved for root in roots):
        searcher.complete(roots)

    return Search(tuple(roots), min(bound, total), searcher.expanded)


class _Searcher:
    """States by their belief, cell and length, and how they are expanded."""

    def __init__(self, family: SceneFamily, criterion: Criterion) -> None:
        self.family = family
        self.by_length = criterion == "spl"
        self.expanded = 0
        self._states: dict[tuple[bytes, int, int], State] = {}
        self._oracle = family.oracle_length
        self._score: Callable[[Scenes, Floats], Floats] = (
            self._spl if criterion == "spl" else self._minus_length
        )

    def first_states(self) -> list[State]:
        """The states after the robot has seen its start, its goal and what is around it."""
        family = self.family
        ends = np.stack([family.start, family.goal], axis=1)
        number = np.min_scalar_type(len(family) - 1)
        roots = []

        for start, goal in np.unique(ends, axis=0).tolist():
            scenes = np.flatnonzero((ends == (start, goal)).all(axis=1)).astype(number)
            roots += [self._state(each, start, 0) for each in family.alike(scenes, start)]

        return roots

    def improve(self, root: State, max_states: int) -> None:
        """Expand the states at the ends of the policy that looks best, and hand back what that
        tells.
        """
        found: list[State] = []
        ahead = [root]
        met = {id(root)}

        while ahead:
            state = ahead.pop()
            found.append(state)
            if not len(state.ends):
                if self.expanded < max_states:
                    self._expand(state)
                continue
            for each in self._after(state, state.best):
                if not each.is_solved and id(each) not in met:
                    met.add(id(each))
                    ahead.append(each)

        # what comes after a state has a smaller belief
        for state in sorted(found, key=lambda each: len(each.scenes)):
            if len(state.ends):
                self._back_up(state)

    def complete(self, roots: list[State]) -> None:
        """Expand all states of the policy that looks best."""
        ahead = list(roots)
        while ahead:
            state = ahead.pop()
            if state.is_solved and state.is_sure:
                continue
            if not len(state.ends):
                self._expand(state)
            ahead += self._after(state, state.best)

    # --- a state ----------------------------------------------------------------------------------

    def _state(self, scenes: Scenes, cell: int, walked: int) -> State:
        """The state of a belief in a cell, the same whenever it is asked for."""
        key = (scenes.tobytes(), cell, walked)
        known = self._states.get(key)
        if known is not None:
            return known

        to_go = self.family.to_go[scenes, cell]  # (n,)
        is_sure = len(scenes) == 1 or self._is_sure(scenes, cell, to_go)
        value = float(self._score(scenes, self._length(walked) + to_go))
        state = State(scenes, cell, walked, value, is_solved=is_sure, is_sure=is_sure)
        self._states[key] = state

        return state

    def _is_sure(self, scenes: Scenes, cell: int, to_go: Floats) -> bool:
        """Whether one way is a shortest in all those scenes."""
        if to_go.max() - to_go.min() > _TIE:
            return False

        family = self.family
        goal = int(family.goal[scenes[0]])
        everywhere = np.ones(family.to_go.shape[1], dtype=bool)
        whole = family.lengths_from(cell, family.moves_out_of(scenes, everywhere))[goal]

        return bool(whole < inf and self._length(int(whole)) <= to_go[0] + _TIE)

    def _expand(self, state: State) -> None:
        """Find the walks to the goal and to cells that tell scenes apart."""
        family = self.family
        scenes = state.scenes
        tells = family.telling_cells(scenes)  # (N,)

        # all scenes agree on the moves out of cells from which they look alike
        moves = family.moves_out_of(scenes[:1], ~tells)
        steps = family.lengths_from(state.cell, moves)
        state.ends = np.flatnonzero(tells & (steps < inf))
        state.steps = steps[state.ends]

        # with full knowledge from there on
        lengths = self._length(state.walked) + family.true_lengths(state.steps)  # (A,)
        to_go = family.to_go[scenes][:, state.ends]  # (n, A)
        state.values = self._score(scenes, lengths + to_go)
        state.best = int(np.argmax(state.values))
        self.expanded += 1

    def _after(self, state: State, walk: int) -> list[State]:
        """The states that a walk of a state may end in; none at the goal."""
        if walk not in state.after:
            family = self.family
            end = int(state.ends[walk])
            walked = state.walked + int(state.steps[walk]) if self.by_length else 0
            is_goal = end == family.goal[state.scenes[0]]
            parts = [] if is_goal else family.alike(state.scenes, end)
            state.after[walk] = [self._state(each, end, walked) for each in parts]

        return state.after[walk]

    def _back_up(self, state: State) -> None:
        """The best walk, as far as it is known now."""
        while True:
            walk = state.best
            if state.ends[walk] == self.family.goal[state.scenes[0]]:
                state.is_solved = True
                break

            if walk in state.after:
                after = state.after[walk]
                spent = 0.0
                if not self.by_length:
                    length = float(self.family.true_lengths(state.steps[walk]))
                    spent = length * float(self.family.weights[state.scenes].sum())
                state.values[walk] = sum(each.value for each in after) - spent
                state.is_solved = all(each.is_solved for each in after)

            highest = int(np.argmax(state.values))
            if state.values[highest] <= state.values[walk] + _TIE:
                break

            state.best = highest
            state.is_solved = False

        state.value = float(state.values[state.best])

    # --- scores -----------------------------------------------------------------------------------

    def _length(self, whole: int) -> float:
        return float(self.family.true_lengths(whole)) if whole else 0.0

    def _spl(self, scenes: Scenes, lengths: Floats) -> Floats:
        shortest = self._oracle[scenes]
        # lengths are (n,), or (n, A) for A walks
        ratio = shortest / np.maximum(lengths.T, shortest)
        return np.asarray(ratio @ self.family.weights[scenes])

    def _minus_length(self, scenes: Scenes, lengths: Floats) -> Floats:
        return np.asarray(-(lengths.T @ self.family.weights[scenes]))
