"""`IrsNavVectorEnv`: n environments over one scene in one, a thin shell over their episodes."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.envs.nav import IrsNavEnv
from irs_gym.grid import Cell
from irs_gym.mdp.autoreset import AutoresetMode, checked_mode
from irs_gym.mdp.budget import is_below
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    check_num_envs,
    checked_count,
    checked_options,
    checked_render_mode,
    each_seed,
)
from irs_gym.mdp.dynamics import ACTIONS, check_task, choose_start, tables_for
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.task import Task, TaskArguments, World, build_world, shows_fields, task_of
from irs_gym.rendering.frame_collection import FrameCollection
from irs_gym.rendering.modes import with_render_mode
from irs_gym.rendering.window import Window
from irs_gym.vector.episodes import VectorEpisodes
from irs_gym.vector.infos import VALUES, Infos
from irs_gym.vector.one_scene import build_one_scene
from irs_gym.vector.protocols import RngOf, States
from irs_gym.vector.single_envs import SingleEnvs


class IrsNavVectorEnv(VectorEnv[Any, NDArray[np.integer[Any]], NDArray[Any]]):
    """`IrsNav-v0` for many robots at once; equal to n single environments, step for step.

    Parameters
    ----------
    num_envs
        Number of environments n.
    max_episode_steps
        Steps after which an episode is truncated.
    autoreset_mode
        ``"NextStep"``: the step after an end ignores the action and returns the reset observation
        with a reward of 0; ``"SameStep"``: it comes at once, the last one in
        ``infos["final_obs"]``, its info in ``infos["final_info"]``; ``"Disabled"``: the user resets
        with ``options={"reset_mask": ...}``. Or an `AutoresetMode`.
    copy
        Whether each observation has memory of its own. Otherwise the next step overwrites it, which
        is faster.
    render_mode
        ``"rgb_array"`` or ``"ansi"``: `render` gives one picture or text for each environment.
        `gymnasium.make_vec` knows ``"human"``, one window for all, ``"rgb_array_list"`` and
        ``"ansi_list"`` as well.
    infos
        Keys that the infos hold, at every step the same: ``"all"`` of the single environment's, a
        list of some, or ``"fast"``: all but ``refused``, ``is_refused``, ``distance_to_go``,
        ``gain_db`` and ``margin_db``.
    scene, target_db, ...
        As `irs_gym.mdp.task.Task` says.

    Notes
    -----
    Actions are integers of shape ``(n,)``. Infos hold an array ``(n, ...)`` for each key of the
    single environment's, with a mask ``_key`` that tells which environments have it. ``reset``
    takes a seed (environment i gets seed + i) or one for each, and the options ``start``, ``goal``
    and ``reset_mask`` (bool, ``(n,)``).

    Examples
    --------
    >>> envs = IrsNavVectorEnv(num_envs=3, random_start=True)
    >>> observation, infos = envs.reset(seed=0)
    >>> observation, reward, terminated, truncated, infos = envs.step(np.array([0, 2, 4]))
    >>> observation["position"].shape, infos["distance"].shape
    ((3, 4), (3,))
    """

    spec = PlainSpec()

    @shows_fields(Task)
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 400,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        infos: Infos = "fast",
        **arguments: Unpack[TaskArguments],
    ) -> None:
        self.num_envs = checked_count("num_envs", num_envs)
        self.max_episode_steps = checked_count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode = checked_render_mode(render_mode)
        self.copy = copy
        self.world: World = build_world(task_of(arguments, type(self).__name__))
        check_task(self.world)
        check_num_envs(
            self.num_envs,
            self.max_episode_steps,
            build_observer(self.world, self.world.goal).packing,
        )
        sampler = _EpisodeSampler(self.world, self.num_envs)
        self._episodes = VectorEpisodes(
            sampler, self.num_envs, self.max_episode_steps, self.autoreset_mode, copy, infos
        )

        self._singles = SingleEnvs(
            self,
            partial(IrsNavEnv, render_mode=render_mode, infos=infos, **arguments),
            self._episodes.snapshot,
        )

        self.single_action_space: spaces.Discrete = spaces.Discrete(ACTIONS)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = sampler.packing.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def task(self) -> Task:
        """The arguments."""
        return self.world.task

    @property
    def radio_map(self) -> Any:
        """The `RadioMap`."""
        return self.world.radio_map

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in every environment, or in those of ``options["reset_mask"]``."""
        seeds = each_seed(seed, self.num_envs)
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))

        return self._episodes.reset(seeds, options)

    def step(
        self, actions: NDArray[np.integer[Any]]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once; see `IrsNavEnv`."""
        return self._episodes.step(actions)

    def paths(self) -> list[list[Cell]]:
        """Cells (i, j) of each robot's episode, refused moves left out; see `IrsNavEnv.path`.

        Where an episode ended at the latest step, they are its cells, whether or not the robot has
        begun anew.
        """
        return self._episodes.paths()

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused, bool ``(n, 8)``; see `IrsNavEnv.action_masks`."""
        return self._episodes.action_masks()

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What a method (or attribute) of each single environment gives, as `SyncVectorEnv.call`.

        Raises ``AttributeError`` where there is none, or where it would move one environment alone.
        """
        return self._singles.call(name, *args, **kwargs)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each single environment: ``oracle``, ``path``, ``world`` ..., as
        `SyncVectorEnv.get_attr`.
        """
        return self._singles.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of your own in each environment, as `SyncVectorEnv.set_attr`; theirs are
        refused.
        """
        self._singles.set_attr(name, values)

    def render(self) -> tuple[Any, ...] | None:
        """A picture or text for each environment; None without a render mode."""
        return self._episodes.render(self.render_mode)


def make_vector_env(render_mode: str | None = None, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """What `gymnasium.make_vec` calls: an `IrsNavVectorEnv` in any render mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavVectorEnv, **arguments), render_mode, Window, FrameCollection
    )


