"""`throughput`: how fast scenes are generated, and how fast many robots move over many of them."""

import os
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from irs_gym.datasets.generator import draw_solved_scene
from irs_gym.envs.random_vector_nav import IrsNavRandomVectorEnv

MAPS = 1000
ROUNDS = 5


def throughput(scenes: int = 40, seconds: float = 1.0) -> dict[str, Any]:
    """Scenes with map and oracle distance a second in this process, and steps a second of the
    vector environment.

    Medians over `ROUNDS`; ``scenes`` are drawn in each, and each vector environment is stepped for
    so many seconds. The load of the machine before it is told along, since all else that runs on it
    slows this down.
    """
    load = os.getloadavg()[0]
    return {
        "load_before": load,
        "scenes_per_second": median(_generate(scenes, n) for n in range(ROUNDS)),
        "steps_per_second": {str(n): _step(n, seconds) for n in (64, 1024)},
        "maps": MAPS,
    }


def _generate(scenes: int, n: int) -> float:
    begin = perf_counter()
    for seed in range(scenes):
        draw_solved_scene(np.random.default_rng([n, seed]))

    return scenes / (perf_counter() - begin)


def _step(robots: int, seconds: float) -> float:
    env = IrsNavRandomVectorEnv(robots, split="test", num_scenes=MAPS, observation="flat")
    env.reset(seed=0)
    actions = np.random.default_rng(0).integers(8, size=(256, robots))
    rates = []

    for _ in range(ROUNDS):
        begin = perf_counter()
        steps = 0

        while (passed := perf_counter() - begin) < seconds:
            for each in actions:
                env.step(each)

            steps += actions.size

        rates.append(steps / passed)

    return median(rates)
