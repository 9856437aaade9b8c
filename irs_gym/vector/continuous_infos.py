"""The infos of robots that go anywhere on the floor: their keys, and their values for many robots
at once.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.metrics import distance_ratio
from irs_gym.vector.infos import VALUES, Step, Values

Floats = NDArray[np.float64]


def _seconds(step: Step) -> Floats:
    assert step.seconds is not None
    return step.seconds.copy()


def _steps(step: Step) -> NDArray[np.int64]:
    assert step.steps is not None
    return step.steps.copy()


def _x(step: Step) -> Floats:
    model: Any = step.transition_model
    return model.metres(step.states)[0]  # type: ignore[no-any-return]


def _y(step: Step) -> Floats:
    model: Any = step.transition_model
    return model.metres(step.states)[1]  # type: ignore[no-any-return]


def _ratio(step: Step) -> Floats:
    if step.is_success is None:
        return np.zeros(len(step.states))

    ratio = distance_ratio(step.is_success, step.oracle_distance, step.distance)
    return np.where(step.is_success, ratio, 0.0)


def _scene_number(step: Step) -> NDArray[np.int64]:
    model: Any = step.transition_model
    return model.scenes(step.states)  # type: ignore[no-any-return]


def _scene_id(step: Step) -> NDArray[np.object_]:
    model: Any = step.transition_model
    names = np.array([*model.maps.names, None], dtype=object)  # objects even where there is but one
    return np.asarray(names.take(model.scenes(step.states)))


CONTINUOUS_VALUES: Values = {
    "distance": VALUES["distance"],
    "seconds": _seconds,
    "steps": _steps,
    "refused": VALUES["refused"],
    "is_refused": VALUES["is_refused"],
    "x": _x,
    "y": _y,
    "gain_db": VALUES["gain_db"],
    "margin_db": VALUES["margin_db"],
    "cost": VALUES["cost"],
    "is_success": VALUES["is_success"],
    "spl": VALUES["spl"],
    "ratio": _ratio,
    "oracle_distance": VALUES["oracle_distance"],
}
CONTINUOUS_KEYS = tuple(CONTINUOUS_VALUES)
_SCENE_VALUES: Values = {"scene_number": _scene_number, "scene_id": _scene_id}


def continuous_values(*, has_many_scenes: bool) -> Values:
    """How each key is computed; over many scenes there are two more."""
    return {**CONTINUOUS_VALUES, **(_SCENE_VALUES if has_many_scenes else {})}
