"""`IrsNavRandomVectorEnv`: n environments over many scenes in one, a shell over their episodes."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.datasets.random_task import (
    RandomTask,
    RandomTaskArguments,
    Worlds,
    build_worlds,
    random_task_of,
)
from irs_gym.envs.random_nav import IrsNavRandomEnv
from irs_gym.grid import Cell, cells_at
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
from irs_gym.mdp.dynamics import (
    ACTIONS,
    choose_start,
    draw_start,
    draws_start,
    start_cells,
    starts_of,
    tables_for,
)
from irs_gym.mdp.task import World, shows_fields
from irs_gym.rendering.frame_collection import FrameCollection
from irs_gym.rendering.modes import with_render_mode
from irs_gym.rendering.window import Window
from irs_gym.vector.episodes import VectorEpisodes
from irs_gym.vector.infos import VALUES, Infos, Step, Values
from irs_gym.vector.many_scenes import ManyScenes, build_many_scenes
from irs_gym.vector.protocols import RngOf, States
from irs_gym.vector.single_envs import SingleEnvs


class IrsNavRandomVectorEnv(VectorEnv[Any, NDArray[np.integer[Any]], NDArray[Any]]):
    """`IrsNavRandom-v0` for many robots at once; equal to n single environments, step for step.

    Parameters
    ----------
    num_envs, max_episode_steps, autoreset_mode, copy, render_mode, infos
        As in `irs_gym.envs.vector_nav.IrsNavVectorEnv`.
    split, num_scenes, ...
        As `irs_gym.datasets.random_task.RandomTask` says.

    Notes
    -----
    Each robot has a scene of its own, told by ``infos["scene_number"]``; its name,
    ``infos["scene_id"]``, is there with ``infos="all"``. The option ``scene_id`` of
    `reset` is one name or number for all, or a list of one for each environment; everything else is
    as in `IrsNavVectorEnv`.
    """

    spec = PlainSpec()

    @shows_fields(RandomTask)
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 400,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        infos: Infos = "fast",
        **arguments: Unpack[RandomTaskArguments],
    ) -> None:
        self.num_envs = checked_count("num_envs", num_envs)
        self.max_episode_steps = checked_count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode = checked_render_mode(render_mode)
        self.copy = copy
        self.worlds: Worlds = build_worlds(random_task_of(arguments, type(self).__name__))
        sampler = _EpisodeSampler(self.worlds)
        check_num_envs(self.num_envs, self.max_episode_steps, sampler.packing)
        self._episodes = VectorEpisodes(
            sampler, self.num_envs, self.max_episode_steps, self.autoreset_mode, copy, infos
        )

        self._singles = SingleEnvs(
            self,
            partial(IrsNavRandomEnv, render_mode=render_mode, infos=infos, **arguments),
            self._episodes.snapshot,
        )

        self.single_action_space: spaces.Discrete = spaces.Discrete(ACTIONS)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = sampler.packing.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def task(self) -> RandomTask:
        """The arguments."""
        return self.worlds.task

    def world_of(self, i: int) -> World:
        """World of the scene that robot i is in."""
        return self._episodes.scene_and_goal(i)[0]

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
        """Move every robot once; see `IrsNavRandomEnv`."""
        return self._episodes.step(actions)

    def paths(self) -> list[list[Cell]]:
        """Cells (i, j) of each robot's episode; see `IrsNavVectorEnv.paths`."""
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
    """What `gymnasium.make_vec` calls: an `IrsNavRandomVectorEnv` in any mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavRandomVectorEnv, **arguments), render_mode, Window, FrameCollection
    )


def _scene_number(step: Step) -> NDArray[np.int64]:
    scenes: ManyScenes = step.transition_model  # type: ignore[assignment]
    return scenes.code.scenes(step.states)


def _scene_id(step: Step) -> NDArray[np.object_]:
    scenes: ManyScenes = step.transition_model  # type: ignore[assignment]
    return scenes.scene_id(step.states)


class _EpisodeSampler:
    """Starts episodes in many worlds; `irs_gym.vector.protocols.EpisodeSampler` describes its
    attributes and methods.
    """

    is_random = True
    info_values: Values = {**VALUES, "scene_number": _scene_number, "scene_id": _scene_id}

    def __init__(self, worlds: Worlds) -> None:
        self.worlds = worlds
        self.transition_model = build_many_scenes(worlds)
        self.packing = self.transition_model.packing
        self.is_violable = worlds.task.constraint == "allow"
        self.rules = worlds.task.rules
        self.cell_size = worlds.pool.cell_size
        self.map_shape = self.transition_model.shape

    def begin(
        self,
        states: States,
        chosen: NDArray[np.int64],
        options: dict[str, Any] | None,
        rng: RngOf,
        budgets: NDArray[np.float64] | None = None,
    ) -> States:
        given = checked_options(options, "scene_id")
        scene_ids = given.pop("scene_id", None)
        if not isinstance(scene_ids, list | tuple | np.ndarray):
            scene_ids = [scene_ids] * len(states)

        if len(scene_ids) != len(states):
            raise ValueError(
                f"scene_id holds {len(scene_ids)} scenes for {len(states)} environments"
            )

        rngs = [rng(i) for i in chosen.tolist()]
        numbers = [
            self.worlds.choose(scene_ids[i], each)
            for i, each in zip(chosen.tolist(), rngs, strict=True)
        ]
        amounts = [None] * len(numbers) if budgets is None else budgets.tolist()
        if given or is_below(amounts, self.rules.least_budget):
            starts, goals = self._given_ends(numbers, given, rngs, amounts)
        else:
            starts, goals = self._own_ends(numbers, rngs, amounts)

        states = states.copy()
        states[chosen] = self.transition_model.code.encode(np.array(numbers), starts, goals)

        return states

    def scene_number(self, states: States, i: int) -> int:
        return int(self.transition_model.code.scenes(states[[i]])[0])

    def scene_and_goal(self, states: States, i: int) -> tuple[World, Cell]:
        return self.transition_model.scene_and_goal(states, i)

    def _given_ends(
        self,
        numbers: list[int],
        given: dict[str, Cell],
        rngs: list[np.random.Generator],
        budgets: Sequence[float | None],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Starts and goals ``(n, 2)`` where the options say one of them, or budgets bound them."""
        ends = []

        for number, rng, budget in zip(numbers, rngs, budgets, strict=True):
            world = self.worlds.world(number)
            goal = given.get("goal", world.goal)
            start = given.get("start") or choose_start(world, goal, rng, budget)
            tables_for(world, start, goal, budget)
            ends.append((start, goal))

        starts, goals = np.array(ends).transpose(1, 0, 2)

        return starts, goals

    def _own_ends(
        self,
        numbers: list[int],
        rngs: list[np.random.Generator],
        budgets: Sequence[float | None],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The scenes' own starts, some of them drawn, and goals, ``(n, 2)``; such episodes are
        known to be feasible.
        """
        pool = self.worlds.pool
        rules = self.worlds.task.rules
        starts = pool.start[numbers]
        goals = pool.goal[numbers]

        for n, rng in enumerate(rngs if rules.random_start else ()):
            if draws_start(rules.random_start, rng):
                goal = tuple(goals[n].tolist())
                cells = (
                    start_cells(pool.distance_to_go[numbers[n]], goal)
                    if budgets[n] is None
                    else starts_of(self.worlds.world(numbers[n]), goal, budgets[n])
                )
                starts[n] = cells_at(np.array(draw_start(cells, rng)), pool.shape)

        return starts, goals
