"""`Packing`: the layout of observations, by which they are written into rows and read from them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import isqrt, prod
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from irs_gym.grid import flat_cells
from irs_gym.mdp.dynamics import ACTIONS
from irs_gym.mdp.task import Observation

MARGIN_SCALE_DB = 5.0  # a margin of this many dB over the target is seen as 1
# Channels of a map. Obstacle, robot and goal hold 0 or 1; the budget is there under one alone.
MARGIN, OBSTACLE, ROBOT, GOAL, BUDGET = range(5)
SETTINGS = 3  # numbers that `irs_gym.mdp.task.irs_settings` gives; phases follow them
_ENDS = 4  # numbers: own position along x and y, vector to the goal along x and y
_MOST_CELLS = 2**24  # whole numbers up to this one are float32 as well

Ints = NDArray[np.int64]
Rows = NDArray[np.float32]
Parts = tuple[Rows, ...]  # of rows: one for each array of an observation


class DecodedObservation(NamedTuple):
    """One observation taken apart, or a batch of shape ``...``; cells are flat."""

    margin: Rows
    """Scaled margins over the target: of the patch ``(..., 2r+1, 2r+1)`` with the robot in the
    middle, or of the map ``(..., X, Y)``."""
    cell: Ints  # (...,), where the robot is
    goal: Ints  # (...,)
    irs: Rows  # (..., 3), the settings of the IRS; a map tells none, (..., 0)
    phases: Rows  # (..., N), its phase shifts; N is 0 where they are left out
    action_mask: NDArray[np.int8] | None  # (..., 8), in masked observations
    budget: Rows | None = None  # (...,), what is left of a budget, scaled, where there is one


@dataclass(frozen=True)
class Packing:
    """How observations are packed in rows of float32.

    In the order of their keys, as `gymnasium.spaces.flatten` packs a Dict: ``budget`` (1) where
    there is one, ``gain_patch`` (2r+1, 2r+1), ``irs`` (3 + N), ``position`` (4). Masked, the action
    mask (8) follows. As a map, a row holds the image (4, X, Y), or with a budget (5, X, Y); as a
    cell, its flat index. Raises ``ValueError`` for more cells than float32 can number.

    Examples
    --------
    A robot in the cell (1, 2) of a room of 4 x 5 cells, on its way to (3, 0):

    >>> packing = Packing("flat", side=3, settings=3, shape=(4, 5))
    >>> cell, goal = np.array([[1, 2]]), np.array([[3, 0]])
    >>> parts = packing.encode(
    ...     packing.empty(1),
    ...     patch=np.zeros((1, 9)),
    ...     irs=np.full((1, 3), -1.0),
    ...     own=own_positions(cell, packing.shape),
    ...     to_goal=vectors_to_goal(cell - goal, packing.shape),
    ... )
    >>> decoded = packing.decode(packing.unpack(parts))
    >>> decoded.cell.tolist(), decoded.goal.tolist(), decoded.margin.shape
    ([7], [15], (1, 3, 3))
    """

    observation: Observation
    side: int  # of the patch, 2r+1
    settings: int  # 3 + N
    shape: tuple[int, int]  # of the map, (X, Y)
    has_budget: bool = False

    def __post_init__(self) -> None:
        if self.observation == "cell" and prod(self.shape) > _MOST_CELLS:
            raise ValueError(
                f"observation='cell' can tell {_MOST_CELLS} cells apart, and {self.shape} are more"
            )

    @classmethod
    def of(
        cls,
        observation: Any,
        shape: tuple[int, int],
        radius: int | None = None,
        has_budget: bool = False,
    ) -> "Packing":
        """The packing of one observation, or of a batch, as far as it can be told from it.

        Parameters
        ----------
        observation
            Of any kind.
        shape
            Of the map, ``(X, Y)``.
        radius
            Of the patch, r. Without it, a flat observation is taken for one that holds no phase
            shifts; where that cannot be, its patch and its phase shifts cannot be told apart: the
            side is then 0, and all before the position is taken for settings of the IRS.
        has_budget
            Whether flat observations begin with a budget; others tell by themselves.

        Examples
        --------
        >>> Packing.of(np.zeros(9 + 3 + 4), shape=(40, 40))
        Packing(observation='flat', side=3, settings=3, shape=(40, 40), has_budget=False)
        """
        if isinstance(observation, Mapping):
            if "action_mask" in observation:
                flat = cls.of(observation["observation"], shape, radius, has_budget)
                return replace(flat, observation="masked")

            side = np.shape(observation["gain_patch"])[-1]
            irs = np.shape(observation["irs"])[-1]
            return cls("dict", side, irs, shape, "budget" in observation)

        array = np.asarray(observation)
        if np.issubdtype(array.dtype, np.integer):
            return cls("cell", 0, 0, shape)
        if array.shape[-3:] in ((4, *shape), (5, *shape)):
            return cls("map", 0, 0, shape, array.shape[-3] == 5)

        return cls.of_width(array.shape[-1], shape, radius, has_budget)

    @classmethod
    def of_width(
        cls,
        width: int,
        shape: tuple[int, int],
        radius: int | None = None,
        has_budget: bool = False,
    ) -> "Packing":
        """The packing of flat observations of that many numbers; see `of`."""
        width -= has_budget
        if radius is not None:
            side = 2 * radius + 1
        else:
            cells = width - SETTINGS - _ENDS  # of the patch, where there are no phase shifts
            side = isqrt(max(0, cells))
            if side**2 != cells or side % 2 == 0:
                side = 0

        return cls("flat", side, width - side**2 - _ENDS, shape, has_budget)

    # --- columns of a row -------------------------------------------------------------------------

    @cached_property
    def patch(self) -> slice:
        """Columns of the patch."""
        return slice(int(self.has_budget), self.has_budget + self.side**2)

    @cached_property
    def irs(self) -> slice:
        """Columns of what a row tells of the IRS: settings, then phase shifts."""
        return slice(self.patch.stop, self.patch.stop + self.settings)

    @cached_property
    def own(self) -> slice:
        """Columns of the robot's own position."""
        return slice(self.irs.stop, self.irs.stop + 2)

    @cached_property
    def to_goal(self) -> slice:
        """Columns of the vector to the goal."""
        return slice(self.own.stop, self.own.stop + 2)

    @cached_property
    def _position(self) -> slice:
        return slice(self.own.start, self.to_goal.stop)

    @cached_property
    def flat_width(self) -> int:
        """Columns of what a flat observation holds; in a masked one, the mask comes behind them."""
        return int(self.to_goal.stop)

    @cached_property
    def width(self) -> int:
        """Columns of a row, D."""
        image = self.channels * prod(self.shape)
        others = {"map": image, "masked": self.flat_width + ACTIONS, "cell": 1}
        return others.get(self.observation, self.flat_width)

    @property
    def channels(self) -> int:
        """Channels of a map."""
        return BUDGET + self.has_budget

    @property
    def space(self) -> spaces.Space[Any]:
        """Of one observation; a new one each time, as a space holds its samples' randomness."""
        shapes = {"gain_patch": (self.side, self.side), "irs": (self.settings,), "position": (4,)}
        if self.has_budget:
            shapes["budget"] = (1,)

        if self.observation == "dict":
            return spaces.Dict({name: _box(shape) for name, shape in shapes.items()})

        if self.observation == "masked":
            mask = spaces.Box(0, 1, (ACTIONS,), dtype=np.int8)
            return spaces.Dict({"action_mask": mask, "observation": _box((self.flat_width,))})

        if self.observation == "cell":
            return spaces.Discrete(prod(self.shape))

        image = (self.channels, *self.shape)
        return _box((self.width,) if self.observation == "flat" else image)

    # --- rows and their parts ---------------------------------------------------------------------

    @cached_property
    def columns(self) -> tuple[slice, ...]:
        """Columns of a row that are an array of their own in an observation."""
        inner = {"dict": (self.patch.stop, self.irs.stop), "masked": (self.flat_width,)}
        if self.has_budget:
            inner["dict"] = (self.patch.start, *inner["dict"])

        edges = [0, *inner.get(self.observation, ()), self.width]
        return tuple(slice(*each) for each in pairwise(edges))

    def empty(self, count: int) -> Parts:
        """Memory for the parts of that many rows. Each part is in one piece, as not every library
        of arrays takes a view with gaps.
        """
        widths = [each.stop - each.start for each in self.columns]
        return tuple(np.empty((count, width), dtype=np.float32) for width in widths)

    def split(self, rows: Rows) -> Parts:
        """Parts of rows ``(..., D)``, as views of them."""
        return tuple(rows[..., each] for each in self.columns)

    # --- from what robots see to parts, to observations, and back ---------------------------------

    def encode(
        self,
        out: Parts,
        *,
        patch: NDArray[np.floating[Any]],
        irs: NDArray[np.floating[Any]],
        own: NDArray[np.floating[Any]],
        to_goal: NDArray[np.floating[Any]],
        action_mask: NDArray[np.int8] | None = None,
    ) -> Parts:
        """Write what n robots see but for their budgets, which are 0, and return where; neither for
        maps nor for cells. See `set_budget`.

        Parameters
        ----------
        out
            Parts of n rows; see `empty` and `split`.
        patch
            Scaled margins over the target around each robot, ``(n, (2r+1)**2)``.
        irs
            Settings of the IRS and its phase shifts, ``(n, 3 + N)``.
        own, to_goal
            Of `own_positions` and `vectors_to_goal`, ``(n, 2)`` each.
        action_mask
            Shape ``(n, 8)``, where observations are masked.
        """
        its_patch, its_irs, its_position = self._fields(out)
        its_patch[:] = patch
        its_irs[:] = irs
        its_position[:, :2] = own
        its_position[:, 2:] = to_goal
        if action_mask is not None:
            out[1][:] = action_mask

        if self.has_budget:
            out[0][:, 0] = 0.0

        return out

    def set_budget(self, observation: Any, share: Rows) -> None:
        """Write what is left of budgets, scaled, into one observation or a batch of leading axes.

        ``share``: of `irs_gym.mdp.budget.scaled_amount`, ``(...)``.
        """
        if self.observation == "map":
            observation[..., BUDGET, :, :] = share[..., None, None]
        elif self.observation == "flat":
            observation[..., 0] = share
        else:
            name = "observation" if self.observation == "masked" else "budget"
            observation[name][..., 0] = share

    def unpack(self, parts: Parts) -> Any:
        """Observations of the parts of rows, with the leading axes kept: views of them, but for
        masks and cells.
        """
        first = parts[0]
        leading = first.shape[:-1]
        if self.observation == "dict":
            budget = {"budget": first} if self.has_budget else {}
            patch, irs, position = self._fields(parts)
            patch = patch.reshape(*leading, self.side, self.side)
            return budget | {"gain_patch": patch, "irs": irs, "position": position}
        if self.observation == "masked":
            return {"action_mask": parts[1].astype(np.int8), "observation": first}
        if self.observation == "cell":
            return first[..., 0].astype(np.int64) if leading else int(first[0])
        if self.observation == "map":
            return first.reshape(*leading, self.channels, *self.shape)

        return first

    def decode(self, observation: Any) -> DecodedObservation:
        """The parts of one observation, or of a batch along leading axes.

        Raises
        ------
        ValueError
            Where the observation is a cell alone, which tells no goal.
        """
        if self.observation == "cell":
            raise ValueError(
                "observation='cell' tells no goal: this policy needs 'dict', 'flat', 'masked' or "
                "'map'"
            )
        if self.observation == "map":
            return self._decode_map(np.asarray(observation))

        if self.observation == "dict":
            names = ("gain_patch", "irs", "position")
            patch, irs, position = (np.asarray(observation[name]) for name in names)
        else:
            flat = observation["observation"] if self.observation == "masked" else observation
            patch, irs, position = self._fields((np.asarray(flat),))

        is_masked = self.observation == "masked"
        budget = None
        if self.has_budget and self.observation == "dict":
            budget = np.asarray(observation["budget"])[..., 0]
        elif self.has_budget:
            budget = np.asarray(flat)[..., 0]

        robots, goals = cells_of_positions(position, self.shape)  # (..., 2)

        return DecodedObservation(
            margin=patch.reshape(*position.shape[:-1], self.side, self.side),
            cell=flat_cells(robots, self.shape),
            goal=flat_cells(goals, self.shape),
            irs=irs[..., :SETTINGS],
            phases=irs[..., SETTINGS:],
            action_mask=np.asarray(observation["action_mask"]) if is_masked else None,
            budget=budget,
        )

    def own_cells(self, observation: Any) -> Ints:
        """Flat cells of the robots alone, ``(...,)``: observations of every kind tell them."""
        if self.observation == "cell":
            return np.asarray(observation)
        return self.decode(observation).cell

    def _fields(self, parts: Parts) -> tuple[Rows, Rows, Rows]:
        """Views of patch ``(..., (2r+1)**2)``, IRS ``(..., 3 + N)`` and position ``(..., 4)``."""
        if self.observation == "dict":
            patch, irs, position = parts[-3:]
            return patch, irs, position

        flat = parts[0]
        return flat[..., self.patch], flat[..., self.irs], flat[..., self._position]

    def _decode_map(self, maps: Rows) -> DecodedObservation:
        cells = maps.reshape(*maps.shape[:-2], prod(self.shape)).argmax(axis=-1)  # (..., 4)
        nothing = np.empty((*maps.shape[:-3], 0), dtype=np.float32)

        return DecodedObservation(
            margin=maps[..., MARGIN, :, :],
            cell=cells[..., ROBOT],
            goal=cells[..., GOAL],
            irs=nothing,
            phases=nothing,
            action_mask=None,
            budget=maps[..., BUDGET, 0, 0] if self.has_budget else None,
        )


