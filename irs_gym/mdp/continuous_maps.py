"""`ContinuousMaps`: scenes in which a robot goes anywhere on the floor, and what its moves may do.

Points are in cells from a map's lower left corner, so that borders of cells are whole numbers; see
`irs_gym.mdp.segment`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from functools import cached_property
from hashlib import blake2b
from itertools import product
from math import ceil
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import Grid
from irs_gym.mdp.segment import BELOW, OBSTACLE, OPEN, padded, snapped
from irs_gym.mdp.task import Rules, World
from irs_gym.memory import freeze, frozen

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Kinds = NDArray[np.uint8]
Point = tuple[float, float]
FieldKind = Literal["cells", "exact"]
OnRefused = Literal["stop", "stay"]

_LEAST = -1e300  # dB: of free cells where nothing is received, over those of obstacles


@dataclass(frozen=True, eq=False)
class ContinuousMaps:
    """S scenes on maps of one shape (X, Y), and the rules of their robots.

    Padded maps have a border of one cell around them: a robot on the outer wall touches it.
    """

    rules: Rules
    field: FieldKind
    speed: float  # metres a second
    time_step: float  # seconds
    goal_radius: float  # metres
    on_refused: OnRefused
    names: tuple[str, ...]
    world: Callable[[int], World]  # of a scene's number: that of `IrsNav-v0`, with its map
    has_many_scenes: bool
    target_db: Floats  # (S,)
    gain_db: Floats  # (S, X, Y)
    free: Bools  # (S, X, Y)
    feasible: Bools  # (S, X, Y)
    cost: Floats | None  # (S, X, Y), of a second in each cell, under a budget
    start: Floats  # (S, 2), in cells
    goal: Floats  # (S, 2), in cells
    irs: NDArray[np.float32] | None  # (S, 3), see `irs_gym.mdp.task.irs_settings`; None: of a cell
    cell_size: float  # metres
    source: tuple[Callable[..., "ContinuousMaps"], tuple[Any, ...]] = dataclass_field(repr=False)

    def __post_init__(self) -> None:
        freeze(self.target_db, self.gain_db, self.free, self.feasible, self.cost)
        freeze(self.start, self.goal)

    def __len__(self) -> int:
        return len(self.names)

    def __reduce__(self) -> Any:
        return self.source

    @property
    def shape(self) -> tuple[int, int]:
        """Cells of a map, (X, Y)."""
        return self.gain_db.shape[1], self.gain_db.shape[2]

    @property
    def width(self) -> int:
        """Rows of a padded map."""
        return self.shape[1] + 2

    @property
    def padded_size(self) -> int:
        """Cells of a padded map."""
        return (self.shape[0] + 2) * self.width

    @cached_property
    def reach(self) -> float:
        """Cells that a step leads over at most."""
        return self.speed * self.time_step / self.cell_size

    @property
    def radius(self) -> float:
        """Of the goal, in cells."""
        return self.goal_radius / self.cell_size

    @property
    def is_costly(self) -> bool:
        """Whether moves may lead below the target, at a cost."""
        return self.rules.constraint in ("allow", "budget")

    @cached_property
    def reachable(self) -> Bools:
        """Cells that a path to success may lead over, ``(S, X, Y)``: free ones under a budget, else
        those at or above the target.
        """
        return self.free if self.rules.constraint == "budget" else self.feasible

    @cached_property
    def kinds(self) -> Kinds:
        """Padded cells: which ones a robot can be in, and what is in the way in the others."""
        return frozen(_kinds(self.free, self.free if self.is_costly else self.feasible))

    @cached_property
    def reachable_kinds(self) -> Kinds:
        """Likewise, with those of `reachable` to be entered."""
        return frozen(_kinds(self.free, self.reachable))

    @cached_property
    def clear(self) -> NDArray[np.uint8]:
        """Of padded cells, the quarters into which no step meets anything, nor costs anything, so
        that none has to be looked at: bits 0 to 3, see `quarter`.
        """
        is_clear = self.kinds == OPEN
        if self.rate is not None:
            is_clear = is_clear & (self.rate == 0.0)

        reach = ceil(self.reach)
        _, columns, rows = is_clear.shape
        around = np.pad(is_clear, ((0, 0), (reach, reach), (reach, reach)))
        clear = np.zeros(is_clear.shape, dtype=np.uint8)

        for sign_x, sign_y in product((1, -1), (1, -1)):
            is_quarter = is_clear.copy()
            for di, dj in product(range(reach + 1), range(reach + 1)):
                i = reach + sign_x * di
                j = reach + sign_y * dj
                is_quarter &= around[:, i : i + columns, j : j + rows]

            clear |= is_quarter.astype(np.uint8) << np.uint8(quarter(sign_x, sign_y))

        return frozen(clear)

    @cached_property
    def rank(self) -> Floats:
        """Gains of padded cells in dB, where free ones lie above obstacles: a robot on a border
        counts to the cell of the highest.
        """
        gain_db = np.where(self.free, np.maximum(self.gain_db, _LEAST), -np.inf)
        return frozen(padded(gain_db, -np.inf))

    @cached_property
    def rate(self) -> Floats | None:
        """What a second in each padded cell costs; None where nothing ever does."""
        if not self.is_costly:
            return None

        costs = (~self.feasible).astype(np.float64) if self.cost is None else self.cost

        return frozen(padded(costs, 0.0))

    @cached_property
    def fingerprint(self) -> bytes:
        """8 bytes that tell maps and rules apart."""
        rules = self.rules
        said: tuple[Any, ...] = (
            *(rules.constraint, rules.cost, rules.on_exhausted, bool(rules.shaping)),
            *(float(rules.goal_bonus), self.field, self.speed, self.time_step, self.goal_radius),
            *(self.cell_size, self.shape),
        )
        if self.on_refused != "stop":  # which is not mentioned
            said = (*said, self.on_refused)

        content = repr(said).encode() + self.target_db.tobytes() + self.gain_db.tobytes()
        if self.cost is not None:
            content += self.cost.tobytes()

        return blake2b(content, digest_size=8).digest()

    def grid(self, scene: int) -> Grid:
        """The cells of a scene."""
        grid: Grid = self.world(scene).radio_map.grid
        return grid

    def own_start(self, scene: int) -> Point:
        """Where the scene has its robots start."""
        return _point(self.start[scene])

    def own_goal(self, scene: int) -> Point:
        """Where the scene has its robots go."""
        return _point(self.goal[scene])

    def in_metres(self, scene: int, points: Any) -> Floats:
        """Points ``(..., 2)`` in metres on the scene's floor."""
        return np.asarray(points) * self.cell_size + self.grid(scene).origin

    def in_cells(self, scene: int, point: Point) -> Point:
        """A point of the scene's floor, in metres, in cells."""
        origin = self.grid(scene).origin
        x, y = ((v - low) / self.cell_size for v, low in zip(point, origin, strict=True))
        return snapped(x), snapped(y)


def _kinds(free: Bools, is_open: Bools) -> Kinds:
    return padded(
        np.where(is_open, OPEN, np.where(free, BELOW, OBSTACLE)).astype(np.uint8), OBSTACLE
    )


def _point(values: Floats) -> Point:
    x, y = values.tolist()
    return snapped(x), snapped(y)


def quarter(dx: Any, dy: Any) -> Any:
    """Into which quarter a move leads: 1 for a negative dx, and 2 more for a negative dy."""
    return (dx < 0) + 2 * (dy < 0)


def check_reach(maps: ContinuousMaps) -> None:
    """Refuse a time step in which a robot could leave what it sees."""
    seen = maps.rules.patch_radius + 0.5
    if maps.reach > seen:
        raise ValueError(
            f"time_step={maps.time_step} s at speed={maps.speed} m/s leads over "
            f"{maps.reach:.4g} cells, further than the {seen:g} that the robot sees with "
            f"patch_radius={maps.rules.patch_radius}"
        )
