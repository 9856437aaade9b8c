"""`optimal_q`: the exact values of all actions under the rules of an environment."""

from math import ceil, log, log2
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.dynamics import Transition

_NEGLIGIBLE = 1e-20  # a reward discounted by this or less counts as nothing
# Relative: an action that gains no more than this is not taken for better, whatever the rounding of
# sums.
_DUST = 1e-13

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def optimal_q(transition: Transition, gamma: float) -> Floats:
    """The optimal action values Q* of a discounted return over deterministic transitions.

    Howard's policy iteration (1960): the value of a policy is exact, as each state has one
    successor, and it is improved until no action is better. The error is that of sums of floats,
    below 1e-10 of the largest value.

    Parameters
    ----------
    transition
        Arrays ``(S, 8)``; see `irs_gym.mdp.dynamics.transition`.
    gamma
        Discount factor, above 0 and up to 1.

    Returns
    -------
    Shape ``(S, 8)``, in metres. Undiscounted, -inf where the episode can never end: each further
    move costs.

    Raises
    ------
    ValueError
        Where ``gamma`` is out of its range.
    """
    gamma = checked_gamma(gamma)
    states = np.arange(len(transition.next_cell))  # (S,)
    # A first guess that ends the episode where one move can; elsewhere the cheapest move.
    policy = np.argmax(np.where(transition.is_terminated, np.inf, transition.reward), axis=1)

    while True:
        # evaluate: what each state is worth under the policy, (S,), and so each action, (S, 8)
        value = policy_value(
            transition.next_cell[states, policy],
            transition.reward[states, policy],
            transition.is_terminated[states, policy],
            gamma,
        )
        ahead = np.where(transition.is_terminated, 0.0, gamma * value[transition.next_cell])
        q = transition.reward + ahead

        # improve: the best action where it is better than the policy's own
        best = q.argmax(axis=1)
        now = q[states, policy]
        then = q[states, best]
        size = np.maximum(1.0, np.where(np.isfinite(now), np.abs(now), 0.0))
        is_better = then > now + _DUST * size  # (S,)
        if not is_better.any():
            return np.asarray(q)

        policy = np.where(is_better, best, policy)


def policy_value(
    next_state: Ints, reward: Floats, is_terminated: NDArray[np.bool_], gamma: float
) -> Floats:
    """Discounted return from each state, where each has one action; all arrays ``(S,)``.

    Returns of 1, 2, 4, 8 ... steps are put together from two halves each, until the rest counts for
    nothing. Without a discount, -inf where the episode does not end within S steps, and so never.
    """
    # Undiscounted, who has not ended within S steps goes round in a circle. Discounted, the steps
    # after which a reward counts for nothing.
    steps = float(len(reward)) if gamma == 1 else max(len(reward), log(_NEGLIGIBLE) / log(gamma))
    gain = reward  # the return of 2**doubling steps, (S,)
    goes_on = ~is_terminated  # whether the episode does after them, (S,)

    for doubling in range(ceil(log2(steps)) + 1):
        gain = gain + np.where(goes_on, gamma**2.0**doubling * gain[next_state], 0.0)
        goes_on = goes_on & goes_on[next_state]
        next_state = next_state[next_state]

    return np.where(goes_on, -np.inf, gain) if gamma == 1 else gain


def checked_gamma(gamma: float) -> float:
    """The discount factor; a ``ValueError`` where it is no number above 0 and up to 1."""
    if isinstance(gamma, bool) or not isinstance(gamma, Real) or not 0 < gamma <= 1:
        raise ValueError(f"gamma={gamma!r} must be a number above 0 and up to 1")
    return float(gamma)
