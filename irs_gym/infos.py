"""`Infos`: the infos of a step of many robots, a dict whose arrays are computed when they are first looked at."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.ground import Ground

Told = Mapping[str, Callable[["Step"], NDArray[Any]]]


class Step(NamedTuple):
    """What the infos of one step are computed from; none of these arrays is written to again."""

    ground: Ground
    state: NDArray[np.int64]  # (n,)
    travel: NDArray[np.complex128]  # (n,), of this step: metres moved, plus 1j where refused
    travelled: NDArray[np.complex128]  # (n,), the same added up over the episode
    cost: NDArray[np.float64] | None  # (n,), None for none
    is_success: NDArray[np.bool_]  # (n,)
    oracle_distance: NDArray[np.float64]  # (n,)
    everywhere: NDArray[np.bool_]  # (n,), which environments the infos are of
    told: Told  # how each key is computed


def everywhere(step: Step) -> NDArray[np.bool_]:
    """Which environments have a key that all have."""
    return step.everywhere.copy()


def _spl(step: Step) -> NDArray[np.float64]:
    shortest, travelled = step.oracle_distance, step.travelled.real
    return np.divide(shortest, np.maximum(shortest, travelled), out=np.zeros(len(shortest)), where=step.is_success)


TOLD: dict[str, Callable[[Step], NDArray[Any]]] = {
    "distance": lambda step: step.travelled.real.copy(),
    "refused": lambda step: step.travelled.imag.astype(np.int64),
    "distance_to_go": lambda step: step.ground.distance_to_go(step.state),
    "gain_db": lambda step: step.ground.gain_db(step.state),
    "margin_db": lambda step: step.ground.margin_db(step.state),
    "action_mask": lambda step: step.ground.action_mask(step.state),
    "is_refused": lambda step: step.travel.imag > 0,
    "cost": lambda step: np.zeros(len(step.state)) if step.cost is None else step.cost.copy(),
    "is_success": lambda step: step.is_success.copy(),
    "spl": _spl,
}
TOLD |= {f"_{key}": everywhere for key in tuple(TOLD)}


class Infos(dict[str, Any]):
    """A dict of arrays ``(n, ...)`` for each key of the single environment's info, with a mask ``_key`` each.

    It reads like any dict. Asking for one key computes that key; whatever looks at all of them computes all.
    """

    def __init__(
        self,
        step: Step,
        chosen: NDArray[np.bool_] | None = None,
        more: Told = MappingProxyType({}),
    ) -> None:
        """Infos of a step; with ``chosen`` ``(n,)``, of those environments alone, and zero for the others.

        ``more`` holds how further keys are computed.
        """
        super().__init__()
        self.step, self._chosen = step, chosen
        self._values: Told = {**step.told, **more} if more else step.told

    def __missing__(self, key: str) -> Any:
        value = self._values[key](self.step)
        if self._chosen is not None:
            value = only(value, self._chosen)
        self[key] = value
        return value

    def __contains__(self, key: object) -> bool:
        return key in self._values or super().__contains__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """The value of a key, or the default."""
        return self[key] if key in self else default  # noqa: SIM401

    def fill(self) -> "Infos":
        """Compute all that has not been looked at."""
        for key in self._values:
            if not super().__contains__(key):
                self.__missing__(key)
        self._values = {}  # all is there: a key that is deleted from now on stays away
        return self

    def __reduce__(self) -> Any:
        return dict, (list(self.items()),)


def _seen_whole(name: str) -> Callable[..., Any]:
    method = getattr(dict, name)

    def seen_whole(self: Infos, *arguments: Any) -> Any:
        return method(self.fill(), *arguments)

    seen_whole.__name__ = name
    seen_whole.__doc__ = method.__doc__
    return seen_whole


for _name in (
    "__iter__",
    "__len__",
    "__eq__",
    "__ne__",
    "__repr__",
    "__or__",
    "__ror__",
    "__reversed__",
    "__delitem__",
):
    setattr(Infos, _name, _seen_whole(_name))
for _name in ("keys", "values", "items", "copy", "pop", "popitem", "setdefault"):
    setattr(Infos, _name, _seen_whole(_name))


def only(values: NDArray[Any], chosen: NDArray[np.bool_]) -> NDArray[Any]:
    """The values of the chosen environments, zero (or None) elsewhere."""
    kept = np.full_like(values, None) if values.dtype == object else np.zeros_like(values)
    kept[chosen] = values[chosen]
    return kept
