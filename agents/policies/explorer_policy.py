"""`Explorer`: a policy that sees only a patch, remembers it, and plans through the rest by an
`ExplorerNetwork`.
"""

from dataclasses import dataclass, replace
from math import prod
from typing import IO, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.networks.explorer import BLOCKED, costs_of_moves
from agents.networks.map_network import first_of_best, pack_network
from agents.networks.planner import UNREACHED, value_iteration
from agents.policies.belief_map import BeliefMap, windows
from irs_gym.grid import MOVE_LENGTHS, MOVES, cells_at, flat_cells, octile_distance
from irs_gym.mdp.packing import DecodedObservation, Packing

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_BATCH = 16  # maps in work at a time

PLAN_STEPS = 4
"""Steps for which a plan holds, as it does on average where explorers learn, unless a cell turns
out to be closed that it may lead through."""
_NOWHERE = -1  # the goal of a robot that has no plan
_ROUNDING = 1e-3  # cells: more than sums of costs lose


@dataclass(frozen=True, eq=False)
class ExplorerState:
    """What n robots know since their reset, and what they make of it.

    Attributes
    ----------
    belief
        What they have seen.
    goals
        Flat cells ``(n,)``.
    cost, to_go
        Of the latest plan of each, float32 ``(n, X + 2, Y + 2)``: what it costs to enter each cell,
        and to go from it to the goal; out of reach in the border around the map.
    reach
        float32 ``(n,)``: cells from which it costs more to go may be said to cost too much.
    age
        Steps that each has taken by it, ``(n,)``.
    has_news
        Whether it has seen a cell since that it had not seen before, bool ``(n,)``.
    """

    belief: BeliefMap
    goals: Ints
    cost: Floats
    to_go: Floats
    reach: Floats
    age: Ints
    has_news: Bools


