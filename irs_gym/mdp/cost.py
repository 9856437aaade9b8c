"""`cost_map`: what each cell costs a robot that may enter cells below the target."""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.radio.fading import Fading, checked_threshold
from irs_gym.radio.radio_map import RadioMap
from irs_gym.units import Floats

CostKind = Literal["violation", "deficit", "outage"]


def cost_map(radio_map: RadioMap, target_db: float, kind: CostKind) -> Floats:
    """What a robot pays on entering each cell, and for the cell where it starts.

    Parameters
    ----------
    radio_map
        Gains of the cells, and for ``"outage"`` their fading.
    target_db
        The target in dB; for ``"outage"``, the threshold of the instantaneous gain.
    kind
        ``"violation"``: 1 in cells whose expected gain lies below the target, 0 in others.
        ``"deficit"``: dB by which it lies below, inf where nothing is received.
        ``"outage"``: the probability that the instantaneous gain lies below it, from 0 to 1.

    Returns
    -------
    float64, shape ``(X, Y)``, never negative; inf in cells that a robot cannot enter.

    Raises
    ------
    ValueError
        Where there is no such kind, the target is no finite number, or the outage is asked of a
        map that has no fading.

    Examples
    --------
    >>> radio_map = RadioMap.from_array([[-60.0, -np.inf, -70.0]], cell_size=0.5)
    >>> cost_map(radio_map, -65.0, "violation").tolist()
    [[0.0, inf, 1.0]]
    >>> cost_map(radio_map, -65.0, "deficit").tolist()
    [[0.0, inf, 5.0]]
    """
    target_db = checked_threshold(target_db, "target_db")
    return cell_costs(radio_map.gain_db, radio_map.free, target_db, kind, radio_map.fading)


def cell_costs(
    gain_db: Floats,
    free: NDArray[np.bool_],
    target_db: ArrayLike,
    kind: CostKind,
    fading: Fading | None = None,
) -> Floats:
    """`cost_map` of the arrays of one map, or of many at once.

    ``gain_db``, ``free`` and ``fading`` have the shape ``(..., X, Y)``, which ``target_db`` must
    broadcast to. The fading is needed for ``"outage"`` alone.
    """
    target_db = np.asarray(target_db, dtype=np.float64)

    match checked_kind(kind):
        case "violation":
            costs = (gain_db < target_db).astype(np.float64)
        case "deficit":
            costs = np.maximum(target_db - gain_db, 0.0)
        case "outage":
            if fading is None:
                raise ValueError(
                    "kind='outage' needs a map with fading, and this one tells mean gains alone: "
                    "build it of a scene, or give it fading=; a file keeps that if saved with "
                    "fading=True"
                )
            costs = fading.outage(target_db)

    return np.where(free, costs, np.inf)


def checked_kind(kind: Any, name: str = "kind") -> CostKind:
    """The kind, where there is one of that name; a ``ValueError`` names the field otherwise."""
    if not isinstance(kind, str) or kind not in get_args(CostKind):
        raise ValueError(f"{name}={kind!r} must be one of {get_args(CostKind)}")

    return kind  # type: ignore[return-value]  # it is one of them
