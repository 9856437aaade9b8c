"""A pool of small maps with random obstacles, for tests of what learns on many scenes."""

from dataclasses import replace

import numpy as np

from irs_gym.datasets.scene_set import SceneSet
from irs_gym.oracle.shortest_path import distance_to_go


def tiny_pool(
    scenes: int = 6, shape: tuple[int, int] = (9, 7), seed: int = 0, blocked: float = 0.3
) -> SceneSet:
    """Maps in dB, a share of whose cells is blocked or below the target, with a start that reaches
    the goal.
    """
    rng = np.random.default_rng(seed)
    gain_db = rng.normal(-60.0, 1.0, (scenes, *shape))
    target_db = np.quantile(gain_db.reshape(scenes, -1), blocked / 2, axis=1)
    gain_db[rng.random(gain_db.shape) < blocked / 2] = -np.inf
    start, goal = np.zeros((2, scenes, 2), dtype=np.int64)
    to_go = np.empty(gain_db.shape)
    for n in range(scenes):
        feasible = gain_db[n] >= target_db[n]
        while True:
            goal[n] = rng.choice(np.argwhere(feasible))
            to_go[n] = distance_to_go(feasible, tuple(goal[n].tolist()), 0.5)
            can_reach = np.argwhere(np.isfinite(to_go[n]) & (to_go[n] > 1.0))
            if len(can_reach):
                break
        start[n] = rng.choice(can_reach)
    names = tuple(f"tiny-{n}" for n in range(scenes))
    irs = np.full((scenes, 3), -1.0, dtype=np.float32)
    return SceneSet((), names, target_db, gain_db, to_go, irs, start, goal, 0.5)


def resized(pool: SceneSet, cell_size: float) -> SceneSet:
    """The same maps with cells of another size in metres."""
    to_go = pool.distance_to_go / pool.cell_size * cell_size
    return replace(pool, distance_to_go=to_go, cell_size=cell_size)
