"""`IrsNavCodebookEnv`: the single environment whose robot also switches the panel's configuration,
a thin shell over its episodes.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import HumanRendering, RenderCollection
from numpy.typing import NDArray

from irs_gym.datasets.codebook_task import (
    CodebookTask,
    CodebookTaskArguments,
    build_codebook_maps,
    codebook_task_of,
)
from irs_gym.datasets.random_task import chosen_scene
from irs_gym.envs.codebook_episode import CodebookEpisode, resume
from irs_gym.grid import Cell
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    checked_options,
    checked_render_mode,
    checked_seed,
)
from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.codebook_rules import CodebookMaps, Ends, choose_ends, switch_cells
from irs_gym.mdp.dynamics import Transition
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World, shows_fields
from irs_gym.oracle.joint import JointPath
from irs_gym.rendering.modes import with_render_mode
from irs_gym.vector.codebook_infos import CODEBOOK_KEYS
from irs_gym.vector.infos import SCENE_KEYS, Infos, checked_keys

OPTIONS = ("configuration", "scene_id")  # of a reset, beside start and goal


class IrsNavCodebookEnv(gymnasium.Env[Any, int]):
    """A robot crosses a factory and switches the reflecting surface's configuration, to stay
    connected to its access point at the least cost.

    ## Description
    The task of `IrsNavEnv`, with the panel in the robot's hands: the intelligent reflecting surface
    (IRS) holds one of the K configurations of a codebook, and there is a radio map for each. The
    robot has to reach the goal over cells at or above the target under the present configuration.
    A switch takes time, and counts as metres. The exact optimum of path and switches together is
    known (`oracle`).

    ## Action Space
    ``Discrete(8 + K)``: moves to a neighbouring cell, counter-clockwise from +x: E, NE, N, NW, W,
    SW, S, SE; then 8 + k, a switch in place into configuration k. Diagonal moves may cut corners,
    unless ``corner_cutting=False``.

    ## Observation Space
    Float32 in [-1, 1]. ``observation="dict"``:

    - ``configuration`` (K,): 1 at the present one, 0 elsewhere;
    - ``gain_patch`` (2r+1, 2r+1): margin over the target around the robot under the present
      configuration, in units of 5 dB, clipped; first axis along x, second along y; -1 in obstacles
      and outside;
    - ``gains`` (K,): the margin in the robot's cell under each configuration, likewise;
    - ``irs`` (3 + N,): presence, resolution and number of elements of the IRS, then the phase shift
      that each of the N sub-surfaces holds (pi is 0), if ``irs_phases=True``: they follow from the
      configuration;
    - ``position`` (4,): own x and y, scaled to the room, and the vector to the goal over the room's
      size.

    ``observation="flat"`` is the same packed as one Box, in the order of
    `gymnasium.spaces.flatten`. ``observation="masked"`` is a Dict of that Box as ``observation``
    and of ``action_mask`` (8 + K,), int8, 1 where an action is not refused. ``observation="cell"``
    is ``Discrete(K * X * Y)``, for tables: configuration k in the cell (i, j) is k * X * Y + i * Y
    + j.

    ## Rewards
    Minus the metres of the move, or ``switch_cost`` for a switch, plus the decrease of the octile
    distance to the goal, plus ``goal_bonus`` at the goal. The oracle's path has the largest
    undiscounted return of all that satisfy the constraint; under ``"terminate"`` this takes a bonus
    above the detour, which is checked.

    ``switch_cost`` is in metres: the robot's speed x the time that the panel takes to be
    reconfigured.

    ## Starting State
    The scene's start in the configuration of the highest gain there, the first of equals, free of
    cost; or with probability ``random_start`` a cell drawn among those from which the goal can be
    reached, and then a configuration among those that lead there from it.
    ``reset(options={"start": (i, j), "goal": (i, j), "configuration": k})`` sets any of them for
    one episode.

    ## Episode End
    Terminates at the goal and, under ``constraint="terminate"``, at an attempt to enter a cell
    below the target under the present configuration, or to switch into a configuration below it
    here. Truncated after 400 steps.

    A move into an obstacle or out of the room, and a switch into the present configuration, lead
    nowhere and cost what they would have cost. What is below the target: ``"refuse"`` treats it
    likewise; ``"allow"`` lets the robot in, with ``info["cost"]`` 1.0 there, and the episode is no
    success.

    ## Info
    The keys of `IrsNavEnv`, and three more. ``distance`` is metres and costs of switches together,
    and so are ``oracle_distance``, ``distance_to_go`` and the ratio in ``spl``; ``action_mask`` has
    8 + K entries.

    - ``configuration``: the present one; ``switches``: how many so far;
    - ``metres``: travelled, without switches.

    ## Arguments
    Those of the signature. `irs_gym.datasets.codebook_task.CodebookTask` says what each is, but for
    ``infos`` (as in `IrsNavEnv`) and ``render_mode``: ``"rgb_array"`` or ``"ansi"``;
    `gymnasium.make` knows ``"human"``, ``"rgb_array_list"`` and ``"ansi_list"`` as well.

    With ``split`` or ``scenes`` each reset draws another scene, as in `IrsNavRandomEnv`, and each
    has a codebook of the same design and size; a scene whose target no joint path holds has the
    highest that some does. The option ``scene_id`` of `reset`, ``info["scene_id"]`` and
    ``info["scene_number"]`` are those of `IrsNavRandomEnv`.

    >>> env = gymnasium.make("irs_gym:IrsNavCodebook-v0", codebook=("dft", 8), target_db=-63.0)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(1)  # north-east
    >>> env.action_space, round(info["distance"], 3), info["switches"]
    (Discrete(16), 0.707, 0)

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNavCodebook-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA
    spec = PlainSpec()

    @shows_fields(CodebookTask)
    def __init__(
        self,
        *,
        render_mode: str | None = None,
        infos: Infos = "all",
        **arguments: Unpack[CodebookTaskArguments],
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self._task = codebook_task_of(arguments, type(self).__name__)
        self.maps: CodebookMaps = build_codebook_maps(self._task)
        scene_keys = SCENE_KEYS if self._task.has_many_scenes else ()
        self._keys = checked_keys(infos, (*CODEBOOK_KEYS, *scene_keys))

        # Before a reset there are spaces, maps and an oracle already, but no step.
        self._episode = CodebookEpisode(self.maps, self._first_ends(), self._keys)
        self._episode.is_running = False
        self.observation_space = self.packing.space
        self.action_space: spaces.Discrete = spaces.Discrete(self.packing.actions)  # type: ignore[assignment]

    def _first_ends(self) -> Ends:
        start = {"start": self.maps.own_start(0)}
        return choose_ends(self.maps, 0, start, lambda: self.np_random)

    @property
    def task(self) -> CodebookTask:
        """The arguments."""
        return self._task

    @property
    def packing(self) -> CodebookPacking:
        """Layout of the observations."""
        return self._episode.rules.packing

    @property
    def world(self) -> World:
        """World of `IrsNav-v0` with the map of the present configuration."""
        return self._episode.world

    @property
    def radio_map(self) -> Any:
        """The `RadioMap` under the present configuration."""
        return self.world.radio_map

    @property
    def configuration(self) -> int:
        """Number of the present configuration."""
        return self._episode.configuration

    @property
    def ends(self) -> Ends:
        """Scene, first configuration, start and goal of this episode."""
        return self._episode.ends

    @property
    def oracle(self) -> JointPath:
        """The path of least metres and switches together of this episode: ``distance`` in metres,
        ``switches``, ``cells`` ``(D, 2)`` and ``configurations`` ``(D,)``.
        """
        return self._episode.oracle

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) of this episode so far, refused actions and switches left out."""
        return self._episode.path

    @property
    def states(self) -> list[int]:
        """Numbers of the states of this episode, one a step and the first; see
        ``observation="cell"``.
        """
        return self._episode.states

    @property
    def switch_cells(self) -> NDArray[np.int64]:
        """Cells (i, j) where the panel has been switched in this episode, ``(switches, 2)``."""
        return switch_cells(np.array(self._episode.states), self.maps)

    @property
    def distance_to_go(self) -> float:
        """Metres to the goal, switches included; inf where it cannot be reached."""
        return self._episode.distance_to_go

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused here, bool ``(8 + K,)``."""
        return self._episode.action_masks()

    def optimal_actions(
        self, cell: Cell | None = None, configuration: int | None = None
    ) -> NDArray[np.int64]:
        """All actions that begin a path of least metres and switches to this episode's goal, in
        ascending order.

        Parameters
        ----------
        cell, configuration
            The cell (i, j) to act from and the panel's configuration; the present ones by default.

        Raises
        ------
        ValueError
            Where there is no such cell or configuration.
        """
        return self._episode.optimal_actions(cell, configuration)

    def transition_table(self) -> Transition:
        """What each action does in each state, for this episode's goal: arrays ``(K * X * Y, 8 +
        K)`` over the states of ``observation="cell"``; see `IrsNavEnv.transition_table`.

        Raises
        ------
        ValueError
            Where the table would take too much memory.
        """
        return self._episode.transition_table()

    def optimal_q(self, gamma: float) -> NDArray[np.float64]:
        """The optimal action values of this episode's goal and reward, ``(K * X * Y, 8 + K)``; see
        `IrsNavEnv.optimal_q`.
        """
        return self._episode.optimal_q(gamma)

    def get_state(self) -> bytes:
        """Where the episode stands, as 70 bytes for `set_state`; see `IrsNavEnv.get_state`."""
        return self._episode.snapshot().to_bytes()

    def set_state(self, state: bytes) -> None:
        """Go on from a state, in its scene; see `IrsNavEnv.set_state`."""
        self.take_over(Snapshot.from_bytes(state, has_switches=True))

    def take_over(self, snapshot: Snapshot, states: Sequence[int] = ()) -> None:
        """Go on with an episode that another environment began, with its states where they are
        known.
        """
        self._episode = resume(self.maps, snapshot, self._keys, states)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``options`` may hold ``start`` and ``goal``, cells (i, j),
        ``configuration`` and, over many scenes, ``scene_id``.
        """
        super().reset(seed=checked_seed(seed))
        given = checked_options(options, *self._options)
        scene = 0
        if self._task.has_many_scenes:
            scene = chosen_scene(self.maps.names, given.pop("scene_id", None), self.np_random)

        ends = choose_ends(self.maps, scene, given, lambda: self.np_random)
        self._episode = CodebookEpisode(self.maps, ends, self._keys)
        observation, info = self._episode.opening()

        return observation, self._named(info)

    @property
    def _options(self) -> tuple[str, ...]:
        return OPTIONS if self._task.has_many_scenes else OPTIONS[:1]

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move or switch once; see the class for what that does."""
        outcome = self._episode.step(action)
        return *outcome[:-1], self._named(outcome[-1])

    def _named(self, info: dict[str, Any]) -> dict[str, Any]:
        """The info with the scene's number and name, where there are many."""
        if not self._task.has_many_scenes:
            return info

        number = self._episode.ends.scene
        scene = {"scene_number": number, "scene_id": self.maps.names[number]}

        return info | {key: value for key, value in scene.items() if key in self._keys}

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the present configuration's map, with the robot's
        and the oracle's path and where each switched.
        """
        return self._episode.render(self.render_mode)


def make_env(render_mode: str | None = None, **arguments: Any) -> gymnasium.Env[Any, int]:
    """What `gymnasium.make` calls: an `IrsNavCodebookEnv` in any render mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavCodebookEnv, **arguments), render_mode, HumanRendering, RenderCollection
    )
