"""`PricedVecEnv`: environments whose rewards are less by the price of costs; `play`: what a greedy
policy costs, and how far it goes.
"""

from dataclasses import fields, replace
from inspect import getmembers
from math import inf
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.policies.policy import Policy
from irs_gym.mdp.task import Task


class PricedVecEnv(VecEnvWrapper):
    """Rewards less the multiplier times the cost of the step; what the start costs is the same for
    all policies, and left out.
    """

    def __init__(self, venv: VecEnv, multiplier: float) -> None:
        super().__init__(venv)
        self.multiplier = multiplier

    def __getstate__(self) -> dict[str, Any]:
        """All but the members of the class, which cannot be pickled."""
        return {name: each for name, each in vars(self).items() if name != "class_attributes"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """What a checkpoint holds, with the members of the class."""
        vars(self).update(state, class_attributes=dict(getmembers(type(self))))

    def reset(self) -> Any:
        """Start an episode everywhere."""
        return self.venv.reset()

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Move every robot once."""
        observation, rewards, dones, infos = self.venv.step_wait()
        costs = np.array([info["cost"] for info in infos])  # (n,)

        return observation, (rewards - self.multiplier * costs).astype(np.float32), dones, infos


class Outcome(NamedTuple):
    """What an episode from the fixed start costs, the start included, and its metres; both infinite
    where it does not arrive.
    """

    cost: float
    distance: float


def play(policy: Policy, task: Task) -> Outcome:
    """One greedy episode from the fixed start of a task with a budget, which may be overdrawn."""
    own = replace(task, random_start=False, budget=task.rules.least_budget)
    arguments = {each.name: getattr(own, each.name) for each in fields(own)}
    env = gymnasium.make("irs_gym:IrsNav-v0", **arguments)
    observation, info = env.reset()
    cost = info["cost"]
    is_over = has_arrived = False

    while not is_over:
        action, _ = policy.predict(observation, deterministic=True)
        observation, _, has_arrived, is_truncated, info = env.step(int(action))
        cost = cost + info["cost"]
        is_over = has_arrived or is_truncated

    return Outcome(float(cost), float(info["distance"])) if has_arrived else Outcome(inf, inf)
