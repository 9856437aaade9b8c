"""`PpoLagrangian`: PPO under a bound on the expected cost, by dual ascent between trainings; and
`PpoLagrangianConfig`.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, fields
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.single.config import check_settings
from agents.single.mixture import Mixture, Weights, least_distance
from agents.single.ppo import PpoConfig
from irs_gym.mdp.task import Rules

if TYPE_CHECKING:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import VecEnv

_EQUAL = 1e-6  # metres: a policy that is better by less is none that was not known


@dataclass(frozen=True, kw_only=True)
class PpoLagrangianConfig(PpoConfig):
    """Settings of Stable-Baselines3's PPO, trained anew in each round at another price of the cost.

    The bound is the budget of the environment, which must be ``constraint="budget"`` with
    ``on_exhausted="continue"`` and one budget for all episodes.
    """

    algorithm: ClassVar[str] = "ppo_lagrangian"

    total_timesteps: int = 3_600_000
    """Steps of all rounds at most."""
    n_envs: int = 256
    """Environments that are stepped together."""
    max_episode_steps: int = 48
    """Steps after which a robot is set elsewhere in training."""
    n_steps: int = 32
    """Steps of each environment between two updates."""
    n_epochs: int = 4
    """Passes over the transitions in an update."""
    round_timesteps: int = 600_000
    """Steps of a round at most, and of the schedule of its learning rate."""
    test_every: int = 8192
    """Least number of steps between two tests of a round's greedy policy."""
    hold: int = 20
    """A round ends early where so many tests in a row have arrived at the same cost and distance.
    """
    first_price: float = 1.0
    """Metres that a unit of cost is worth in the first round that has a price; doubled until a
    policy meets the bound. Far above the optimum's, so that what costs little is clearly best."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_settings(self, "whole", "round_timesteps", "test_every", "hold")
        check_settings(self, "positive", "first_price")
        if self.final_ent_coef is not None:
            raise ValueError(
                f"final_ent_coef={self.final_ent_coef} must be None: in each round ent_coef stays"
            )


def check_bound(rules: Rules) -> None:
    """Raise a ``ValueError`` where an environment has no bound on the expected cost, or ends where
    it is exceeded.
    """
    if rules.constraint != "budget" or rules.on_exhausted != "continue":
        raise ValueError(
            "ppo_lagrangian needs constraint='budget' and on_exhausted='continue', not "
            f"{rules.constraint!r} and {rules.on_exhausted!r}"
        )
    if isinstance(rules.budget, tuple):
        raise ValueError(
            f"ppo_lagrangian bounds the expected cost by one budget, not by budget={rules.budget}"
        )


class PpoLagrangian:
    """Minimises the expected distance under a bound on the expected cost of an episode, by column
    generation (Dantzig and Wolfe 1960; for policies Le, Voloshin and Yue 2019, after Agarwal et al.
    2018), with the methods of a model of Stable-Baselines3.

    Each round trains Stable-Baselines3's PPO with fresh weights, on rewards less the multiplier
    times the cost: the best response to the multiplier. Its greedy policy joins those found. The
    restricted master problem mixes them, and its dual is the next multiplier. It starts at 0; while
    no policy meets the bound, it is ``first_price`` and then doubled. The rounds end where one
    brings no policy that is better, at its multiplier, than the present mixture.

    The optimum is such a mixture, and at its multiplier all that it mixes is worth the same, so
    that one network trained at one multiplier, however well chosen, ends at one of them.

    Attributes
    ----------
    num_timesteps
        Steps trained so far, over all environments and rounds.
    rounds
        Multiplier, cost and distance of each round that has ended; infinite for a policy that did
        not arrive.
    mixture
        What it acts by: the policy in training, and once the rounds have ended, the mixture.
    """

    def __init__(self, config: PpoLagrangianConfig, env: VecEnv, seed: int) -> None:
        self.config = config
        self.num_timesteps = 0
        self.rounds: list[tuple[float, float, float]] = []
        self.logger: Logger | None = None
        self._env = env
        self._seed = seed
        self._task = env.get_attr("task")[0]
        check_bound(self._task.rules)
        self._bound: float = self._task.rules.budget
        self._found: list[tuple[Any, float, float]] = []  # policies, their costs and distances
        self._begin(0.0)

    @classmethod
    def build(cls, config: PpoLagrangianConfig, env: VecEnv, seed: int) -> PpoLagrangian:
        """An untrained one. ``env`` should hold as many environments as the settings say."""
        return cls(config, env, seed)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.int64], Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says."""
        return self.mixture.predict(observation, state, episode_start, deterministic)

    def learn(
        self, total_timesteps: int, callback: BaseCallback, reset_num_timesteps: bool = True
    ) -> PpoLagrangian:
        """Train for so many steps at most, on top of those so far unless ``reset_num_timesteps``:
        then, from the first round on.
        """
        if reset_num_timesteps:
            self.num_timesteps = 0
            self.rounds = []
            self._found = []
            self._begin(0.0)

        end = self.num_timesteps + total_timesteps
        callback.init_callback(self)  # type: ignore[arg-type]  # asks for no more than there is here
        callback.on_training_start({"total_timesteps": end}, {})

        while self._train_round(end, callback):
            multiplier = self._end_round()
            if multiplier is None or self.num_timesteps >= end:
                break

            self._begin(multiplier)

        self._settle()
        callback.on_training_end()

        return self

    def get_env(self) -> VecEnv:
        """The environment that is trained on."""
        return self._env

    def set_logger(self, logger: Logger) -> None:
        """Log to there from now on."""
        self.logger = logger
        self._ppo.set_logger(logger)

    def _begin(self, multiplier: float) -> None:
        """Make the PPO of a round, with weights and random numbers of its own."""
        from agents.single.model import build_model
        from agents.single.priced_vec_env import PricedVecEnv

        own = {each.name: getattr(self.config, each.name) for each in fields(PpoConfig)}
        own["total_timesteps"] = self.config.round_timesteps
        spawned = np.random.SeedSequence([self._seed, len(self.rounds)]).generate_state(1)
        env = PricedVecEnv(self._env, multiplier)
        self._ppo = build_model(PpoConfig(**own), env, int(spawned[0]))
        if self.logger is not None:
            self._ppo.set_logger(self.logger)

        self._multiplier = multiplier
        self._best: tuple[Any, float, float] | None = None  # of this round
        self._latest = (inf, inf)  # cost and distance of its latest test
        self._held = 0
        self._tested_at = 0
        self.mixture = self._alone()

    def _train_round(self, end: int, callback: BaseCallback) -> bool:
        """Train to the end of the round, or of all steps; returns whether nobody has stopped it."""
        from agents.single.round_callback import RoundCallback

        ppo = self._ppo
        before = self.num_timesteps - ppo.num_timesteps
        steps = min(self.config.round_timesteps, end - before) - ppo.num_timesteps
        watch = RoundCallback(self, callback, before)
        ppo.learn(steps, watch, reset_num_timesteps=ppo._last_obs is None)
        self.num_timesteps = before + ppo.num_timesteps

        return not watch.is_stopped

    def is_round_over(self) -> bool:
        """Whether the tests of the round have held one value; tests, where it is time to."""
        if self._ppo.num_timesteps - self._tested_at >= self.config.test_every:
            self._test()

        return self._held >= self.config.hold

    def _test(self) -> None:
        """Play the greedy policy of the round, and keep the best of them."""
        from agents.single.priced_vec_env import play

        self._tested_at = self._ppo.num_timesteps
        outcome = play(self._ppo, self._task)
        is_same = np.allclose(outcome, self._latest, rtol=0.0, atol=_EQUAL)
        self._held = self._held * is_same + 1 if isfinite(outcome.cost) else 0
        self._latest = outcome
        if isfinite(outcome.cost) and (
            self._best is None or self._value(*outcome) < self._value(*self._best[1:]) - _EQUAL
        ):
            self._best = (deepcopy(self._ppo.policy), *outcome)

    def _value(self, cost: float, distance: float) -> float:
        """Metres of an episode and what its cost is worth at the multiplier of the round."""
        return distance + self._multiplier * cost

    def _end_round(self) -> float | None:
        """Add the policy of the round to those found; returns the next multiplier, or None where
        the round has found none that is better than the mixture.
        """
        self._test()
        multiplier = self._multiplier
        if self._best is None:  # the next round tries again, with other weights
            self.rounds.append((multiplier, inf, inf))
            return multiplier

        _, cost, distance = self._best
        self.rounds.append((multiplier, cost, distance))
        before = self._master()
        self._found.append(self._best)
        now = self._master()
        if now is None:
            return max(self.config.first_price, 2.0 * multiplier)

        # by duality the mixture is worth, at its multiplier, what the best policy found is
        if before is not None and self._value(cost, distance) >= (
            before.distance + multiplier * self._bound - _EQUAL
        ):
            return None

        return now.multiplier

    def _master(self) -> Weights | None:
        costs = [cost for _, cost, _ in self._found]
        distances = [distance for _, _, distance in self._found]

        return least_distance(costs, distances, self._bound)

    def _settle(self) -> None:
        """Act by the best mixture of what was found; where none meets the bound, by what costs
        least.
        """
        if not self._found:
            return

        found = self._master()
        policies, costs, _ = zip(*self._found, strict=True)
        shares = np.eye(len(costs))[np.argmin(costs)] if found is None else found.shares
        drawn = np.flatnonzero(shares > 0)
        self.mixture = Mixture(
            [policies[n] for n in drawn], shares[drawn], self._seed, np.array(self.rounds)
        )

    def _alone(self) -> Mixture:
        """The policy in training."""
        return Mixture(
            [self._ppo.policy], np.ones(1), self._seed, np.array(self.rounds).reshape(-1, 3)
        )
