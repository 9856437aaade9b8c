"""`IrsNavRandomEnv`: the single environment over many scenes, a thin shell over its episodes."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import HumanRendering, RenderCollection
from numpy.typing import NDArray

from irs_gym.datasets.random_task import (
    RandomTask,
    RandomTaskArguments,
    Worlds,
    build_worlds,
    random_task_of,
)
from irs_gym.envs.episode import Episode, begin, episode_budget, option_names, resume
from irs_gym.grid import Cell
from irs_gym.mdp.checks import (
    METADATA,
    PlainSpec,
    checked_options,
    checked_render_mode,
    checked_seed,
)
from irs_gym.mdp.dynamics import ACTIONS, Transition
from irs_gym.mdp.snapshot import Snapshot
from irs_gym.mdp.task import World, shows_fields
from irs_gym.oracle.shortest_path import Path
from irs_gym.rendering.modes import with_render_mode
from irs_gym.vector.infos import SCENE_KEYS, Infos, budget_keys, checked_keys


class IrsNavRandomEnv(gymnasium.Env[Any, int]):
    """A robot crosses factories that it has never seen while it stays connected to its access
    point.

    ## Description
    The task of `IrsNavEnv`, with another scene at each reset, drawn evenly among those of a split:
    other obstacles, access point and intelligent reflecting surface (IRS), another target, start
    and goal. Every scene has a feasible path, and its exact optimum is known (`oracle`).

    ## Action Space
    ``Discrete(8)``: moves to a neighbouring cell, counter-clockwise from +x: E, NE, N, NW, W, SW,
    S, SE. Diagonal moves may cut corners.

    ## Observation Space
    That of `IrsNavEnv` without phase shifts: float32 in [-1, 1]. All maps are padded with blocked
    cells to one frame, (X, Y) cells, and positions are scaled to it. ``observation="dict"``:

    - ``position`` (4,): own x and y, and the vector to the goal, over the frame's size;
    - ``gain_patch`` (2r+1, 2r+1): margin over the scene's target around the robot in units of 5 dB,
      clipped; first axis along x, second along y; -1 in obstacles and outside;
    - ``irs`` (3,): presence, resolution and number of elements of the scene's IRS.

    ``observation="flat"`` is the same packed as one Box, in the order of
    `gymnasium.spaces.flatten`. ``observation="masked"`` is a Dict of that Box as ``observation``
    and of ``action_mask`` (8,), int8, 1 where an action is not refused. ``observation="map"`` is an
    image (4, X, Y), channels first: margin, obstacle, robot, goal. ``observation="cell"`` is
    ``Discrete(X * Y)``: the robot's cell (i, j) in the frame as i * Y + j, for tables. Under a
    budget, what is left of it is added as in `IrsNavEnv`.

    ## Rewards
    As in `IrsNavEnv`: minus the metres of the move, plus the decrease of the octile distance to the
    goal, plus ``goal_bonus`` at the goal. Under ``"terminate"`` the bonus must be above the detour
    of every scene.

    ## Starting State
    The start of the scene drawn, or with probability ``random_start`` a cell drawn among those from
    which its goal can be reached. ``reset(options={"scene_id": name_or_number})`` chooses the
    scene, ``"start"`` and ``"goal"``, cells (i, j), either end, for one episode.
    ``info["scene_id"]`` is the scene's name, ``info["scene_number"]`` its number.

    ## Episode End
    Terminates at the goal and, under ``constraint="terminate"``, at an attempt to enter a cell
    below the target. Truncated after 400 steps in every split, which is several times an optimal
    path on the largest maps; ``gymnasium.make(..., max_episode_steps=n)`` changes that. `python -m
    eval` scores its policies over max(400, 5 (X + Y)) steps: 400 on the usual maps of 40 x 40
    cells, 800 in ``"ood-size"``. Refused moves are as in `IrsNavEnv`.

    ## Arguments
    Those of the signature. `irs_gym.datasets.random_task.RandomTask` says what each is, but for
    ``infos`` (as in `IrsNavEnv`) and ``render_mode``: ``"rgb_array"`` or ``"ansi"``;
    `gymnasium.make` knows ``"human"``, ``"rgb_array_list"`` and ``"ansi_list"`` as well.

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNavRandom-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA
    spec = PlainSpec()

    @shows_fields(RandomTask)
    def __init__(
        self,
        *,
        render_mode: str | None = None,
        infos: Infos = "all",
        **arguments: Unpack[RandomTaskArguments],
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self.worlds: Worlds = build_worlds(random_task_of(arguments, type(self).__name__))
        rules = self.worlds.task.rules
        self._keys = checked_keys(infos, (*SCENE_KEYS, *budget_keys(rules)))
        self._episode_keys = [key for key in self._keys if key not in SCENE_KEYS]
        self._number = 0  # of the episode's scene

        # Before a reset there are spaces, a map and an oracle already, but no step.
        first = self.worlds.world(0)
        ends = first.start, first.goal
        self._episode = Episode(first, *ends, self._episode_keys, rules.least_budget)
        self._episode.is_running = False
        self.observation_space = self._episode.observer.packing.space
        self.action_space: spaces.Discrete = spaces.Discrete(ACTIONS)  # type: ignore[assignment]

    @property
    def task(self) -> RandomTask:
        """The arguments."""
        return self.worlds.task

    @property
    def world(self) -> World:
        """World of this episode's scene; of the first scene before any."""
        return self._episode.world

    @property
    def radio_map(self) -> Any:
        """The `RadioMap` of this episode's scene, padded to the frame."""
        return self.world.radio_map

    @property
    def oracle(self) -> Path:
        """The shortest feasible path of this episode: ``distance`` in metres, ``cells`` of shape
        ``(D, 2)``.
        """
        return self._episode.oracle

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) of this episode so far, refused moves left out; see `IrsNavEnv.path`."""
        return self._episode.path

    @property
    def distance_to_go(self) -> float:
        """Metres of the shortest feasible path from the robot's cell to the goal; inf where there
        is none.
        """
        return self._episode.distance_to_go

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused here, bool ``(8,)``; see `IrsNavEnv.action_masks`."""
        return self._episode.action_masks()

    def optimal_actions(self, cell: Cell | None = None) -> NDArray[np.int64]:
        """All actions that begin a shortest feasible path, int64 ``(n,)``; see
        `IrsNavEnv.optimal_actions`.
        """
        return self._episode.optimal_actions(cell)

    def transition_table(self) -> Transition:
        """What each action does in each cell of this episode's scene; see
        `IrsNavEnv.transition_table`.
        """
        return self._episode.transition_table()

    def optimal_q(self, gamma: float) -> NDArray[np.float64]:
        """The optimal action values in this episode's scene, ``(X * Y, 8)``; see
        `IrsNavEnv.optimal_q`.
        """
        return self._episode.optimal_q(gamma)

    def get_state(self) -> bytes:
        """Where the episode stands, as 58 bytes for `set_state`; see `IrsNavEnv.get_state`."""
        return self._episode.snapshot(self._number).to_bytes()

    def set_state(self, state: bytes) -> None:
        """Go on from a state, in its scene; see `IrsNavEnv.set_state`."""
        self.take_over(Snapshot.from_bytes(state))

    def take_over(self, snapshot: Snapshot, path: Sequence[Cell] = ()) -> None:
        """Go on with an episode that another environment began, with its path where it is known."""
        if snapshot.scene >= len(self.worlds):
            raise ValueError(
                f"state is of scene {snapshot.scene}, and there are {len(self.worlds)} here"
            )

        world = self.worlds.world(snapshot.scene)
        self._episode = resume(world, snapshot, self._episode_keys, path)
        self._number = snapshot.scene

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in another scene; ``options`` may hold ``scene_id``, ``start`` and
        ``goal``, and under a budget ``budget``.
        """
        super().reset(seed=checked_seed(seed))
        rules = self.worlds.task.rules
        given = checked_options(options, "scene_id", *option_names(rules))
        budget = episode_budget(rules, given.pop("budget", None), self.np_random)
        number = self.worlds.choose(given.pop("scene_id", None), self.np_random)
        world = self.worlds.world(number)
        self._episode = begin(world, given, self.np_random, self._episode_keys, budget)
        self._number = number
        observation, info = self._episode.opening()

        return observation, self._named(info)

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; see the class for what the move does."""
        outcome = self._episode.step(action)
        return *outcome[:-1], self._named(outcome[-1])

    def _named(self, info: dict[str, Any]) -> dict[str, Any]:
        """The info with the scene's number and name."""
        scene = {"scene_number": self._number, "scene_id": self.worlds.pool.names[self._number]}
        return info | {key: value for key, value in scene.items() if key in self._keys}

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path."""
        return self._episode.render(self.render_mode)


def make_env(render_mode: str | None = None, **arguments: Any) -> gymnasium.Env[Any, int]:
    """What `gymnasium.make` calls: an `IrsNavRandomEnv` in any render mode of Gymnasium."""
    return with_render_mode(
        partial(IrsNavRandomEnv, **arguments), render_mode, HumanRendering, RenderCollection
    )
