"""`Explorer`: a policy that sees only a patch, remembers it, and plans through the rest by an
`ExplorerNetwork`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import IO, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.networks.explorer import BLOCKED, Kernel
from agents.networks.map_network import first_of_best, pack_network
from agents.networks.planner import UNREACHED, value_iteration_over_cells
from agents.policies.belief_map import BeliefMap, windows
from irs_gym.grid import MOVE_LENGTHS, MOVES, cells_at, flat_cells, octile_distance
from irs_gym.mdp.packing import DecodedObservation, Packing

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_BATCH = 16  # maps in work at a time

PLAN_STEPS = 3
"""Steps for which a plan holds, if not a cell of its way turns out to be closed: with more of them
ways become longer, with fewer they do not become shorter."""
_NOWHERE = -1  # the goal of a robot that has no plan


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

    It plans anew after `PLAN_STEPS` steps if it has seen a new cell since, and at once where one of
    its way is closed. It takes the likeliest move, whether or not ``deterministic``. What it does
    in one environment of a batch depends on no other.

    Attributes
    ----------
    settings, network
        Of the `ExplorerNetwork`, which learns no more once it has acted.
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

        # A plan holds until it is out of date, does not reach where the robot is, or is cut off.
        cost, to_go, reach = old.cost.copy(), old.to_go.copy(), old.reach.copy()
        robots = np.arange(len(at))
        here = (robots, *(cells.T + 1))  # the robots' cells in their frames
        is_over = (to != old.goals) | (to_go[here] > reach) | (has_news & (age >= PLAN_STEPS))
        is_closed = is_new & (patches < 0) & ~is_over[:, None, None]
        is_over |= self._is_cut_off(cells, cost, to_go, is_closed)
        needs_plan = np.flatnonzero(is_over)
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
        actions = self._likeliest(robots, cells, cost, to_go)

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
            prices = network.prices(margins, to, self._kernels)
            to_go = value_iteration_over_cells(prices.cost, prices.is_goal, at)

        return prices.cost.numpy(), to_go.numpy()

    def _is_cut_off(self, cells: Ints, cost: Floats, to_go: Floats, is_closed: Bools) -> Bools:
        """Whether the ways of plans from cells ``(n, 2)`` lead, as far as they are in view, through
        any of those that turn out to be closed, ``(n, 2r+1, 2r+1)`` around them: bool ``(n,)``.
        """
        side = is_closed.shape[1]
        is_cut_off = np.zeros(len(cells), dtype=bool)
        robots = np.flatnonzero(is_closed.any(axis=(1, 2)))
        at = np.full((len(robots), 2), side // 2)  # in the patches around their first cells

        for _ in range(side):
            if not len(robots):
                break

            here = cells[robots] + at - side // 2
            at = at + MOVES[self._likeliest(robots, here, cost, to_go)]
            is_in_view = ((at >= 0) & (at < side)).all(axis=1)
            robots, at = robots[is_in_view], at[is_in_view]

            is_hit = is_closed[robots, *at.T]
            is_cut_off[robots[is_hit]] = True
            robots, at = robots[~is_hit], at[~is_hit]

        return is_cut_off

    def _likeliest(self, robots: Ints, cells: Ints, cost: Floats, to_go: Floats) -> Ints:
        """The first of the best moves of these robots' plans from cells ``(k, 2)``, ``(k,)``."""
        frame = cost.shape[1:]
        ahead = flat_cells(cells + 1, frame)[:, None] + flat_cells(MOVES, frame)  # (k, 8)
        there = robots[:, None] * prod(frame) + ahead  # in all frames
        worth = MOVE_LENGTHS.astype(np.float32) * cost.take(there) + to_go.take(there)
        worse = worth - worth.min(axis=1, keepdims=True)

        return first_of_best(-self._beta * worse, axis=1)

    @cached_property
    def _kernels(self) -> list[Kernel]:
        network: Any = self.network.eval()
        with torch.inference_mode():
            kernels: list[Kernel] = network.kernels()
            return kernels

    @cached_property
    def _beta(self) -> float:
        network: Any = self.network
        return float(network.log_beta.exp().item())


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
