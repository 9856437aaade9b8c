"""Masks as a part of the observation, for a hundred robots at once: none of their moves is refused.

A mask tells which neighbouring cells meet the target, one step of radio information.
"""

import gymnasium
import numpy as np

ROBOTS = 100
STEPS = 200

for uses_mask in (False, True):
    envs = gymnasium.make_vec(
        "irs_gym:IrsNav-v0",
        num_envs=ROBOTS,
        observation="masked",
        random_start=True,
        infos=["is_refused"],
    )
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    refused = 0

    for _ in range(STEPS):
        is_allowed = observations["action_mask"] if uses_mask else np.ones((ROBOTS, 8))
        actions = np.argmax(is_allowed * rng.random((ROBOTS, 8)), axis=1)  # (100,)
        observations, _, _, _, infos = envs.step(actions)
        refused += infos["is_refused"].sum()

    print(f"with masks: {uses_mask}, refused: {refused / (ROBOTS * STEPS):.1%}")
    envs.close()
