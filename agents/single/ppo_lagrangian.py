"""`PpoLagrangian`: PPO under a bound on the expected cost, by dual ascent on a multiplier."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from inspect import getmembers
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.single.config import check_settings
from agents.single.ppo import PpoConfig


@dataclass(frozen=True, kw_only=True)
class PpoLagrangianConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO with a multiplier.

    The bound is the budget of the environment, which must be ``constraint="budget"`` with
    ``on_exhausted="continue"``.
    """

    algorithm: ClassVar[str] = "ppo_lagrangian"

    multiplier_rate: float = 0.0005
    """What is added to the multiplier after each rollout for each unit by which the mean cost of
    its episodes is above the bound."""
    damping: float = 0.004
    """What a unit of cost is charged beside the multiplier for each unit by which the mean cost is
    above the bound at present."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "positive", "multiplier_rate")
        check_settings(self, "weight", "damping")


class PpoLagrangian(PPO):
    """Maximises the expected return with a bound on the expected cost of an episode.

    The Lagrangian of the problem is the return minus the multiplier times what the cost exceeds the
    bound by. PPO ascends it in the policy, by a reward less the price of the cost; after each
    rollout the multiplier ascends its dual, lambda <- max(0, lambda + rate (J_C - bound)), as
    PPO-Lagrangian does in Ray, Achiam and Amodei (2019). The price is the multiplier and a term
    proportional to J_C - bound, which damps its swings (Stooke, Achiam and Abbeel, 2020). An excess
    counts up to the bound itself, as far as a lack of cost can go, so that the first, random
    episodes do not drive the multiplier away.

    Parameters
    ----------
    policy, env, **settings
        Those of Stable-Baselines3's `PPO`. Infos must tell the ``"cost"``; the bound is the budget
        of the environments.
    multiplier_rate, damping
        See `PpoLagrangianConfig`.
    """

    def __init__(
        self,
        policy: Any,
        env: VecEnv,
        *,
        multiplier_rate: float = PpoLagrangianConfig.multiplier_rate,
        damping: float = PpoLagrangianConfig.damping,
        **settings: Any,
    ) -> None:
        self.bound = bound_of(env)
        self.multiplier = 0.0
        self.multiplier_rate = multiplier_rate
        self.damping = damping
        self.priced = PricedVecEnv(env, own_start(env))
        super().__init__(policy, self.priced, **settings)

    def train(self) -> None:
        """Ascend the dual by the episodes of the rollout, then update the policy."""
        costs = self.priced.take_costs()
        if costs:
            excess = min(float(np.mean(costs)) - self.bound, max(self.bound, 1.0))
            self.multiplier = max(0.0, self.multiplier + self.multiplier_rate * excess)
            self.priced.price = max(0.0, self.multiplier + self.damping * excess)
            self.logger.record("train/cost", float(np.mean(costs)))

        self.logger.record("train/multiplier", self.multiplier)
        super().train()


class PricedVecEnv(VecEnvWrapper):
    """Rewards less the ``price`` of the cost of a step, the first with that of the start.

    Parameters
    ----------
    venv
        Environments whose infos tell the ``"cost"``, also at the reset.
    start
        What the infos of the episodes whose costs are wanted tell at the reset; others, from random
        starts, are learned from alone.
    """

    def __init__(self, venv: VecEnv, start: dict[str, float]) -> None:
        super().__init__(venv)
        self.price = 0.0
        self._start = start
        self._is_own = np.zeros(self.num_envs, dtype=bool)  # (n,): whether it began there
        self._unpaid = np.zeros(self.num_envs)  # (n,): what the start costs, until the first step
        self._total = np.zeros(self.num_envs)  # (n,): of the episodes that are under way
        self._totals: list[float] = []  # of those that have ended

    def __getstate__(self) -> dict[str, Any]:
        """All but the members of the class, which cannot be pickled."""
        return {name: each for name, each in vars(self).items() if name != "class_attributes"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """What a checkpoint holds, with the members of the class."""
        vars(self).update(state, class_attributes=dict(getmembers(type(self))))

    def take_costs(self) -> list[float]:
        """The total costs of the episodes that have ended since this was last asked."""
        totals = self._totals
        self._totals = []

        return totals

    def reset(self) -> Any:
        """Start an episode everywhere."""
        observation = self.venv.reset()
        self._unpaid = np.zeros(self.num_envs)
        self._total[:] = 0.0
        self._begin(range(self.num_envs))

        return observation

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Move every robot once."""
        observation, rewards, dones, infos = self.venv.step_wait()
        costs = np.array([info["cost"] for info in infos]) + self._unpaid  # (n,)
        self._total += costs

        # those that have ended begin anew, in the same step
        self._totals += self._total[dones & self._is_own].tolist()
        self._total[dones] = 0.0
        self._unpaid[:] = 0.0
        self._begin(np.flatnonzero(dones).tolist())

        return observation, (rewards - self.price * costs).astype(np.float32), dones, infos

    def _begin(self, chosen: Iterable[int]) -> None:
        """Note what the starts cost, and which are those whose costs are wanted."""
        for i in chosen:
            info = self.venv.reset_infos[i]
            self._unpaid[i] = info["cost"]
            self._is_own[i] = all(info[key] == value for key, value in self._start.items())


def own_start(env: VecEnv) -> dict[str, float]:
    """What infos tell at the task's own start; no other start has the same gain and distances."""
    task = replace(env.get_attr("task")[0], random_start=False)
    arguments = {each.name: getattr(task, each.name) for each in fields(task)}
    _, info = gymnasium.make("irs_gym:IrsNav-v0", **arguments).reset()

    return {key: info[key] for key in ("gain_db", "distance_to_go", "oracle_distance")}


def bound_of(env: VecEnv) -> float:
    """The budget of the environments, which they must count without ending an episode.

    Raises
    ------
    ValueError
        Where they have none, or end where it is exhausted.
    """
    rules = env.get_attr("task")[0].rules
    if rules.constraint != "budget" or rules.on_exhausted != "continue":
        raise ValueError(
            "ppo_lagrangian needs constraint='budget' and on_exhausted='continue', not "
            f"{rules.constraint!r} and {rules.on_exhausted!r}"
        )
    if not isinstance(rules.budget, float):
        raise ValueError(f"ppo_lagrangian needs one budget, not the range {rules.budget}")

    return rules.budget
