"""`IrsNavVectorEnv`: n environments in one, a thin shell over the same tables as the single environment."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.dynamics import ACTIONS, check_task, draw_start, tables_for
from irs_gym.grid import Cell
from irs_gym.infos import Infos, Step
from irs_gym.interface import METADATA, RENDERERS, checked_actions, checked_options, checked_render_mode, view_of
from irs_gym.observation import Observer, build_observer
from irs_gym.stack import Stack, build_stack, unpack_masks
from irs_gym.task import World, build_world, task_of
from irs_gym.trail import History, Trail


class IrsNavVectorEnv(VectorEnv[Any, NDArray[np.integer[Any]], NDArray[Any]]):
    """`IrsNav-v0` for many robots at once; equal to n single environments, step for step.

    Parameters
    ----------
    num_envs
        Number of environments n.
    max_episode_steps
        Steps after which an episode is truncated.
    autoreset_mode
        ``"NextStep"``: the step after an end ignores the action and returns the reset observation with a reward of 0;
        ``"SameStep"``: it comes at once, the last one in ``infos["final_obs"]``, its info in ``infos["final_info"]``;
        ``"Disabled"``: the user resets with ``options={"reset_mask": ...}``. Or an `AutoresetMode`.
    copy
        Whether each observation has memory of its own. Otherwise the next step overwrites it, which is faster.
    render_mode
        ``"rgb_array"`` or ``"ansi"``: `render` gives one picture or text for each environment.
    **arguments
        The fields of `irs_gym.task.Task`.

    Notes
    -----
    Actions are integers of shape ``(n,)``. Infos hold an array ``(n, ...)`` for each key of the single environment's,
    with a mask ``_key`` that tells which environments have it. ``reset`` takes a seed (environment i gets seed + i) or
    one for each, and the options ``start``, ``goal`` and ``reset_mask`` (bool, ``(n,)``).
    """

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 400,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        for name, value in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps)):
            if not isinstance(value, int | np.integer) or value < 1:
                raise ValueError(f"{name}={value!r} must be a positive integer")
        self.num_envs, self.max_episode_steps = int(num_envs), int(max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode, self.copy = checked_render_mode(render_mode), copy
        self.world: World = build_world(task_of(arguments))
        check_task(self.world)
        self._observer: Observer = build_observer(self.world, self.world.goal)
        self._stack: Stack = build_stack(self.world, (self.world.goal,))

        self.single_action_space: spaces.Discrete = spaces.Discrete(ACTIONS)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = self._observer.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

        n = self.num_envs
        self._cells = self.world.feasible.size
        self._state = np.zeros(n, dtype=np.int64)
        self._travelled = np.zeros(n, dtype=np.complex128)  # metres, plus 1j for each refusal
        self._oracle_distance = np.zeros(n)
        self._has_violated = np.zeros(n, dtype=bool)
        self._has_ended = np.zeros(n, dtype=bool)
        self._num_ended = 0
        self._clock = 0  # steps of all environments
        self._deadline = np.zeros(n, dtype=np.int64)  # clock at which each is truncated
        self._first_deadline = 0
        self._goals: list[Cell] = [self.world.goal] * n
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._is_reset = False
        self._history = History(n, self.max_episode_steps + 1, self.world.feasible.shape)
        self._buffer = np.empty((n, self._observer.width), dtype=np.float32)
        everywhere = np.ones(n, dtype=bool)
        everywhere.setflags(write=False)
        self._everywhere = everywhere

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in every environment, or in those of ``options["reset_mask"]``."""
        options = dict(options or {})
        mask = self._checked_mask(options.pop("reset_mask", None))
        chosen = np.flatnonzero(mask)
        self._seed(seed, chosen)
        self._begin(chosen, **checked_options(options))
        self._is_reset = True
        step = self._step(np.zeros(self.num_envs, dtype=complex), None, np.zeros(self.num_envs, dtype=bool))
        return self._observe(), self._with_oracle(Infos(step._replace(everywhere=mask)), chosen)

    def step(
        self, actions: NDArray[np.integer[Any]]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once; see `IrsNavEnv`."""
        self._check_running()
        entry = self._state * ACTIONS + checked_actions(actions, self.num_envs)
        stack = self._stack
        state, reward = stack.next_state.take(entry), stack.reward.take(entry)
        travel, terminated = stack.travel.take(entry), stack.is_terminated.take(entry)
        cost, is_success = self._judge(entry, terminated)
        self._clock += 1
        resumed = self._resume(state, reward, travel, terminated, cost, is_success) if self._num_ended else None

        self._state = state
        self._travelled = self._travelled + travel
        self._history.advance(state % self._cells if len(stack.goals) > 1 else state)
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
        """Which actions are not refused, bool ``(n, 8)``; see `IrsNavEnv.action_masks`."""
        return unpack_masks(self._stack.action_mask.take(self._state)).astype(bool)

    def render(self) -> tuple[Any, ...] | None:
        """A picture or text for each environment; None without a render mode."""
        if self.render_mode is None:
            return None
        trails = [self._trail(i) for i in range(self.num_envs)]
        show = RENDERERS[self.render_mode]
        return tuple(show(view_of(self.world, t[0], goal), t) for t, goal in zip(trails, self._goals, strict=True))

    # --- episodes ---------------------------------------------------------------------------------------------------

    def _begin(self, chosen: NDArray[np.int64], start: Cell | None = None, goal: Cell | None = None) -> None:
        """Start an episode in the chosen environments."""
        goal = goal or self.world.goal
        flat = self._starts(chosen, start, goal)
        for i in chosen.tolist():
            self._goals[i] = goal
        self._restack(goal)
        # Infos hold on to the arrays so far: episodes begin in new ones.
        self._state = _with(self._state, chosen, flat + self._stack.first_state(goal))
        self._oracle_distance = _with(
            self._oracle_distance, chosen, self._stack.distance_to_go.take(self._state[chosen])
        )
        self._travelled = _with(self._travelled, chosen, 0)
        self._has_violated[chosen] = False
        self._has_ended = _with(self._has_ended, chosen, False)
        self._deadline[chosen] = self._clock + self.max_episode_steps
        self._first_deadline = int(self._deadline.min())
        self._num_ended = int(np.count_nonzero(self._has_ended))
        self._history.begin(chosen, flat)

    def _judge(self, entry: Any, terminated: NDArray[np.bool_]) -> tuple[Any, NDArray[np.bool_]]:
        """Cost of the step, and whether it reaches the goal of an episode without violations."""
        stack = self._stack
        if stack.cost is None:  # moves are refused: only the goal ends an episode
            return None, terminated
        cost = stack.cost.take(entry)
        if self.task.constraint == "allow":
            self._has_violated |= cost > 0
        return cost, stack.is_at_goal.take(entry) & ~self._has_violated

    def _resume(self, state: NDArray[np.int64], *outcome: NDArray[Any] | None) -> NDArray[np.int64]:
        """Begin anew, in place of this step and its outcome, where the last one ended an episode."""
        ended = np.flatnonzero(self._has_ended)
        self._begin(ended)
        state[ended] = self._state[ended]
        for array in outcome:
            if array is not None:
                array[ended] = 0
        return ended

    def _end(self, step: Step, ended: NDArray[np.int64]) -> Infos:
        """Infos with the paths of the episodes that ended; with autoreset in the same step, begins anew as well."""
        is_ended, steps = self._has_ended, self._clock - (self._deadline[ended] - self.max_episode_steps)
        trails = self._history.trails(ended, steps)
        paths = {"path": lambda _: _objects(self.num_envs, ended, trails()), "_path": lambda _: is_ended.copy()}
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return Infos(step, more=paths)

        final = Infos(step._replace(everywhere=is_ended), is_ended, paths)
        rows = np.empty((len(ended), self._observer.width), dtype=np.float32)
        rows = self._stack.observe(self._state[ended], rows)
        final_obs = _objects(self.num_envs, ended, map(self._observer.unpack, rows))
        self._begin(ended)
        fresh = (None if each is None else _with(each, ended, 0) for each in (step.travel, step.cost, step.is_success))
        infos = self._with_oracle(Infos(self._step(*fresh)), ended)
        infos.update(final_obs=final_obs, _final_obs=is_ended, final_info=final, _final_info=is_ended)
        return infos

    def _starts(self, chosen: NDArray[np.int64], start: Cell | None, goal: Cell) -> NDArray[np.int64]:
        """Flat cells that the chosen environments start in: the given one, the world's, or one drawn for each."""
        own = start or self.world.start
        fixed = own[0] * self.world.feasible.shape[1] + own[1]
        if start is not None or not self.task.random_start:
            tables_for(self.world, own, goal)
            return np.full(len(chosen), fixed)
        cells = np.array([self._draw_start(i, goal) for i in chosen.tolist()])
        flat = cells @ np.array([self.world.feasible.shape[1], 1])
        if fixed in flat:
            tables_for(self.world, own, goal)
        return np.asarray(flat)

    def _draw_start(self, i: int, goal: Cell) -> Cell:
        probability = self.task.random_start
        rng = self._rngs[i]
        if rng is None:
            rng = self._rngs[i] = seeding.np_random()[0]
        if probability == 1 or rng.random() < probability:
            return draw_start(self.world, goal, rng)
        return self.world.start

    def _restack(self, goal: Cell) -> None:
        """Keep the tables of the goals in use, and no others."""
        if goal in self._stack.goals and len(self._stack.goals) == 1:
            return
        goals = tuple(dict.fromkeys(self._goals))
        if goals == self._stack.goals:
            return
        number = {each: n for n, each in enumerate(goals)}
        old, cell = np.divmod(self._state, self._cells)
        kept = np.array([number.get(each, 0) for each in self._stack.goals])
        self._state = kept[old] * self._cells + cell
        self._stack = build_stack(self.world, goals)

    def _seed(self, seed: int | Sequence[int | None] | None, chosen: NDArray[np.int64]) -> None:
        if seed is None:
            return
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seed = [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed holds {len(seed)} numbers for {self.num_envs} environments")
        if self.task.random_start:  # the only use of randomness
            for i in chosen:
                if seed[i] is not None:
                    self._rngs[i] = seeding.np_random(seed[i])[0]

    # --- what is returned -------------------------------------------------------------------------------------------

    @property
    def task(self) -> Any:
        """The arguments, an `irs_gym.task.Task`."""
        return self.world.task

    @property
    def radio_map(self) -> Any:
        """The `RadioMap`."""
        return self.world.radio_map

    def _observe(self) -> Any:
        out = np.empty_like(self._buffer) if self.copy else self._buffer
        return self._observer.unpack(self._stack.observe(self._state, out))

    def _step(self, travel: Any, cost: Any, is_success: Any) -> Step:
        travelled, shortest = self._travelled, self._oracle_distance
        return Step(self._stack, self._state, travel, travelled, cost, is_success, shortest, self._everywhere)

    def _with_oracle(self, infos: Infos, chosen: NDArray[np.int64]) -> Infos:
        infos["oracle_distance"], infos["_oracle_distance"] = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        infos["oracle_distance"][chosen] = self._oracle_distance[chosen]
        infos["_oracle_distance"][chosen] = True
        return infos

    def _trail(self, i: int) -> Trail:
        steps = self._clock - (self._deadline[[i]] - self.max_episode_steps)
        return self._history.trails(np.array([i]), steps)()[0]

    # --- what is accepted -------------------------------------------------------------------------------------------

    def _check_running(self) -> None:
        if not self._is_reset:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        if self._num_ended and self.autoreset_mode is AutoresetMode.DISABLED:
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


def _mode(mode: str | AutoresetMode) -> AutoresetMode:
    if isinstance(mode, AutoresetMode):
        return mode
    for each in AutoresetMode:
        if mode in (each.value, each.name, each.name.lower()):
            return each
    raise ValueError(f"autoreset_mode={mode!r} must be one of {[each.value for each in AutoresetMode]}")


def _objects(count: int, chosen: NDArray[np.int64], objects: Iterable[Any]) -> NDArray[Any]:
    """An array ``(count,)`` of the objects of the chosen environments, and None elsewhere."""
    array = np.full(count, None, dtype=object)
    for i, each in zip(chosen.tolist(), objects, strict=True):
        array[i] = each
    return array


def _with(values: NDArray[Any], chosen: NDArray[np.int64], new: Any) -> NDArray[Any]:
    """A copy with new values for the chosen environments."""
    values = values.copy()
    values[chosen] = new
    return values
