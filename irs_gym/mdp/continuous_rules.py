"""`Site`: the moves of one robot anywhere on the floor, for one scene and goal."""

from functools import lru_cache
from math import floor, isfinite, sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.continuous_maps import ContinuousMaps, Point, quarter
from irs_gym.mdp.dynamics import reward
from irs_gym.mdp.exact_field import exact_field
from irs_gym.mdp.segment import BELOW, OPEN, Walk, snapped, walk

NEVER = 2.0  # a share of a segment that is not reached


class Judge(Protocol):
    """What the field says of points and segments in cells, of one scene."""

    def walk(self, start: Point, end: Point, until: float) -> Walk:
        """How far a robot comes; see `irs_gym.mdp.segment.walk`."""

    def rate(self, x: float, y: float) -> float:
        """What a second there costs."""

    def gain_db(self, x: float, y: float) -> float:
        """Expected channel gain."""

    def kind(self, x: float, y: float) -> int:
        """Whether a robot can be there, and what is in its way if not."""

    def sees(self, start: Point, end: Point) -> bool:
        """Whether the straight line between two points may be part of a path to success."""


class Move(NamedTuple):
    """What an action does to a robot."""

    x: float  # in cells
    y: float
    moved: float  # metres
    share: float  # of the time step that was used
    cost: float
    is_refused: bool  # whether something stopped it
    is_violation: bool  # whether that ends the episode
    is_at_goal: bool


class CellJudge:
    """The field as the map has it: the gain at a point is that of its cell."""

    def __init__(self, maps: ContinuousMaps, scene: int) -> None:
        self._width = maps.width
        self._kinds = maps.kinds[scene].tobytes()
        self._clear = maps.clear[scene].tobytes()
        self._reachable = maps.reachable_kinds[scene].tobytes()
        self._rank: list[float] = maps.rank[scene].ravel().tolist()
        self._rate = None if maps.rate is None else maps.rate[scene].ravel().tolist()
        self._gain = maps.gain_db[scene]

    def walk(self, start: Point, end: Point, until: float) -> Walk:  # noqa: D102
        if until == 1.0:
            x, y = start
            clear = self._clear[(floor(x) + 1) * self._width + floor(y) + 1]
            if clear >> quarter(end[0] - x, end[1] - y) & 1:
                return Walk(1.0, end[0], end[1], -1, 0.0)

        return walk(self._kinds, self._rate, self._width, start, end, until)

    def rate(self, x: float, y: float) -> float:  # noqa: D102
        return 0.0 if self._rate is None else self._rate[self.cell(x, y)]

    def gain_db(self, x: float, y: float) -> float:  # noqa: D102
        i, j = divmod(self.cell(x, y), self._width)
        return float(self._gain.item(i - 1, j - 1))

    def kind(self, x: float, y: float) -> int:  # noqa: D102
        return int(self._kinds[self.cell(x, y)])

    def sees(self, start: Point, end: Point) -> bool:  # noqa: D102
        return start == end or walk(self._reachable, None, self._width, start, end)[0] == 1.0

    def cell(self, x: float, y: float) -> int:
        """The flat padded cell that counts as a robot's: of those that it touches, the one of the
        highest gain.
        """
        i = floor(x)
        j = floor(y)
        cell = (i + 1) * self._width + j + 1
        if i != x and j != y:
            return cell

        touched = [cell]
        if i == x:
            touched.append(cell - self._width)
        if j == y:
            touched += [each - 1 for each in touched]

        return max(touched, key=self._rank.__getitem__)  # the first of equals


class Site:
    """One scene for one goal, as plain numbers: what the moves of a single robot ask for."""

    def __init__(self, maps: ContinuousMaps, scene: int, goal: Point) -> None:
        self.maps = maps
        self.scene = scene
        self.goal = goal
        self.cells = cell_judge(maps, scene)
        self.judge = judge_of(maps, scene)
        self.is_plain = is_plain(maps, scene, goal)
        self._reach = maps.reach
        self._radius = maps.radius
        self._is_endable = maps.rules.constraint == "terminate"
        self._stays = maps.on_refused == "stay"

    def sees_goal(self, x: float, y: float) -> bool:
        """Whether the straight line from a point to the goal's centre may be gone."""
        return self.is_plain or self.judge.sees((x, y), self.goal)

    def move(self, x: float, y: float, ax: float, ay: float) -> Move:
        """What an action of at most length 1 does to a robot at (x, y)."""
        to_x = snapped(x + ax * self._reach)
        to_y = snapped(y + ay * self._reach)
        dx = to_x - x
        dy = to_y - y
        judge = self.judge
        time_step = self.maps.time_step
        if dx == 0.0 and dy == 0.0:
            return Move(x, y, 0.0, 1.0, judge.rate(x, y) * time_step, False, False, False)

        # where the disc of the goal is entered, if the centre can be seen from there
        goal_x, goal_y = self.goal
        until = entrance(x - goal_x, y - goal_y, dx, dy, self._radius)
        if until <= 1.0 and not self.sees_goal(x + until * dx, y + until * dy):
            until = NEVER

        share, new_x, new_y, blocked, paid = judge.walk((x, y), (to_x, to_y), min(until, 1.0))
        is_refused = blocked >= 0
        if is_refused and self._stays:
            share, new_x, new_y, paid = 0.0, x, y, 0.0

        is_at_goal = until <= 1.0 and not is_refused
        if until == NEVER:  # or where it has come to
            away = (new_x - goal_x) * (new_x - goal_x) + (new_y - goal_y) * (new_y - goal_y)
            is_inside = away <= self._radius * self._radius
            is_at_goal = is_inside and self.sees_goal(new_x, new_y)

        # who is stopped stands there for the rest of the time
        used = share if is_at_goal else 1.0
        stood = used - share
        if stood > 0.0:
            paid += stood * judge.rate(new_x, new_y)

        away_x = new_x - x
        away_y = new_y - y
        moved = sqrt(away_x * away_x + away_y * away_y) * self.maps.cell_size
        is_violation = self._is_endable and blocked == BELOW and not is_at_goal
        cost = 1.0 if is_violation else paid * time_step

        return Move(new_x, new_y, moved, used, cost, is_refused, is_violation, is_at_goal)


