"""`roll_out_alike`: the greedy episodes of a policy in scenes of which many look alike for long."""

from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.policy import Policy
from agents.rollout.scene_set import NOTHING, SceneSetResults
from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.vector.many_scenes import build_many_scenes

Ints = NDArray[np.int64]


def roll_out_alike(
    policy: Policy, pool: SceneSet, *, patch_radius: int, max_steps: int
) -> SceneSetResults:
    """Episodes as those of `agents.rollout.scene_set.roll_out_scene_set`, by asking a policy once
    for all scenes that have looked alike to it so far.

    It has to be deterministic. Observations are flat.

    Parameters
    ----------
    policy
        Whoever acts on flat observations.
    pool
        S scenes, with their own starts and goals.
    patch_radius
        Cells that the robot sees in each direction.
    max_steps
        Steps after which an episode ends.
    """
    task = RandomTask(scenes=pool, observation="flat", patch_radius=patch_radius)
    model = build_many_scenes(build_worlds(task))
    states = model.code.encode(np.arange(len(pool)), pool.start, pool.goal)
    distance = np.zeros(len(pool))
    is_success = np.zeros(len(pool), dtype=bool)
    done = np.full((len(pool), max_steps), NOTHING)  # (S, T)

    # scenes that have looked alike, and what the policy remembers of them
    groups: list[tuple[Ints, Any]] = [(np.arange(len(pool)), None)]

    for step in range(max_steps):
        ahead = []
        for group, memory in groups:
            rows = model.observe(states[group])[0]  # (n, D)
            for part in _alike(rows):
                scenes = group[part]
                seen = model.packing.unpack((rows[part[:1]],))
                # each part has a memory of its own, whatever a policy does to it
                actions, after = policy.predict(
                    seen, deepcopy(memory), np.array([step == 0]), deterministic=True
                )
                outcome = model.move(states[scenes], np.repeat(actions, len(scenes)))

                done[scenes, step] = actions
                states[scenes] = outcome.states
                distance[scenes] += outcome.moved
                is_success[scenes] = outcome.is_terminated
                left = scenes[~outcome.is_terminated]
                if len(left):
                    ahead.append((left, after))

        groups = ahead
        if not groups:
            break

    return SceneSetResults(is_success, distance, pool.oracle_distance, done)


def _alike(rows: NDArray[np.float32]) -> list[Ints]:
    """The numbers of equal rows ``(n, D)``, together."""
    _, kind = np.unique(rows, axis=0, return_inverse=True)
    return [np.flatnonzero(kind == each) for each in range(int(kind.max()) + 1)]
