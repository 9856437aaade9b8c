"""The infos where the panel is switched: their keys, and their values for many robots at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.vector.codebook_model import CodebookModel
from irs_gym.vector.infos import VALUES, Step, Values


def _model(step: Step) -> CodebookModel:
    model: Any = step.transition_model
    return model  # type: ignore[no-any-return]


def _configuration(step: Step) -> NDArray[np.int64]:
    return _model(step).configuration(step.states)


def _switches(step: Step) -> NDArray[np.int64]:
    return np.zeros(len(step.states), np.int64) if step.switches is None else step.switches.copy()


def _metres(step: Step) -> NDArray[np.float64]:
    return np.zeros(len(step.states)) if step.metres is None else step.metres.copy()


def _scene_number(step: Step) -> NDArray[np.int64]:
    return _model(step).rules.scene_of(step.states)


def _scene_id(step: Step) -> NDArray[np.object_]:
    rules = _model(step).rules
    names = np.array([*rules.maps.names, None], dtype=object)  # objects even where there is but one
    return names.take(rules.scene_of(step.states))


CODEBOOK_VALUES: Values = {
    "configuration": _configuration,
    "switches": _switches,
    "metres": _metres,
}
SCENE_VALUES: Values = {"scene_number": _scene_number, "scene_id": _scene_id}
CODEBOOK_KEYS = tuple(CODEBOOK_VALUES)


def codebook_values(*, has_many_scenes: bool) -> Values:
    """How each key is computed from an `irs_gym.vector.infos.Step`."""
    return {**VALUES, **CODEBOOK_VALUES, **(SCENE_VALUES if has_many_scenes else {})}
