"""`VectorEpisodes`: the episodes of n robots with autoreset, for all vector environments."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from irs_gym.grid import Cell
from irs_gym.mdp.autoreset import AutoresetMode
from irs_gym.mdp.budget import can_pay, choose_budget, cleared, scaled_amount
from irs_gym.mdp.checks import checked_actions
from irs_gym.mdp.dynamics import ACTIONS, refused_reward
from irs_gym.mdp.path_history import PathHistory
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World
from irs_gym.memory import frozen
from irs_gym.rendering.episode_view import RENDERERS, view_of
from irs_gym.vector.infos import BUDGET_VALUES, KEYS, InfoBuilder, Infos, Step, checked_keys
from irs_gym.vector.protocols import EpisodeSampler, Outcome


@dataclass(frozen=True)
class EpisodeKind:
    """What states and actions are: by default, numbers of cells and of moves."""

    states: Any = np.int64  # type of a state
    places: Any = np.int64  # type of what `TransitionModel.cells` gives
    checked: Callable[[Any, int], NDArray[Any]] | None = None  # actions of so many robots
    refuse: Callable[[Outcome, NDArray[np.int64]], None] | None = None
    """Writes the outcome of steps that a budget refuses, of the robots of those numbers."""
    keys: tuple[str, ...] = KEYS  # of the infos
    is_timed: bool = False  # whether seconds and steps are told


class VectorEpisodes:
    """What the methods of a vector environment do; see `IrsNavVectorEnv`."""

    def __init__(
        self,
        sampler: EpisodeSampler,
        num_envs: int,
        max_episode_steps: int,
        mode: AutoresetMode,
        copy: bool,
        infos: Infos,
        actions: int = ACTIONS,
        kind: EpisodeKind = EpisodeKind(),
    ) -> None:
        """Episodes that a sampler begins; see `IrsNavVectorEnv` for the other arguments.

        Actions beyond the eight moves are switches of the panel. ``kind``: what states and actions
        are, where they are no numbers of cells and moves.
        """
        n = num_envs
        self.num_envs = n
        self.max_episode_steps = max_episode_steps
        self.mode = mode
        self._sampler = sampler
        self._rules = sampler.rules
        values = sampler.info_values
        if self._rules.budget is not None:
            values = {**values, **BUDGET_VALUES}

        keys = checked_keys(infos, [key for key in values if key not in kind.keys], kind.keys)
        self._infos = InfoBuilder(values, keys)
        # Whether a move was refused costs a comparison of all states: only where somebody asks.
        self._counts_refusals = not {"refused", "is_refused"}.isdisjoint(keys)
        self._counts_switches = not {"switches", "metres"}.isdisjoint(keys)
        self._kind = kind
        self._checked = kind.checked or partial(checked_actions, of=actions)

        # the episode of each robot
        self._states = np.zeros(n, dtype=kind.states)
        self._distance = np.zeros(n)  # metres
        self._refused = np.zeros(n, dtype=np.int64)
        self._oracle_distance = np.zeros(n)  # metres
        self._has_violated = np.zeros(n, dtype=bool)
        self._switches = np.zeros(n, dtype=np.int64)
        self._metres = np.zeros(n)  # of the distance, the part that is no switch's
        self._seconds = np.zeros(n)  # where moves take time
        # Where there are budgets: the total cost that it may come to, that of its start, and what
        # is left. The last is another array after every step.
        has_budget = self._rules.budget is not None
        self._budget = np.zeros(n)
        self._start_cost = np.zeros(n)
        self._left = np.zeros(n) if has_budget else None
        self._nobody = frozen(np.zeros(n, dtype=bool))
        self._has_ended = self._nobody  # and has not begun anew
        self._num_ended = 0
        self._just_ended = self._nobody  # at the latest step
        self._history = PathHistory(n, max_episode_steps, sampler.map_shape, kind.places)

        # Time, in steps of all robots. An episode's limit is kept as the time at which it ends, so
        # that no counter of each robot has to be raised at every step.
        self._clock = 0
        self._deadline = np.zeros(n, dtype=np.int64)  # at which each is truncated
        self._first_deadline = 0

        # made on first use: most environments draw nothing
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._is_reset = False
        # of observations, where they need no memory of their own
        self._buffer = None if copy else sampler.packing.empty(n)

    def reset(
        self, seeds: Sequence[int | None] | None, options: dict[str, Any] | None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode everywhere, or in the environments of ``options["reset_mask"]``."""
        options = dict(options or {})
        mask = self._checked_mask(options.pop("reset_mask", None))
        chosen = np.flatnonzero(mask)
        if seeds is not None:
            self._seed(seeds, chosen)

        self._begin(chosen, options)
        self._is_reset = True
        self._just_ended = self._nobody

        # infos of the environments that were reset, and of no others
        step = self._opening()
        infos = self._infos.everywhere(step) if mask.all() else self._infos.of(step, chosen)

        return self._observe(), infos

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once."""
        self._check_running()
        checked = self._checked(actions, self.num_envs)
        self._clock += 1

        # Next-step autoreset: robots whose episodes have ended begin anew in place of a move. (With
        # the other modes none is left that has ended.) All others move.
        resumed = np.flatnonzero(self._has_ended) if self._num_ended else None
        if resumed is not None:
            self._begin(resumed, {})

        before = self._states  # (n,)
        outcome = self._sampler.transition_model.move(before, checked)
        if self._rules.on_exhausted == "refuse":
            self._refuse_unpaid(before, checked, outcome)
        if resumed is not None:
            outcome.clear(resumed, before[resumed])
        if self._rules.budget is not None:
            outcome = self._pay(outcome, resumed)

        is_refused = self._add_up(before, checked, outcome, resumed)

        # An episode that has ever gone below the target is none that succeeds.
        if self._sampler.is_violable and outcome.cost is not None:
            self._has_violated |= outcome.cost > 0

        cells = self._sampler.transition_model.cells(outcome.states)
        self._history.advance(cells, self._clock)

        # Episodes end at the goal, at a violation where it is terminal, or at the step limit.
        # Most steps end none, and then no flags are computed.
        truncated = self._truncated()
        self._num_ended = int(np.count_nonzero(outcome.is_terminated))
        if self._num_ended or self._clock >= self._first_deadline:
            self._has_ended = outcome.is_terminated | truncated
            self._num_ended = int(np.count_nonzero(self._has_ended))
        else:
            self._has_ended = self._nobody

        self._just_ended = self._has_ended

        # The goal ends an episode: where none ends, nobody has reached it.
        is_success = outcome.is_at_goal & ~self._has_failed() if self._num_ended else None

        # Same-step autoreset begins new episodes before the observation is taken; the infos then
        # tell of the new ones, and carry the last ones of the old.
        step = self._step(is_refused, outcome.cost, is_success)
        if self._num_ended and self.mode is AutoresetMode.SAME_STEP:
            infos = self._end(step, np.flatnonzero(self._has_ended))
        else:
            infos = self._infos.everywhere(step)

        return self._observe(), outcome.reward, outcome.is_terminated, truncated, infos

    def paths(self) -> list[list[Cell]]:
        """Cells (i, j) of each robot's episode, refused moves left out.

        Where an episode ended at the latest step, they are its cells, whether or not the robot has
        begun anew.
        """
        has_begun_anew = self.has_begun_anew()
        return [
            self._history.path(i, of_last_episode=has_begun_anew[i]) for i in range(self.num_envs)
        ]

    def has_begun_anew(self) -> NDArray[np.bool_]:
        """Which robots have begun another episode at the step that ended one, ``(n,)``."""
        return self._just_ended & ~self._has_ended

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused, bool ``(n, 8)``, or ``(n, 8 + K)``."""
        model = self._sampler.transition_model
        return model.action_mask(self._states, self._left).astype(bool)

    def history(self, i: int, *, of_last_episode: bool = False) -> NDArray[Any]:
        """What `TransitionModel.cells` gave for robot i since its episode began, ``(T,)``, or in
        the one before, if that ended at the latest step; nothing before the first reset.
        """
        if not self._is_reset:
            return np.zeros(0, dtype=self._kind.places)
        return self._history.flat(i, of_last_episode=of_last_episode)

    def render(self, mode: str | None) -> tuple[Any, ...] | None:
        """A picture or text for each robot; None without a mode."""
        return None if mode is None else tuple(self._picture(i, mode) for i in range(self.num_envs))

    def scene_and_goal(self, i: int) -> tuple[World, Cell]:
        """World and goal of robot i."""
        return self._sampler.scene_and_goal(self._states, i)

    def snapshot(self, i: int) -> tuple[Snapshot, list[Cell]]:
        """Where the episode of robot i stands, and its path so far."""
        world, goal = self.scene_and_goal(i)
        path = self._history.path(i)
        # before the first reset: where the world's own episode would begin, as single environments
        if not self._is_reset:
            goal = world.goal
            path = [world.start]

        start, cell, end = map(world.radio_map.grid.flat, (path[0], path[-1], goal))
        snapshot = Snapshot(
            rules=world.fingerprint,
            scene=self._sampler.scene_number(self._states, i),
            start=start,
            goal=end,
            cell=cell,
            # steps that led nowhere, whether or not refusals are counted as they happen
            refused=self._history.steps(i) - (len(path) - 1),
            **self.totals(i),
        )

        return snapshot, path

    def totals(self, i: int) -> dict[str, Any]:
        """What the episode of robot i has come to, by fields of a `Snapshot`."""
        return {
            "distance": float(self._distance[i]),
            "budget": float(self._budget[i]),
            "budget_left": 0.0 if self._left is None else float(self._left[i]),
            "has_violated": bool(self._has_violated[i]),
            "is_running": self._is_reset and not self._has_ended[i],
        }

    def counts(self, i: int) -> dict[str, Any]:
        """What the episode of robot i has taken, where moves take time."""
        return {
            "seconds": float(self._seconds[i]),
            "steps": self._history.steps(i) if self._is_reset else 0,
            "refused": int(self._refused[i]),
        }

    # --- episodes ---------------------------------------------------------------------------------

    def _begin(self, chosen: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Start an episode for the chosen robots."""
        budgets = self._budgets(chosen, options)

        # The sampler may take another transition model for this, so it is asked for afterwards.
        self._states = self._sampler.begin(self._states, chosen, options, self._rng, budgets)
        transition_model = self._sampler.transition_model
        begun = self._states[chosen]
        if budgets is not None and self._left is not None:
            self._budget[chosen] = budgets
            self._start_cost[chosen] = transition_model.cost(begun)
            self._left = self._left.copy()
            self._left[chosen] = cleared(budgets - self._start_cost[chosen])

        # what an episode adds up, from nothing
        self._distance[chosen] = 0.0
        self._refused[chosen] = 0
        self._oracle_distance[chosen] = transition_model.oracle_distance(begun, budgets)
        self._has_violated[chosen] = False
        self._switches[chosen] = 0
        self._metres[chosen] = 0.0
        self._seconds[chosen] = 0.0
        self._history.begin(chosen, transition_model.cells(begun), self._clock)

        # Not in place: `_just_ended`, which is of the step before, may be the same array.
        has_ended = self._has_ended.copy()
        has_ended[chosen] = False
        self._has_ended = has_ended
        self._num_ended = int(np.count_nonzero(has_ended))
        self._deadline[chosen] = self._clock + self.max_episode_steps
        self._first_deadline = int(self._deadline.min())

    def _refuse_unpaid(
        self, before: NDArray[np.int64], actions: NDArray[np.int64], outcome: Outcome
    ) -> None:
        """Take back the steps that the budgets cannot pay; nothing is paid for them."""
        assert outcome.cost is not None
        assert self._left is not None
        unpaid = np.flatnonzero(~can_pay(self._left, outcome.cost))
        outcome.clear(unpaid, before[unpaid])
        if self._kind.refuse is not None:
            self._kind.refuse(outcome, unpaid)
            return

        lost = refused_reward(self._rules, actions[unpaid], self._sampler.cell_size)
        outcome.reward[unpaid] = lost

    def _pay(self, outcome: Outcome, resumed: NDArray[np.int64] | None) -> Outcome:
        """Take the costs of a move out of the budgets. Where one is exhausted, the episode may end,
        and then it is a failure, at the goal as well.
        """
        assert outcome.cost is not None
        assert self._left is not None
        self._left = cleared(self._left - outcome.cost)
        if resumed is not None:  # they have begun, and paid for their start
            outcome.cost[resumed] = self._start_cost[resumed]

        if self._rules.on_exhausted != "terminate":
            return outcome

        is_exhausted = self._left < 0
        if not np.count_nonzero(is_exhausted):
            return outcome

        outcome.reward[outcome.is_at_goal & is_exhausted] -= self._rules.goal_bonus

        return outcome._replace(is_terminated=outcome.is_terminated | is_exhausted)

    def _has_failed(self) -> NDArray[np.bool_]:
        """Which episodes can be no success any more, ``(n,)``."""
        return self._has_violated if self._left is None else self._left < 0

    def _add_up(
        self,
        before: NDArray[Any],
        actions: NDArray[Any],
        outcome: Outcome,
        resumed: NDArray[np.int64] | None,
    ) -> NDArray[np.bool_] | None:
        """Add to the episodes where the robots are, what they travelled, what was refused; which
        moves were, ``(n,)``, None where nobody asks.
        """
        self._states = outcome.states
        self._distance += outcome.moved
        is_refused = outcome.is_refused
        if is_refused is None and self._counts_refusals:
            is_refused = self._refusals(before, outcome, resumed)
        if is_refused is not None:
            self._refused += is_refused
        if outcome.seconds is not None:
            self._seconds += outcome.seconds

        if self._counts_switches:
            is_switch = (actions >= ACTIONS) & (outcome.states != before)
            if resumed is not None:
                is_switch[resumed] = False
            self._switches += is_switch
            self._metres += np.where(is_switch, 0.0, outcome.moved)

        return is_refused

    def _refusals(
        self,
        before: NDArray[np.int64],
        outcome: Outcome,
        resumed: NDArray[np.int64] | None,
    ) -> NDArray[np.bool_]:
        """Which robots made a move that was refused, ``(n,)``: one that is not leads elsewhere."""
        is_refused: NDArray[np.bool_] = outcome.states == before
        if resumed is not None:  # they have begun, and not moved
            is_refused[resumed] = False

        return is_refused

    def _truncated(self) -> NDArray[np.bool_]:
        """Which episodes are at their step limit, ``(n,)``."""
        if self._clock < self._first_deadline:
            return np.zeros(self.num_envs, dtype=bool)
        return self._deadline <= self._clock

    def _end(self, step: Step, ended: NDArray[np.int64]) -> dict[str, Any]:
        """Begin anew where episodes ended; infos of the new ones, and of the last step of the old
        ones.
        """
        # the last of the old episodes, before their states are lost
        packing = self._sampler.packing
        final_parts = self._sampler.transition_model.observe(self._states[ended])
        final_obs: Iterable[Any] = map(packing.unpack, zip(*final_parts, strict=True))
        if step.budget_left is not None:
            last = packing.unpack(final_parts)
            self._show_budget(last, self._states[ended], step.budget_left[ended])
            final_obs = _each(last, len(ended))

        final = {
            "final_obs": _objects(self.num_envs, ended, final_obs),
            "_final_obs": self._just_ended.copy(),
            "final_info": self._infos.of(step, ended),
            "_final_info": self._just_ended.copy(),
        }

        self._begin(ended, {})

        # In the new episodes nothing has happened yet, but that they have paid for their start.
        if step.is_refused is not None:
            step.is_refused[ended] = False
        if step.cost is not None:
            step.cost[ended] = self._start_cost[ended]

        return {
            **self._infos.everywhere(self._step(step.is_refused, step.cost, None)),
            **final,
        }

    def _rng(self, i: int) -> np.random.Generator:
        """The randomness of environment i; from the system where no seed was given."""
        rng = self._rngs[i]
        if rng is None:
            rng = self._rngs[i] = seeding.np_random()[0]

        return rng

    def _budgets(
        self, chosen: NDArray[np.int64], options: dict[str, Any]
    ) -> NDArray[np.float64] | None:
        """Budgets of the chosen robots' new episodes, ``(len(chosen),)``; None without any."""
        budget = self._rules.budget
        if budget is None:
            return None

        asked = options.pop("budget", None)
        if isinstance(budget, tuple) and asked is None:
            return np.array([choose_budget(budget, None, self._rng(i)) for i in chosen.tolist()])

        return np.full(len(chosen), choose_budget(budget, asked, None))

    def _seed(self, seeds: Sequence[int | None], chosen: NDArray[np.int64]) -> None:
        """Take the seeds that are not None for the chosen environments."""
        # the only uses of randomness
        if self._sampler.is_random or isinstance(self._rules.budget, tuple):
            for i in chosen:
                if seeds[i] is not None:
                    self._rngs[i] = seeding.np_random(seeds[i])[0]

    # --- what is returned -------------------------------------------------------------------------

    def _observe(self) -> Any:
        """The observations of all robots, in memory of their own or in one buffer for all steps."""
        parts = self._sampler.transition_model.observe(self._states, self._buffer)
        observation = self._sampler.packing.unpack(parts)
        if self._left is not None:
            self._show_budget(observation, self._states, self._left)

        return observation

    def _show_budget(
        self, observation: Any, states: NDArray[np.int64], left: NDArray[np.float64]
    ) -> None:
        """Write what is left of budgets ``(n,)`` into observations of states ``(n,)``."""
        packing = self._sampler.packing
        packing.set_budget(observation, scaled_amount(left))
        if packing.observation == "masked":
            mask = self._sampler.transition_model.action_mask(states, left)
            observation["action_mask"][:] = mask

    def _opening(self) -> Step:
        """As after a step in which nothing happened, but that robots pay for their start."""
        return self._step(None, None if self._left is None else self._start_cost.copy(), None)

    def _step(
        self,
        is_refused: NDArray[np.bool_] | None,
        cost: NDArray[np.float64] | None,
        is_success: NDArray[np.bool_] | None,
    ) -> Step:
        """What the infos are made of."""
        return Step(
            self._sampler.transition_model,
            self._states,
            self._distance,
            self._refused,
            self._oracle_distance,
            is_refused,
            cost,
            is_success,
            self._left,
            self._switches,
            self._metres,
            self._seconds,
            self.max_episode_steps - (self._deadline - self._clock)
            if self._kind.is_timed
            else None,
        )

    def _picture(self, i: int, mode: str) -> Any:
        """A picture or text of robot i."""
        world, goal = self.scene_and_goal(i)
        # before the first reset: where the world's own episode would begin, as single environments
        if not self._is_reset:
            budget = self._rules.least_budget
            return RENDERERS[mode](view_of(world, world.start, world.goal, budget), [world.start])

        path = self._history.path(i)
        budget = None if self._rules.budget is None else float(self._budget[i])

        return RENDERERS[mode](view_of(world, path[0], goal, budget), path)

    # --- what is accepted -------------------------------------------------------------------------

    def _check_running(self) -> None:
        """Refuse a step where an episode has not begun, or has ended and begins only on demand."""
        if not self._is_reset:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        if self._num_ended and self.mode is AutoresetMode.DISABLED:
            raise ResetNeeded(
                f"environments {np.flatnonzero(self._has_ended).tolist()} have ended: "
                "reset them with options={'reset_mask': ...} before step()"
            )

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        """Which environments to reset, ``(n,)``: those of the mask, all without one."""
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)

        chosen: NDArray[np.bool_] = np.asarray(mask)
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise ValueError(
                f"reset_mask must hold {self.num_envs} bools, at least one of them True"
            )
        if not self._is_reset and not chosen.all():
            raise ResetNeeded("the first reset must be of all environments: leave reset_mask out")

        return chosen


def _each(observations: Any, count: int) -> Iterator[Any]:
    """The observations of a batch one by one."""
    for i in range(count):
        if isinstance(observations, dict):
            yield {name: array[i] for name, array in observations.items()}
        else:
            yield observations[i]


def _objects(count: int, chosen: NDArray[np.int64], objects: Iterable[Any]) -> NDArray[Any]:
    """An array ``(count,)`` of the objects of the chosen robots, and None elsewhere."""
    array = np.full(count, None, dtype=object)

    for i, each in zip(chosen.tolist(), objects, strict=True):
        array[i] = each

    return array
