"""What all networks over maps share: what they see (`maps_of`), what they say (`Plan`), and their file.

A file holds plain arrays and a line of JSON; nothing in it is unpickled.
"""

import json
from collections.abc import Mapping
from importlib import import_module
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.arrays import read_arrays
from agents.map_settings import NetworkName
from irs_gym.observation import MARGIN_SCALE_DB
from irs_gym.pool import Pool

STILL = [0, 1, 3]  # channels of the environment's map observation that stay the same while the robot moves
_MOST = 10_000  # layers, channels or rounds
_CLASSES: dict[NetworkName, tuple[str, str]] = {
    "planner": ("agents.planner", "PlanningNetwork"),
    "unet": ("agents.unet", "UNet"),
    "vin": ("agents.vin", "ValueIterationNetwork"),
    "explorer": ("agents.explorer", "ExplorerNetwork"),
}


class NetworkFileError(ValueError):
    """A file that is not a network over maps, or a damaged one."""


class Plan(NamedTuple):
    """What a network says of all cells of its maps at once."""

    logits: Tensor  # (B, 8, X, Y), of the moves in the order of `irs_gym.grid.MOVES`
    to_go: Tensor  # (B, X, Y), its estimate of the way to the goal, in units of its own


def maps_of(pool: Pool, scenes: NDArray[np.int64]) -> Tensor:
    """What networks see of some scenes of a pool: float32 ``(B, 3, X, Y)``.

    The channels are those of the environment's map observation without the robot: margin over the target, obstacle,
    goal.
    """
    maps = np.zeros((len(scenes), 3, *pool.shape), dtype=np.float32)
    margin_db = pool.gain_db[scenes] - pool.target_db[scenes, None, None]
    maps[:, 0] = np.clip(margin_db / MARGIN_SCALE_DB, -1.0, 1.0)
    maps[:, 1] = np.isneginf(margin_db)
    maps[np.arange(len(scenes)), 2, pool.goal[scenes, 0], pool.goal[scenes, 1]] = 1.0
    return torch.from_numpy(maps)


def plan_pool(network: nn.Module, pool: Pool, batch: int = 32) -> NDArray[np.float32]:
    """Logits of a network for all cells of all scenes of a pool: ``(S, 8, X, Y)``."""
    network.eval()
    with torch.inference_mode():
        scenes = np.array_split(np.arange(len(pool)), -(-len(pool) // batch))
        return np.concatenate([network(maps_of(pool, each)).logits.numpy() for each in scenes])


def build_network(name: NetworkName, settings: Mapping[str, Any]) -> nn.Module:
    """A network by its name, untrained; its weights are drawn from PyTorch's random numbers."""
    module, kind = _CLASSES[name]
    network: nn.Module = getattr(import_module(module), kind)(**settings)
    return network


def pack_network(name: NetworkName, settings: Mapping[str, Any], network: nn.Module) -> bytes:
    """A network as the content of a file; equal weights give equal bytes."""
    content = BytesIO()
    header = np.array(json.dumps({"network": name, "settings": dict(settings)}))
    weights = {f"weight:{key}": each.numpy() for key, each in network.state_dict().items()}
    np.savez_compressed(content, header=header, **weights)
    return content.getvalue()


def unpack_network(content: bytes) -> tuple[NetworkName, dict[str, Any], nn.Module]:
    """Name, settings and network in the content of a file; raises `NetworkFileError` where it is none."""
    try:
        arrays = read_arrays(content)
        header = json.loads(str(arrays.pop("header")))
        weights = {key.removeprefix("weight:"): torch.from_numpy(each) for key, each in arrays.items()}
        _check_kinds(weights, header["network"], header["settings"])
        network = build_network(header["network"], header["settings"])
        network.load_state_dict(weights)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RuntimeError, AssertionError) as error:
        raise NetworkFileError(f"the file does not hold a network over maps: {error}") from None
    network.eval()
    return header["network"], header["settings"], network


def _check_kinds(weights: Mapping[str, Tensor], name: NetworkName, settings: Mapping[str, Any]) -> None:
    """Raise ``ValueError`` where weights are not those of such a network, before one is made that fills the memory."""
    for setting, value in settings.items():
        if isinstance(value, int) and value > _MOST:
            raise ValueError(f"{setting}={value} is more than {_MOST}")
    with torch.device("meta"):  # shapes alone
        wanted = build_network(name, settings).state_dict()
    kinds = [{key: (each.dtype, tuple(each.shape)) for key, each in some.items()} for some in (wanted, weights)]
    for key in sorted({*wanted, *weights}):
        if kinds[0].get(key) != kinds[1].get(key):
            raise ValueError(f"{key} is {kinds[1].get(key, 'missing')}, not {kinds[0].get(key, 'asked for')}")
