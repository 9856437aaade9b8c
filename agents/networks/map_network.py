"""What all networks over maps share: what they see (`maps_of`), what they say (`MapPlan`), and
their file.

A file holds plain arrays and a line of JSON; nothing in it is unpickled.
"""

import json
from collections.abc import Mapping
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from agents.registry import network_class
from irs_gym.datasets.scene_set import SceneSet, frame_of
from irs_gym.files import read_arrays
from irs_gym.mdp.packing import GOAL, MARGIN, OBSTACLE, scaled_margin
from irs_gym.memory import check_memory

STILL = [MARGIN, OBSTACLE, GOAL]
"""Channels of the environment's map observation that stay the same while the robot moves."""

TIE = 1e-3
"""Logits that differ by less are equal: of such moves the first is taken."""
_MARGIN, _OBSTACLE = STILL.index(MARGIN), STILL.index(OBSTACLE)

FILE_BYTES = 2**28  # of a network's file and of its weights
_TRAINED = 4  # times the weights that learning takes: gradients and two moments of Adam beside them
_LARGEST_SETTING = 4096  # channels, rounds, passes


class NetworkFileError(ValueError):
    """A file that is not a network over maps, or a damaged one."""


class MapPlan(NamedTuple):
    """What a network says of all cells of its maps at once."""

    logits: Tensor  # (B, 8, X, Y), of the moves in the order of `irs_gym.grid.MOVES`
    to_go: Tensor  # (B, X, Y), its estimate of the way to the goal, in units of its own


def maps_of(pool: SceneSet, scenes: NDArray[np.int64]) -> Tensor:
    """What networks see of some scenes of a pool: float32 ``(B, 3, X, Y)``.

    The channels are those of the environment's map observation without the robot: margin over the
    target, obstacle, goal.
    """
    gain_db = pool.gain_db[scenes]  # (B, X, Y)
    maps = np.zeros((len(scenes), len(STILL), *pool.shape), dtype=np.float32)

    # In the order of `STILL`: with no robot among them, the goal's channel is the third.
    maps[:, 0] = scaled_margin(gain_db, pool.target_db[scenes, None, None])
    maps[:, 1] = np.isneginf(gain_db)
    maps[np.arange(len(scenes)), 2, pool.goal[scenes, 0], pool.goal[scenes, 1]] = 1.0

    return torch.from_numpy(maps)


def plan_scene_set(network: nn.Module, pool: SceneSet) -> NDArray[np.float32]:
    """Logits of a network for all cells of all scenes of a pool, each by `plan_alone`: ``(S, 8, X,
    Y)``.
    """
    network.eval()
    each = (maps_of(pool, np.array([n]))[0].numpy() for n in range(len(pool)))
    return np.stack([plan_alone(network, one) for one in each])


