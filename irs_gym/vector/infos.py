"""The infos: their keys, and their values for many robots at once, as plain dicts of arrays."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.metrics import spl
from irs_gym.mdp.task import Rules
from irs_gym.vector.protocols import TransitionModel

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


class Step(NamedTuple):
    """What the infos after a step, or a reset, are made of: arrays ``(n,)``."""

    transition_model: TransitionModel
    states: NDArray[np.int64]
    # of the episode so far; the environment goes on adding to them
    distance: Floats  # metres
    refused: NDArray[np.int64]
    oracle_distance: Floats  # metres
    # of this step alone
    is_refused: Bools | None  # None where none is
    cost: Floats | None  # None where it is always 0
    is_success: Bools | None  # None where none is
    budget_left: Floats | None = None  # None where there is no budget
    # of the episode so far, where the panel is switched and somebody asks
    switches: NDArray[np.int64] | None = None
    metres: Floats | None = None
    # of the episode so far, where time is counted beside metres
    seconds: Floats | None = None
    steps: NDArray[np.int64] | None = None

    def of(self, chosen: NDArray[np.int64]) -> "Step":
        """The same for some of the robots."""
        # the transition model is the same for all; the other fields have a row a robot, or are None
        arrays = (None if each is None else each[chosen] for each in self[1:])
        return Step(self.transition_model, *arrays)  # type: ignore[arg-type]


Values = Mapping[str, Callable[[Step], NDArray[Any]]]


def _distance(step: Step) -> Floats:
    return step.distance.copy()


def _refused(step: Step) -> NDArray[np.int64]:
    return step.refused.copy()


def _distance_to_go(step: Step) -> Floats:
    return step.transition_model.distance_to_go(step.states, step.budget_left)


def _gain_db(step: Step) -> Floats:
    return step.transition_model.gain_db(step.states)


def _margin_db(step: Step) -> Floats:
    return step.transition_model.margin_db(step.states)


def _action_mask(step: Step) -> NDArray[np.int8]:
    return step.transition_model.action_mask(step.states, step.budget_left)


def _is_refused(step: Step) -> Bools:
    return np.zeros(len(step.states), dtype=bool) if step.is_refused is None else step.is_refused


def _cost(step: Step) -> Floats:
    return np.zeros(len(step.states)) if step.cost is None else step.cost


def _is_success(step: Step) -> Bools:
    return np.zeros(len(step.states), dtype=bool) if step.is_success is None else step.is_success


def _spl(step: Step) -> Floats:
    if step.is_success is None:
        return np.zeros(len(step.states))

    return spl(step.is_success, step.oracle_distance, step.distance)


def _oracle_distance(step: Step) -> Floats:
    return step.oracle_distance.copy()


def _budget_left(step: Step) -> Floats:
    assert step.budget_left is not None
    return step.budget_left  # a new one at each step


# One set of keys: at a reset, midway and at the end, in the single environment too. Each array is a
# fresh one.
VALUES: Values = {
    "distance": _distance,
    "refused": _refused,
    "distance_to_go": _distance_to_go,
    "gain_db": _gain_db,
    "margin_db": _margin_db,
    "action_mask": _action_mask,
    "is_refused": _is_refused,
    "cost": _cost,
    "is_success": _is_success,
    "spl": _spl,
    "oracle_distance": _oracle_distance,
}
KEYS = tuple(VALUES)
BUDGET_VALUES: Values = {"budget_left": _budget_left}  # under a budget
SCENE_KEYS = ("scene_number", "scene_id")  # over many scenes
# With these, a step of a vector takes a third longer; and names are no numbers, which is what
# wrappers ask for.
SLOW = (
    "refused",
    "is_refused",
    "distance_to_go",
    "gain_db",
    "margin_db",
    "scene_id",
    "configuration",
    "switches",
    "metres",
    "x",
    "y",
)

Infos = Literal["all", "fast"] | Sequence[str]  # what a user may ask for


def budget_keys(rules: Rules) -> tuple[str, ...]:
    """Keys that the rules add to all others."""
    return () if rules.budget is None else tuple(BUDGET_VALUES)


def checked_keys(
    infos: Infos, more: Sequence[str] = (), own: Sequence[str] = KEYS
) -> tuple[str, ...]:
    """Keys that a user asks for, in one order: of ``own`` and those of the environment beside them.

    ``"fast"`` stands for all but the `SLOW`. Raises ``ValueError`` for what are no known keys.
    """
    known = (*own, *more)
    if isinstance(infos, str) and infos in ("all", "fast"):
        return tuple(key for key in known if infos == "all" or key not in SLOW)

    is_list = isinstance(infos, Sequence) and not isinstance(infos, str)
    if not is_list or not all(key in known for key in infos):
        raise ValueError(
            f"infos={infos!r} must be 'all', 'fast', or a list of some of {', '.join(known)}"
        )

    return tuple(key for key in known if key in infos)


class InfoBuilder:
    """Makes the infos of a vector environment: for each key an array ``(n, ...)``, and a mask
    ``_key`` ``(n,)``.
    """

    def __init__(self, values: Values, keys: Sequence[str]) -> None:
        """Infos with some of the keys that there are values for."""
        self._keys = tuple(keys)
        self._masks = tuple(f"_{key}" for key in keys)
        self._values = [values[key] for key in keys]

    def everywhere(self, step: Step) -> dict[str, Any]:
        """Infos of all environments."""
        arrays = [value(step) for value in self._values]

        has_key = np.empty(len(step.states), dtype=bool)
        has_key.fill(True)  # less than half the time of `np.ones`

        return self._labelled(arrays, has_key)

    def of(self, step: Step, chosen: NDArray[np.int64]) -> dict[str, Any]:
        """Infos of the chosen environments, and zero (or None) for all others."""
        has_key = np.zeros(len(step.states), dtype=bool)
        has_key[chosen] = True
        some = step.of(chosen)  # computed for the chosen alone
        arrays = [spread(value(some), chosen, len(step.states)) for value in self._values]

        return self._labelled(arrays, has_key)

    def _labelled(self, arrays: list[NDArray[Any]], has_key: NDArray[np.bool_]) -> dict[str, Any]:
        infos: dict[str, Any] = dict(zip(self._keys, arrays, strict=True))
        infos.update(dict.fromkeys(self._masks, has_key))  # one for all keys: nobody writes to it
        return infos


def spread(values: NDArray[Any], chosen: NDArray[np.int64], count: int) -> NDArray[Any]:
    """An array ``(count, ...)`` with the values of the chosen environments, and zero (or None)
    elsewhere.
    """
    blank = None if values.dtype == object else 0
    array = np.full((count, *values.shape[1:]), blank, dtype=values.dtype)
    array[chosen] = values

    return array
