"""`ReturnVariance`: what a discount makes of the returns on one problem, exactly.

`best_ratios` gives how far the path of the largest discounted return is from the shortest, from
each start.

A learner that starts out moving at random has to tell a route from one that is a little longer by
returns that scatter. Their scatter under uniformly random moves and the optimum of the discounted
problem follow from the transition tables by linear equations and by value iteration; nothing is
sampled. This is why similar routes are hard to tell apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import spsolve

from agents.rollout.episode import TOLERANCE
from irs_gym.mdp.dynamics import Transition, tabulate, transition
from irs_gym.mdp.task import World

DETOUR = 0.02  # share of the oracle's distance by which the longer of two routes exceeds the other
_TIE = 1e-9  # metres: values this close are equal

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReturnVariance:
    """Returns on one problem under one discount.

    Attributes
    ----------
    gamma
        Discount factor.
    ratio
        Length of the path that is best under the discounted reward, over the oracle's: 1 where
        discounting does not change what is best.
    longer
        From how many of all starts the best path is longer than the oracle's: "10 of 933".
    spread
        Standard deviation in metres of the discounted return from the start under uniformly random
        moves.
    episodes
        (spread / detour)**2, with a detour of `DETOUR` times the oracle's distance: how many
        returns have to be averaged before their standard error is as small as the detour.
    """

    gamma: float
    ratio: float
    longer: str
    spread: float
    episodes: float


def return_variances(world: World, gammas: Sequence[float]) -> list[ReturnVariance]:
    """Returns from a world's start to its goal under each discount."""
    moves = transition(world, world.goal)
    start = world.radio_map.grid.flat(world.start)
    shortest = float(tabulate(world, world.goal).distance_to_go[world.start])
    found = []

    for gamma in gammas:
        ratios = best_ratios(world, gamma)
        spread = random_spread(moves, gamma, start)
        episodes = (spread / (DETOUR * shortest)) ** 2
        found.append(
            ReturnVariance(
                gamma, float(ratios[world.start]), count_longer(ratios), spread, episodes
            )
        )

    return found


def best_ratios(world: World, gamma: float) -> Floats:
    """Length of the path of the largest discounted return over that of the shortest, from each cell
    to the goal.

    Shape ``(X, Y)``: 1 where discounting leaves the best path a shortest one, infinite where the
    best never arrives, NaN where the goal cannot be reached or is reached already. The first of
    equal moves is taken.
    """
    moves = transition(world, world.goal)
    to_go = tabulate(world, world.goal).distance_to_go.ravel()  # (n,), n = X * Y
    is_start = np.isfinite(to_go) & (to_go > 0)

    # The best move of each cell, the cell that it leads to, and its metres.
    start = world.radio_map.grid.flat(world.start)
    best = action_values(moves, optimal_values(moves, gamma, start), gamma)  # (n, 8)
    choice = (best >= best.max(axis=1, keepdims=True) - _TIE).argmax(axis=1)
    every = np.arange(len(best))
    ahead = moves.next_cell[every, choice]
    moved = moves.moved[every, choice]

    # All robots at once; who has not arrived after as many moves as there are cells goes in a
    # circle.
    goal = world.radio_map.grid.flat(world.goal)
    at = every.copy()
    length = np.zeros(len(best))

    for _ in every:
        under_way = np.flatnonzero(is_start & (at != goal))
        if not len(under_way):
            break

        length[under_way] += moved[at[under_way]]
        at[under_way] = ahead[at[under_way]]

    length[at != goal] = np.inf
    ratios = np.full(len(best), np.nan)
    np.divide(length, to_go, out=ratios, where=is_start)

    return ratios.reshape(world.feasible.shape)


def count_longer(ratios: Floats) -> str:
    """How many ratios are above 1, whatever the rounding of sums, of those that are not NaN: "10 of
    933".
    """
    return f"{(ratios > 1.0 + TOLERANCE).sum():,} of {(~np.isnan(ratios)).sum():,}"


def optimal_values(moves: Transition, gamma: float, start: int) -> Floats:
    """Largest discounted return of each flat cell that the start leads to, by value iteration to a
    fixed point.

    Values of other cells mean nothing: at a discount of 1 those that the goal cannot be reached
    from have none.
    """
    values: Floats = np.zeros(len(moves.next_cell))
    seen = reached(moves, start)

    while True:  # to an end: going in circles costs, and the goal can be reached
        better: Floats = action_values(moves, values, gamma).max(axis=1)
        is_still = np.abs(better - values)[seen].max() <= _TIE / 1e3
        values = better
        if is_still:
            return values


def action_values(moves: Transition, values: Floats, gamma: float) -> Floats:
    """Discounted return ``(X * Y, 8)`` of each move and of the values of the cells thereafter."""
    return np.asarray(moves.reward + gamma * ~moves.is_terminated * values[moves.next_cell])


def random_spread(moves: Transition, gamma: float, start: int) -> float:
    """Standard deviation of the discounted return from a flat cell under uniformly random moves.

    First and second moment, V and M, solve V = E[r] + gamma P V and M = E[r^2 + 2 gamma r V'] +
    gamma^2 P M, where P leads on from moves that do not end the episode (Sobel 1982, "The variance
    of discounted Markov decision processes").
    """
    # The transitions among the cells that are reached, numbered anew: elsewhere, a discount of 1
    # has no finite return.
    seen = reached(moves, start)
    place = np.zeros(len(moves.next_cell), dtype=np.int64)
    place[seen] = np.arange(len(seen))
    reward = moves.reward[seen]  # (cells, 8)
    ahead = place[moves.next_cell[seen]]  # (cells, 8)
    goes_on = ~moves.is_terminated[seen]  # (cells, 8)

    # P, (cells, cells)
    cells, actions = ahead.shape
    rows = np.repeat(np.arange(cells), actions)
    onward = csr_array((goes_on.ravel() / actions, (rows, ahead.ravel())), shape=(cells, cells))
    unit = eye_array(cells, format="csr")

    # V, then M, (cells,) each
    first = spsolve((unit - gamma * onward).tocsc(), reward.mean(axis=1))
    known = (reward**2 + 2.0 * gamma * reward * goes_on * first[ahead]).mean(axis=1)
    second = spsolve((unit - gamma**2 * onward).tocsc(), known)

    # the variance; rounding must not make it negative
    at = int(place[start])
    return float(np.sqrt(max(second[at] - first[at] ** 2, 0.0)))


def reached(moves: Transition, start: int) -> NDArray[np.int64]:
    """Flat cells that moves lead to from the start without ending the episode, the start included,
    sorted.
    """
    seen = np.zeros(len(moves.next_cell), dtype=bool)
    seen[start] = True
    new = np.array([start])

    while len(new):
        ahead = np.unique(moves.next_cell[new][~moves.is_terminated[new]])
        new = ahead[~seen[ahead]]
        seen[new] = True

    return np.flatnonzero(seen)
