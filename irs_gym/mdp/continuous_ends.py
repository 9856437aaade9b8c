"""`choose_ends`: where an episode anywhere on the floor begins and ends; `oracle_distance`: how far
that is at least.
"""

from collections.abc import Callable
from functools import lru_cache
from math import hypot
from typing import Any, NamedTuple

import numpy as np

from irs_gym.grid import Cell, checked_point
from irs_gym.mdp.continuous_maps import ContinuousMaps, Floats, Point
from irs_gym.mdp.continuous_rules import cell_judge, judge_of, site_of
from irs_gym.mdp.dynamics import draws_start
from irs_gym.mdp.segment import BELOW, OBSTACLE, OPEN, snapped
from irs_gym.memory import frozen
from irs_gym.oracle.euclidean_to_go import EuclideanToGo, euclidean_distance_to_go
from irs_gym.oracle.shortest_path import distance_to_go, infeasible

_TRIES = 10_000  # points drawn for a start before it is given up


class ContinuousEnds(NamedTuple):
    """Where an episode begins and ends."""

    scene: int  # its number
    start: Point  # in cells
    goal: Point  # in cells, the centre of the disc


def checked_ends(options: dict[str, Any] | None, *more: str) -> dict[str, Any]:
    """The options of `reset`: ``start`` and ``goal``, checked to be points in metres, and those of
    ``more`` as they are given.

    A ``ValueError`` names an unknown key, or a value that is no point.
    """
    unknown = sorted(set(options or {}) - {"start", "goal", *more})
    if unknown:
        may_hold = "start and goal, points (x, y)" + "".join(f", and {each}" for each in more)
        raise ValueError(
            f"options has the unknown key {', '.join(unknown)}: it may hold {may_hold}"
        )

    return {
        name: value if name in more else checked_point(value, name)
        for name, value in (options or {}).items()
    }


def choose_ends(
    maps: ContinuousMaps,
    scene: int,
    given: dict[str, Point],
    rng: Callable[[], np.random.Generator],
    random_start: float,
) -> ContinuousEnds:
    """Ends of an episode: those that are given, points in metres, else the scene's; or, with
    probability ``random_start``, a start that is drawn.

    Raises ``ValueError`` where there can be no such episode.
    """
    goal = maps.in_cells(scene, given["goal"]) if "goal" in given else maps.own_goal(scene)
    if "start" in given:
        ends = ContinuousEnds(scene, maps.in_cells(scene, given["start"]), goal)
    elif random_start and draws_start(random_start, rng()):
        _check_point(maps, scene, "goal", goal)
        return ContinuousEnds(scene, _drawn_start(maps, scene, goal, rng()), goal)
    else:
        ends = ContinuousEnds(scene, maps.own_start(scene), goal)

    _check_ends(maps, ends)

    return ends


def check_scene(maps: ContinuousMaps, scene: int) -> None:
    """Refuse a scene whose own start and goal cannot be joined, or where giving up would pay."""
    ends = ContinuousEnds(scene, maps.own_start(scene), maps.own_goal(scene))
    _check_ends(maps, ends)
    rules = maps.rules
    if rules.constraint in ("refuse", "allow") or rules.on_exhausted != "terminate":
        return

    straight = hypot(ends.start[0] - ends.goal[0], ends.start[1] - ends.goal[1]) * maps.cell_size
    detour = oracle_distance(maps, ends) - rules.shaping * straight
    if detour >= rules.goal_bonus:
        raise ValueError(
            f"goal_bonus={rules.goal_bonus} is too small for constraint={rules.constraint!r}: to "
            f"end the episode at once would pay more than the detour of {detour:.3f} m, so a bonus "
            "above that is needed"
        )


@lru_cache(maxsize=4096)
def _check_ends(maps: ContinuousMaps, ends: ContinuousEnds) -> None:
    """Refuse ends that cannot be joined; kept, so that the same are checked once."""
    scene, start, goal = ends
    _check_point(maps, scene, "start", start)
    _check_point(maps, scene, "goal", goal)

    away = hypot(start[0] - goal[0], start[1] - goal[1])
    if away <= maps.radius and site_of(maps, scene, goal).sees_goal(*start):
        raise ValueError(
            f"start={_said(maps, scene, start)} m must lie outside of the goal, the disc of "
            f"goal_radius={maps.goal_radius} m about {_said(maps, scene, goal)} m"
        )

    # cells that touch are joined, by the grid's moves as by any
    here, there = (_cell(maps, scene, point) for point in (start, goal))
    if not np.isfinite(grid_to_go(maps, scene, there)[here]):
        gain_db = maps.gain_db[scene]
        raise ValueError(infeasible(gain_db, here, there, float(maps.target_db[scene])))


