"""`IrsNavEnv`: the single environment, a thin shell over the tables of the dynamics."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.dynamics import ACTIONS, check_task, draw_start, tables_for
from irs_gym.grid import Cell
from irs_gym.interface import METADATA, RENDERERS, checked_action, checked_options, checked_render_mode, view_of
from irs_gym.observation import build_observer
from irs_gym.oracle import Path, descend
from irs_gym.task import Task, World, build_world, task_of
from irs_gym.trail import Trail


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

    ## Arguments
    The fields of `irs_gym.task.Task`, and ``render_mode`` (``"rgb_array"`` or ``"ansi"``).

    ## Vectorized environment
    ``gymnasium.make_vec("irs_gym:IrsNav-v0", num_envs=n, ...)``.

    ## Version History
    - v0: first version.
    """

    metadata: dict[str, Any] = METADATA

    _cell: int  # flat index
    _trail: list[int]  # flat indices
    _distance: float
    _refused: int
    _has_violated: bool
    _is_running: bool

    def __init__(self, *, render_mode: str | None = None, **arguments: Any) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self.world: World = build_world(task_of(arguments))
        check_task(self.world)
        self._enter(self.world.start, self.world.goal)
        self.observation_space = self._observer.space
        self.action_space: spaces.Discrete = spaces.Discrete(ACTIONS)  # type: ignore[assignment]
        self._is_running = False

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
        return descend(self._tables.distance_to_go, self._start, self.radio_map.grid.cell_size)

    @property
    def path(self) -> Trail:
        """Cells of this episode so far, refused moves left out.

        ``info["path"]`` holds it at termination; the step limit is not this environment's, so read it here then.
        """
        return Trail(np.array(self._trail), self.world.feasible.shape)

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are not refused in this cell, bool ``(8,)``.

        A mask reveals one step of radio information: whether each neighbouring cell meets the target.
        """
        return np.asarray(self._tables.action_mask[self._cell], dtype=bool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``options`` may hold ``start`` and ``goal``, cells (i, j)."""
        super().reset(seed=seed)
        given = checked_options(options)
        goal = given.get("goal", self.world.goal)
        start = given.get("start") or self._draw_start(goal)
        self._enter(start, goal)
        return self._observer.observe(self._cell), {
            **self._info(),
            "oracle_distance": float(self._tables.distance_to_go[start]),
        }

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; see the class for what the move does."""
        if not self._is_running:
            raise ResetNeeded("the episode has ended, or none has begun: call reset() before step()")
        entry = self._cell * ACTIONS + checked_action(action)
        outcome: Any = self._tables.transition.item(entry)
        next_cell, reward, moved, is_refused, cost, is_terminated, is_at_goal = outcome
        self._trail.append(next_cell)
        self._cell = next_cell
        self._distance += moved
        self._refused += is_refused
        self._has_violated = self._has_violated or cost > 0
        self._is_running = not is_terminated
        info = self._info(is_refused, cost, is_at_goal and not self._has_violated)
        if is_terminated:
            info["path"] = self.path
        return self._observer.observe(next_cell), reward, is_terminated, False, info

    def render(self) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path."""
        if self.render_mode is None:
            return None
        return RENDERERS[self.render_mode](view_of(self.world, self._start, self._goal), self.path)

    def _draw_start(self, goal: Cell) -> Cell:
        probability = self.task.random_start
        if probability and (probability == 1 or self.np_random.random() < probability):
            return draw_start(self.world, goal, self.np_random)
        return self.world.start

    def _enter(self, start: Cell, goal: Cell) -> None:
        self._tables = tables_for(self.world, start, goal)
        self._observer = build_observer(self.world, goal)
        self._start, self._goal = start, goal
        self._cell = int(np.ravel_multi_index(start, self.radio_map.grid.shape))
        self._trail = [self._cell]
        self._distance, self._refused = 0.0, 0
        self._has_violated, self._is_running = False, True

    def _info(self, is_refused: bool = False, cost: float = 0.0, is_success: bool = False) -> dict[str, Any]:
        distance_to_go, gain_db, margin_db = self._tables.cell.item(self._cell)
        return {
            "distance": self._distance,
            "refused": self._refused,
            "distance_to_go": distance_to_go,
            "gain_db": gain_db,
            "margin_db": margin_db,
            "action_mask": self._tables.action_mask[self._cell].copy(),
            "is_refused": is_refused,
            "cost": cost,
            "is_success": is_success,
            "spl": self._spl() if is_success else 0.0,
        }

    def _spl(self) -> float:
        """Success weighted by path length (Anderson et al., 2018) of a success; start and goal always differ."""
        shortest = float(self._tables.distance_to_go[self._start])
        return shortest / max(shortest, self._distance)
