"""`read_network`: the policy in a file of arrays, a network over maps or an explorer."""

from typing import Any


def read_network(content: bytes) -> Any:
    """The policy in a file of arrays: that of a network over maps, or an explorer.

    Raises ``NetworkFileError``, a ``ValueError``, where the file holds none.
    """
    from agents.networks.map_network import unpack_network
    from agents.policies.explorer_policy import Explorer
    from agents.policies.map_policy import MapPolicy

    name, settings, network = unpack_network(content)

    return Explorer(settings, network) if name == "explorer" else MapPolicy(name, settings, network)