@dataclass(frozen=True, eq=False)
class Explorer:
    """Acts on local observations, dict or flat, of `IrsNavRandom-v0`; its state is what it has seen
    in the episode.

    It plans anew after `PLAN_STEPS` steps if it has seen a new cell since, and at once where one is
    closed that its way may lead through. It takes the likeliest move, whether or not
    ``deterministic``. What it does in one environment of a batch depends on no other.

    Attributes
    ----------
    settings, network
        Of the `ExplorerNetwork`.
    shape
        Frame (X, Y) that positions are scaled to, as in `agents.policies.replanning.Replanner`:
        (40, 40) in most splits.
    """

    settings: dict[str, Any]
    network: nn.Module
    shape: tuple[int, int] = (40, 40)

    def predict(
        self,
        observation: Any,
        state: ExplorerState | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Ints, ExplorerState]:
        """Actions for one observation or a batch, and what was seen so far; see
        `agents.policies.policy.Policy`.

        Without ``state``, or where ``episode_start``, it knows nothing but what it sees.
        """
        decoded = decode_local(observation, self.shape)
        patches = decoded.margin.reshape(-1, *decoded.margin.shape[-2:])  # (n, 2r+1, 2r+1)
        at = decoded.cell.ravel()  # (n,)
        to = decoded.goal.ravel()  # (n,)

        # What each robot remembers, and nothing in a new episode.
        old = self._blank(len(at), patches.shape[-1] // 2) if state is None else state
        if episode_start is not None and np.any(episode_start):
            begins = np.ravel(episode_start).astype(bool)
            old = replace(
                old, belief=old.belief.forget(begins), goals=np.where(begins, _NOWHERE, old.goals)
            )

        cells = cells_at(at, self.shape)  # (n, 2)
        is_new = np.isnan(old.belief.margin[windows(cells, old.belief.radius)])  # as the patches
        belief = old.belief.look(cells, patches)
        age = old.age + 1
        has_news = old.has_news | is_new.any(axis=(1, 2))

        # A plan holds until it is out of date, is cut off, or does not reach where the robot is.
        cost, to_go, reach = old.cost.copy(), old.to_go.copy(), old.reach.copy()
        here = (np.arange(len(at)), *(cells.T + 1))  # the robots' cells in their frames
        needs_plan = np.flatnonzero(
            (has_news & (age >= PLAN_STEPS))
            | _is_cut_off(cells, to_go, is_new & (patches < 0))
            | (to != old.goals)
            | (to_go[here] > reach)
        )
        age[needs_plan] = 0
        has_news[needs_plan] = False

        # Those with as far to go are planned for together, as they take as many rounds.
        apart = octile_distance(cells[needs_plan] - cells_at(to[needs_plan], self.shape))
        needs_plan = needs_plan[np.argsort(apart, kind="stable")]
        for first in range(0, len(needs_plan), _BATCH):
            part = needs_plan[first : first + _BATCH]
            inner = part, slice(1, -1), slice(1, -1)
            cost[inner], to_go[inner] = self._plan(belief.maps[part], to[part], at[part])

        reach[needs_plan] = to_go[here][needs_plan]
        actions = self._likeliest(cells, cost, to_go)

        state = ExplorerState(belief, to, cost, to_go, reach, age, has_news)
        return actions.reshape(decoded.cell.shape), state

    def save(self, file: IO[bytes]) -> None:
        """Write the network's file."""
        file.write(pack_network("explorer", self.settings, self.network))

    def _blank(self, robots: int, radius: int) -> ExplorerState:
        framed = (robots, self.shape[0] + 2, self.shape[1] + 2)
        return ExplorerState(
            belief=BeliefMap.nothing(robots, self.shape, radius),
            goals=np.full(robots, _NOWHERE),
            cost=np.full(framed, BLOCKED, dtype=np.float32),
            to_go=np.full(framed, UNREACHED, dtype=np.float32),
            reach=np.zeros(robots, dtype=np.float32),
            age=np.zeros(robots, dtype=np.int64),
            has_news=np.zeros(robots, dtype=bool),
        )

    def _plan(self, margin: Floats, goals: Ints, cells: Ints) -> tuple[Floats, Floats]:
        """What cells cost to enter, and to go on from, ``(n, X, Y)`` each."""
        network: Any = self.network.eval()
        margins, to, at = (
            torch.from_numpy(np.ascontiguousarray(each)) for each in (margin, goals, cells)
        )
        with torch.inference_mode():
            prices = network.prices(margins, to)
            to_go = value_iteration(costs_of_moves(prices.cost), prices.is_goal, cells=at)

        return prices.cost.numpy(), to_go.numpy()

    def _likeliest(self, cells: Ints, cost: Floats, to_go: Floats) -> Ints:
        """The first of the best moves of plans from cells ``(n, 2)``, ``(n,)``."""
        frame = cost.shape[1:]
        ahead = flat_cells(cells + 1, frame)[:, None] + flat_cells(MOVES, frame)  # (n, 8)
        there = np.arange(len(cells))[:, None] * prod(frame) + ahead  # in all frames
        worth = MOVE_LENGTHS.astype(np.float32) * cost.take(there) + to_go.take(there)
        worse = worth - worth.min(axis=1, keepdims=True)
        network: Any = self.network

        return first_of_best(-network.log_beta.exp().item() * worse, axis=1)


def _is_cut_off(cells: Ints, to_go: Floats, is_closed: Bools) -> Bools:
    """Whether plans may lead from cells ``(n, 2)`` through one of those that turn out to be closed,
    ``(n, 2r+1, 2r+1)`` around them: bool ``(n,)``.

    As no cell costs less than its length, none is on a best way that is farther from the robot than
    it is nearer to the goal.
    """
    robot, *offset = np.nonzero(is_closed)  # (K,) each
    from_robot = np.stack(offset, axis=1) - is_closed.shape[1] // 2  # (K, 2)
    there = cells[robot] + 1 + from_robot
    is_on_map = ((there >= 0) & (there < to_go.shape[1:])).all(axis=1)
    robot, from_robot, there = robot[is_on_map], from_robot[is_on_map], there[is_on_map]

    nearer = to_go[robot, *(cells[robot].T + 1)] - to_go[robot, *there.T]
    is_cut_off = np.zeros(len(cells), dtype=bool)
    is_cut_off[robot[octile_distance(from_robot) <= nearer + _ROUNDING]] = True

    return is_cut_off


def decode_local(observation: Any, shape: tuple[int, int]) -> DecodedObservation:
    """The parts of one local observation or a batch, in a frame of that shape.

    Raises
    ------
    ValueError
        Where the observation is no local one: a cell, a map, or flat with the phase shifts of
        `IrsNav-v0` between its parts.
    """
    packing = Packing.of(observation, shape)
    if packing.observation != "cell" and packing.side == 0:
        numbers = packing.width if packing.observation == "map" else packing.flat_width
        raise ValueError(
            f"observation has {numbers} numbers: a patch of (2r+1)**2, 3 settings of the IRS and "
            "4 of the position are needed, as IrsNavRandom-v0 has them with observation='flat', "
            "and IrsNav-v0 with irs_phases=False"
        )

    return packing.decode(observation)
