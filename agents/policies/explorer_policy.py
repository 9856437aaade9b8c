"""`Explorer`: a policy that sees only a patch, remembers it, and plans through the rest by an
`ExplorerNetwork`.
"""

from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.networks.map_network import pack_network
from agents.policies.belief_map import BeliefMap, parts_of
from agents.policies.observation_decoding import decode
from irs_gym.grid import cells_at

Ints = NDArray[np.int64]
_BATCH = 64  # maps in work at a time


@dataclass(frozen=True, eq=False)
class ExplorerState:
    """What n robots know since their reset, and what they are about to do."""

    seen: BeliefMap
    goals: Ints  # (n,), flat
    moves: NDArray[np.uint8]  # (n, X * Y): the move in each cell


@dataclass(frozen=True, eq=False)
class Explorer:
    """Acts on local observations, dict or flat, of `IrsNavRandom-v0`; its state is what it has seen
    in the episode.

    It plans anew whenever it has seen a new cell, and takes the likeliest move, whether or not
    ``deterministic``.

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
        robots, goals = decode(observation, self.shape)
        patches, settings = parts_of(observation)
        at = robots.ravel()
        to = goals.ravel()
        old = self._blank(len(at), patches.shape[-1] // 2) if state is None else state
        if episode_start is not None and np.any(episode_start):
            old = ExplorerState(
                old.seen.forget(np.ravel(episode_start).astype(bool)), old.goals, old.moves
            )

        seen = old.seen.look(cells_at(at, self.shape), patches)
        is_new = np.isnan(old.seen.maps).sum(axis=(1, 2)) != np.isnan(seen.maps).sum(axis=(1, 2))
        changed = np.flatnonzero(is_new | (to != old.goals))
        moves = old.moves.copy()

        for part in np.array_split(changed, -(-len(changed) // _BATCH)) if len(changed) else ():
            moves[part] = self._plan(seen.maps[part], to[part], settings[part])

        return moves[np.arange(len(at)), at].astype(np.int64).reshape(robots.shape), ExplorerState(
            seen, to, moves
        )

    def save(self, file: IO[bytes]) -> None:
        """Write the network's file."""
        file.write(pack_network("explorer", self.settings, self.network))

    def _blank(self, robots: int, radius: int) -> ExplorerState:
        cells = self.shape[0] * self.shape[1]
        seen = BeliefMap.nothing(robots, self.shape, radius)
        return ExplorerState(
            seen, np.full(robots, -1, dtype=np.int64), np.zeros((robots, cells), dtype=np.uint8)
        )

    def _plan(
        self, margin: NDArray[np.float32], goals: Ints, settings: NDArray[np.float32]
    ) -> NDArray[np.uint8]:
        self.network.eval()
        with torch.inference_mode():
            given = (
                np.ascontiguousarray(margin),
                goals,
                np.ascontiguousarray(settings, dtype=np.float32),
            )
            logits = self.network(*map(torch.from_numpy, given)).plan.logits
            return likeliest(logits).flatten(1).numpy()


def likeliest(logits: Tensor) -> Tensor:
    """The move with the greatest logit, of equals the first: uint8 ``(B, X, Y)`` for logits ``(B,
    8, X, Y)``.

    As `torch.argmax`, which takes a quarter of the time of a plan, with strides as long as a map.
    """
    greatest = logits[:, 0].clone()
    move = torch.zeros_like(logits[:, 0], dtype=torch.uint8)

    for number in range(1, logits.shape[1]):
        move.masked_fill_(logits[:, number] > greatest, number)
        torch.maximum(greatest, logits[:, number], out=greatest)

    return move
