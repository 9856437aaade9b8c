"""`compiled`: loops over cells as machine code."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """A function in Numba's part of Python, compiled at its first call, and kept for other
    processes where there is a folder for that.
    """
    try:
        return cast(Callable[P, R], njit(cache=True)(function))
    except RuntimeError:
        return cast(Callable[P, R], njit(function))
