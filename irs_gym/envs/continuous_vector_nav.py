"""`IrsNavContinuousVectorEnv`: n environments in one, whose robots go anywhere on the floor, a
shell over their episodes.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.datasets.continuous_task import (
    ContinuousTask,
    ContinuousTaskArguments,
    continuous_task_of,
)
from irs_gym.datasets.random_task import chosen_scene
from irs_gym.envs.continuous_nav import (
    Action,
    IrsNavContinuousEnv,
    action_box,
    first_ends,
    reset_options,
)
from irs_gym.envs.continuous_worlds import build_continuous_maps
from irs_gym.grid import Cell
from irs_gym.mdp.autoreset import AutoresetMode, checked_mode
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    check_num_envs,
    checked_count,
    checked_render_mode,
    each_seed,
)
from irs_gym.mdp.continuous_ends import ContinuousEnds, checked_ends, choose_ends
from irs_gym.mdp.continuous_maps import ContinuousMaps, Point
from irs_gym.mdp.continuous_rules import checked_headings
from irs_gym.mdp.continuous_snapshot import ContinuousSnapshot
from irs_gym.mdp.task import World, check_random_start, shows_fields
from irs_gym.rendering.continuous_view import continuous_picture
from irs_gym.rendering.frame_collection import FrameCollection
from irs_gym.rendering.modes import with_render_mode
from irs_gym.rendering.window import Window
from irs_gym.vector.continuous_infos import CONTINUOUS_KEYS, continuous_values
from irs_gym.vector.continuous_model import STATE, ContinuousModel, model_of
from irs_gym.vector.episodes import EpisodeKind, VectorEpisodes
from irs_gym.vector.infos import Infos
from irs_gym.vector.protocols import RngOf
from irs_gym.vector.single_envs import SingleEnvs


class IrsNavContinuousVectorEnv(VectorEnv[Any, Action, NDArray[Any]]):
    """`IrsNavContinuous-v0` for many robots at once; equal to n single environments, step for step.

    Parameters
    ----------
    num_envs, max_episode_steps, autoreset_mode, copy, render_mode
        As in `irs_gym.envs.vector_nav.IrsNavVectorEnv`.
    infos
        Keys that the infos hold: ``"all"`` of the single environment's, a list of some, or
        ``"fast"``: all but ``refused``, ``is_refused``, ``x``, ``y``, ``gain_db``, ``margin_db``
        and ``scene_id``.
    field, speed, ...
        As `irs_gym.datasets.continuous_task.ContinuousTask` says.

    Notes
    -----
    Actions are numbers of shape ``(n, 2)``. The options ``start`` and ``goal`` of `reset` are the
    same for all; over many scenes ``scene_id`` is one name or number for all, or a list of one for
    each environment; everything else is as in `IrsNavVectorEnv`.

    Examples
    --------
    >>> envs = IrsNavContinuousVectorEnv(num_envs=3, target_db=-63.0)
    >>> observation, infos = envs.reset(seed=0)
    >>> actions = np.array([[1.0, 0.0], [0.6, 0.8], [0.0, 0.0]])
    >>> observation, reward, terminated, truncated, infos = envs.step(actions)
    >>> observation["position"].shape, infos["distance"].round(3).tolist()
    ((3, 4), [0.5, 0.5, 0.0])
    """

    spec = PlainSpec()

    @shows_fields(ContinuousTask)
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 400,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        infos: Infos = "fast",
        **arguments: Unpack[ContinuousTaskArguments],
    ) -> None:
        self.num_envs = checked_count("num_envs", num_envs)
        self.max_episode_steps = checked_count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode = checked_render_mode(render_mode)
        self.copy = copy
        self._task = continuous_task_of(arguments, type(self).__name__)
        self.maps: ContinuousMaps = build_continuous_maps(self._task)
        self._sampler = sampler = _EpisodeSampler(self.maps, self.num_envs)
        check_num_envs(self.num_envs, self.max_episode_steps, sampler.packing, place_bytes=16.0)
        kind = EpisodeKind(
            states=STATE,
            places=np.complex128,
            checked=checked_headings,
            refuse=sampler.transition_model.refuse,
            keys=CONTINUOUS_KEYS,
            is_timed=True,
        )
        self._episodes = VectorEpisodes(
            sampler,
            self.num_envs,
            self.max_episode_steps,
            self.autoreset_mode,
            copy,
            infos,
            kind=kind,
        )

        self._singles = SingleEnvs(
            self,
            partial(IrsNavContinuousEnv, render_mode=render_mode, infos=infos, **arguments),
            self._snapshot,
        )

        self.single_action_space: spaces.Box = action_box()
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = sampler.packing.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def task(self) -> ContinuousTask:
        """The arguments."""
        return self._task

    @property
    def random_start(self) -> float:
        """Probability with which the start of an episode that begins from now on is drawn: at first
        the argument's. It may be set, as a curriculum does.

        Raises
        ------
        ValueError
            Where it is set to no probability, or above 0 where the argument is 0, for which no
            random numbers are seeded.
        """
        return self._sampler.random_start

    @random_start.setter
    def random_start(self, value: float) -> None:
        check_random_start(value)
        if value and not self.maps.rules.random_start:
            raise ValueError(
                f"random_start={value!r} cannot be set in an environment made without: make it "
                "with a random_start above 0"
            )
        self._sampler.random_start = value

    def world_of(self, i: int) -> World:
        """World of `IrsNav-v0` with the map of robot i."""
        return self.maps.world(self.ends_of(i).scene)

    def ends_of(self, i: int) -> ContinuousEnds:
        """Scene, start and goal of the episode of robot i, in cells from the map's lower left
        corner.
        """
        return self._sampler.ends[i]

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
        self, actions: Action
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once; see `IrsNavContinuousEnv`."""
        return self._episodes.step(actions)

    def paths(self) -> list[NDArray[np.float64]]:
        """Where each robot has been in its episode, one point a step and the first: ``(T, 2)`` in
        metres.

        Where an episode ended at the latest step, they are its points, whether or not the robot has
        begun anew.
        """
        paths = []
        for i, is_anew in enumerate(self._episodes.has_begun_anew().tolist()):
            ends = self._sampler.before[i] if is_anew else self.ends_of(i)
            history = self._episodes.history(i, of_last_episode=is_anew)
            points = _points(history) if len(history) else np.array([ends.start])
            paths.append(self.maps.in_metres(ends.scene, points))

        return paths

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What a method (or attribute) of each single environment gives, as `SyncVectorEnv.call`.

        Raises ``AttributeError`` where there is none, or where it would move one environment alone.
        """
        return self._singles.call(name, *args, **kwargs)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each single environment: ``position``, ``path``, ``oracle_path`` ..., as
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
        if self.render_mode is None:
            return None
        return tuple(self._picture(i, self.render_mode) for i in range(self.num_envs))

    def _picture(self, i: int, mode: str) -> Any:
        return continuous_picture(mode, self.maps, self.ends_of(i), self._path(i))

    def _path(self, i: int) -> NDArray[np.float64]:
        """Points ``(T, 2)`` of robot i in cells; where it would begin, before the first reset."""
        history = self._episodes.history(i)
        return _points(history) if len(history) else np.array([self.ends_of(i).start])

    def _snapshot(self, i: int) -> tuple[ContinuousSnapshot, list[Point]]:
        """Where the episode of robot i stands, and its points so far."""
        ends = self.ends_of(i)
        path: list[Any] = [(x, y) for x, y in self._path(i).tolist()]
        snapshot = ContinuousSnapshot(
            rules=self.maps.fingerprint,
            scene=ends.scene,
            start=ends.start,
            goal=ends.goal,
            at=path[-1],
            **self._episodes.counts(i),
            **self._episodes.totals(i),
        )

        return snapshot, path


def _points(history: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Points ``(T, 2)`` of numbers x + jy."""
    return np.stack([history.real, history.imag], axis=-1)


