"""`cost_map`: what each cell costs a robot that may enter cells below the target."""

from collections.abc import Callable
from math import isfinite
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irs_gym.radio.radio_map import RadioMap
from irs_gym.units import Floats

CostKind = Literal["violation", "deficit"]


def cost_map(radio_map: RadioMap, target_db: float, kind: CostKind) -> Floats:
    """What a robot pays on entering each cell, and for the cell where it starts.

    Parameters
    ----------
    radio_map
        Gains of the cells.
    target_db
        The target in dB.
    kind
        ``"violation"``: 1 in cells whose expected gain lies below the target, 0 in others.
        ``"deficit"``: dB by which it lies below, inf where nothing is received.

    Returns
    -------
    float64, shape ``(X, Y)``, never negative; inf in cells that a robot cannot enter.

    Raises
    ------
    ValueError
        Where there is no such kind, or the target is no finite number.

    Examples
    --------
    >>> radio_map = RadioMap.from_array([[-60.0, -np.inf, -70.0]], cell_size=0.5)
    >>> cost_map(radio_map, -65.0, "violation").tolist()
    [[0.0, inf, 1.0]]
    >>> cost_map(radio_map, -65.0, "deficit").tolist()
    [[0.0, inf, 5.0]]
    """
    is_number = isinstance(target_db, Real) and not isinstance(target_db, bool | np.bool_)
    if not (is_number and isfinite(target_db)):
        raise ValueError(f"target_db={target_db!r} must be a finite number of dB")

    return cell_costs(radio_map.gain_db, radio_map.free, float(target_db), kind)


def cell_costs(
    gain_db: Floats, free: NDArray[np.bool_], target_db: ArrayLike, kind: CostKind
) -> Floats:
    """`cost_map` of the arrays of one map or of many.

    ``gain_db`` and ``free`` have the shape ``(..., X, Y)``, which ``target_db`` must broadcast to.
    """
    checked_kind(kind)
    target_db = np.asarray(target_db, dtype=np.float64)

    return np.where(free, _COSTS[kind](gain_db, target_db), np.inf)


def checked_kind(kind: Any, name: str = "kind") -> CostKind:
    """The kind, where there is one of that name; a ``ValueError`` names the field otherwise."""
    if not isinstance(kind, str) or kind not in _COSTS:
        raise ValueError(f"{name}={kind!r} must be one of {get_args(CostKind)}")

    return kind  # type: ignore[return-value]  # it is one of them


def _violation(gain_db: Floats, target_db: Floats) -> Floats:
    return (gain_db < target_db).astype(np.float64)


def _deficit(gain_db: Floats, target_db: Floats) -> Floats:
    return np.maximum(target_db - gain_db, 0.0)


_COSTS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "violation": _violation,
    "deficit": _deficit,
}
