"""`PathHistory`: the cells of many robots since their episodes began."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Cell, cells_at


class PathHistory:
    """Remembers where n robots were at their latest steps: a ring of arrays, each as it was given,
    so that a step costs nothing.

    Cells are flat; where there are several maps, they lie one above the other. Places of another
    type than numbers of cells are remembered likewise, and told by `flat` alone.
    """

    def __init__(
        self, num_robots: int, length: int, shape: tuple[int, int], places: Any = np.int64
    ) -> None:
        """Remember ``length`` steps on maps of the given shape."""
        self._shape = shape
        self._rows: list[NDArray[Any]] = [
            np.zeros(0, dtype=places)
        ] * length  # each (n,), once there was its step
        self._clock = 0  # steps of all robots

        # Row 0: of the episode of each robot. Row 1: of the one before it, which is still asked for
        # after a same-step autoreset.
        self._starts = np.zeros((2, num_robots), dtype=places)
        self._began = np.zeros((2, num_robots), dtype=np.int64)
        self._ended = np.zeros(num_robots, dtype=np.int64)  # clock at the end of the one before

    def begin(self, chosen: NDArray[np.int64], cells: NDArray[Any], clock: int) -> None:
        """Start an episode of the chosen robots in the flat cells at a time, in steps of all
        robots.
        """
        # the episode becomes the one before
        self._starts[1, chosen] = self._starts[0, chosen]
        self._began[1, chosen] = self._began[0, chosen]
        self._ended[chosen] = clock

        self._starts[0, chosen] = cells
        self._began[0, chosen] = clock

    def advance(self, cells: NDArray[Any], clock: int) -> None:
        """Remember the flat cells ``(n,)`` after a step, at a time that is one step later than the
        last; the array is kept, so nobody may write to it any more.
        """
        self._clock = clock
        self._rows[clock % len(self._rows)] = cells

    def steps(self, robot: int) -> int:
        """Steps of a robot since its episode began."""
        return int(self._clock - self._began[0, robot])

    def path(self, robot: int, *, of_last_episode: bool | np.bool_ = False) -> list[Cell]:
        """Cells (i, j) of a robot's episode, or of the one before it, if that ended at the latest
        step.

        Refused moves are left out.
        """
        return cells_of(self.flat(robot, of_last_episode=of_last_episode), self._shape)

    def flat(self, robot: int, *, of_last_episode: bool | np.bool_ = False) -> NDArray[Any]:
        """The flat cells behind `path`, one a step and the first, ``(T,)``."""
        # the cell in which it began, and then one cell a step: rows of the ring
        which = int(of_last_episode)
        end = self._ended[robot] if of_last_episode else self._clock
        steps = range(int(self._began[which, robot]) + 1, int(end) + 1)
        walked = [self._rows[step % len(self._rows)][robot] for step in steps]

        return np.array([self._starts[which, robot], *walked])


def cells_of(flat: NDArray[np.integer], shape: tuple[int, int]) -> list[Cell]:
    """Cells (i, j) of flat cells ``(T,)`` of a map, or of several one above the other; repetitions
    in a row count once, whichever map they are of.

    Examples
    --------
    >>> cells_of(np.array([0, 0, 5, 6, 6]), (3, 5))
    [(0, 0), (1, 0), (1, 1)]
    """
    flat = flat % (shape[0] * shape[1])
    moved = flat[np.append(True, flat[1:] != flat[:-1])]
    i, j = cells_at(moved, shape).T
    return list(zip(i.tolist(), j.tolist(), strict=True))
