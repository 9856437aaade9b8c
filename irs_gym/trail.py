"""`Trail`: the cells of an episode as a sequence, and `History`, which remembers those of many robots."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell


class Trail(Sequence[Cell]):
    """The cells (i, j) that a robot was in, refused moves left out. ``np.asarray(trail)`` has the shape ``(T, 2)``.

    It is unpacked on first use, since most trails of a training run are never looked at.
    """

    __slots__ = ("_cells", "_shape", "_states")

    def __init__(self, states: NDArray[np.integer[Any]], shape: tuple[int, int]) -> None:
        """Hold flat cells ``(T,)`` of a map of the given shape, or of one among many that lie one above the other.

        Repetitions in a row count once.
        """
        self._states, self._shape = states, shape
        self._cells: list[Cell] | None = None

    def _unpacked(self) -> list[Cell]:
        if self._cells is None:
            flat = self._states[np.append(True, self._states[1:] != self._states[:-1])]
            i, j = np.divmod(flat, self._shape[1])
            self._cells = list(zip((i % self._shape[0]).tolist(), j.tolist(), strict=True))
        return self._cells

    @overload
    def __getitem__(self, n: int) -> Cell: ...
    @overload
    def __getitem__(self, n: slice) -> list[Cell]: ...
    def __getitem__(self, n: int | slice) -> Cell | list[Cell]:
        return self._unpacked()[n]

    def __len__(self) -> int:
        return len(self._unpacked())

    def __iter__(self) -> Iterator[Cell]:
        return iter(self._unpacked())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._unpacked() == list(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Trail({self._unpacked()})"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self._unpacked(), dtype=dtype or np.int64)


class History:
    """Flat cells of n robots at their latest steps: a ring, so that remembering a step costs one row."""

    def __init__(self, num_robots: int, length: int, shape: tuple[int, int], num_maps: int = 1) -> None:
        """Remember ``length`` steps of robots on maps of the given shape."""
        smallest = np.min_scalar_type(num_maps * shape[0] * shape[1] - 1)  # leaves the caches to the tables
        self._rows = np.zeros((length, num_robots), dtype=smallest)
        self._now, self._shape = 0, shape

    def advance(self, cells: NDArray[np.int64]) -> None:
        """Remember the flat cells ``(n,)`` after a step."""
        self._now = (self._now + 1) % len(self._rows)
        self._rows[self._now] = cells

    def begin(self, chosen: NDArray[np.int64], cells: NDArray[np.int64]) -> None:
        """Put the chosen robots elsewhere, at the latest step."""
        self._rows[self._now, chosen] = cells

    def trails(self, chosen: NDArray[np.int64], steps: NDArray[np.int64]) -> Callable[[], list[Trail]]:
        """Trails of the chosen robots over their latest ``steps``; copied now, and made on a call."""
        longest = int(steps.max(initial=0))
        first, end = self._now - longest, self._now + 1
        parts = [self._rows[first:end]] if first >= 0 else [self._rows[first:], self._rows[:end]]
        block = np.concatenate([part.take(chosen, axis=1) for part in parts])  # (longest + 1, len(chosen))
        return lambda: [Trail(block[longest - count :, n], self._shape) for n, count in enumerate(steps.tolist())]
