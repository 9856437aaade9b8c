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
from irs_gym.mdp.budget import range_of


@dataclass(frozen=True, kw_only=True)
class PpoLagrangianConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO with a multiplier.

    The bound is the mean budget of the environment, which must be ``constraint="budget"`` with
    ``on_exhausted="continue"``.
    """

    algorithm: ClassVar[str] = "ppo_lagrangian"

    multiplier: float = 0.5
    """Metres that a unit of cost is worth at the start of the schedule."""
    multiplier_rate: float = 0.0005
    """What is added to the multiplier after each rollout for each unit by which the mean cost of
    its episodes is above the bound."""
    spread: float = 1.0
    """How much more an episode with the least budget is charged, and how much less one with the
    largest, as a share of the multiplier."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "weight", "multiplier")
        check_settings(self, "positive", "multiplier_rate")
        check_settings(self, "weight", "spread")


class PpoLagrangian(PPO):
    """Maximises the expected return with a bound on the expected cost of an episode.

    The Lagrangian of the problem is the return minus the multiplier times what the cost exceeds the
    bound by. PPO ascends it in the policy, by a reward less the multiplier times the cost; after
    each rollout the multiplier ascends its dual, lambda <- max(0, lambda + rate (J_C - bound)), as
    PPO-Lagrangian does in Ray, Achiam and Amodei (2019). An excess counts up to the bound itself,
    as far as a lack of cost can go, so that random episodes do not drive the multiplier away.

    The optimum is a mixture of paths, and at its multiplier all of them are worth the same: a
    policy then swings from one to the next. So where the budget is a range, of which each episode
    draws its own and sees it, that draw makes the mixture: episodes are charged lambda (1 + spread
    (1 - 2 u)), or nothing where that is negative, u from 0 at the least budget to 1 at the largest.
    The expected cost is then continuous in lambda.

    Parameters
    ----------
    policy, env, **settings
        Those of Stable-Baselines3's `PPO`. Infos must tell ``"cost"`` and ``"budget_left"``; the
        bound is the mean budget of the environments.
    multiplier, multiplier_rate, spread
        See `PpoLagrangianConfig`.
    """

    def __init__(
        self,
        policy: Any,
        env: VecEnv,
        *,
        multiplier: float = PpoLagrangianConfig.multiplier,
        multiplier_rate: float = PpoLagrangianConfig.multiplier_rate,
        spread: float = PpoLagrangianConfig.spread,
        **settings: Any,
    ) -> None:
        least, largest = budgets_of(env)
        self.bound = (least + largest) / 2
        self.multiplier = multiplier
        self.multiplier_rate = multiplier_rate
        self.spread = spread
        self.priced = PricedVecEnv(env, own_start(env), (least, largest))
        super().__init__(policy, self.priced, **settings)

    def collect_rollouts(self, *arguments: Any, **settings: Any) -> bool:
        """Play at the present price."""
        self.priced.charge(self.multiplier, self.spread)

        return super().collect_rollouts(*arguments, **settings)

    def train(self) -> None:
        """Ascend the dual by the episodes of the rollout, then update the policy."""
        costs = self.priced.take_costs()
        if costs:
            excess = min(float(np.mean(costs)) - self.bound, max(self.bound, 1.0))
            self.multiplier = max(0.0, self.multiplier + self.multiplier_rate * excess)
            self.logger.record("train/cost", float(np.mean(costs)))

        self.logger.record("train/multiplier", self.multiplier)
        super().train()


class PricedVecEnv(VecEnvWrapper):
    """Rewards less the price of the cost of a step, the first with that of the start.

    Parameters
    ----------
    venv
        Environments whose infos tell the ``"cost"``, also at the reset.
    start
        What the infos of the episodes whose costs are wanted tell at the reset; others, from random
        starts, are learned from alone.
    budgets
        The least and the largest budget.
    """

    def __init__(self, venv: VecEnv, start: dict[str, float], budgets: tuple[float, float]) -> None:
        super().__init__(venv)
        self._start = start
        self._budgets = budgets
        self._multiplier = 0.0
        self._spread = 0.0
        self._rank = np.zeros(self.num_envs)  # (n,): of its budget, from 1 for the least to -1
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

    def charge(self, multiplier: float, spread: float) -> None:
        """Set the price of a unit of cost: the multiplier, and its share for the least budget that
        is added, and taken off for the largest.
        """
        self._multiplier = multiplier
        self._spread = spread

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
        prices = self._multiplier * np.maximum(1.0 + self._spread * self._rank, 0.0)  # (n,)
        self._total += costs

        # those that have ended begin anew, in the same step
        self._totals += self._total[dones & self._is_own].tolist()
        self._total[dones] = 0.0
        self._unpaid[:] = 0.0
        self._begin(np.flatnonzero(dones).tolist())

        return observation, (rewards - prices * costs).astype(np.float32), dones, infos

    def _begin(self, chosen: Iterable[int]) -> None:
        """Note what the starts cost, and which are those whose costs are wanted."""
        for i in chosen:
            info = self.venv.reset_infos[i]
            self._unpaid[i] = info["cost"]
            self._rank[i] = self._rank_of(info["budget_left"] + info["cost"])
            self._is_own[i] = all(info[key] == value for key, value in self._start.items())

    def _rank_of(self, budget: float) -> float:
        least, largest = self._budgets

        return 1.0 - 2.0 * (budget - least) / (largest - least) if largest > least else 0.0


def own_start(env: VecEnv) -> dict[str, float]:
    """What infos tell at the task's own start; no other start has the same gain and distances."""
    task = replace(env.get_attr("task")[0], random_start=False)
    arguments = {each.name: getattr(task, each.name) for each in fields(task)}
    _, info = gymnasium.make("irs_gym:IrsNav-v0", **arguments).reset()

    return {key: info[key] for key in ("gain_db", "distance_to_go", "oracle_distance")}


def budgets_of(env: VecEnv) -> tuple[float, float]:
    """The least and the largest budget of environments that count on where it is exhausted.

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

    return range_of(rules.budget)
