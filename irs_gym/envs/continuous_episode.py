"""`ContinuousEpisode`: one robot on its way anywhere on the floor, step by step."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from irs_gym.mdp.budget import can_pay, cleared, payable, scaled_amount
from irs_gym.mdp.continuous_ends import (
    ContinuousEnds,
    cells_to_go,
    oracle_distance,
    oracle_distances,
    oracle_points,
)
from irs_gym.mdp.continuous_maps import ContinuousMaps, Point
from irs_gym.mdp.continuous_rules import Move, checked_heading, site_of, step_reward
from irs_gym.mdp.continuous_snapshot import ContinuousSnapshot
from irs_gym.mdp.observation import build_observer
from irs_gym.mdp.task import World
from irs_gym.rendering.continuous_view import continuous_picture
from irs_gym.vector.continuous_infos import CONTINUOUS_KEYS
from irs_gym.vector.infos import BUDGET_VALUES

Floats = NDArray[np.float64]


class ContinuousEpisode:
    """What has become of a robot since its reset; see `IrsNavContinuousEnv` for the rules."""

    def __init__(
        self,
        maps: ContinuousMaps,
        ends: ContinuousEnds,
        keys: Sequence[str] = CONTINUOUS_KEYS,
        budget: float | None = None,
    ) -> None:
        """Begin between two ends that can be joined; ``keys``: those of the infos. ``budget``: the
        total cost that the episode may come to, where the rules hold one.
        """
        self.maps = maps
        self.ends = ends
        self.site = site_of(maps, ends.scene, ends.goal)
        self.world: World = maps.world(ends.scene)
        self.observer = build_observer(self.world, self.world.goal)
        self.is_running = True
        known = (*CONTINUOUS_KEYS, *(() if budget is None else BUDGET_VALUES))
        self._unwanted = [key for key in known if key not in keys]
        self._x, self._y = ends.start
        self._path = [ends.start]
        self._away = self._to_centre(*ends.start)
        self._target_db = float(maps.target_db[ends.scene])
        self._origin = maps.grid(ends.scene).origin
        self._budget = budget
        self._left = budget
        self._oracle_distance = oracle_distance(maps, ends)
        self._distance = 0.0
        self._seconds = 0.0
        self._steps = 0
        self._refused = 0
        self._has_violated = False

    @property
    def at(self) -> Point:
        """Where the robot is, in cells."""
        return self._x, self._y

    @property
    def position(self) -> Floats:
        """Where the robot is, ``(2,)`` in metres."""
        return self.maps.in_metres(self.ends.scene, self.at)

    @property
    def path(self) -> Floats:
        """Where the robot has been, one point a step and the first, ``(T, 2)`` in metres."""
        return self.maps.in_metres(self.ends.scene, self._path)

    @property
    def oracle_path(self) -> Floats:
        """The shortest polyline to the goal's centre over cells, ``(k, 2)`` in metres."""
        return self.maps.in_metres(self.ends.scene, oracle_points(self.maps, self.ends))

    @property
    def path_to_go(self) -> Floats:
        """Likewise from where the robot is; ``(0, 2)`` where there is none."""
        to_go = cells_to_go(self.maps, self.ends.scene, self.ends.goal)
        return self.maps.in_metres(self.ends.scene, to_go.path(np.array(self.at)))

    @property
    def distance_to_go(self) -> float:
        """Metres from here to the goal's disc; inf where it cannot be reached."""
        here = np.array([self.at])
        return float(oracle_distances(self.maps, self.ends.scene, here, self.ends.goal)[0])

    def snapshot(self) -> ContinuousSnapshot:
        """Where the episode stands."""
        return ContinuousSnapshot(
            rules=self.maps.fingerprint,
            scene=self.ends.scene,
            start=self.ends.start,
            goal=self.ends.goal,
            at=self.at,
            distance=self._distance,
            seconds=self._seconds,
            steps=self._steps,
            refused=self._refused,
            budget=self._budget or 0.0,
            budget_left=self._left or 0.0,
            has_violated=self._has_violated,
            is_running=self.is_running,
        )

    def opening(self) -> tuple[Any, dict[str, Any]]:
        """What a reset returns: the first observation and its info."""
        return self._observe(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move once; returns what an environment's step does."""
        if not self.is_running:
            raise ResetNeeded(
                "the episode has ended, or none has begun: call reset() before step()"
            )

        move = self.site.move(self._x, self._y, *checked_heading(action))
        if self._left is not None:
            move = self._charged(move)

        # where the robot is, and what it took to come there
        self._x = move.x
        self._y = move.y
        self._path.append((move.x, move.y))
        before = self._away
        self._away = self._to_centre(move.x, move.y)
        self._distance += move.moved
        self._seconds += move.share * self.maps.time_step
        self._steps += 1
        self._refused += move.is_refused

        reward = step_reward(self.maps, move.share, before, self._away, move.is_at_goal)
        is_terminated = move.is_at_goal or move.is_violation
        if self._left is None:
            self._has_violated = self._has_violated or move.cost > 0.0
        else:
            reward, is_terminated = self._pay(move, reward, is_terminated)

        self.is_running = not is_terminated
        is_success = move.is_at_goal and not self._has_violated

        return (
            self._observe(),
            reward,
            is_terminated,
            False,
            self._info(move.is_refused, move.cost, is_success),
        )

    def render(self, mode: str | None) -> Any:
        """Picture (uint8, (H, W, 3)) or text of the map with the robot's and the oracle's path;
        None without a mode.
        """
        if mode is None:
            return None
        return continuous_picture(mode, self.maps, self.ends, np.array(self._path))

    def _to_centre(self, x: float, y: float) -> float:
        """Cells to the goal's centre as the crow flies."""
        dx = x - self.ends.goal[0]
        dy = y - self.ends.goal[1]
        return sqrt(dx * dx + dy * dy)

    def _charged(self, move: Move) -> Move:
        """The move with a cost that can be paid; where the budget refuses it, the robot stays for
        the time step, for nothing.
        """
        move = move._replace(cost=float(payable(np.asarray(move.cost))))
        if self.maps.rules.on_exhausted != "refuse" or can_pay(self._left or 0.0, move.cost):
            return move

        return Move(self._x, self._y, 0.0, 1.0, 0.0, True, False, False)

    def _pay(self, move: Move, reward: float, is_terminated: bool) -> tuple[float, bool]:
        """Take a cost out of the budget; the reward of the move, and whether the episode ends.

        Where the budget is exhausted, it may end, and then it is a failure, at the goal as well.
        """
        assert self._left is not None
        self._left = float(cleared(np.asarray(self._left - move.cost)))
        self._has_violated = self._left < 0
        if not self._has_violated or self.maps.rules.on_exhausted == "continue":
            return reward, is_terminated

        return reward - self.maps.rules.goal_bonus * move.is_at_goal, True

    def _observe(self) -> Any:
        columns, rows = self.maps.shape
        i, j = divmod(self.site.cells.cell(self._x, self._y), self.maps.width)
        observation = self.observer.observe((i - 1) * rows + j - 1)
        is_dict = isinstance(observation, dict)
        position = observation["position"] if is_dict else observation[-4:]

        # as `irs_gym.mdp.packing.own_positions` and `vectors_to_goal` of cells
        position[0] = 2.0 * self._x / columns - 1.0
        position[1] = 2.0 * self._y / rows - 1.0
        position[2] = (self.ends.goal[0] - self._x) / columns
        position[3] = (self.ends.goal[1] - self._y) / rows

        if self._left is not None:
            self.observer.packing.set_budget(observation, scaled_amount(self._left))

        return observation

    def _info(
        self, is_refused: bool = False, cost: float = 0.0, is_success: bool = False
    ) -> dict[str, Any]:
        gain_db = self.site.judge.gain_db(self._x, self._y)
        size = self.maps.cell_size
        best = self._oracle_distance
        info = {
            "distance": self._distance,
            "seconds": self._seconds,
            "steps": self._steps,
            "refused": self._refused,
            "is_refused": is_refused,
            "x": self._x * size + self._origin[0],
            "y": self._y * size + self._origin[1],
            "gain_db": gain_db,
            "margin_db": gain_db - self._target_db,
            "cost": cost,
            "is_success": is_success,
            "spl": best / max(best, self._distance) if is_success else 0.0,
            "ratio": self._distance / best if is_success else 0.0,
            "oracle_distance": best,
        }
        if self._left is not None:
            info["budget_left"] = self._left

        for key in self._unwanted:
            del info[key]

        return info


def resume(
    maps: ContinuousMaps,
    snapshot: ContinuousSnapshot,
    keys: Sequence[str],
    path: Sequence[Point] = (),
) -> ContinuousEpisode:
    """The episode of a snapshot, with its points so far where they are known.

    Raises ``ValueError`` for a snapshot of other maps or other rules.
    """
    if snapshot.rules != maps.fingerprint or snapshot.scene >= len(maps):
        raise ValueError(
            "state is of another task: its maps or its rules differ from those of this environment"
        )

    budget = None if maps.rules.budget is None else snapshot.budget
    ends = ContinuousEnds(snapshot.scene, snapshot.start, snapshot.goal)
    episode = ContinuousEpisode(maps, ends, keys, budget)
    episode._left = None if budget is None else snapshot.budget_left
    episode._x, episode._y = snapshot.at
    episode._path = list(path) or [snapshot.at]
    episode._away = episode._to_centre(*snapshot.at)
    episode._distance = snapshot.distance
    episode._seconds = snapshot.seconds
    episode._steps = snapshot.steps
    episode._refused = snapshot.refused
    episode._has_violated = snapshot.has_violated
    episode.is_running = snapshot.is_running

    return episode
