"""`Mixture`: a policy that draws one of several for each episode; `least_distance`: how often to
draw each, under a bound on the expected cost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from agents.policies.policy import Policy


@dataclass(frozen=True)
class Weights:
    """The optimum of the restricted master problem, over the policies found so far.

    Attributes
    ----------
    shares
        float64, shape ``(K,)``: how often each policy is drawn.
    distance
        Mean distance in metres.
    multiplier
        Metres that a unit of cost is worth: by how much the mean distance falls with the bound.
    """

    shares: NDArray[np.float64]
    distance: float
    multiplier: float


def least_distance(costs: ArrayLike, distances: ArrayLike, bound: float) -> Weights | None:
    """The shares with the least mean distance whose mean cost is at most the bound; None where no
    policy meets it.

    This is the restricted master problem of Dantzig and Wolfe's decomposition, a linear program,
    whose dual prices the cost.

    Parameters
    ----------
    costs, distances
        Expected costs and distances in metres of K policies, shape ``(K,)``.
    bound
        On the mean cost.

    Examples
    --------
    >>> found = least_distance([26.0, 0.0], [21.5, 25.4], bound=13.0)
    >>> found.shares.tolist(), round(found.distance, 3), round(found.multiplier, 3)
    ([0.5, 0.5], 23.45, 0.15)
    """
    cost = np.asarray(costs, dtype=np.float64)
    if not (cost <= bound).any():
        return None

    found = linprog(
        distances,
        A_ub=cost[None],
        b_ub=[bound],
        A_eq=np.ones((1, len(cost))),
        b_eq=[1.0],
        method="highs",
    )
    if not found.success:
        raise RuntimeError(f"no weights of policies were found: {found.message}")

    return Weights(found.x, float(found.fun), float(-found.ineqlin.marginals[0]))


class Mixture:
    """Draws one of several policies for each episode, and follows it to the end.

    Parameters
    ----------
    policies
        What is drawn from.
    shares
        float64, shape ``(K,)``: how often each is drawn; they sum to 1.
    seed
        Of the draws.
    rounds
        float64, shape ``(R, 3)``: multiplier, cost and distance of each round of the training;
        infinite where its policy did not arrive.
    """

    def __init__(
        self,
        policies: Sequence[Policy],
        shares: NDArray[np.float64],
        seed: int,
        rounds: NDArray[np.float64],
    ) -> None:
        self.policies = tuple(policies)
        self.shares = shares
        self.rounds = rounds
        self._rng = np.random.default_rng(seed)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.int64], Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says; the
        state tells which policy each episode follows.
        """
        chosen = [
            each.predict(observation, deterministic=deterministic)[0] for each in self.policies
        ]
        actions = np.stack(chosen)  # (K,) or (K, n)
        is_first = np.ones(actions.shape[1:] or (1,), dtype=bool)
        if state is None:
            state = np.zeros(is_first.shape, dtype=np.int64)
        elif episode_start is not None:
            is_first = np.atleast_1d(episode_start)
        else:
            is_first = np.zeros_like(is_first)

        if is_first.any():
            drawn = self._rng.choice(len(self.shares), size=is_first.shape, p=self.shares)
            state = np.where(is_first, drawn, state)

        followed = state.reshape(actions.shape[1:])

        return np.take_along_axis(actions, followed[None], axis=0)[0], state
