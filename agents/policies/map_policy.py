"""`MapPolicy`: a policy around a network over maps, which is asked once for each map and goal."""

from collections import OrderedDict
from hashlib import blake2b
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from torch import nn

from agents.networks.map_network import STILL, first_of_best, pack_network, plan_alone
from irs_gym.mdp.packing import ROBOT

_REMEMBERED = 2**26  # bytes of logits


class MapPolicy:
    """Acts on the environment's map observation ``(4, X, Y)``, or a batch of them, of any size.

    The network gives the logits of all cells at once, and these are kept as long as the map and the
    goal stay the same: an episode costs one forward pass.

    Parameters
    ----------
    name, settings
        Of the network, see `agents.networks.map_network.build_network`.
    network
        The network.
    seed
        Of the draws where actions are drawn.
    """

    def __init__(
        self, name: str, settings: dict[str, Any], network: nn.Module, seed: int = 0
    ) -> None:
        self.name = name
        self.settings = settings
        self.network = network.eval()
        self._rng = np.random.default_rng(seed)
        self._known: OrderedDict[bytes, NDArray[np.float32]] = OrderedDict()

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.int64], Any]:
        """Actions for one observation or a batch, as `agents.policies.policy.Policy` says: the
        likeliest ones, or drawn. Neither other observations in the batch nor blocked cells around
        a map change them.
        """
        maps = np.asarray(observation, dtype=np.float32)
        batch = maps.reshape(-1, *maps.shape[-3:])  # (n, 4, X, Y)
        cells = batch[:, ROBOT].reshape(len(batch), -1).argmax(axis=1)  # (n,), flat
        plans = self._logits(batch[:, STILL])
        logits = np.stack(
            [each.reshape(8, -1)[:, cell] for each, cell in zip(plans, cells, strict=True)]
        )  # (n, 8)

        # With Gumbel noise, the greatest is a draw from the softmax.
        actions = (
            first_of_best(logits, axis=1)
            if deterministic
            else (logits + self._rng.gumbel(size=logits.shape)).argmax(axis=1)
        )

        return actions.reshape(maps.shape[:-3]), state

    def save(self, file: IO[bytes]) -> None:
        """Write the network's file."""
        file.write(pack_network(self.name, self.settings, self.network))

    def _logits(self, maps: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Logits ``(8, X, Y)`` of each of the maps ``(B, 3, X, Y)``."""
        # Maps are told apart by their content; those not known yet are asked for one by one.
        keys = [blake2b(each.tobytes() + bytes(str(each.shape), "ascii")).digest() for each in maps]
        new = {key: n for n, key in enumerate(keys) if key not in self._known}
        for key, n in new.items():
            self._known[key] = plan_alone(self.network, maps[n])

        for key in keys:
            self._known.move_to_end(key)

        # The least lately asked for are forgotten first.
        found = [self._known[key] for key in keys]
        while len(self._known) > 1 and len(self._known) * found[0].nbytes > _REMEMBERED:
            self._known.popitem(last=False)

        return found
