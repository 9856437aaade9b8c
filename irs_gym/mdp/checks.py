"""Checks of what users hand to an environment: actions, seeds, options, modes and sizes."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum
from functools import lru_cache
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from irs_gym.grid import MOVE_NAMES, as_cell
from irs_gym.mdp.codebook_packing import CodebookPacking
from irs_gym.mdp.dynamics import ACTIONS
from irs_gym.mdp.packing import Packing
from irs_gym.memory import check_memory, frozen
from irs_gym.radio.codebook import Codebook
from irs_gym.radio.radio_map import RadioMap
from irs_gym.radio.scene import Scene

METADATA: dict[str, Any] = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}
_MOVES = ", ".join(f"{n} {name}" for n, name in enumerate(MOVE_NAMES))


class PlainSpec:
    """The attribute ``spec``: how `gymnasium.make` makes an environment again, kept with arguments
    that JSON can hold.

    A `Scene`, a `Codebook` and a `RadioMap` become dicts and a path a string, which the
    environments take in their place. A `SceneSet` stays what it is: it is the one argument that
    JSON cannot hold.
    """

    def __get__(self, env: Any, kind: Any = None) -> EnvSpec | None:
        return None if env is None else vars(env).get("_spec")

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        arguments = (
            {} if spec is None else {name: as_data(value) for name, value in spec.kwargs.items()}
        )
        vars(env)["_spec"] = None if spec is None else replace(spec, kwargs=arguments)


def as_data(argument: Any) -> Any:
    """An argument of an environment as numbers, strings, lists and dicts, where it can be so.

    Examples
    --------
    >>> as_data((np.int64(3), Path("floor.npz")))
    [3, 'floor.npz']
    """
    if isinstance(argument, Codebook | RadioMap | Scene):
        known = {"fading": True} if isinstance(argument, RadioMap) else {}
        return argument.to_data(**known)
    if isinstance(argument, Enum):  # an autoreset mode
        return argument.value
    if isinstance(argument, Path):
        return str(argument)
    if isinstance(argument, np.generic | np.ndarray):
        return argument.tolist()
    if isinstance(argument, Sequence) and not isinstance(argument, str):
        return [as_data(each) for each in argument]

    return argument


def checked_render_mode(render_mode: str | None) -> str | None:
    """The mode; a ``ValueError`` lists the known ones for an unknown one."""
    is_known = isinstance(render_mode, str) and render_mode in METADATA["render_modes"]
    if render_mode is not None and not is_known:
        raise ValueError(
            f"render_mode={render_mode!r} must be one of {METADATA['render_modes']} or None"
        )

    return render_mode


def _said(count: int) -> str:
    """The actions in words: moves, and switches where there are more."""
    switches = "" if count == ACTIONS else ", then a switch into each configuration"
    return f"an integer from 0 to {count - 1}: {_MOVES}{switches}"


def checked_action(action: Any, count: int = ACTIONS) -> int:
    """The action of ``count`` as an int; a ``ValueError`` lists the actions for one that is none.

    Examples
    --------
    >>> checked_action(np.int64(7))
    7
    """
    if type(action) is int and 0 <= action < count:  # nearly all are: a step has no time to lose
        return action

    try:
        number = index(action)
    except TypeError:
        number = -1

    # True would pass for 1.
    if not 0 <= number < count or isinstance(action, bool | np.bool_):
        raise ValueError(f"action={action!r} must be {_said(count)}")

    return number


def checked_actions(actions: Any, count: int, of: int = ACTIONS) -> NDArray[np.int64]:
    """Actions of ``count`` robots, out of ``of``, as an array; a ``ValueError`` names the first
    that is none.
    """
    checked: NDArray[np.integer[Any]] = np.asarray(actions)
    if checked.shape != (count,) or checked.dtype.kind not in "iu":
        raise ValueError(
            f"actions has the shape {checked.shape} and the type {checked.dtype}, "
            f"but one integer for each of the {count} environments is needed"
        )

    numbers = checked.astype(np.int64, copy=False)
    is_wrong = numbers.view(np.uint64) >= _bound(of)  # where a negative number is a huge one
    if np.count_nonzero(is_wrong):
        first = int(np.flatnonzero(is_wrong)[0])
        raise ValueError(f"actions[{first}]={checked[first]} must be {_said(of)}")

    return numbers


@lru_cache(maxsize=64)
def _bound(of: int) -> NDArray[np.uint64]:
    """A number as an array ``()``: arrays are compared with it faster than with an int."""
    return frozen(np.array(of, dtype=np.uint64))


def checked_options(options: dict[str, Any] | None, *more: str) -> dict[str, Any]:
    """The options of `reset`: ``start`` and ``goal``, checked to be cells, and those of ``more`` as
    they are given.

    A ``ValueError`` names an unknown key, or a value that is no cell.
    """
    unknown = sorted(set(options or {}) - {"start", "goal", *more})
    if unknown:
        may_hold = "start and goal, cells (i, j)" + "".join(f", and {each}" for each in more)
        raise ValueError(
            f"options has the unknown key {', '.join(unknown)}: it may hold {may_hold}"
        )

    return {
        name: value if name in more else as_cell(value, name)
        for name, value in (options or {}).items()
    }


def check_num_envs(
    num_envs: int,
    max_episode_steps: int,
    packing: Packing | CodebookPacking,
    place_bytes: float = 8.0,
) -> None:
    """Refuse a vector environment whose observations and paths would take too much memory, before
    any is made.
    """
    check_memory(
        f"num_envs={num_envs}: state and observations of {packing.width} numbers",
        num_envs * (18 * packing.width + 500),  # bytes: observations in work and kept, and state
    )
    check_memory(
        f"num_envs={num_envs}, max_episode_steps={max_episode_steps}: the paths of all robots",
        place_bytes * num_envs * (max_episode_steps + 1),  # a flat cell a step, or a point
    )


def checked_count(name: str, value: Any) -> int:
    """A positive integer of at most 64 bits; a ``ValueError`` names what is none."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name}={value!r} must be a positive integer")
    if value > sys.maxsize:
        raise ValueError(f"{name} must be at most {sys.maxsize}")

    return int(value)


def checked_seed(seed: Any, name: str = "seed") -> int | None:
    """The seed as an int, which Gymnasium asks for, or None; a ``ValueError`` names what is
    neither.

    NumPy's integers are taken as well.

    Examples
    --------
    >>> checked_seed(np.int64(3))
    3
    """
    return None if seed is None else _seed(seed, name)


def _seed(seed: Any, name: str) -> int:
    try:
        number = index(seed)
    except TypeError:
        number = -1

    if number < 0 or isinstance(seed, bool | np.bool_):
        raise ValueError(f"{name}={seed!r} must be an integer from 0, or None")

    return number


def each_seed(seed: Any, count: int) -> Sequence[int | None] | None:
    """A seed for each of ``count`` environments: the given ones, or counted up from one; None for
    no change.

    Raises ``ValueError`` for a number of seeds that is not ``count``, and for a seed that is none.

    Examples
    --------
    >>> each_seed(5, count=3)
    [5, 6, 7]
    """
    if seed is None:
        return None

    if not isinstance(seed, Sequence | np.ndarray) or np.ndim(seed) == 0:
        first = _seed(seed, "seed")
        return [first + i for i in range(count)]

    if len(seed) != count:
        raise ValueError(f"seed holds {len(seed)} numbers for {count} environments")

    return [checked_seed(each, f"seed[{i}]") for i, each in enumerate(seed)]
