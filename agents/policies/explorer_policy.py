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

from agents.networks.explorer import Kernels
from agents.networks.map_network import TIE, pack_network
from agents.policies.belief_map import BeliefMap, windows
from agents.policies.path_plan import OFF_PATH, Moves, are_cut_off, plan_paths
from irs_gym.grid import cells_at
from irs_gym.mdp.packing import DecodedObservation, Packing

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_BATCH = 32  # maps in work at a time

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
    moves
        int8, shape ``(n, X * Y)``: those of their paths, as `agents.policies.path_plan.plan_paths`
        has them.
    age
        Steps that each has taken by its plan, ``(n,)``.
    has_news
        Whether it has seen a cell since that it had not seen before, bool ``(n,)``.
    """

    belief: BeliefMap
    goals: Ints
    moves: Moves
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

        # A plan holds until it is out of date, or leads elsewhere, or is cut off.
        moves = old.moves
        robots = np.arange(len(at))
        is_over = (to != old.goals) | (moves[robots, at] < 0) | (has_news & (age >= PLAN_STEPS))
        is_closed = is_new & (patches < 0) & ~is_over[:, None, None]
        is_over |= are_cut_off(moves.reshape(-1, *self.shape), at, is_closed)
        needs_plan = np.flatnonzero(is_over)
        age[needs_plan] = 0
        has_news[needs_plan] = False
        if len(needs_plan):
            moves = moves.copy()

        for first in range(0, len(needs_plan), _BATCH):
            part = needs_plan[first : first + _BATCH]
            moves[part] = self._plan(belief.maps[part], at[part], to[part])

        actions = moves[robots, at].astype(np.int64)
        state = ExplorerState(belief, to, moves, age, has_news)
        return actions.reshape(decoded.cell.shape), state

    def save(self, file: IO[bytes]) -> None:
        """Write the network's file."""
        file.write(pack_network("explorer", self.settings, self.network))

    def _blank(self, robots: int, radius: int) -> ExplorerState:
        return ExplorerState(
            belief=BeliefMap.nothing(robots, self.shape, radius),
            goals=np.full(robots, _NOWHERE),
            moves=np.full((robots, prod(self.shape)), OFF_PATH, dtype=np.int8),
            age=np.zeros(robots, dtype=np.int64),
            has_news=np.zeros(robots, dtype=bool),
        )

    def _plan(self, margin: Floats, cells: Ints, goals: Ints) -> Moves:
        """The moves of paths through maps ``(n, X, Y)``, ``(n, X * Y)``."""
        network: Any = self.network
        if network.training:
            network.eval()

        with torch.inference_mode():
            seen = torch.from_numpy(np.ascontiguousarray(margin))
            prices = network.prices(seen, torch.from_numpy(goals), self._kernels)

        # Moves whose logits would be as good as equal are equally good.
        return plan_paths(prices.cost.contiguous().numpy(), cells, goals, tie=TIE / self._beta)

    @cached_property
    def _kernels(self) -> Kernels:
        network: Any = self.network.eval()
        with torch.inference_mode():
            kernels: Kernels = network.kernels()
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