def entrance(x: float, y: float, dx: float, dy: float, radius: float) -> float:
    """Share of the segment from (x, y) by (dx, dy) after which it enters the disc about the origin:
    `NEVER` where it does not, 0 from inside.

    Examples
    --------
    >>> entrance(-2.0, 0.0, 2.0, 0.0, 0.5), entrance(0.0, 1.0, 1.0, 0.0, 0.5)
    (0.75, 2.0)
    """
    beyond = x * x + y * y - radius * radius
    if beyond <= 0.0:
        return 0.0

    towards = -(x * dx + y * dy)
    under = towards * towards - (dx * dx + dy * dy) * beyond
    if towards <= 0.0 or under < 0.0:
        return NEVER

    share = beyond / (towards + sqrt(under))

    return share if share <= 1.0 else NEVER


def is_plain(maps: ContinuousMaps, scene: int, goal: Point) -> bool:
    """Whether the goal's disc lies within one cell that may be entered, so that its centre is seen
    from all of it.
    """
    i, j = floor(goal[0]), floor(goal[1])
    to_border = min(goal[0] - i, i + 1 - goal[0], goal[1] - j, j + 1 - goal[1])
    is_reachable = bool(maps.reachable_kinds[scene, i + 1, j + 1] == OPEN)

    return maps.field == "cells" and to_border >= maps.radius and is_reachable


def step_reward(maps: ContinuousMaps, share: Any, before: Any, after: Any, is_at_goal: Any) -> Any:
    """Minus the metres for which the time would have sufficed, plus the decrease of the distance to
    the goal's centre as the crow flies, plus the goal's bonus.

    ``before`` and ``after``: that distance in cells.
    """
    shaping = maps.cell_size * maps.rules.shaping
    length = share * (maps.speed * maps.time_step)
    return reward(maps.rules, length, -before * shaping, -after * shaping, is_at_goal)


def checked_heading(action: Any) -> Point:
    """The action ``(2,)`` as two numbers, clipped to the unit disc; a ``ValueError`` says what is
    wrong with one that is none.

    Examples
    --------
    >>> checked_heading([3.0, 4.0])
    (0.6, 0.8)
    """
    try:
        x, y = action.tolist() if isinstance(action, np.ndarray) else action
        length = sqrt(x * x + y * y)
    except (AttributeError, OverflowError, TypeError, ValueError):
        length = np.nan

    if not isfinite(length) or isinstance(x, bool):
        raise ValueError(f"action={action!r} must be two finite numbers, along x and y")

    return (x / length, y / length) if length > 1.0 else (float(x), float(y))


def checked_headings(actions: Any, count: int) -> NDArray[np.float64]:
    """Actions ``(count, 2)`` of robots, clipped to the unit disc, as ``(2, count)``; a
    ``ValueError`` names the first that is none.
    """
    try:
        headings = np.array(actions, dtype=np.float64)
    except (TypeError, ValueError):
        headings = np.empty(0)

    if headings.shape != (count, 2):
        raise ValueError(
            f"actions has the shape {np.shape(actions)}, but two numbers for each of the {count} "
            "environments are needed"
        )

    x, y = np.ascontiguousarray(headings.T)
    with np.errstate(over="ignore"):
        length = np.sqrt(x * x + y * y)  # (n,)
    if not np.isfinite(length).all():
        first = int(np.flatnonzero(~np.isfinite(length))[0])
        raise ValueError(
            f"actions[{first}]={headings[first].tolist()} must be two finite numbers, along x and y"
        )

    return np.asarray(np.stack([x, y]) / np.maximum(length, 1.0))


@lru_cache(maxsize=32)
def cell_judge(maps: ContinuousMaps, scene: int) -> CellJudge:
    """Judge of a scene's cells; kept."""
    return CellJudge(maps, scene)


def judge_of(maps: ContinuousMaps, scene: int) -> Judge:
    """What the field of the maps says of a scene."""
    return exact_field(maps, scene) if maps.field == "exact" else cell_judge(maps, scene)


@lru_cache(maxsize=32)
def site_of(maps: ContinuousMaps, scene: int, goal: Point) -> Site:
    """Site of a scene and a goal; kept."""
    return Site(maps, scene, goal)
