"""`compare_lengths`: the oracle against the lengths that scenario files of the MovingAI benchmarks
print; `time_solvers`: its time for a path beside other packages.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from math import floor, hypot, inf, log10
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from irs_gym import shortest_lengths, shortest_path
from irs_gym.grid import MOVES, Cell, legal_moves
from irs_gym.radio.readers.movingai import (
    MovingAiMap,
    MovingAiScenario,
    map_of,
    read_movingai_scenarios,
)

DIGITS = 6  # that a length is printed with, zeros at its end left out
# Relative: the files' own sums are of single precision, and round the sixth digit with that error.
SINGLE = 2.0**-23

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Comparison:
    """What one scenario file says, and what the oracle finds.

    Attributes
    ----------
    name
        Of the file.
    cells
        That can be entered.
    scenarios
        The tasks.
    lengths
        Of the oracle's paths in cells, shape ``(n,)``.
    seconds
        Of one core that it took for all.
    """

    name: str
    cells: int
    scenarios: tuple[MovingAiScenario, ...]
    lengths: NDArray[np.float64]
    seconds: float

    @property
    def printed(self) -> NDArray[np.float64]:
        """The printed lengths, shape ``(n,)``."""
        return np.array([each.length for each in self.scenarios])

    @property
    def differences(self) -> NDArray[np.float64]:
        """How far each length lies from the printed one, in cells; shape ``(n,)``."""
        return np.abs(self.lengths - self.printed)

    @property
    def units(self) -> NDArray[np.float64]:
        """One in the last of six digits of each printed length, shape ``(n,)``."""
        return np.array([last_digit(length) for length in self.printed.tolist()])

    @property
    def is_equal(self) -> Bools:
        """Whether each length is the printed one within its rounding, shape ``(n,)``."""
        return self.differences <= self.units / 2 + self.printed * SINGLE


def last_digit(length: float) -> float:
    """One in the last of the digits that a length is printed with.

    Examples
    --------
    >>> last_digit(3.41421), last_digit(760.938)
    (1e-05, 0.001)
    """
    first = floor(log10(length)) if length > 0 else 0
    return float(f"1e{first - DIGITS + 1}")


def compare_lengths(path: Path, folder: Path) -> Comparison:
    """Compare one scenario file, whose map lies beside it or below a folder.

    Raises
    ------
    FileNotFoundError
        Where there is no such file or map.
    ValueError
        Where one is damaged, or is not of the other.
    """
    scenarios = read_movingai_scenarios(path)
    if not scenarios:
        raise ValueError(f"{path}: it holds no scenario")

    grid = map_of(path, scenarios, folder)
    began = process_time()
    lengths = np.full(len(scenarios), inf)

    # ways over ground, and ways over water
    is_water = np.array([grid.letters[each.start] == b"W" for each in scenarios])
    for which in (np.flatnonzero(~is_water), np.flatnonzero(is_water)):
        if len(which):
            lengths[which] = shortest_lengths(
                grid.free_from(scenarios[which[0]].start),
                [scenarios[n].start for n in which],
                [scenarios[n].goal for n in which],
                cell_size=1.0,
                corner_cutting=False,
            )

    return Comparison(
        name=path.name,
        cells=int(np.count_nonzero(grid.free_from())),
        scenarios=scenarios,
        lengths=lengths,
        seconds=process_time() - began,
    )


# --- time beside other packages -------------------------------------------------------------------


def _ours(free: Bools, start: Cell, goal: Cell, corner_cutting: bool) -> float:
    path = shortest_path(free, start, goal, 1.0, corner_cutting=corner_cutting)
    return inf if path is None else path.distance


def _networkx(free: Bools, start: Cell, goal: Cell, corner_cutting: bool) -> float:
    import networkx

    # half of the eight moves: an edge leads both ways
    graph = networkx.Graph()
    cells = np.arange(free.size).reshape(free.shape)
    is_move = legal_moves(free, corner_cutting) & free[..., None]  # (X, Y, 8)
    for move, (di, dj) in enumerate(MOVES[:4].tolist()):
        first = cells[is_move[..., move]]
        second = first + di * free.shape[1] + dj
        graph.add_weighted_edges_from(
            (a, b, hypot(di, dj)) for a, b in zip(first.tolist(), second.tolist(), strict=True)
        )

    ends = int(cells[start]), int(cells[goal])
    return float(networkx.bidirectional_dijkstra(graph, *ends)[0])


def _scikit_image(free: Bools, start: Cell, goal: Cell, corner_cutting: bool) -> float:
    from skimage.graph import MCP_Geometric

    if not corner_cutting:
        raise ValueError("scikit-image always cuts corners")

    costs, _ = MCP_Geometric(np.where(free, 1.0, inf)).find_costs([start], [goal])
    return float(costs[goal])


Solver = Callable[[Bools, Cell, Cell, bool], float]
# name, package that it needs, whether it cuts corners
SOLVERS: tuple[tuple[str, str, bool, Solver], ...] = (
    ("irs_gym", "scipy", False, _ours),
    ("networkx", "networkx", False, _networkx),
    ("irs_gym, corners cut", "scipy", True, _ours),
    ("scikit-image, corners cut", "skimage", True, _scikit_image),
)


@dataclass(frozen=True)
class Timing:
    """Seconds of one core for one task, from the map to the length in cells; None where a package
    is not installed.
    """

    solver: str
    seconds: float | None
    length: float | None


def time_solvers(grid: MovingAiMap, scenario: MovingAiScenario) -> list[Timing]:
    """Each solver's time for one task: of three runs the fastest, or of one that takes longer than
    ten seconds.
    """
    free = grid.free_from(scenario.start)
    timings = []

    for name, package, corner_cutting, solve in SOLVERS:
        if find_spec(package) is None:
            timings.append(Timing(name, None, None))
            continue

        seconds: list[float] = []
        length = inf
        while not seconds or (len(seconds) < 3 and sum(seconds) < 10):
            began = process_time()
            length = solve(free, scenario.start, scenario.goal, corner_cutting)
            seconds.append(process_time() - began)

        timings.append(Timing(name, min(seconds), length))

    return timings


def longest(comparison: Comparison) -> MovingAiScenario:
    """The task of the longest path."""
    return comparison.scenarios[int(np.argmax(comparison.printed))]
