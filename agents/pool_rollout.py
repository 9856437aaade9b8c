"""`follow`: the greedy episodes of a whole pool at once, from what a network says of all cells."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVES
from irs_gym.pool import Pool


@dataclass(frozen=True, eq=False)
class Episodes:
    """What a policy achieved from the start of each of S scenes; arrays of shape ``(S,)``.

    Attributes
    ----------
    is_success
        Whether the robot reached the goal.
    distance, oracle_distance
        Metres travelled, and of the shortest feasible path.
    """

    is_success: NDArray[np.bool_]
    distance: NDArray[np.float64]
    oracle_distance: NDArray[np.float64]

    @property
    def spl(self) -> NDArray[np.float64]:
        """Success weighted by path length: 0 for a failure, else oracle distance over distance."""
        return np.where(self.is_success, self.oracle_distance / np.where(self.is_success, self.distance, 1.0), 0.0)

    @property
    def ratio(self) -> float | None:
        """Mean over the successes of distance over oracle distance; None without any."""
        if not self.is_success.any():
            return None
        return float((self.distance / self.oracle_distance)[self.is_success].mean())


def follow(logits: NDArray[np.float32], pool: Pool, max_steps: int = 400) -> Episodes:
    """Follow the likeliest moves in each scene of a pool, refused into cells that are not feasible.

    Parameters
    ----------
    logits
        Shape ``(S, 8, X, Y)``.
    pool
        S scenes.
    max_steps
        Steps after which an episode ends.
    """
    ahead, kind = _successors(logits.argmax(axis=1), pool.feasible)
    columns = pool.shape[1]
    scenes, cells = np.arange(len(pool)), pool.start @ [columns, 1]
    goals = pool.goal @ [columns, 1]
    steps = np.zeros((len(pool), 3), dtype=np.int64)  # refused, straight, diagonal
    for _ in range(max_steps):
        scenes = scenes[cells[scenes] != goals[scenes]]
        steps[scenes, kind[scenes, cells[scenes]]] += 1
        cells[scenes] = ahead[scenes, cells[scenes]]
    distance = (steps[:, 1] + steps[:, 2] * np.sqrt(2.0)) * pool.cell_size
    return Episodes(cells == goals, distance, pool.oracle_distance)


def _successors(moves: NDArray[np.int64], feasible: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Flat cell that a move in each cell leads to, and 0 for a refused, 1 for a straight, 2 for a diagonal move.

    Both arguments have the shape ``(S, X, Y)``, both results ``(S, X * Y)``.
    """
    scenes, columns, rows = feasible.shape
    di, dj = MOVES[moves.reshape(scenes, -1)].transpose(2, 0, 1)
    i, j = np.divmod(np.arange(columns * rows), rows)
    padded = np.pad(feasible, ((0, 0), (1, 1), (1, 1)))
    is_legal = padded[np.arange(scenes)[:, None], i + di + 1, j + dj + 1]
    here = np.arange(columns * rows)
    return np.where(is_legal, here + di * rows + dj, here), np.where(is_legal, np.abs(di) + np.abs(dj), 0)
