"""`IrsNavVectorEnv`: n environments in one, a thin shell over the same tables as the single environment."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.dynamics import ACTIONS, Tables, draw_start, tables_for, tabulate
from irs_gym.env import INFO_KEYS, IrsNavEnv, checked_options
from irs_gym.grid import MOVE_NAMES, Cell
from irs_gym.observation import Observer, build_observer
from irs_gym.task import World, build_world, task_of

_REFUSED, _COST, _ENDS, _GOAL = 1, 2, 4, 8  # bits of one byte for each cell and action


class _Stack(NamedTuple):
    """Tables of several goals, one behind the other: a state is a flat cell of one of them."""

    goals: tuple[Cell, ...]
    next_state: NDArray[np.int64]  # (S * 8,)
    reward: NDArray[np.float64]
    moved: NDArray[np.float64]
    flags: NDArray[np.uint8]
    action_mask: NDArray[np.int64]  # (S,), the eight bytes of a mask as one number
    distance_to_go: NDArray[np.float64]
    gain_db: NDArray[np.float64]
    margin_db: NDArray[np.float64]
    observations: NDArray[np.float32] | None  # (S, D)


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
        if render_mode not in (None, *IrsNavEnv.metadata["render_modes"]):
            raise ValueError(f"render_mode={render_mode!r} must be one of {IrsNavEnv.metadata['render_modes']} or None")
        self.num_envs, self.max_episode_steps = int(num_envs), int(max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**IrsNavEnv.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode, self.copy = render_mode, copy
        self.world: World = build_world(task_of(arguments))
        tables_for(self.world, self.world.start, self.world.goal)
        self._observer: Observer = build_observer(self.world, self.world.goal)
        self._stack = _stack(self.world, (self.world.goal,))

        self.single_action_space: spaces.Discrete = spaces.Discrete(ACTIONS)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = self._observer.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

        n = self.num_envs
        self._state = np.zeros(n, dtype=np.int64)
        self._steps = np.zeros(n, dtype=np.int64)
        self._distance = np.zeros(n)
        self._refused = np.zeros(n, dtype=np.int64)
        self._has_violated = np.zeros(n, dtype=bool)
        self._oracle_distance = np.zeros(n)
        self._has_ended = np.zeros(n, dtype=bool)
        self._goals: list[Cell] = [self.world.goal] * n
        self._rngs: list[np.random.Generator | None] = [None] * n
        self._is_reset = False
        # States of all robots at the latest steps, a ring: the paths of episodes that end are read from it.
        self._history = np.zeros((self.max_episode_steps + 1, n), dtype=np.int64)
        self._clock = 0
        self._buffer = np.empty((n, self._observer.width), dtype=np.float32)
        self._all = np.ones(n, dtype=bool)
        self._all.setflags(write=False)

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
        still = np.zeros(self.num_envs, dtype=bool)
        infos = self._infos(still, still.astype(np.float64), still)
        infos.update({key: mask for key in infos if key.startswith("_")})
        return self._observe(), self._with_oracle(infos, chosen)

    def step(
        self, actions: NDArray[np.integer[Any]]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once; see `IrsNavEnv`."""
        entry = self._state * ACTIONS + self._checked_actions(actions)
        stack = self._stack
        state = np.take(stack.next_state, entry, mode="clip")
        reward = np.take(stack.reward, entry, mode="clip")
        moved = np.take(stack.moved, entry, mode="clip")
        flags = np.take(stack.flags, entry, mode="clip")
        self._steps += 1
        resumed = self._resume(state, reward, moved, flags) if self._has_ended.any() else None

        self._state = state
        self._distance += moved
        is_refused, cost = (flags & _REFUSED).view(bool), (flags & _COST).astype(bool)
        self._refused += is_refused
        self._has_violated |= cost
        terminated, truncated = (flags & _ENDS).astype(bool), self._steps >= self.max_episode_steps
        is_success = (flags & _GOAL).astype(bool) & ~self._has_violated
        self._remember()
        self._has_ended = terminated | truncated

        infos = self._infos(is_refused, cost.astype(np.float64), is_success)
        if resumed is not None:
            self._with_oracle(infos, resumed)
        if self._has_ended.any():
            ended = np.flatnonzero(self._has_ended)
            self._with_paths(infos, ended)
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                infos = self._restart(infos, ended)
        return self._observe(), reward, terminated, truncated, infos

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused, bool ``(n, 8)``; see `IrsNavEnv.action_masks`."""
        return self._masks().astype(bool)

    def render(self) -> tuple[Any, ...] | None:
        """A picture or text for each environment; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._render(i) for i in range(self.num_envs))

    # --- episodes ---------------------------------------------------------------------------------------------------

    def _begin(self, chosen: NDArray[np.int64], start: Cell | None = None, goal: Cell | None = None) -> None:
        """Start an episode in the chosen environments."""
        goal = goal or self.world.goal
        cells = [start or self._draw_start(i, goal) for i in chosen]
        if not self.task.random_start or start is not None:
            tables_for(self.world, cells[0], goal)
        for i in chosen:
            self._goals[i] = goal
        self._restack(goal)
        shape = self.world.feasible.shape
        flat = np.ravel_multi_index(np.array(cells).T, shape)
        self._state[chosen] = flat + self._stack.goals.index(goal) * self.world.feasible.size
        self._oracle_distance[chosen] = self._stack.distance_to_go[self._state[chosen]]
        for array in (self._steps, self._distance, self._refused, self._has_violated, self._has_ended):
            array[chosen] = 0
        self._history[self._clock, chosen] = self._state[chosen]

    def _resume(self, state: Any, reward: Any, moved: Any, flags: Any) -> NDArray[np.int64]:
        """Begin anew, in place of this step, where the last one ended an episode."""
        if self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise ResetNeeded(
                f"environments {np.flatnonzero(self._has_ended).tolist()} have ended: reset them with "
                "options={'reset_mask': ...} before step()"
            )
        ended = np.flatnonzero(self._has_ended)
        self._begin(ended)
        state[ended] = self._state[ended]
        for array in (reward, moved, flags):
            array[ended] = 0
        return ended

    def _restart(self, infos: dict[str, Any], ended: NDArray[np.int64]) -> dict[str, Any]:
        """Begin anew at once where this step ended an episode; the infos of the step become the final ones."""
        final_obs = np.full(self.num_envs, None, dtype=object)
        rows = self._rows(ended)
        for row, i in zip(rows, ended, strict=True):
            final_obs[i] = self._observer.unpack(row)
        mask = self._has_ended.copy()
        final = {key: _only(value, ended) for key, value in infos.items() if not key.startswith("_")}
        self._begin(ended)
        kept = {key: infos[key].copy() for key in ("is_refused", "cost", "is_success")}
        for value in kept.values():
            value[ended] = 0
        fresh = self._with_oracle(self._infos(**kept), ended)
        final_info = final | {f"_{key}": mask for key in final}
        return {**fresh, "final_obs": final_obs, "_final_obs": mask, "final_info": final_info, "_final_info": mask}

    def _draw_start(self, i: int, goal: Cell) -> Cell:
        probability = self.task.random_start
        if not probability:
            return self.world.start
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
        wanted = tuple(dict.fromkeys(self._goals))
        if wanted == self._stack.goals:
            return
        size = self.world.feasible.size
        moved_to = {old: wanted.index(g) for old, g in enumerate(self._stack.goals) if g in wanted}
        slots = np.array([moved_to.get(slot, 0) for slot in range(len(self._stack.goals))])
        self._state = slots[self._state // size] * size + self._state % size
        self._history = slots[np.minimum(self._history // size, len(slots) - 1)] * size + self._history % size
        self._stack = _stack(self.world, wanted)

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
        return self._observer.unpack(self._rows(slice(None), out))

    def _rows(self, chosen: Any, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        state = self._state[chosen]
        if out is None:
            out = np.empty((len(state), self._observer.width), dtype=np.float32)
        if self._stack.observations is not None:
            # "clip" is the fast mode; states come from the tables and are never out of range
            return np.take(self._stack.observations, state, axis=0, out=out, mode="clip")
        slot, cell = np.divmod(state, self.world.feasible.size)
        for n, goal in enumerate(self._stack.goals):
            here = slot == n
            of_goal = np.empty((int(here.sum()), self._observer.width), dtype=np.float32)
            out[here] = build_observer(self.world, goal).rows(cell[here], of_goal)
        return out

    def _masks(self) -> NDArray[np.int8]:
        return np.take(self._stack.action_mask, self._state, mode="clip").view(np.int8).reshape(-1, ACTIONS)

    def _infos(
        self, is_refused: NDArray[np.bool_], cost: NDArray[np.float64], is_success: NDArray[np.bool_]
    ) -> dict[str, Any]:
        stack, state = self._stack, self._state
        spl = np.zeros(self.num_envs)
        if is_success.any():
            shortest = self._oracle_distance
            spl = np.where(is_success, shortest / np.maximum(np.maximum(shortest, self._distance), 1e-300), 0.0)
        infos = {
            "distance": self._distance.copy(),
            "refused": self._refused.copy(),
            "distance_to_go": np.take(stack.distance_to_go, state, mode="clip"),
            "gain_db": np.take(stack.gain_db, state, mode="clip"),
            "margin_db": np.take(stack.margin_db, state, mode="clip"),
            "action_mask": self._masks(),
            "is_refused": is_refused,
            "cost": cost,
            "is_success": is_success,
            "spl": spl,
        }
        return infos | dict.fromkeys(_MASK_NAMES, self._all)

    def _with_oracle(self, infos: dict[str, Any], chosen: NDArray[np.int64]) -> dict[str, Any]:
        infos["oracle_distance"], infos["_oracle_distance"] = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        infos["oracle_distance"][chosen] = self._oracle_distance[chosen]
        infos["_oracle_distance"][chosen] = True
        return infos

    def _with_paths(self, infos: dict[str, Any], ended: NDArray[np.int64]) -> None:
        infos["path"], infos["_path"] = np.full(self.num_envs, None, dtype=object), self._has_ended.copy()
        for i in ended:
            infos["path"][i] = [tuple(cell) for cell in self._path(i).tolist()]

    def _remember(self) -> None:
        self._clock = (self._clock + 1) % len(self._history)
        self._history[self._clock] = self._state

    def _path(self, i: int) -> NDArray[np.int64]:
        """Cells of environment i's episode so far, shape ``(T, 2)``, refused moves left out."""
        when = np.arange(self._clock - self._steps[i], self._clock + 1) % len(self._history)
        states = self._history[when, i]
        cells = states[np.append(True, states[1:] != states[:-1])] % self.world.feasible.size
        return np.stack(np.unravel_index(cells, self.world.feasible.shape), axis=-1)

    def _render(self, i: int) -> Any:
        raise NotImplementedError

    # --- what is accepted -------------------------------------------------------------------------------------------

    def _checked_actions(self, actions: Any) -> NDArray[np.integer[Any]]:
        if not self._is_reset:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise ValueError(
                f"actions has the shape {actions.shape} and the type {actions.dtype}, "
                f"but one integer for each of the {self.num_envs} environments is needed"
            )
        if actions.max() >= ACTIONS or actions.min() < 0:
            first = int(np.flatnonzero((actions < 0) | (actions >= ACTIONS))[0])
            names = ", ".join(f"{n} {name}" for n, name in enumerate(MOVE_NAMES))
            raise ValueError(f"actions[{first}]={actions[first]} must be an integer from 0 to 7: {names}")
        return actions

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(f"reset_mask must hold {self.num_envs} bools, at least one of them True")
        if not self._is_reset and not mask.all():
            raise ResetNeeded("the first reset must be of all environments: leave reset_mask out")
        return mask


_MASK_NAMES = tuple(f"_{key}" for key in INFO_KEYS)


def _mode(mode: str | AutoresetMode) -> AutoresetMode:
    if isinstance(mode, AutoresetMode):
        return mode
    for each in AutoresetMode:
        if mode in (each.value, each.name, each.name.lower()):
            return each
    raise ValueError(f"autoreset_mode={mode!r} must be one of {[each.value for each in AutoresetMode]}")


def _only(values: NDArray[Any], chosen: NDArray[np.int64]) -> NDArray[Any]:
    """The values of the chosen environments, zero (or None) elsewhere."""
    kept = np.full_like(values, None) if values.dtype == object else np.zeros_like(values)
    kept[chosen] = values[chosen]
    return kept


def _flags(tables: Tables) -> NDArray[np.uint8]:
    each = tables.transition
    bits = ((each.is_refused, _REFUSED), (each.cost > 0, _COST), (each.is_terminated, _ENDS), (each.is_at_goal, _GOAL))
    return np.sum([condition * bit for condition, bit in bits], axis=0, dtype=np.uint8)


def _stack(world: World, goals: tuple[Cell, ...]) -> _Stack:
    every = [tabulate(world, goal) for goal in goals]
    observed = [build_observer(world, goal).table for goal in goals]
    size = world.feasible.size

    def join(parts: list[Any]) -> Any:
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    return _Stack(
        goals=goals,
        next_state=join([t.transition.next_cell + n * size for n, t in enumerate(every)]),
        reward=join([t.transition.reward for t in every]),
        moved=join([t.transition.moved for t in every]),
        flags=join([_flags(t) for t in every]),
        action_mask=join([t.action_mask.view(np.int64)[:, 0] for t in every]),
        distance_to_go=join([t.distance_to_go.ravel() for t in every]),
        gain_db=join([t.gain_db for t in every]),
        margin_db=join([t.margin_db for t in every]),
        observations=None if any(o is None for o in observed) else join(observed),
    )
