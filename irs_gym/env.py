"""`IrsNavEnv`: the single environment over one scene, a thin shell over its episodes."""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import HumanRendering, RenderCollection
from numpy.typing import NDArray

from irs_gym.dynamics import ACTIONS, check_task
from irs_gym.episode import Episode, begin
from irs_gym.grid import Cell
from irs_gym.infos import Infos, checked_keys
from irs_gym.interface import METADATA, PlainSpec, checked_options, checked_render_mode, checked_seed
from irs_gym.oracle import Path
from irs_gym.rendering.modes import with_render_mode
from irs_gym.task import Task, World, build_world, task_of


class IrsNavEnv(gymnasium.Env[Any, int]):
    """A robot crosses a factory while it stays connected to its access point.

    ## Description
    The floor is a grid of cells. The radio map gives the exact expected channel gain of each, helped by an
    intelligent reflecting surface (IRS). The robot has to reach the goal over cells at or above the target by the
    shortest path; the exact optimum is known (`oracle`).

    ## Action Space
    ``Discrete(8)``: moves to a neighbouring cell, counter-clockwise from +x: E, NE, N, NW, W, SW, S, SE. Diagonal
    moves may cut corners.

    ## Observation Space
    Float32 in [-1, 1]. ``observation="dict"``:

    - ``position`` (4,): own x and y, scaled to the room, and the vector to the goal over the room's size;
    - ``gain_patch`` (2r+1, 2r+1): margin over the target around the robot in units of 5 dB, clipped; first axis
      along x, second along y; -1 in obstacles and outside;
    - ``irs`` (3 + N,): presence, resolution (1 - 2/L) and number of elements (1 - 2/(1 + M/1000)) of the IRS, then
      the phase shift that each of the N sub-surfaces holds for the robot's cell (pi is 0; left out with
      ``irs_phases=False``).

    ``observation="flat"`` is the same packed as one Box, in the order of `gymnasium.spaces.flatten`.
    ``observation="map"`` is an image (4, X, Y), channels first: margin, obstacle, robot, goal.

    ## Rewards
    Minus the metres of the move, plus the decrease of the octile distance to the goal (potential-based shaping, which
    leaves the best path the best), plus ``goal_bonus`` at the goal. The oracle's path has the largest undiscounted
    return of all that satisfy the constraint; under ``"terminate"`` this takes a bonus above the detour,
    which is checked for the task's own start.

    ## Starting State
    The scene's start, or with probability ``random_start`` a cell drawn among those from which the goal can be
    reached. ``reset(options={"start": (i, j), "goal": (i, j)})`` sets either for one episode.

    ## Episode End
    Terminates at the goal and, under ``constraint="terminate"``, at an attempt to enter a cell below the target.
    Truncated after 400 steps; ``gymnasium.make(..., max_episode_steps=n)`` changes that.

    A move into an obstacle or out of the room leaves the robot where it is and costs the move. Cells below the
    target: ``"refuse"`` treats them likewise; ``"allow"`` lets the robot in, with ``info["cost"]`` 1.0 there, and
    the episode is no success.

    ## Info
    The same keys at the reset and at every step, as plain numbers and arrays:

    - ``distance``: metres travelled; ``oracle_distance``: metres of the shortest feasible path from the start;
    - ``margin_db``: gain over the target in this cell;
    - ``action_mask`` (8,): int8, 1 where a move is not refused;
    - ``cost``: 1.0 where the target is missed; ``is_success``: at the goal, without having missed the target;
    - ``spl``: success weighted by path length, 0 until there is success.

    ``infos="all"``, or a list of names, gives also ``refused`` (moves refused so far), ``is_refused`` (the last one),
    ``distance_to_go`` (metres of the shortest feasible path from here, inf where there is none) and ``gain_db``.

    ## Arguments
    The fields of `irs_gym.task.Task`, ``infos``, and ``render_mode`` (``"rgb_array"`` or ``"ansi"``).

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA
    spec = PlainSpec()

    def __init__(self, *, render_mode: str | None = None, infos: Infos = None, **arguments: Any) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self._keys = checked_keys(infos)
        self.world: World = build_world(task_of(arguments, type(self).__name__))
        check_task(self.world)
        self._episode = Episode(self.world, self.world.start, self.world.goal, self._keys)
        self._episode.is_running = False
        self.observation_space = self._episode.observer.packing.space
        self.action_space: spaces.Discrete = spaces.Discrete(ACTIONS)  # type: ignore[assignment]

    @property
    def task(self) -> Task:
        """The arguments."""
        return self.world.task

    @property
    def radio_map(self) -> Any:
        """The `RadioMap`."""
        return self.world.radio_map

    @property
    def oracle(self) -> Path:
        """The shortest feasible path of this episode: ``distance`` in metres, ``cells`` of shape ``(D, 2)``."""
        return self._episode.oracle

    @property
    def path(self) -> list[Cell]:
        """Cells (i, j) of this episode so far, refused moves left out."""
        return self._episode.path

    @property
    def distance_to_go(self) -> float:
        """Metres of the shortest feasible path from the robot's cell to the goal; inf where there is none."""
        return self._episode.distance_to_go

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused in this cell, bool ``(8,)``.

        A mask reveals one step of radio information: whether each neighbouring cell meets the target.
        """
        return self._episode.action_masks()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``options`` may hold ``start`` and ``goal``, cells (i, j)."""
        super().reset(seed=checked_seed(seed))
        self._episode = begin(self.world, checked_options(options), self.np_random, self._keys)
        return self._episode.opening()

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; see the class for what the move does."""
        return self._episode.step(action)

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path."""
        return self._episode.render(self.render_mode)


def make_env(render_mode: str | None = None, **arguments: Any) -> gymnasium.Env[Any, int]:
    """What `gymnasium.make` calls: an `IrsNavEnv` in any render mode of Gymnasium."""
    return with_render_mode(partial(IrsNavEnv, **arguments), render_mode, HumanRendering, RenderCollection)