def plan_alone(network: nn.Module, maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """Logits ``(8, X, Y)`` of a network for one map ``(3, X, Y)``, of no other influence.

    In a batch, the last digits of a network's numbers depend on how large that is, and a padded map
    is another map to some. So each map is seen alone, and in the frame of
    `irs_gym.datasets.scene_set.frame_of` its cells up to the last one that is free. Cells outside
    of it get 0.
    """
    inside = np.argwhere(maps[_OBSTACLE] == 0)  # (n, 2)
    columns, rows = (inside.max(axis=0) + 1).tolist() if len(inside) else maps.shape[1:]
    seen = np.zeros((len(STILL), *frame_of((columns, rows))), dtype=np.float32)
    seen[_MARGIN] = -1.0
    seen[_OBSTACLE] = 1.0
    seen[:, :columns, :rows] = maps[:, :columns, :rows]

    with torch.inference_mode():
        found = network(torch.from_numpy(seen[None])).logits[0].numpy()  # (8, ...)

    logits = np.zeros((len(found), *maps.shape[1:]), dtype=np.float32)
    logits[:, :columns, :rows] = found[:, :columns, :rows]

    return logits


def first_of_best(logits: NDArray[np.floating[Any]], axis: int) -> NDArray[np.int64]:
    """The first move along an axis whose logit is the greatest, or less than `TIE` below it.

    Ways of equal cost have sums that differ in their last digits, which depend on the machine.
    """
    return np.asarray((logits >= logits.max(axis=axis, keepdims=True) - TIE).argmax(axis=axis))


def build_network(name: str, settings: Mapping[str, Any]) -> nn.Module:
    """A network by its name, untrained; its weights are drawn from PyTorch's random numbers.

    Raises ``ValueError`` where a setting is out of its range, or the network would take too much
    memory.
    """
    outline = _outline(name, settings)
    check_memory(
        f"{dict(settings)}: the network",
        _TRAINED * sum(each.nbytes for each in outline.state_dict().values()),
    )
    network: nn.Module = network_class(name)(**settings)

    return network


def _outline(name: str, settings: Mapping[str, Any]) -> nn.Module:
    """A network that has shapes but no numbers, and so takes no memory."""
    _check_sizes(settings)

    with torch.device("meta"):
        network: nn.Module = network_class(name)(**settings)

    return network


def pack_network(name: str, settings: Mapping[str, Any], network: nn.Module) -> bytes:
    """A network as the content of a file; equal weights give equal bytes."""
    content = BytesIO()
    header = np.array(json.dumps({"network": name, "settings": dict(settings)}))
    weights = {f"weight:{key}": each.cpu().numpy() for key, each in network.state_dict().items()}
    np.savez_compressed(content, header=header, **weights)

    return content.getvalue()


def unpack_network(content: bytes) -> tuple[str, dict[str, Any], nn.Module]:
    """Name, settings and network in the content of a file; raises `NetworkFileError` where it is
    none.
    """
    try:
        arrays = read_arrays(content, limit=FILE_BYTES, needed=["header"])
        header = json.loads(str(arrays.pop("header")))
        weights = {
            key.removeprefix("weight:"): torch.from_numpy(each) for key, each in arrays.items()
        }

        # Before the network is made, as its settings may ask for any memory.
        _check_fit(_outline(header["network"], header["settings"]), weights)
        network = build_network(header["network"], header["settings"])
        network.load_state_dict(weights)
    except (ValueError, KeyError, TypeError, RecursionError, RuntimeError) as error:
        raise NetworkFileError(f"the file does not hold a network over maps: {error}") from None

    network.eval()
    return header["network"], header["settings"], network


def _check_sizes(settings: Any) -> None:
    """Refuse settings of which a network would grow without end."""
    if not isinstance(settings, Mapping):
        raise ValueError(f"settings={settings!r} must be an object")

    for name, value in settings.items():
        is_size = (
            isinstance(value, int)
            and not isinstance(value, bool)
            and 1 <= value <= _LARGEST_SETTING
        )
        if not is_size and not isinstance(value, str):
            raise ValueError(
                f"settings.{name}={value!r} must be a name or an integer from 1 to "
                f"{_LARGEST_SETTING}"
            )


def _check_fit(network: nn.Module, weights: Mapping[str, Tensor]) -> None:
    """Refuse weights that are not the network's own, all of them and finite."""
    former = getattr(network, "former_weights", {})
    for name in sorted({*former} & {*weights}):
        raise ValueError(former[name])

    wanted = {name: (each.shape, each.dtype) for name, each in network.state_dict().items()}
    found = {name: (each.shape, each.dtype) for name, each in weights.items()}
    wrong = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    if wrong:
        raise ValueError(f"its weights are not those of such a network: {', '.join(wrong[:3])}")

    infinite = [
        name
        for name, each in weights.items()
        if each.is_floating_point() and not each.isfinite().all()
    ]
    if infinite:
        raise ValueError(f"its weights are not finite: {', '.join(infinite[:3])}")
