"""`installed_policies`: the policies whose paths other packages lend to the workbench."""

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from irs_gym.radio.scene import Scene

GROUP = "irs_gym.workbench"

# The cells (i, j) that a policy visits from the scene's start, shape (D, 2); a ValueError says why
# it cannot be asked.
PolicyPath = Callable[[Scene], NDArray[np.int64]]


def installed_policies() -> dict[str, EntryPoint]:
    """Entry points of the group ``irs_gym.workbench`` by their names: functions that give a
    policy's path in a scene.

    None of them is imported, and those whose module is not there are left out: this package knows
    of no policy, and runs without any.
    """
    return {each.name: each for each in sorted(entry_points(group=GROUP)) if _is_there(each.module)}


def _is_there(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ImportError:  # of the package that it is in
        return False
