"""`Outlook`: what a discount makes of the returns on one problem, exactly: why similar routes are hard to tell apart.

A learner that starts out moving at random has to tell a route from one that is a little longer by returns that scatter.
Their scatter under uniformly random moves and the optimum of the discounted problem follow from the transition tables
by linear equations and by value iteration; nothing is sampled.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import spsolve

from irs_gym.dynamics import Transition, tabulate, transition
from irs_gym.oracle import path_length
from irs_gym.task import World

DETOUR = 0.02  # share of the oracle's distance by which the longer of two routes exceeds the other
_TIE = 1e-9  # metres: values this close are equal

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Outlook:
    """Returns on one problem under one discount.

    Attributes
    ----------
    gamma
        Discount factor.
    ratio
        Length of the path that is best under the discounted reward, over the oracle's: 1 where discounting does not
        change what is best.
    spread
        Standard deviation in metres of the discounted return from the start under uniformly random moves.
    episodes
        (spread / detour)**2, with a detour of `DETOUR` times the oracle's distance: how many returns have to be
        averaged before their standard error is as small as the detour.
    """

    gamma: float
    ratio: float
    spread: float
    episodes: float


def outlooks(world: World, gammas: Sequence[float]) -> list[Outlook]:
    """The outlook from a world's start to its goal under each discount."""
    moves, start = transition(world, world.goal), int(np.ravel_multi_index(world.start, world.feasible.shape))
    shortest = float(tabulate(world, world.goal).distance_to_go[world.start])
    found = []
    for gamma in gammas:
        ratio = _length(world, moves, gamma, start) / shortest
        spread = random_spread(moves, gamma, start)
        found.append(Outlook(gamma, ratio, spread, (spread / (DETOUR * shortest)) ** 2))
    return found


def optimal_values(moves: Transition, gamma: float, start: int) -> Floats:
    """Largest discounted return of each flat cell that the start leads to, by value iteration to a fixed point.

    Values of other cells mean nothing: at a discount of 1 those that the goal cannot be reached from have none.
    """
    values, seen = np.zeros(len(moves.next_cell)), reached(moves, start)
    for _ in range(len(values)):
        better = action_values(moves, values, gamma).max(axis=1)
        is_still = np.abs(better - values)[seen].max() <= _TIE / 1e3
        values = better
        if is_still:
            break
    return values


def action_values(moves: Transition, values: Floats, gamma: float) -> Floats:
    """Discounted return ``(X * Y, 8)`` of each move and of the values of the cells thereafter."""
    return np.asarray(moves.reward + gamma * ~moves.is_terminated * values[moves.next_cell])


def random_spread(moves: Transition, gamma: float, start: int) -> float:
    """Standard deviation of the discounted return from a flat cell under uniformly random moves.

    First and second moment, V and M, solve V = E[r] + gamma P V and M = E[r^2 + 2 gamma r V'] + gamma^2 P M, where P
    leads on from moves that do not end the episode (Sobel 1982, "The variance of discounted Markov decision
    processes").
    """
    seen = reached(moves, start)  # elsewhere, a discount of 1 has no finite return
    place = np.zeros(len(moves.next_cell), dtype=np.int64)
    place[seen] = np.arange(len(seen))
    reward, ahead, goes_on = moves.reward[seen], place[moves.next_cell[seen]], ~moves.is_terminated[seen]
    cells, actions = ahead.shape
    rows = np.repeat(np.arange(cells), actions)
    onward = csr_array((goes_on.ravel() / actions, (rows, ahead.ravel())), shape=(cells, cells))
    unit = eye_array(cells, format="csr")
    first = spsolve((unit - gamma * onward).tocsc(), reward.mean(axis=1))
    known = (reward**2 + 2.0 * gamma * reward * goes_on * first[ahead]).mean(axis=1)
    second = spsolve((unit - gamma**2 * onward).tocsc(), known)
    at = int(place[start])
    return float(np.sqrt(max(second[at] - first[at] ** 2, 0.0)))


def reached(moves: Transition, start: int) -> NDArray[np.int64]:
    """Flat cells that moves lead to from the start without ending the episode, the start included, sorted."""
    seen = np.zeros(len(moves.next_cell), dtype=bool)
    seen[start], new = True, np.array([start])
    while len(new):
        ahead = np.unique(moves.next_cell[new][~moves.is_terminated[new]])
        new = ahead[~seen[ahead]]
        seen[new] = True
    return np.flatnonzero(seen)


def _length(world: World, moves: Transition, gamma: float, start: int) -> float:
    """Length in metres of the greedy path, the first of equal moves taken; infinite where it misses the goal."""
    best = action_values(moves, optimal_values(moves, gamma, start), gamma)
    choice = (best >= best.max(axis=1, keepdims=True) - _TIE).argmax(axis=1)
    cells, goal = [start], int(np.ravel_multi_index(world.goal, world.feasible.shape))
    while cells[-1] != goal and len(cells) <= len(best):
        cells.append(int(moves.next_cell[cells[-1], choice[cells[-1]]]))
    if cells[-1] != goal:
        return float("inf")
    path = np.stack(np.unravel_index(cells, world.feasible.shape), axis=-1)
    return path_length(path, world.radio_map.grid.cell_size)
