"""`check_memory`: work that would take too much memory is refused before it begins."""

import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray

_Array = TypeVar("_Array", bound=NDArray[Any])

VARIABLE = "IRS_GYM_MEMORY"
# Work that goes over more than this many times as many bytes as may be held at once is refused too.
PASSES = 100
_UNITS = {"": 1, "B": 1, **{f"{prefix}iB": 1024**n for n, prefix in enumerate("KMGT", start=1)}}
_UNKNOWN = 8 * 1024**3  # bytes of a machine that does not say how many it has


class MemoryLimitError(ValueError):
    """Work that would take more memory, or go over more bytes, than the limit."""


def memory_limit() -> int:
    """Bytes that one piece of work may hold: ``IRS_GYM_MEMORY``, else half of the machine's or
    container's memory.

    Raises
    ------
    ValueError
        Where ``IRS_GYM_MEMORY`` is no positive number of bytes such as ``"500MiB"`` or ``"8GiB"``.
    """
    given = os.environ.get(VARIABLE, "").strip()
    if not given:
        return _machine() // 2

    parts = re.fullmatch(r"(\d{1,15}(?:\.\d{1,6})?)\s*([KMGT]iB|B|)", given)
    limit = int(float(parts[1]) * _UNITS[parts[2]]) if parts else 0
    if limit < 1:
        raise ValueError(
            f'{VARIABLE}={given!r} must be a positive number of bytes, such as "500MiB" or "8GiB"'
        )

    return limit


def check_memory(what: str, held: float, passed: float = 0) -> None:
    """Refuse work before it begins.

    Parameters
    ----------
    what
        Field, value and what they ask for, the beginning of the message: ``"num_envs=1000000: their
        state"``.
    held
        Bytes that it takes at once.
    passed
        Bytes that it reads and writes in all, which tells how long it takes.

    Raises
    ------
    MemoryLimitError
        Where it holds more than `memory_limit`, or passes over more than `PASSES` times that.
    """
    limit = memory_limit()
    if held > limit:
        raise MemoryLimitError(
            f"{what} would take {in_words(held)} of memory, "
            f"more than the limit of {in_words(limit)}; {VARIABLE} sets another"
        )
    if passed > PASSES * limit:
        raise MemoryLimitError(
            f"{what} would go over {in_words(passed)} of numbers, "
            f"more than {PASSES} times the memory limit of {in_words(limit)}; "
            f"{VARIABLE} sets another"
        )


def in_words(size: float) -> str:
    """Bytes for people.

    Examples
    --------
    >>> in_words(1.5 * 1024**3)
    '1.5 GiB'
    """
    for unit in ("B", "KiB", "MiB", "GiB"):
        if size < 1024:
            return f"{size:.4g} {unit}"
        size /= 1024

    return f"{size:.4g} TiB"


def freeze(*arrays: NDArray[Any] | None) -> None:
    """Make arrays that are shared read-only: to write to one raises a ``ValueError``."""
    for array in arrays:
        if array is not None:
            array.setflags(write=False)


def frozen(array: _Array) -> _Array:
    """The array, made read-only."""
    freeze(array)
    return array


@lru_cache(maxsize=1)
def _machine() -> int:
    """Bytes of memory that there are, for this container where it is bounded."""
    try:
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # not on Windows
        total = _UNKNOWN

    # a container has its own bound; "max" where it has none
    try:
        bound = Path("/sys/fs/cgroup/memory.max").read_text().strip()
    except OSError:
        return total

    return min(total, int(bound)) if bound.isdecimal() else total
