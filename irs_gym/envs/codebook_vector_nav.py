"""`IrsNavCodebookVectorEnv`: n environments in one, whose robots also switch the panel's
configuration, a shell over their episodes.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from irs_gym.datasets.codebook_task import (
    CodebookTask,
    CodebookTaskArguments,
    build_codebook_maps,
    codebook_task_of,
)
from irs_gym.datasets.random_task import chosen_scene
from irs_gym.envs.codebook_episode import joint_path
from irs_gym.envs.codebook_nav import OPTIONS, IrsNavCodebookEnv
from irs_gym.grid import Cell
from irs_gym.mdp.autoreset import AutoresetMode, checked_mode
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    check_num_envs,
    checked_count,
    checked_options,
    checked_render_mode,
    each_seed,
)
from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.codebook_rules import (
    CodebookMaps,
    CodebookRules,
    Ends,
    choose_ends,
    configuration_world,
    own_rules,
)
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World, shows_fields
from irs_gym.rendering.codebook_view import codebook_picture
from irs_gym.rendering.frame_collection import FrameCollection
from irs_gym.rendering.modes import with_render_mode
from irs_gym.rendering.window import Window
from irs_gym.vector.codebook_infos import codebook_values
from irs_gym.vector.codebook_model import CodebookModel, model_of
from irs_gym.vector.episodes import VectorEpisodes
from irs_gym.vector.infos import Infos
from irs_gym.vector.protocols import RngOf, States
from irs_gym.vector.single_envs import SingleEnvs


class IrsNavCodebookVectorEnv(VectorEnv[Any, NDArray[np.integer[Any]], NDArray[Any]]):
    """`IrsNavCodebook-v0` for many robots at once; equal to n single environments, step for step.

    Parameters
    ----------
    num_envs, max_episode_steps, autoreset_mode, copy, render_mode
        As in `irs_gym.envs.vector_nav.IrsNavVectorEnv`.
    infos
        Likewise; ``"fast"`` leaves ``switches`` and ``metres`` out too.
    codebook, switch_cost, ...
        As `irs_gym.datasets.codebook_task.CodebookTask` says.

    Notes
    -----
    Each robot has a panel of its own. The option ``configuration`` of `reset` is the same for all;
    over many scenes ``scene_id`` is one name or number for all, or a list of one for each
    environment; everything else is as in `IrsNavVectorEnv`.

    Examples
    --------
    >>> envs = IrsNavCodebookVectorEnv(num_envs=3, codebook=("dft", 4), target_db=-63.0)
    >>> observation, infos = envs.reset(seed=0)
    >>> observation, reward, terminated, truncated, infos = envs.step(np.array([0, 2, 11]))
    >>> observation["gains"].shape, infos["action_mask"].shape
    ((3, 4), (3, 12))
    """

    spec = PlainSpec()

    @shows_fields(CodebookTask)
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 400,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        infos: Infos = "fast",
        **arguments: Unpack[CodebookTaskArguments],
    ) -> None:
        self.num_envs = checked_count("num_envs", num_envs)
        self.max_episode_steps = checked_count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode = checked_render_mode(render_mode)
        self.copy = copy
        self._task = codebook_task_of(arguments, type(self).__name__)
        self.maps: CodebookMaps = build_codebook_maps(self._task)
        self._sampler = sampler = _EpisodeSampler(
            self.maps, self.num_envs, is_many=self._task.has_many_scenes
        )
        check_num_envs(self.num_envs, self.max_episode_steps, sampler.packing)
        self._episodes = VectorEpisodes(
            sampler,
            self.num_envs,
            self.max_episode_steps,
            self.autoreset_mode,
            copy,
            infos,
            sampler.packing.actions,
        )

        made: dict[str, Any] = {
            **arguments,
            "codebook": self._task.codebook,
        }  # of a dict, one for all of them
        self._singles = SingleEnvs(
            self,
            partial(IrsNavCodebookEnv, render_mode=render_mode, infos=infos, **made),
            self._snapshot,
        )

        self.single_action_space: spaces.Discrete = spaces.Discrete(sampler.packing.actions)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.single_observation_space = sampler.packing.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def task(self) -> CodebookTask:
        """The arguments."""
        return self._task

    @property
    def packing(self) -> CodebookPacking:
        """Layout of the observations."""
        return self._sampler.packing

    def world_of(self, i: int) -> World:
        """World of `IrsNav-v0` with the map of the present configuration of robot i."""
        return self._episodes.scene_and_goal(i)[0]

    def ends_of(self, i: int) -> Ends:
        """Scene, first configuration, start and goal of the episode of robot i."""
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
        self, actions: NDArray[np.integer[Any]]
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Move every robot once, or switch its panel; see `IrsNavCodebookEnv`."""
        return self._episodes.step(actions)

    def paths(self) -> list[list[Cell]]:
        """Cells (i, j) of each robot's episode; see `IrsNavVectorEnv.paths`."""
        return self._episodes.paths()

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused, bool ``(n, 8 + K)``."""
        return self._episodes.action_masks()

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What a method (or attribute) of each single environment gives, as `SyncVectorEnv.call`.

        Raises ``AttributeError`` where there is none, or where it would move one environment alone.
        """
        return self._singles.call(name, *args, **kwargs)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each single environment: ``oracle``, ``path``, ``configuration`` ..., as
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
        ends = self.ends_of(i)
        states = self._sampler.own_states(self._episodes.history(i), ends)

        return codebook_picture(mode, self.maps, ends, joint_path(self.maps, ends), states)

    def _snapshot(self, i: int) -> tuple[Snapshot, list[Any]]:
        """Where the episode of robot i stands, and its states so far."""
        snapshot, _ = self._episodes.snapshot(i)
        ends = self.ends_of(i)
        states = self._sampler.own_states(self._episodes.history(i), ends)
        configurations, cells = np.divmod(states, self.maps.size)
        is_switch = np.diff(configurations) != 0  # (T - 1,)
        first = ends.configuration * self.maps.size + self.maps.grid(ends.scene).flat(ends.start)

        return (
            snapshot._replace(
                rules=self.maps.fingerprint,
                start=first,
                goal=self.maps.grid(ends.scene).flat(ends.goal),
                cell=int(states[-1]),
                refused=int(np.count_nonzero(states[1:] == states[:-1])),
                switches=int(np.count_nonzero(is_switch)),
                metres=self._sampler.metres(cells),
            ),
            states.tolist(),
        )


