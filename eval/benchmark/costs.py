"""Costs of what happens once in a while: a reset, a frame, a front, an import; each a list of
repeated measurements.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path
from time import perf_counter
from typing import Any
from unittest import mock

import gymnasium
import numpy as np

from eval.benchmark.benchmark_envs import ID
from eval.benchmark.timing import Spread
from irs_gym import budget_to_go, build_radio_map, cost_map, pareto_front
from irs_gym.grid import Cell
from irs_gym.mdp.dynamics import tabulate
from irs_gym.oracle import shortest_path

ROOT = Path(__file__).resolve().parents[2]
FRAMES = 20  # of an episode
CELL_SIZES = (0.5, 0.05)  # of the maps of fronts, in metres


@dataclass(frozen=True)
class EventCost:
    """What something takes.

    Attributes
    ----------
    seconds
        Of one time.
    dijkstra_runs
        Per time; None where there are none to count.
    """

    what: str
    seconds: Spread
    dijkstra_runs: float | None = None


def resets(repeats: int) -> list[EventCost]:
    """Resets of one environment and of 1,024, with old and new starts and goals."""
    env = gymnasium.make(ID)
    cells = _cells(env)
    goal = next(cells)
    env.reset(options={"goal": goal})
    many: Any = gymnasium.make_vec(ID, num_envs=1024, random_start=True)
    many.reset(seed=0)

    return [
        _reset("the scene's start and goal", repeats, env.reset),
        _reset("a new start", repeats, lambda: env.reset(options={"start": next(cells)})),
        _reset(
            "a new start and a goal used before",
            repeats,
            lambda: env.reset(options=_ends(cells, goal)),
        ),
        _reset("1,024 environments, each with a new start", max(1, repeats // 10), many.reset),
        _reset(
            "a new start and a new goal",
            repeats,
            lambda: env.reset(options=_ends(cells, next(cells))),
        ),
    ]


def frames(repeats: int) -> list[EventCost]:
    """Pictures of 512 px: the first of an episode, and those after it."""
    env = gymnasium.make(ID, render_mode="rgb_array")
    cells = _cells(env)
    firsts = []
    laters = []

    for _ in range(max(1, repeats // FRAMES)):
        _, info = env.reset(seed=0, options={"start": next(cells)})
        firsts.append(_seconds(env.render))
        is_over = False
        count = 0

        while not is_over and count < FRAMES:
            _, _, is_over, _, info = env.step(env.action_space.sample(mask=info["action_mask"]))
            laters.append(_seconds(env.render))
            count += 1

    return [
        EventCost("first frame of an episode", Spread.of(firsts)),
        EventCost("each frame after it", Spread.of(laters)),
    ]


def fronts(repeats: int) -> list[EventCost]:
    """Pareto fronts of the paper's scene at -60 dB, on its grid and on one of 100 times as many
    cells; and distances of 1,024 robots with budgets.
    """
    found = []

    for cell_size, times in zip(CELL_SIZES, (repeats, 1), strict=False):
        radio_map = build_radio_map("paper", cell_size)
        grid = radio_map.grid
        ends = (grid.cell_of((-10.0, 0.0)), grid.cell_of((10.0, 0.0)))

        costs = {
            "violations": cost_map(radio_map, -60.0, "violation"),
            "deficits": cost_map(radio_map, -60.0, "deficit"),
        }
        for name, cost in costs.items():
            seconds = [
                _seconds(partial(pareto_front, cost, *ends, cell_size)) for _ in range(times)
            ]
            found.append(EventCost(f"front of {name}, {cost.size:,} cells", Spread.of(seconds)))

    return found + _budgets(repeats)


def _budgets(repeats: int) -> list[EventCost]:
    cost = cost_map(build_radio_map("paper"), -60.0, "violation")
    solve = partial(budget_to_go, cost, (39, 20), 0.5, most=26)
    rng = np.random.default_rng(0)
    look_up = partial(solve().distance, rng.integers(0, cost.size, 1024), rng.integers(0, 27, 1024))

    return [
        EventCost(
            "fronts of all 1,600 cells", Spread.of([_seconds(solve) for _ in range(repeats)])
        ),
        EventCost("1,024 looked up", Spread.of([_seconds(look_up) for _ in range(repeats)])),
    ]


def imports(repeats: int) -> list[EventCost]:
    """Imports in a new Python each, of this package and, for comparison, of Gymnasium alone."""
    return [
        EventCost(
            f"import {package}", Spread.of([_import_seconds(package) for _ in range(repeats)])
        )
        for package in ("irs_gym", "gymnasium")
    ]


def _reset(what: str, repeats: int, reset: Callable[[], Any]) -> EventCost:
    module: Any = shortest_path  # `dijkstra` there is scipy's, and not exported
    with mock.patch.object(module, "dijkstra", wraps=module.dijkstra) as runs:
        seconds = [_seconds(reset) for _ in range(repeats)]

    return EventCost(what, Spread.of(seconds), runs.call_count / repeats)


def _cells(env: gymnasium.Env[Any, Any]) -> Iterator[Cell]:
    """All cells but the goal that are joined to it, in random order, again and again."""
    world = env.unwrapped.world  # type: ignore[attr-defined]
    starts = np.random.default_rng(0).permutation(tabulate(world, world.goal).starts)
    return cycle([world.radio_map.grid.cell_at(each) for each in starts.tolist()])


def _ends(cells: Iterator[Cell], goal: Cell) -> dict[str, Cell]:
    """Options of a reset with that goal and another cell as the start."""
    return {"goal": goal, "start": next(cell for cell in cells if cell != goal)}


def _seconds(call: Callable[[], Any]) -> float:
    began = perf_counter()
    call()
    return perf_counter() - began


def _import_seconds(package: str) -> float:
    code = (
        "from time import perf_counter as now; began = now(); "
        f"import {package}; print(now() - began)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT
    )
    return float(done.stdout)
