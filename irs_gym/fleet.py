"""`Fleet`: the episodes of n robots over any ground, with autoreset: what is the same for all vector environments."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from irs_gym.autoreset import AutoresetMode
from irs_gym.grid import Cell
from irs_gym.ground import Dispatcher, Outcome
from irs_gym.infos import Infos, Step
from irs_gym.interface import RENDERERS, checked_actions, view_of
from irs_gym.task import World
from irs_gym.trail import History, Trail


class Fleet:
    """What `reset`, `step` and the other methods of a vector environment do; see `IrsNavVectorEnv`."""

    def __init__(
        self, dispatcher: Dispatcher, num_envs: int, max_episode_steps: int, mode: AutoresetMode, copy: bool
    ) -> None:
        """n robots that a dispatcher sends on their way; ``copy`` gives each observation memory of its own."""
        n = num_envs
        self.num_envs, self.max_episode_steps, self.mode, self.copy = n, max_episode_steps, mode, copy
        self._dispatcher = dispatcher
        self._states = np.zeros(n, dtype=np.int64)
        self._travelled = np.zeros(n, dtype=np.complex128)  # metres, plus 1j for each refusal
        self._oracle_distance = np.zeros(n)
        self._has_violated = np.zeros(n, dtype=bool)
        self._has_ended = np.zeros(n, dtype=bool)
        self._num_ended = 0
        self._clock = 0  # steps of all robots
        self._deadline = np.zeros(n, dtype=np.int64)  # clock at which each is truncated
        self._first_deadline = 0
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._is_reset = False
        self._history = History(n, max_episode_steps + 1, dispatcher.map_shape, dispatcher.num_maps)
        self._buffer = np.empty((n, dispatcher.packing.width), dtype=np.float32)
        self._everywhere = np.ones(n, dtype=bool)
        self._everywhere.setflags(write=False)

    def reset(self, seeds: Sequence[int | None] | None, options: dict[str, Any] | None) -> tuple[Any, dict[str, Any]]:
        """Start an episode everywhere, or in the environments of ``options["reset_mask"]``."""
        options = dict(options or {})
        mask = self._checked_mask(options.pop("reset_mask", None))
        chosen = np.flatnonzero(mask)
        if seeds is not None:
            self._seed(seeds, chosen)
        self._begin(chosen, options)
        self._is_reset = True
        step = self._step(np.zeros(self.num_envs, dtype=complex), None, np.zeros(self.num_envs, dtype=bool))
        return self._observe(), self._with_oracle(Infos(step._replace(everywhere=mask)), chosen)

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once."""
        self._check_running()
        checked = checked_actions(actions, self.num_envs)
        self._clock += 1
        resumed = self._resume() if self._num_ended else None
        outcome = self._dispatcher.ground.move(self._states, checked)
        if resumed is not None:
            outcome.clear(resumed, self._states[resumed])
        states, reward, travel, terminated, cost, _ = outcome
        is_success = self._judge(outcome)

        self._states = states
        self._travelled = self._travelled + travel
        self._history.advance(self._dispatcher.ground.cells(states))
        is_late = self._clock >= self._first_deadline
        truncated = self._deadline <= self._clock if is_late else np.zeros(self.num_envs, dtype=bool)
        self._has_ended = terminated | truncated
        self._num_ended = int(np.count_nonzero(self._has_ended))

        step = self._step(travel, cost, is_success)
        infos = self._end(step, np.flatnonzero(self._has_ended)) if self._num_ended else Infos(step)
        if resumed is not None:
            self._with_oracle(infos, resumed)
        return self._observe(), reward, terminated, truncated, infos

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused, bool ``(n, 8)``."""
        return self._dispatcher.ground.action_mask(self._states).astype(bool)

    def render(self, mode: str | None) -> tuple[Any, ...] | None:
        """A picture or text for each robot; None without a mode."""
        return None if mode is None else tuple(self._picture(i, mode) for i in range(self.num_envs))

    def errand(self, i: int) -> tuple[World, Cell]:
        """World and goal of robot i."""
        return self._dispatcher.errand(self._states, i)

    # --- episodes ---------------------------------------------------------------------------------------------------

    def _begin(self, chosen: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Start an episode for the chosen robots."""
        # Infos hold on to the arrays so far: episodes begin in new ones.
        self._states = self._dispatcher.begin(self._states, chosen, options, self._rng)
        ground, begun = self._dispatcher.ground, self._states[chosen]
        self._oracle_distance = _with(self._oracle_distance, chosen, ground.distance_to_go(begun))
        self._travelled = _with(self._travelled, chosen, 0)
        self._has_violated[chosen] = False
        self._has_ended = _with(self._has_ended, chosen, False)
        self._deadline[chosen] = self._clock + self.max_episode_steps
        self._first_deadline = int(self._deadline.min())
        self._num_ended = int(np.count_nonzero(self._has_ended))
        self._history.begin(chosen, ground.cells(begun))

    def _resume(self) -> NDArray[np.int64]:
        """Begin anew where the last step ended an episode."""
        ended = np.flatnonzero(self._has_ended)
        self._begin(ended, {})
        return ended

    def _judge(self, outcome: Outcome) -> NDArray[np.bool_]:
        """Whether the step reaches the goal of an episode without violations."""
        if outcome.cost is None:
            return outcome.is_at_goal
        if self._dispatcher.is_violable:
            self._has_violated |= outcome.cost > 0
        return outcome.is_at_goal & ~self._has_violated

    def _end(self, step: Step, ended: NDArray[np.int64]) -> Infos:
        """Infos with the paths of the episodes that ended; with autoreset in the same step, begins anew as well."""
        is_ended, steps = self._has_ended, self._clock - (self._deadline[ended] - self.max_episode_steps)
        trails = self._history.trails(ended, steps)
        paths = {"path": lambda _: _objects(self.num_envs, ended, trails()), "_path": lambda _: is_ended.copy()}
        if self.mode is not AutoresetMode.SAME_STEP:
            return Infos(step, more=paths)

        final = Infos(step._replace(everywhere=is_ended), is_ended, paths)
        packing = self._dispatcher.packing
        rows = np.empty((len(ended), packing.width), dtype=np.float32)
        rows = self._dispatcher.ground.observe(self._states[ended], rows)
        final_obs = _objects(self.num_envs, ended, map(packing.unpack, rows))
        self._begin(ended, {})
        fresh = (None if each is None else _with(each, ended, 0) for each in (step.travel, step.cost, step.is_success))
        infos = self._with_oracle(Infos(self._step(*fresh)), ended)
        infos.update(final_obs=final_obs, _final_obs=is_ended, final_info=final, _final_info=is_ended)
        return infos

    def _rng(self, i: int) -> np.random.Generator:
        rng = self._rngs[i]
        if rng is None:
            rng = self._rngs[i] = seeding.np_random()[0]
        return rng

    def _seed(self, seeds: Sequence[int | None], chosen: NDArray[np.int64]) -> None:
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed holds {len(seeds)} numbers for {self.num_envs} environments")
        if self._dispatcher.is_random:  # the only use of randomness
            for i in chosen:
                if seeds[i] is not None:
                    self._rngs[i] = seeding.np_random(seeds[i])[0]

    # --- what is returned -------------------------------------------------------------------------------------------

    def _observe(self) -> Any:
        out = np.empty_like(self._buffer) if self.copy else self._buffer
        return self._dispatcher.packing.unpack(self._dispatcher.ground.observe(self._states, out))

    def _step(self, travel: Any, cost: Any, is_success: Any) -> Step:
        travelled, shortest, by = self._travelled, self._oracle_distance, self._dispatcher
        return Step(by.ground, self._states, travel, travelled, cost, is_success, shortest, self._everywhere, by.told)

    def _with_oracle(self, infos: Infos, chosen: NDArray[np.int64]) -> Infos:
        infos["oracle_distance"], infos["_oracle_distance"] = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        infos["oracle_distance"][chosen] = self._oracle_distance[chosen]
        infos["_oracle_distance"][chosen] = True
        return infos

    def _picture(self, i: int, mode: str) -> Any:
        trail, (world, goal) = self._trail(i), self.errand(i)
        return RENDERERS[mode](view_of(world, trail[0], goal), trail)

    def _trail(self, i: int) -> Trail:
        steps = self._clock - (self._deadline[[i]] - self.max_episode_steps)
        return self._history.trails(np.array([i]), steps)()[0]

    # --- what is accepted -------------------------------------------------------------------------------------------

    def _check_running(self) -> None:
        if not self._is_reset:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        if self._num_ended and self.mode is AutoresetMode.DISABLED:
            raise ResetNeeded(
                f"environments {np.flatnonzero(self._has_ended).tolist()} have ended: reset them with "
                "options={'reset_mask': ...} before step()"
            )

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        chosen: NDArray[np.bool_] = np.asarray(mask)
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise ValueError(f"reset_mask must hold {self.num_envs} bools, at least one of them True")
        if not self._is_reset and not chosen.all():
            raise ResetNeeded("the first reset must be of all environments: leave reset_mask out")
        return chosen


def _objects(count: int, chosen: NDArray[np.int64], objects: Iterable[Any]) -> NDArray[Any]:
    """An array ``(count,)`` of the objects of the chosen robots, and None elsewhere."""
    array = np.full(count, None, dtype=object)
    for i, each in zip(chosen.tolist(), objects, strict=True):
        array[i] = each
    return array


def _with(values: NDArray[Any], chosen: NDArray[np.int64], new: Any) -> NDArray[Any]:
    """A copy with new values for the chosen robots."""
    values = values.copy()
    values[chosen] = new
    return values
