"""Render modes: those of the environments, and those that a wrapper adds to them."""

from collections.abc import Callable
from typing import TypeVar

Environment = TypeVar("Environment")  # or a vector of them

_LIST = "_list"


def with_render_mode(
    make: Callable[..., Environment],
    render_mode: str | None,
    window: Callable[[Environment], Environment],
    collection: Callable[[Environment], Environment],
) -> Environment:
    """What ``make`` makes, in any render mode.

    ``"human"`` is a ``window`` around ``"rgb_array"``, and ``"rgb_array_list"`` or ``"ansi_list"``
    a ``collection`` of what the mode without ``_list`` gives. Gymnasium does the same by itself,
    but not without a warning, nor for vector environments.
    """
    if render_mode == "human":
        return window(make(render_mode="rgb_array"))
    if isinstance(render_mode, str) and render_mode.endswith(_LIST):
        return collection(make(render_mode=render_mode.removesuffix(_LIST)))

    return make(render_mode=render_mode)