def make_vector_env(render_mode: str | None = None, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """What `gymnasium.make_vec` calls: an `IrsNavContinuousVectorEnv` in any mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavContinuousVectorEnv, **arguments), render_mode, Window, FrameCollection
    )


class _EpisodeSampler:
    """Starts episodes; `irs_gym.vector.protocols.EpisodeSampler` describes its attributes and
    methods.
    """

    def __init__(self, maps: ContinuousMaps, num_envs: int) -> None:
        self.maps = maps
        self.transition_model: ContinuousModel = model_of(maps)
        self.packing = self.transition_model.packing
        self.random_start: float = maps.rules.random_start
        self.is_random = maps.has_many_scenes or bool(self.random_start)
        self.rules = maps.rules
        self.cell_size = maps.cell_size
        self.is_violable = maps.rules.constraint == "allow"
        self.map_shape = maps.shape
        self.info_values = continuous_values(has_many_scenes=maps.has_many_scenes)
        self.ends: list[ContinuousEnds] = [first_ends(maps)] * num_envs
        self.before = list(self.ends)  # of the episodes before those

    def begin(
        self,
        states: NDArray[Any],
        chosen: NDArray[np.int64],
        options: dict[str, Any] | None,
        rng: RngOf,
        budgets: NDArray[np.float64] | None = None,
    ) -> NDArray[Any]:
        given = checked_ends(options, *reset_options(self.maps))
        scene_ids = given.pop("scene_id", None)
        if not isinstance(scene_ids, list | tuple | np.ndarray):
            scene_ids = [scene_ids] * len(states)
        if len(scene_ids) != len(states):
            raise ValueError(
                f"scene_id holds {len(scene_ids)} scenes for {len(states)} environments"
            )

        states = states.copy()
        for i in chosen.tolist():
            scene = 0
            if self.maps.has_many_scenes:
                scene = chosen_scene(self.maps.names, scene_ids[i], rng(i))

            self.before[i] = self.ends[i]
            self.ends[i] = choose_ends(self.maps, scene, given, partial(rng, i), self.random_start)
            states[i] = self.transition_model.state(self.ends[i])

        return states

    def scene_number(self, states: NDArray[Any], i: int) -> int:
        return self.ends[i].scene

    def scene_and_goal(self, states: NDArray[Any], i: int) -> tuple[World, Cell]:
        world = self.maps.world(self.ends[i].scene)
        return world, world.goal