class _EpisodeSampler:
    """Starts episodes in one world; `irs_gym.vector.protocols.EpisodeSampler` describes its
    attributes and methods.
    """

    info_values = VALUES

    def __init__(self, world: World, num_envs: int) -> None:
        self.world = world
        self.transition_model = build_one_scene(world, (world.goal,))
        self.packing = build_observer(world, world.goal).packing
        self.is_random = bool(world.rules.random_start)
        self.is_violable = world.rules.constraint == "allow"
        self.rules = world.rules
        self.cell_size = world.radio_map.grid.cell_size
        self.map_shape = world.radio_map.grid.shape
        self._goals: list[Cell] = [world.goal] * num_envs

    def begin(
        self,
        states: States,
        chosen: NDArray[np.int64],
        options: dict[str, Any] | None,
        rng: RngOf,
        budgets: NDArray[np.float64] | None = None,
    ) -> States:
        ends = checked_options(options)
        goal = ends.get("goal", self.world.goal)
        cells = self._starts(chosen, ends.get("start"), goal, rng, budgets)

        for i in chosen.tolist():
            self._goals[i] = goal

        states = self._restacked(states, goal)
        states[chosen] = cells + self.transition_model.first_state(goal)

        return states

    def scene_number(self, states: States, i: int) -> int:
        return 0

    def scene_and_goal(self, states: States, i: int) -> tuple[World, Cell]:
        return self.world, self._goals[i]

    def _starts(
        self,
        chosen: NDArray[np.int64],
        start: Cell | None,
        goal: Cell,
        rng: RngOf,
        budgets: NDArray[np.float64] | None,
    ) -> NDArray[np.int64]:
        """Flat cells that the chosen robots start in: the given one, the world's, or one drawn for
        each.
        """
        own = start or self.world.start
        grid = self.world.radio_map.grid
        fixed = grid.flat(own)
        amounts = [None] * len(chosen) if budgets is None else budgets.tolist()

        # The world's own ends were checked with its least budget, and cells are drawn among those
        # that reach the goal; others are checked now.
        is_checked = (own, goal) == (self.world.start, self.world.goal)
        is_checked = is_checked and not is_below(amounts, self.rules.least_budget)
        if start is not None or not self.is_random:
            for amount in () if is_checked else set(amounts):
                tables_for(self.world, own, goal, amount)

            return np.full(len(chosen), fixed)

        cells = np.empty(len(chosen), dtype=np.int64)
        for n, (i, amount) in enumerate(zip(chosen.tolist(), amounts, strict=True)):
            cells[n] = grid.flat(choose_start(self.world, goal, rng(i), amount))
            if cells[n] == fixed and not is_checked:
                tables_for(self.world, own, goal, amount)

        return cells

    def _restacked(self, states: States, goal: Cell) -> States:
        """The states in a model of the goals in use, and no others."""
        if goal in self.transition_model.goals and len(self.transition_model.goals) == 1:
            return states.copy()

        goals = tuple(dict.fromkeys(self._goals))  # each once, in the order of the robots
        number = {each: n for n, each in enumerate(goals)}

        # A state is the number of its goal times the cells, plus its cell.
        old, cell = np.divmod(states, self.world.feasible.size)  # (n,) each
        kept = np.array([number.get(each, 0) for each in self.transition_model.goals])
        if goals != self.transition_model.goals:
            self.transition_model = build_one_scene(self.world, goals)

        return np.asarray(kept[old] * self.world.feasible.size + cell)
