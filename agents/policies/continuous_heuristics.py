"""Reference policies where the robot goes anywhere on the floor: the oracle's polyline, the grid's
path from centre to centre, straight to the goal, and random headings.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from irs_gym.mdp.continuous_ends import ContinuousEnds, oracle_points
from irs_gym.mdp.continuous_maps import ContinuousMaps
from irs_gym.oracle.shortest_path import shortest_path

Floats = NDArray[np.float64]
Line = Callable[[ContinuousMaps, ContinuousEnds], Floats]
"""For the maps of an environment and the ends of an episode, the points to go to one after the
other, ``(k, 2)`` in cells.
"""
_ARRIVED = 1e-9  # cells from a point, and the next one is gone to


@dataclass(frozen=True, eq=False)
class Follower:
    """A policy that goes along a line at full speed, with a shorter step where the line bends.

    It remembers what is left of each robot's line, which is drawn where an episode begins.
    """

    env: Any  # `IrsNavContinuousEnv`, or `IrsNavContinuousVectorEnv`
    line: Line

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Floats, Any]:
        """Actions ``(2,)`` for one robot or ``(n, 2)`` for many, and what is left of their lines.

        Robots are found in the environment, as an observation tells too little of where they are.
        """
        is_many = hasattr(self.env, "num_envs")
        ends = self.env.get_attr("ends") if is_many else [self.env.ends]
        places = self.env.get_attr("position") if is_many else [self.env.position]
        has_begun = np.broadcast_to(True if episode_start is None else episode_start, len(ends))
        maps = self.env.maps
        lines = [
            self.line(maps, each) if state is None or begun else old
            for each, begun, old in zip(ends, has_begun, state or [None] * len(ends), strict=True)
        ]

        actions = []
        for n, (each, place) in enumerate(zip(ends, places, strict=True)):
            here = (place - maps.grid(each.scene).origin) / maps.cell_size
            lines[n] = lines[n][_passed(lines[n], here) :]
            actions.append((lines[n][0] - here) / maps.reach)

        action = np.stack(actions)  # (n, 2), which the environment clips to the unit disc

        return action if is_many else action[0], lines


def _passed(line: Floats, here: Floats) -> int:
    """How many points the robot has arrived at; never the last, which is the goal."""
    is_ahead = np.hypot(*(line - here).T) > _ARRIVED
    return int(is_ahead.argmax()) if is_ahead.any() else len(line) - 1


@dataclass(frozen=True, eq=False)
class RandomHeadings:
    """A policy that draws any action of the space."""

    env: Any
    rng: np.random.Generator

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Floats, Any]:
        """Actions ``(2,)`` or ``(n, 2)``, drawn even where ``deterministic`` is asked for."""
        return self.rng.uniform(-1.0, 1.0, self.env.action_space.shape), state


def _oracle(maps: ContinuousMaps, ends: ContinuousEnds) -> Floats:
    """The shortest polyline over cells."""
    return oracle_points(maps, ends)[1:]


def _grid_oracle(maps: ContinuousMaps, ends: ContinuousEnds) -> Floats:
    """The shortest path over the grid, from centre to centre; to its first, and on from its last,
    straight.
    """
    grid = maps.grid(ends.scene)
    start, goal = (grid.cell_of(tuple(maps.in_metres(ends.scene, each))) for each in ends[1:])
    path = shortest_path(maps.reachable[ends.scene], start, goal, 1.0)
    centres = np.empty((0, 2)) if path is None else path.cells + 0.5

    return np.concatenate([centres, [ends.goal]])


def _straight(maps: ContinuousMaps, ends: ContinuousEnds) -> Floats:
    """Straight to the goal."""
    return np.array([ends.goal])


LINES: dict[str, Line] = {"oracle": _oracle, "grid_oracle": _grid_oracle, "straight": _straight}


def _follower(line: Line) -> Callable[[gymnasium.Env[Any, Any], int | None], Policy]:
    def make(env: gymnasium.Env[Any, Any], seed: int | None = None) -> Policy:
        return Follower(env.unwrapped, line)

    return make


def random(env: gymnasium.Env[Any, Any], seed: int | None = None) -> Policy:
    """Any heading and speed."""
    return RandomHeadings(env.unwrapped, np.random.default_rng(seed))


CONTINUOUS_REFERENCES = {
    **{name: _follower(line) for name, line in LINES.items()},
    "random": random,
}