def _box(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, shape, dtype=np.float32)


def scaled_margin(
    gain_db: NDArray[np.float64], target_db: float | NDArray[np.float64]
) -> NDArray[np.float32]:
    """Margin over the target in `MARGIN_SCALE_DB`, clipped to [-1, 1]; -1 in obstacles. Shape of
    the gain.

    Examples
    --------
    >>> scaled_margin(np.array([-60.0, -70.0, -np.inf]), target_db=-61.0).tolist()
    [0.20000000298023224, -1.0, -1.0]
    """
    return np.clip((gain_db - target_db) / MARGIN_SCALE_DB, -1.0, 1.0).astype(np.float32)


def own_positions(cells: Ints, shape: tuple[int, int]) -> Rows:
    """x and y of cells ``(..., 2)``, scaled to a room of that shape, ``(..., 2)``.

    Examples
    --------
    >>> own_positions(np.array([0, 4]), shape=(2, 5)).tolist()
    [-0.5, 0.800000011920929]
    """
    return (2.0 * (cells + 0.5) / shape - 1.0).astype(np.float32)


def vectors_to_goal(offsets: Ints, shape: tuple[int, int]) -> Rows:
    """Vectors to the goal over the room's size, ``(..., 2)``, of cells that far from it.

    Examples
    --------
    >>> vectors_to_goal(np.array([-1, 0]), shape=(2, 5)).tolist()
    [0.5, 0.0]
    """
    return (-offsets / shape).astype(np.float32)


def cells_of_positions(
    positions: NDArray[np.floating[Any]], shape: tuple[int, int]
) -> tuple[Ints, Ints]:
    """Cells of robots and of their goals, ``(..., 2)`` each: the inverse of `own_positions` and
    `vectors_to_goal`, which positions ``(..., 4)`` hold one behind the other.

    Examples
    --------
    >>> cells_of_positions(np.array([-0.5, 0.8, 0.5, 0.0]), shape=(2, 5))
    (array([0, 4]), array([1, 4]))
    """
    exact = np.asarray(positions, dtype=np.float64)
    cells = np.rint((exact[..., :2] + 1.0) / 2.0 * shape - 0.5).astype(np.int64)
    to_goal = np.rint(exact[..., 2:] * shape).astype(np.int64)

    return cells, cells + to_goal
