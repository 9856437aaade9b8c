"""`ScalingCost`: time and memory of maps and paths over the number of cells, other packages in the
same run.
"""

import json
import multiprocessing
import os
import platform
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from agents.runs import provenance
from irs_gym import RadioMap, build_radio_map, load_scene, shortest_path
from irs_gym.grid import Cell

SIDES = (40, 200, 400, 1000)  # cells along each side of the room
TARGET_DB = -61.8
MIB = 2**20


@dataclass(frozen=True)
class ScalingCost:
    """Cost of one task.

    Attributes
    ----------
    task
        Its name in `TASKS`.
    cells
        Cells of the map.
    seconds
        Time of the fastest run: what slows the others down is the machine's other work.
    peak_mib
        Peak memory of the whole process that did it, interpreter and imports included.
    distance
        What it found, in metres; None for maps.
    """

    task: str
    cells: int
    seconds: float
    peak_mib: float
    distance: float | None


# --- tasks: each gives what is to be timed --------------------------------------------------------


def nothing(_side: int) -> Callable[[], None]:
    """The interpreter and the imports."""
    return lambda: None


def map_of(**arguments: Any) -> Callable[[int], Callable[[], None]]:
    """A map, from the scene file on."""

    def prepare(side: int) -> Callable[[], None]:
        def run() -> None:
            scene = load_scene("paper")
            build_radio_map(scene, (scene.room.x_max - scene.room.x_min) / side, **arguments)

        return run

    return prepare


def oracle(side: int) -> Callable[[], float]:
    """The oracle of this package, from the feasible map to the path."""
    radio_map, start, goal = _task(side)
    feasible = radio_map.feasible(TARGET_DB)

    def run() -> float:
        path = shortest_path(feasible, start, goal, radio_map.grid.cell_size)
        return float("inf") if path is None else path.distance

    return run


def with_networkx(side: int) -> Callable[[], float]:
    """networkx, from the feasible map to the path: its graph, then its Dijkstra search with two
    ends.
    """
    import networkx

    radio_map, start, goal = _task(side)
    feasible = radio_map.feasible(TARGET_DB)
    cell_size = radio_map.grid.cell_size

    def run() -> float:
        graph = networkx.Graph()

        # Half of the eight directions: an edge leads both ways.
        for di, dj, length in ((1, 0, 1.0), (0, 1, 1.0), (1, 1, 2**0.5), (1, -1, 2**0.5)):
            i, j = np.nonzero(feasible)
            on_map = (i + di < side) & (j + dj < side) & (j + dj >= 0)
            i = i[on_map]
            j = j[on_map]

            both = feasible[i + di, j + dj]
            one = i * side + j
            other = (i + di) * side + j + dj
            graph.add_weighted_edges_from(
                (a, b, length)
                for a, b in zip(one[both].tolist(), other[both].tolist(), strict=False)
            )

        ends = start[0] * side + start[1], goal[0] * side + goal[1]
        return float(networkx.bidirectional_dijkstra(graph, *ends)[0]) * cell_size

    return run


def with_scikit_image(side: int) -> Callable[[], float]:
    """scikit-image's ``MCP_Geometric``, from the feasible map to the path."""
    from skimage.graph import MCP_Geometric

    radio_map, start, goal = _task(side)
    feasible = radio_map.feasible(TARGET_DB)
    cell_size = radio_map.grid.cell_size

    def run() -> float:
        search = MCP_Geometric(np.where(feasible, 1.0, np.inf))
        costs, _ = search.find_costs([start], [goal])
        search.traceback(goal)
        return float(costs[goal]) * cell_size

    return run


def _task(side: int) -> tuple[RadioMap, Cell, Cell]:
    scene = load_scene("paper")
    radio_map = build_radio_map(scene, (scene.room.x_max - scene.room.x_min) / side)
    return radio_map, radio_map.grid.cell_of(scene.start), radio_map.grid.cell_of(scene.goal)


TASKS: dict[str, Callable[[int], Callable[[], Any]]] = {
    "imports alone": nothing,
    "map, continuous phases": map_of(),
    "map, 1 bit, nearest": map_of(phase_bits=1),
    "map, 1 bit, optimal": map_of(phase_bits=1, quantiser="optimal"),
    "path, irs_gym": oracle,
    "path, scikit-image": with_scikit_image,
    "path, networkx": with_networkx,
}
LEFT_OUT = {("path, networkx", 1000)}  # minutes, and several GiB of Python objects


# --- measurement ----------------------------------------------------------------------------------


def measure_task(task: str, side: int) -> ScalingCost:
    """Cost of a task on a map of ``side`` by ``side`` cells, in this process, which should be a
    fresh one.
    """
    run = TASKS[task](side)
    seconds: list[float] = []
    found = None

    # three times or more, for a second, and no longer than twenty
    while len(seconds) < 3 or (sum(seconds) < 1.0 and len(seconds) < 50):
        began = perf_counter()
        found = run()
        seconds.append(perf_counter() - began)
        if sum(seconds) > 20:
            break

    return ScalingCost(task, side * side, min(seconds), peak_memory() / MIB, found)


def peak_memory() -> int:
    """Largest resident size of this process so far, in bytes."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))
    except (OSError, StopIteration):  # not Linux; there, getrusage counts the parent's pages too
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else peak * 1024


def measure_all(
    sides: tuple[int, ...] = SIDES, report: Callable[[str], None] = print
) -> dict[str, Any]:
    """All costs, one after the other, each in a process of its own, and the machine behind them."""
    costs = []

    for task in TASKS:
        for side in sides if task != "imports alone" else (0,):
            if (task, side) in LEFT_OUT:
                continue

            cost = _in_a_process(task, side)
            costs.append(cost)
            report(f"{task}, {cost.cells:,} cells: {cost.seconds:.4g} s, {cost.peak_mib:.0f} MiB")

    packages = {name: version(name) for name in ("numpy", "scipy", "networkx", "scikit-image")}
    machine = {
        "processor": provenance.processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **packages,
    }

    return {"machine": machine, "costs": [asdict(cost) for cost in costs]}


def _in_a_process(task: str, side: int) -> ScalingCost:
    """Cost of a task in a fresh process, so that its peak memory is its own."""
    context = multiprocessing.get_context("spawn")
    on_start = (signal.SIGINT, signal.SIG_DFL)  # a Ctrl-C ends it without a traceback
    with ProcessPoolExecutor(1, context, signal.signal, on_start) as pool:
        return pool.submit(measure_task, task, side).result()


def read_costs(path: Path) -> tuple[dict[str, Any], list[ScalingCost]]:
    """Machine and costs from a file of `measure_all`'s results."""
    record = json.loads(path.read_text(encoding="utf-8"))
    return record["machine"], [ScalingCost(**cost) for cost in record["costs"]]