def make_vector_env(render_mode: str | None = None, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    """What `gymnasium.make_vec` calls: an `IrsNavCodebookVectorEnv` in any mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavCodebookVectorEnv, **arguments), render_mode, Window, FrameCollection
    )


class _EpisodeSampler:
    """Starts episodes; `irs_gym.vector.protocols.EpisodeSampler` describes its attributes and
    methods.
    """

    def __init__(self, maps: CodebookMaps, num_envs: int, *, is_many: bool) -> None:
        self.maps = maps
        self.is_many = is_many
        self.transition_model: CodebookModel = model_of(own_rules(maps))
        self.packing = self.transition_model.packing
        self.is_random = is_many or bool(maps.rules.random_start)
        self.rules = maps.rules
        self.cell_size = maps.cell_size
        self.is_violable = maps.rules.constraint == "allow"
        self.map_shape = maps.shape
        self.info_values = codebook_values(has_many_scenes=is_many)
        first = choose_ends(maps, 0, {"start": maps.own_start(0)}, np.random.default_rng)
        self.ends: list[Ends] = [first] * num_envs
        self._first_state = self._state(first)
        self._is_at_home = True  # whether all episodes so far have begun in the scene's own start

    def begin(
        self,
        states: States,
        chosen: NDArray[np.int64],
        options: dict[str, Any] | None,
        rng: RngOf,
        budgets: NDArray[np.float64] | None = None,
    ) -> States:
        if not options and not self.is_random and self._is_at_home:  # they all begin alike
            states = states.copy()
            states[chosen] = self._first_state

            return states

        self._is_at_home = False
        given = checked_options(options, *(OPTIONS if self.is_many else OPTIONS[:1]))
        scene_ids = given.pop("scene_id", None)
        if not isinstance(scene_ids, list | tuple | np.ndarray):
            scene_ids = [scene_ids] * len(states)
        if len(scene_ids) != len(states):
            raise ValueError(
                f"scene_id holds {len(scene_ids)} scenes for {len(states)} environments"
            )

        for i in chosen.tolist():
            self.ends[i] = self._ends(scene_ids[i], given, partial(rng, i))

        states = self._restated(states)
        states[chosen] = [self._state(self.ends[i]) for i in chosen.tolist()]

        return states

    def scene_number(self, states: States, i: int) -> int:
        return self.ends[i].scene

    def scene_and_goal(self, states: States, i: int) -> tuple[World, Cell]:
        ends = self.ends[i]
        configuration = int(self.transition_model.configuration(states[[i]])[0])
        return configuration_world(self.maps, ends.scene, configuration), ends.goal

    def own_states(self, history: NDArray[np.int64], ends: Ends) -> NDArray[np.int64]:
        """States ``(T,)`` as a single environment numbers them, for its one scene and goal; where
        no episode has begun, that in which one would.
        """
        if not len(history):
            history = np.array([self._state(ends)])
        return np.asarray(history % (self.maps.configurations * self.maps.size))

    def metres(self, cells: NDArray[np.int64]) -> float:
        """Metres of the moves between flat cells ``(T,)``, added up as an episode adds them."""
        shape = self.maps.shape
        apart = np.abs(np.diff(np.stack(np.divmod(cells, shape[1]), axis=1), axis=0))
        total = 0.0

        for di, dj in apart.tolist():
            total += float(np.hypot(di, dj)) * self.maps.cell_size

        return total

    def _ends(self, scene_id: Any, given: dict[str, Any], rng: Any) -> Ends:
        scene = chosen_scene(self.maps.names, scene_id, rng()) if self.is_many else 0
        return choose_ends(self.maps, scene, given, rng)

    def _state(self, ends: Ends) -> int:
        rules = self.transition_model.rules
        cell = ends.start[0] * self.maps.shape[1] + ends.start[1]
        return int(rules.state(rules.numbers[ends.scene, ends.goal], ends.configuration, cell))

    def _restated(self, states: States) -> States:
        """The states in a model of all scenes with their own goals, and the other goals in use."""
        own = own_rules(self.maps)
        others = dict.fromkeys(
            (ends.scene, ends.goal)
            for ends in set(self.ends)
            if ends.goal != self.maps.own_goal(ends.scene)
        )
        old = self.transition_model.rules
        pairs = (*own.pairs, *others)
        if pairs == old.pairs:
            return states.copy()

        rules = CodebookRules.of(self.maps, pairs) if others else own
        self.transition_model = model_of(rules)
        pair, configuration, cell = old.decode(states)
        # a pair that is no longer in use is that of robots who are just beginning elsewhere
        number = np.array([rules.numbers.get(each, 0) for each in old.pairs])

        return np.asarray(rules.state(number[pair], configuration, cell))
