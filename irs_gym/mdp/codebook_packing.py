"""`CodebookPacking`: the layout of observations where the robot switches between configurations."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from math import prod
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from gymnasium import spaces

from irs_gym.grid import flat_cells
from irs_gym.mdp.dynamics import ACTIONS
from irs_gym.mdp.packing import SETTINGS, Ints, Parts, Rows, cells_of_positions

CodebookObservation = Literal["dict", "flat", "masked", "cell"]
_MOST_STATES = 2**24  # whole numbers up to this one are float32 as well


class DecodedState(NamedTuple):
    """One observation taken apart, or a batch of shape ``...``; cells are flat."""

    configuration: Ints  # (...,), the number of the present one
    cell: Ints  # (...,), where the robot is
    goal: Ints  # (...,)
    margin: Rows  # (..., 2r+1, 2r+1), scaled margins around the robot, as configured
    gains: Rows  # (..., K), scaled margins of all configurations in the robot's cell
    irs: Rows  # (..., 3), the settings of the IRS
    phases: Rows  # (..., N), its phase shifts; N is 0 where they are left out


@dataclass(frozen=True)
class CodebookPacking:
    """How observations are packed in rows of float32, in the order of their keys, as
    `gymnasium.spaces.flatten` packs a Dict.

    ``configuration`` (K), ``gain_patch`` (2r+1, 2r+1), ``gains`` (K), ``irs`` (3 + N), ``position``
    (4); masked, the action mask (8 + K) follows. As a cell, a row is the number of the state:
    configuration x X x Y + flat cell.

    Raises ``ValueError`` for an observation of another kind, or more states than float32 numbers.

    Examples
    --------
    >>> packing = CodebookPacking("flat", side=3, settings=3, shape=(4, 5), configurations=2)
    >>> packing.actions, packing.width, packing.fields["gains"]
    (10, 20, slice(11, 13, None))
    """

    observation: str
    side: int  # of the patch, 2r+1
    settings: int  # 3 + N
    shape: tuple[int, int]  # of the map, (X, Y)
    configurations: int  # K

    def __post_init__(self) -> None:
        if self.observation not in get_args(CodebookObservation):
            raise ValueError(
                f"observation={self.observation!r} must be one of {get_args(CodebookObservation)}: "
                "of a codebook there are as many maps as configurations"
            )
        if self.observation == "cell" and self.states > _MOST_STATES:
            raise ValueError(
                f"observation='cell' can tell {_MOST_STATES} states apart, and "
                f"{self.configurations} configurations of {self.shape} cells are more"
            )

    @property
    def actions(self) -> int:
        """Moves and switches, 8 + K."""
        return ACTIONS + self.configurations

    @property
    def states(self) -> int:
        """Configurations times cells."""
        return self.configurations * prod(self.shape)

    # --- columns of a row -------------------------------------------------------------------------

    @cached_property
    def fields(self) -> dict[str, slice]:
        """Columns of each part of a flat row."""
        widths = {
            "configuration": self.configurations,
            "gain_patch": self.side**2,
            "gains": self.configurations,
            "irs": self.settings,
            "position": 4,
        }
        edges = accumulate(widths.values(), initial=0)
        return {name: slice(*each) for name, each in zip(widths, pairwise(edges), strict=True)}

    @cached_property
    def flat_width(self) -> int:
        """Columns of what a flat observation holds; in a masked one, the mask comes behind them."""
        return int(self.fields["position"].stop)

    @cached_property
    def width(self) -> int:
        """Columns of a row, D."""
        others = {"masked": self.flat_width + self.actions, "cell": 1}
        return others.get(self.observation, self.flat_width)

    @property
    def space(self) -> spaces.Space[Any]:
        """Of one observation; a new one each time, as a space holds its samples' randomness."""
        if self.observation == "dict":
            shapes = {name: (each.stop - each.start,) for name, each in self.fields.items()}
            shapes["gain_patch"] = (self.side, self.side)  # type: ignore[assignment]
            return spaces.Dict({name: _box(shape) for name, shape in shapes.items()})

        if self.observation == "masked":
            mask = spaces.Box(0, 1, (self.actions,), dtype=np.int8)
            return spaces.Dict({"action_mask": mask, "observation": _box((self.flat_width,))})

        return spaces.Discrete(self.states) if self.observation == "cell" else _box((self.width,))

    # --- rows and their parts ---------------------------------------------------------------------

    @cached_property
    def columns(self) -> tuple[slice, ...]:
        """Columns of a row that are an array of their own in an observation."""
        if self.observation == "dict":
            return tuple(self.fields.values())
        if self.observation == "masked":
            return slice(0, self.flat_width), slice(self.flat_width, self.width)

        return (slice(0, self.width),)

    def empty(self, count: int) -> Parts:
        """Memory for the parts of that many rows, each in one piece."""
        widths = [each.stop - each.start for each in self.columns]
        return tuple(np.empty((count, width), dtype=np.float32) for width in widths)

    def split(self, rows: Rows) -> Parts:
        """Parts of rows ``(..., D)``, as views of them."""
        return tuple(rows[..., each] for each in self.columns)

    def views(self, parts: Parts) -> dict[str, Rows]:
        """Each field of the parts of rows by its name, to be written or read; none of a cell."""
        if self.observation == "dict":
            return dict(zip(self.fields, parts, strict=True))
        return {name: parts[0][..., each] for name, each in self.fields.items()}

    def unpack(self, parts: Parts) -> Any:
        """Observations of the parts of rows, with the leading axes kept: views of them, but for
        masks and cells.
        """
        first = parts[0]
        leading = first.shape[:-1]
        if self.observation == "dict":
            named = dict(zip(self.fields, parts, strict=True))
            named["gain_patch"] = named["gain_patch"].reshape(*leading, self.side, self.side)
            return named
        if self.observation == "masked":
            return {"action_mask": parts[1].astype(np.int8), "observation": first}
        if self.observation == "cell":
            return first[..., 0].astype(np.int64) if leading else int(first[0])

        return first

    def set_budget(self, observation: Any, share: Any) -> None:
        """There are no budgets to tell; see `irs_gym.mdp.packing.Packing.set_budget`."""
        raise NotImplementedError("no budget is kept where the panel is switched")

    def decode(self, observation: Any) -> DecodedState:
        """The parts of one observation, or of a batch along leading axes.

        Raises
        ------
        ValueError
            Where the observation is a cell alone, which tells no goal.
        """
        if self.observation == "cell":
            raise ValueError(
                "observation='cell' tells no goal: this policy needs 'dict', 'flat' or 'masked'"
            )

        if self.observation == "dict":
            seen = {name: np.asarray(observation[name]) for name in self.fields}
            patch = seen["gain_patch"]
        else:
            flat = observation["observation"] if self.observation == "masked" else observation
            seen = self.views((np.asarray(flat),))
            patch = seen["gain_patch"].reshape(*np.shape(flat)[:-1], self.side, self.side)

        robots, goals = cells_of_positions(seen["position"], self.shape)  # (..., 2)

        return DecodedState(
            configuration=seen["configuration"].argmax(axis=-1),
            cell=flat_cells(robots, self.shape),
            goal=flat_cells(goals, self.shape),
            margin=patch,
            gains=seen["gains"],
            irs=seen["irs"][..., :SETTINGS],
            phases=seen["irs"][..., SETTINGS:],
        )