def _check_point(maps: ContinuousMaps, scene: int, name: str, point: Point) -> None:
    """Refuse a point off the floor, or where a robot cannot be; the ``ValueError`` names it."""
    said = f"{name}={_said(maps, scene, point)} m"
    grid = maps.grid(scene)
    if not (0 <= point[0] <= grid.shape[0] and 0 <= point[1] <= grid.shape[1]):
        raise ValueError(f"{said} lies off the floor from {grid.origin} to {grid.upper} m")

    judge = judge_of(maps, scene)
    kind = judge.kind(*point)
    if kind == OBSTACLE:
        raise ValueError(f"{said} lies in an obstacle")
    if kind == BELOW and maps.field == "exact":  # of cells, it is told with a target that is not
        raise ValueError(
            f"{said} has a gain of {judge.gain_db(*point):.4f} dB, below "
            f"target_db={maps.target_db[scene]}"
        )


def _said(maps: ContinuousMaps, scene: int, point: Point) -> tuple[float, float]:
    x, y = maps.in_metres(scene, point).tolist()
    return x, y


def _cell(maps: ContinuousMaps, scene: int, point: Point) -> Cell:
    """The cell (i, j) that counts as a point's."""
    i, j = divmod(cell_judge(maps, scene).cell(*point), maps.width)
    return i - 1, j - 1


def _drawn_start(maps: ContinuousMaps, scene: int, goal: Point, rng: np.random.Generator) -> Point:
    """A point of the floor from which the goal can be reached, all equally likely, outside of the
    goal's disc.
    """
    cells = _start_cells(maps, scene, _cell(maps, scene, goal))

    for _ in range(_TRIES):
        i, j = cells[rng.integers(len(cells))].tolist()
        x, y = rng.random(2).tolist()
        start = snapped(i + x), snapped(j + y)
        is_away = hypot(start[0] - goal[0], start[1] - goal[1]) > maps.radius
        if is_away and judge_of(maps, scene).kind(*start) == OPEN:
            return start

    raise ValueError(
        f"goal_radius={maps.goal_radius}: none of {_TRIES} starts that were drawn lies outside of "
        f"the goal at {_said(maps, scene, goal)} m"
    )


@lru_cache(maxsize=64)
def _start_cells(maps: ContinuousMaps, scene: int, goal: Cell) -> Any:
    """Cells from which the goal's can be reached, ``(n, 2)``."""
    return frozen(np.argwhere(np.isfinite(grid_to_go(maps, scene, goal))))


@lru_cache(maxsize=64)
def grid_to_go(maps: ContinuousMaps, scene: int, goal: Cell) -> Floats:
    """Metres to go by the grid's moves, ``(X, Y)``: finite where the goal can be reached."""
    known = maps.world(scene).to_go
    if known is not None and maps.rules.constraint != "budget" and goal == maps.world(scene).goal:
        return known
    return frozen(distance_to_go(maps.reachable[scene], goal, maps.cell_size))


# --- what is best ---------------------------------------------------------------------------------


@lru_cache(maxsize=256)
def cells_to_go(maps: ContinuousMaps, scene: int, goal: Point) -> EuclideanToGo:
    """Cells to go from any point to the goal's centre, where a path to success may lead."""
    return euclidean_distance_to_go(maps.reachable[scene], goal, cell_size=1.0)


def oracle_distances(maps: ContinuousMaps, scene: int, starts: Floats, goal: Point) -> Floats:
    """Metres from points ``(n, 2)`` in cells to the goal's disc, ``(n,)``.

    Of ``field="cells"`` it is the least, where the whole disc can be entered; under a budget, and
    of the exact field, a bound that no robot can beat.
    """
    if maps.field == "exact":
        away = np.hypot(starts[:, 0] - goal[0], starts[:, 1] - goal[1])
    else:
        away = cells_to_go(maps, scene, goal)(starts)

    return np.maximum(0.0, away - maps.radius) * maps.cell_size


@lru_cache(maxsize=4096)
def oracle_distance(maps: ContinuousMaps, ends: ContinuousEnds) -> float:
    """`oracle_distances` of one episode; kept."""
    return float(oracle_distances(maps, ends.scene, np.array([ends.start]), ends.goal)[0])


def oracle_points(maps: ContinuousMaps, ends: ContinuousEnds) -> Floats:
    """The oracle's polyline from the start to the goal's centre over cells, ``(k, 2)`` in cells."""
    return cells_to_go(maps, ends.scene, ends.goal).path(np.array(ends.start))
