"""Contenders of `python -m eval speed`: policies that see a patch and plan as they go, in
environments over many scenes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from agents.policies.replanning import Replanner
from agents.runs.pretrained import load_pretrained
from eval.benchmark.benchmark_envs import BenchmarkEnvs
from eval.benchmark.timing import Steps
from irs_gym.grid import MOVE_LENGTHS, MOVES, legal_moves, neighbours
from irs_gym.mdp.packing import Packing
from irs_gym.oracle.shortest_path import distance_to_go

RANDOM_ID = "irs_gym:IrsNavRandom-v0"
REPLANNING = "optimistic replanning"
ANEW = "optimistic replanning, anew whenever a cell closes"
SCENES = 1000

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Memory(NamedTuple):
    """What one robot knows since its reset, and what it is about to do."""

    is_open: Bools  # (X, Y): not seen to be closed
    goal: int  # flat
    moves: Ints  # (X * Y,): the first move of a shortest path
    cell: int  # flat, at the last step


@dataclass(frozen=True, eq=False)
class PlansAnew:
    """What `agents.policies.replanning.Replanner` does, but with a whole run of Dijkstra's
    algorithm whenever a robot sees that a cell is closed: what it is held against.
    """

    shape: tuple[int, int]
    radius: int
    corner_cutting: bool = True

    def predict(
        self,
        observation: Any,
        state: Sequence[Memory | None] | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, list[Memory]]:
        """Actions for a batch, and what was seen so far; see `agents.policies.policy.Policy`."""
        decoded = Packing.of(observation, self.shape, self.radius).decode(observation)
        begins = np.zeros(len(decoded.cell)) if episode_start is None else np.ravel(episode_start)
        olds = [None] * len(begins) if state is None else state
        memories = [
            self._look(None if begins[n] else old, int(cell), int(goal), margin >= 0.0)
            for n, (old, cell, goal, margin) in enumerate(
                zip(olds, decoded.cell, decoded.goal, decoded.margin, strict=True)
            )
        ]

        return np.array([memory.moves[memory.cell] for memory in memories]), memories

    def _look(self, old: Memory | None, cell: int, goal: int, view: Bools) -> Memory:
        # a border as wide as the view, so that all of it finds a place
        is_open = np.ones(self.shape, dtype=bool) if old is None else old.is_open
        floor = np.pad(is_open, self.radius)
        i, j = divmod(cell, self.shape[1])
        side = 2 * self.radius + 1
        floor[i : i + side, j : j + side] &= view
        inner = tuple(slice(self.radius, self.radius + each) for each in self.shape)
        is_open = floor[inner]

        # Without its neighbours in view, it did not see that its move would be refused.
        if self.radius == 0 and old is not None and old.cell == cell:
            is_open[tuple(np.add((i, j), MOVES[old.moves[cell]]))] = False

        if old is not None and old.goal == goal and (is_open == old.is_open).all():
            return old._replace(cell=cell)

        return Memory(is_open, goal, self._moves(is_open, goal), cell)

    def _moves(self, is_open: Bools, goal: int) -> Ints:
        """The first best move in each cell, ``(X * Y,)``."""
        to = divmod(goal, self.shape[1])
        to_go = distance_to_go(is_open, to, 1.0, corner_cutting=self.corner_cutting)
        is_legal = legal_moves(is_open, self.corner_cutting)
        worth = np.where(is_legal, MOVE_LENGTHS + neighbours(to_go, np.inf), np.inf)  # (X, Y, 8)

        return np.asarray(worth.argmin(axis=-1).ravel())


def planners(num_envs: int) -> BenchmarkEnvs:
    """Policies of the local track that act in so many environments over the test scenes, the steps
    of these included.
    """
    return {
        REPLANNING: ("irs_gym", lambda: acting(Replanner((40, 40), 5), num_envs)),
        ANEW: ("irs_gym", lambda: acting(PlansAnew((40, 40), 5), num_envs)),
        "explorer": ("torch", lambda: acting(load_pretrained("explorer").policy, num_envs)),
    }


def acting(policy: Policy, num_envs: int) -> Steps:
    """A policy in environments that begin anew, in another scene, when an episode ends."""
    env: Any = gymnasium.make_vec(
        RANDOM_ID,
        num_envs=num_envs,
        split="test",
        num_scenes=SCENES,
        observation="flat",
        autoreset_mode="SameStep",
    )
    observation, _ = env.reset(seed=0)
    memory = None
    begins = np.ones(num_envs, dtype=bool)

    def steps(calls: int) -> int:
        nonlocal observation, memory, begins
        for _ in range(calls):
            actions, memory = policy.predict(observation, memory, begins, deterministic=True)
            observation, _, terminated, truncated, _ = env.step(actions)
            begins = terminated | truncated

        return calls * num_envs

    return steps
