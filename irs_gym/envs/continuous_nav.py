"""`IrsNavContinuousEnv`: the single environment whose robot goes anywhere on the floor, a thin
shell over its episodes.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import HumanRendering, RenderCollection
from numpy.typing import NDArray

from irs_gym.datasets.continuous_task import (
    ContinuousTask,
    ContinuousTaskArguments,
    continuous_task_of,
)
from irs_gym.datasets.random_task import chosen_scene
from irs_gym.envs.continuous_episode import ContinuousEpisode, resume
from irs_gym.envs.continuous_worlds import build_continuous_maps
from irs_gym.envs.episode import episode_budget, option_names
from irs_gym.mdp.checks import METADATA, PlainSpec, checked_render_mode, checked_seed
from irs_gym.mdp.continuous_ends import ContinuousEnds, checked_ends, choose_ends
from irs_gym.mdp.continuous_maps import ContinuousMaps, Point
from irs_gym.mdp.continuous_snapshot import ContinuousSnapshot
from irs_gym.mdp.task import World, shows_fields
from irs_gym.rendering.continuous_view import point_at
from irs_gym.rendering.modes import with_render_mode
from irs_gym.vector.continuous_infos import CONTINUOUS_KEYS
from irs_gym.vector.infos import SCENE_KEYS, Infos, budget_keys, checked_keys

Action = NDArray[np.floating[Any]]


class IrsNavContinuousEnv(gymnasium.Env[Any, Action]):
    """A robot crosses a factory on any path at bounded speed, while it stays connected to its
    access point.

    ## Description
    The paper's problem before it lays a grid: a path q(t) with abs(q'(t)) <= V_max that keeps the
    expected channel gain at or above the target at every moment, in the least time. The robot goes
    anywhere on the floor, and the whole segment of each move is judged, not its end alone.

    With ``field="cells"`` the gain at a point is that of its cell, as in `IrsNavEnv`, and the exact
    optimum over all paths is known (`oracle_path`). Cells are closed: a robot may go along the
    border of a cell at or above the target, and pass where two such cells touch at a corner. With
    ``field="exact"`` it is the gain of Lemma 1 at the point itself, and obstacles are as they are;
    a segment is judged at points `irs_gym.mdp.exact_field.RESOLUTION` apart, 1 mm: what is
    below the target for less may be missed.

    ## Action Space
    ``Box(-1, 1, (2,))``: heading and speed. The action, clipped to the unit disc, times ``speed``
    times ``time_step`` is the robot's displacement along x and y. Any finite numbers are taken.

    ## Observation Space
    Float32 in [-1, 1]. ``observation="dict"``:

    - ``position`` (4,): own x and y, scaled to the room, and the vector to the goal's centre over
      the room's size;
    - ``gain_patch`` (2r+1, 2r+1): margin over the target, in units of 5 dB, clipped, in the robot's
      cell and those around it; first axis along x, second along y; -1 in obstacles and outside;
    - ``irs`` (3 + N,): presence, resolution and number of elements of the IRS, then the phase shift
      that each of the N sub-surfaces holds for the robot's cell (left out with
      ``irs_phases=False``).

    ``observation="flat"`` is the same packed as one Box, in the order of
    `gymnasium.spaces.flatten`. ``constraint="budget"`` adds what is left of the budget, as left /
    (1 + abs(left)): the key ``budget`` (1,) of the Dict, the first number of the Box. On the border
    of cells, the robot's is the one of the highest gain.

    ## Rewards
    Minus the seconds of the step times ``speed``, in metres: a whole step costs ``speed`` x
    ``time_step``, however short the move. Plus the decrease of the straight distance to the goal's
    centre (Phi' - Phi), plus ``goal_bonus`` at the goal. The oracle's path at full speed has the
    largest undiscounted return of all that satisfy the constraint; under ``"terminate"`` this takes
    a bonus above the detour, which is checked for the task's own start.

    ## Starting State
    The centre of the scene's start cell, as in `IrsNavEnv`, or with probability ``random_start`` a
    point drawn anywhere on the floor that leads to the goal. ``reset(options={"start": (x, y),
    "goal": (x, y)})`` sets either for one episode, in metres.

    ## Episode End
    Terminates at the goal, the disc of ``goal_radius`` about its centre: where the robot first
    enters it, if the straight line from there to the centre is feasible. Only what the robot needs
    of that step counts. Truncated after 400 steps.

    Obstacles and walls stop the robot where it meets them, and it stands there for the rest of the
    step. Below the target, ``"refuse"`` stops it likewise, on the border; ``"terminate"`` stops it
    and ends the episode, at a cost of 1.0; ``"allow"`` lets it in, ``info["cost"]`` is the seconds
    of the step that were spent below the target, and the episode is no success. With
    ``on_refused="stay"`` a robot that is stopped is where it was before the step.

    ``"budget"`` lets it in as well, and each second has its price, that of `irs_gym.cost_map` for
    its cell: ``info["cost"]``, in multiples of 2**-36. What happens where the ``budget`` is
    exhausted is told in `IrsNavEnv`; nothing is paid for the start itself, and a step that is
    refused lasts its time.

    ## Info
    The same keys at the reset and at every step, as plain numbers:

    - ``distance``: metres travelled; ``seconds`` and ``steps`` so far;
    - ``refused``: moves so far that were stopped; ``is_refused``: whether the last one was;
    - ``x``, ``y``: where the robot is, in metres;
    - ``gain_db``: expected channel gain there; ``margin_db``: gain over the target;
    - ``cost``: of this step; ``is_success``: at the goal, without having missed the target;
    - ``oracle_distance``: metres of the shortest way from the start to the disc, at full speed
      ``speed`` times its seconds. It is exact for ``field="cells"`` where the disc is feasible, as
      the default one is. Under a budget it is that over all free cells, and with ``field="exact"``
      the straight line: bounds that no robot can beat, so that SPL is never too good;
    - ``spl``: success weighted by path length, ``ratio``: distance over ``oracle_distance``; both 0
      until there is success;
    - ``budget_left``: under a budget alone, what is left of it.

    ``infos`` may be a list of the keys that are wanted.

    ## Arguments
    Those of the signature. `irs_gym.datasets.continuous_task.ContinuousTask` says what each is, but
    for ``infos`` and ``render_mode``: ``"rgb_array"`` or ``"ansi"``; `gymnasium.make` knows
    ``"human"``, ``"rgb_array_list"`` and ``"ansi_list"`` as well.

    With ``split`` or ``scenes`` each reset draws another scene, as in `IrsNavRandomEnv`, with the
    option ``scene_id`` of `reset` and the infos ``scene_number`` and ``scene_id``.

    >>> env = gymnasium.make("irs_gym:IrsNavContinuous-v0", target_db=-63.0)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([0.6, 0.8])
    >>> round(info["distance"], 3), round(info["oracle_distance"], 3)
    (0.5, 20.319)

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNavContinuous-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA
    spec = PlainSpec()

    @shows_fields(ContinuousTask)
    def __init__(
        self,
        *,
        render_mode: str | None = None,
        infos: Infos = "all",
        **arguments: Unpack[ContinuousTaskArguments],
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self._task = continuous_task_of(arguments, type(self).__name__)
        self.maps: ContinuousMaps = build_continuous_maps(self._task)
        rules = self.maps.rules
        scene_keys = SCENE_KEYS if self.maps.has_many_scenes else ()
        more = (*scene_keys, *budget_keys(rules))
        self._keys = checked_keys(infos, more, CONTINUOUS_KEYS)

        # Before a reset there are spaces, maps and an oracle already, but no step.
        ends = first_ends(self.maps)
        self._episode = ContinuousEpisode(self.maps, ends, self._keys, rules.least_budget)
        self._episode.is_running = False
        self.observation_space = self._episode.observer.packing.space
        self.action_space: spaces.Box = action_box()  # type: ignore[assignment]

    @property
    def task(self) -> ContinuousTask:
        """The arguments."""
        return self._task

    @property
    def world(self) -> World:
        """World of `IrsNav-v0` with this episode's map."""
        return self._episode.world

    @property
    def radio_map(self) -> Any:
        """The `RadioMap` of this episode."""
        return self.world.radio_map

    @property
    def ends(self) -> ContinuousEnds:
        """Scene, start and goal of this episode, in cells from the map's lower left corner."""
        return self._episode.ends

    @property
    def position(self) -> NDArray[np.float64]:
        """Where the robot is: (x, y) in metres."""
        return self._episode.position

    @property
    def goal(self) -> NDArray[np.float64]:
        """Centre of the goal's disc: (x, y) in metres."""
        return self.maps.in_metres(self.ends.scene, self.ends.goal)

    @property
    def path(self) -> NDArray[np.float64]:
        """Where the robot has been in this episode, one point a step and the first: ``(T, 2)`` in
        metres.
        """
        return self._episode.path

    @property
    def oracle_path(self) -> NDArray[np.float64]:
        """The shortest polyline from the episode's start to the goal's centre over cells at or
        above the target, ``(k, 2)`` in metres; under a budget, over free ones.
        """
        return self._episode.oracle_path

    @property
    def path_to_go(self) -> NDArray[np.float64]:
        """Likewise from where the robot is; ``(0, 2)`` where there is none."""
        return self._episode.path_to_go

    @property
    def distance_to_go(self) -> float:
        """Metres from where the robot is to the goal's disc; inf where it cannot be reached. See
        ``info["oracle_distance"]``.
        """
        return self._episode.distance_to_go

    def get_state(self) -> bytes:
        """Where the episode stands, as bytes for `set_state`; see `IrsNavEnv.get_state`."""
        return self._episode.snapshot().to_bytes()

    def set_state(self, state: bytes) -> None:
        """Go on from a state, in its scene; see `IrsNavEnv.set_state`."""
        self.take_over(ContinuousSnapshot.from_bytes(state))

    def take_over(self, snapshot: ContinuousSnapshot, path: Sequence[Point] = ()) -> None:
        """Go on with an episode that another environment began, with its points so far, in cells,
        where they are known.
        """
        self._episode = resume(self.maps, snapshot, self._keys, path)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``options`` may hold ``start`` and ``goal``, points (x, y) in metres,
        under a budget ``budget`` and, over many scenes, ``scene_id``.
        """
        super().reset(seed=checked_seed(seed))
        given = checked_ends(options, *reset_options(self.maps))
        budget = episode_budget(self.maps.rules, given.pop("budget", None), self.np_random)
        scene = 0
        if self.maps.has_many_scenes:
            scene = chosen_scene(self.maps.names, given.pop("scene_id", None), self.np_random)

        random_start = self.maps.rules.random_start
        ends = choose_ends(self.maps, scene, given, lambda: self.np_random, random_start)
        self._episode = ContinuousEpisode(self.maps, ends, self._keys, budget)
        observation, info = self._episode.opening()

        return observation, self._named(info)

    def step(self, action: Action) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; see the class for what the move does."""
        observation, reward, terminated, truncated, info = self._episode.step(action)
        return observation, reward, terminated, truncated, self._named(info)

    def _named(self, info: dict[str, Any]) -> dict[str, Any]:
        """The info with the scene's number and name, where there are many."""
        if not self.maps.has_many_scenes:
            return info

        number = self._episode.ends.scene
        scene = {"scene_number": number, "scene_id": self.maps.names[number]}

        return info | {key: value for key, value in scene.items() if key in self._keys}

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path."""
        return self._episode.render(self.render_mode)

    def point_at(self, pixel: tuple[float, float]) -> NDArray[np.float64]:
        """The point (x, y) in metres that a pixel of the picture shows: for who steers by mouse."""
        return point_at(self.maps, self.ends, pixel)


def action_box() -> spaces.Box:
    """The space of headings; a new one each time, as a space holds its samples' randomness."""
    return spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)


def reset_options(maps: ContinuousMaps) -> tuple[str, ...]:
    """Options of a reset beside start and goal."""
    scene = ("scene_id",) if maps.has_many_scenes else ()
    return (*option_names(maps.rules), *scene)


def first_ends(maps: ContinuousMaps) -> ContinuousEnds:
    """Ends of the first scene's own episode."""
    return ContinuousEnds(0, maps.own_start(0), maps.own_goal(0))


def make_env(render_mode: str | None = None, **arguments: Any) -> gymnasium.Env[Any, Action]:
    """What `gymnasium.make` calls: an `IrsNavContinuousEnv` in any render mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavContinuousEnv, **arguments), render_mode, HumanRendering, RenderCollection
    )
