"""A random agent beside the oracle: what an episode looks like, and what there is to gain."""

import gymnasium

env = gymnasium.make("irs_gym:IrsNav-v0", target_db=-61.8)
env.action_space.seed(0)


def random_action(info):
    """Any action that is not refused."""
    return env.action_space.sample(mask=info["action_mask"])


def oracle_action(info):
    """The first of the actions that begin a shortest feasible path."""
    return env.unwrapped.optimal_actions()[0]


for policy in (random_action, oracle_action):
    _, info = env.reset(seed=0)
    is_over = False

    while not is_over:
        _, _, terminated, truncated, info = env.step(policy(info))
        is_over = terminated or truncated

    print(
        f"{policy.__name__}: success {info['is_success']}, {info['distance']:.3f} m,"
        f" SPL {info['spl']:.3f}"
    )