def own_states(observation: Any, shape: tuple[int, int], configurations: int) -> Ints:
    """Numbers of the robots' states, ``(...,)``: one observation of any kind tells it, and a batch
    tells those of all.

    Examples
    --------
    >>> packing = CodebookPacking("flat", side=3, settings=3, shape=(4, 5), configurations=2)
    >>> row = np.zeros(packing.width)
    >>> row[packing.fields["configuration"]] = [0, 1]
    >>> row[packing.fields["position"]] = [-0.25, 0.0, 0.5, 0.0]  # in the cell (1, 2)
    >>> int(own_states(row, (4, 5), 2))
    27
    """
    if isinstance(observation, Mapping) and "observation" in observation:  # masked
        return own_states(observation["observation"], shape, configurations)

    if isinstance(observation, Mapping):
        configuration = np.asarray(observation["configuration"])
        position = np.asarray(observation["position"])
    else:
        row = np.asarray(observation)
        if np.issubdtype(row.dtype, np.integer):
            return row

        # the first and the last of a flat row
        configuration = row[..., :configurations]
        position = row[..., -4:]

    robots, _ = cells_of_positions(position, shape)
    cells = flat_cells(robots, shape)

    return np.asarray(configuration.argmax(axis=-1) * prod(shape) + cells)


def _box(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, shape, dtype=np.float32)
