"""`planner_path`, `explorer_path`: where pretrained policies go in a scene, for the workbench.

Entry points of the group ``irs_gym.workbench`` name them; see
`irs_gym.workbench.policy_paths`.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from agents.policies.explorer_policy import Explorer
from agents.rollout.episode import roll_out
from agents.runs.pretrained import load_pretrained
from irs_gym.radio.scene import Scene


def planner_path(scene: Scene) -> NDArray[np.int64]:
    """Cells ``(D, 2)`` that the pretrained planner, which sees the whole map, visits from the
    scene's start.

    Raises ``ValueError`` where the goal cannot be reached, or there is no such model.
    """
    return _path("planner", scene)


def explorer_path(scene: Scene) -> NDArray[np.int64]:
    """Cells ``(D, 2)`` that the pretrained explorer, which sees what is around it, visits from the
    scene's start.

    Raises ``ValueError`` where the goal cannot be reached, or there is no such model.
    """
    return _path("explorer", scene)


def _path(algorithm: str, scene: Scene) -> NDArray[np.int64]:
    pretrained = _load(algorithm)
    env = gymnasium.make(
        "irs_gym:IrsNavRandom-v0", observation=pretrained.env["observation"], scenes=[scene]
    )

    policy = pretrained.policy
    if isinstance(policy, Explorer):  # its memory is as large as the map
        inner: Any = env.unwrapped
        policy = replace(policy, shape=inner.worlds.pool.shape)

    path = roll_out(policy, env).path
    env.close()

    return path.astype(np.int64)


@lru_cache
def _load(algorithm: str) -> Any:
    return load_pretrained(algorithm)
