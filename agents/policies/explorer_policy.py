"""`Explorer`: a policy that sees only a patch, remembers it, and plans through the rest by an
`ExplorerNetwork`.
"""

from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.networks.map_network import TIE, pack_network
from agents.policies.belief_map import BeliefMap
from agents.policies.traced_prices import traced_prices
from irs_gym.grid import cells_at
from irs_gym.mdp.packing import DecodedObservation, Packing

Ints = NDArray[np.int64]
_BATCH = 64  # maps in work at a time


@dataclass(frozen=True, eq=False)
class ExplorerState:
    """What n robots know since their reset, and what they are about to do."""

    belief: BeliefMap
    goals: Ints  # (n,), flat
    moves: NDArray[np.uint8]  # (n, X * Y): the move in each cell


@dataclass(frozen=True, eq=False)
class Explorer:
    """Acts on local observations, dict or flat, of `IrsNavRandom-v0`; its state is what it has seen
    in the episode.

    It plans anew whenever it has seen a new cell, and takes the likeliest move, whether or not
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
            old = ExplorerState(
                old.belief.forget(np.ravel(episode_start).astype(bool)), old.goals, old.moves
            )

        # A plan holds until something new comes into view.
        belief = old.belief.look(cells_at(at, self.shape), patches)
        unknown, unknown_before = (
            np.isnan(each.maps).sum(axis=(1, 2)) for each in (belief, old.belief)
        )  # (n,), numbers of cells
        changed = np.flatnonzero((unknown != unknown_before) | (to != old.goals))
        moves = old.moves.copy()

        for part in np.array_split(changed, -(-len(changed) // _BATCH)) if len(changed) else ():
            moves[part] = self._plan(belief.maps[part], to[part])

        actions = moves[np.arange(len(at)), at].astype(np.int64)

        return actions.reshape(decoded.cell.shape), ExplorerState(belief, to, moves)

    def save(self, file: IO[bytes]) -> None:
        """Write the network's file."""
        file.write(pack_network("explorer", self.settings, self.network))

    def _blank(self, robots: int, radius: int) -> ExplorerState:
        cells = self.shape[0] * self.shape[1]
        return ExplorerState(
            belief=BeliefMap.nothing(robots, self.shape, radius),
            goals=np.full(robots, -1, dtype=np.int64),
            moves=np.zeros((robots, cells), dtype=np.uint8),
        )

    def _plan(self, margin: NDArray[np.float32], goals: Ints) -> NDArray[np.uint8]:
        network: Any = self.network.eval()
        margins, to = (torch.from_numpy(np.ascontiguousarray(each)) for each in (margin, goals))
        with torch.inference_mode():
            # In a batch, the last digits of convolutions depend on how large that is: prices are
            # asked for one by one. Sums and minima of the plan are the same in any batch.
            prices = [
                traced_prices(network, (margins[n : n + 1], to[n : n + 1]))
                for n in range(len(goals))
            ]
            cost = torch.cat([each.cost for each in prices])  # (n, X, Y)
            is_goal = torch.cat([each.is_goal for each in prices])
            logits = network.plan(cost, is_goal).logits  # (n, 8, X, Y)
            moves: NDArray[np.uint8] = likeliest(logits).flatten(1).numpy()

        return moves


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


def likeliest(logits: Tensor) -> Tensor:
    """The move with the greatest logit, of equals the first: uint8 ``(B, X, Y)`` for logits
    ``(B, 8, X, Y)``.

    Logits are equal where they differ by less than `agents.networks.map_network.TIE`.
    """
    least = logits.amax(dim=1) - TIE
    move = torch.zeros_like(logits[:, 0], dtype=torch.uint8)

    # the first one last, in a quarter of the time of an argmax, with strides as long as a map
    for number in reversed(range(logits.shape[1])):
        move.masked_fill_(logits[:, number] >= least, number)

    return move
