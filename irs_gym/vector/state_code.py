"""`StateCode`: a robot's scene, cell and goal as one number; `MoveBits`: which moves it has.

n robots then move by one addition, and all that they are told is gathered from tables.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irs_gym.grid import MOVES, cells_at, flat_cells
from irs_gym.mdp.dynamics import ACTIONS
from irs_gym.memory import freeze, frozen
from irs_gym.vector.protocols import States

Ints = NDArray[np.int64]

# The layout of a state, an int64, from the low bits up:
#
#     bits  0 to 27   place    flat cell, counted through all maps one behind the other
#     bits 28 to 31   zero     room for the code of a move, see `StateCode.entries`
#     bits 32 to 62   offset   number of the difference of cell and goal, see `StateCode.offsets`
_PLACE_BITS = 28
_CODE_BITS = 4
_OFFSET_SHIFT = _PLACE_BITS + _CODE_BITS
_PLACE_MASK = 2**_OFFSET_SHIFT - 1

MOST_PLACES = 2**_PLACE_BITS


class RobotStates(NamedTuple):
    """What the states of n robots say."""

    scene: Ints  # (n,), numbers
    cell: Ints  # (n, 2)
    goal: Ints  # (n, 2)


@dataclass(frozen=True)
class StateCode:
    """Packs the scene, the cell and the goal of a robot into one number, and unpacks them.

    Attributes
    ----------
    shape
        Of every map with its border.
    frame
        Of every map without it: cells and goals lie in there.

    Examples
    --------
    >>> code = StateCode(shape=(5, 6), frame=(4, 5))
    >>> states = code.encode(np.array([2]), np.array([[1, 3]]), np.array([[3, 0]]))
    >>> code.decode(states)
    RobotStates(scene=array([2]), cell=array([[1, 3]]), goal=array([[3, 0]]))
    """

    shape: tuple[int, int]
    frame: tuple[int, int]

    def encode(self, scenes: Ints, cells: Ints, goals: Ints) -> States:
        """States of robots: numbers of their scenes ``(n,)``, cells and goals ``(n, 2)``."""
        places = scenes * self.map_size + flat_cells(cells, self.shape)
        offsets = flat_cells(cells - goals + self._centre, self._offset_shape)
        return (offsets << _OFFSET_SHIFT) | places

    def decode(self, states: States) -> RobotStates:
        """Undoes `encode`."""
        cells = self.cells(states)
        offsets = cells_at(self.offsets(states), self._offset_shape) - self._centre
        return RobotStates(self.scenes(states), cells, cells - offsets)

    def scenes(self, states: States) -> Ints:
        """Numbers of the scenes, ``(n,)``."""
        return self.places(states) // self.map_size

    def cells(self, states: States) -> Ints:
        """Cells (i, j), shape ``(n, 2)``."""
        cells = cells_at(self.places(states), self.shape)
        cells[:, 0] %= self.shape[0]  # i is counted on through the maps before
        return cells

    # --- rows of tables ---------------------------------------------------------------------------

    def places(self, states: States) -> Ints:
        """Flat cells, counted through all maps with their borders: rows of a table of all cells."""
        return np.asarray(states & _PLACE_MASK)

    def offsets(self, states: States) -> Ints:
        """Numbers of the differences of cell and goal: rows of `all_offsets`."""
        return states >> _OFFSET_SHIFT

    def entries(self, states: States, codes: Ints) -> Ints:
        """Rows of a table ``(O, 16)``, one behind the other: of all offsets, and codes of moves."""
        return (states >> _PLACE_BITS) + codes  # 16 * offset, since the bits between are zero

    def step(self, states: States, codes: Ints) -> States:
        """States after moves of those codes (`MoveBits.codes`)."""
        return states + self._steps.take(codes)

    # --- small tables -----------------------------------------------------------------------------

    @cached_property
    def map_size(self) -> int:
        """Cells of a map with its border, C."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def all_offsets(self) -> Ints:
        """All differences of a cell and a goal that there can be, in the order of their numbers:
        shape ``(O, 2)``.
        """
        cells = np.indices(self._offset_shape).reshape(2, -1).T
        return frozen(np.asarray(cells - self._centre))

    @cached_property
    def _offset_shape(self) -> tuple[int, int]:
        """Offsets along x and along y that there are."""
        return 2 * self.frame[0] - 1, 2 * self.frame[1] - 1

    @cached_property
    def _centre(self) -> Ints:
        """Where the offset of 0 lies among all of them, shape ``(2,)``."""
        return frozen(np.array(self.frame) - 1)

    @cached_property
    def _steps(self) -> Ints:
        """What to add to a state, by the code of a move: shape ``(16,)``."""
        offset = flat_cells(MOVES, self._offset_shape)
        place = flat_cells(MOVES, self.shape)
        return frozen(by_code(0, (offset << _OFFSET_SHIFT) + place))


@dataclass(frozen=True, eq=False)
class MoveBits:
    """Which of the eight moves may be made in each of many cells, as `pack_moves` packs it."""

    packed: NDArray[np.uint16]  # (cells,)

    def __post_init__(self) -> None:
        freeze(self.packed)

    def __len__(self) -> int:
        return len(self.packed)

    def of(self, places: Ints, actions: Ints) -> NDArray[np.bool_]:
        """Whether the bits are set of actions in cells, ``(n,)``."""
        return _BITS.take(self.packed.take(places) + actions)

    def of_all(self, places: Ints) -> NDArray[np.bool_]:
        """Whether the bits are set of all actions in cells, ``(n, 8)``."""
        return _BITS.take(self.packed.take(places)[:, None] + np.arange(ACTIONS))

    def codes(self, places: Ints, actions: Ints) -> Ints:
        """Codes of actions in cells, ``(n,)``: 2 x action + 1 where the bit is set."""
        return np.asarray(_CODES.take(self.packed.take(places) + actions))


# By 8 x byte + action: whether that bit of the byte is set, and the code.
_BITS = (np.arange(256)[:, None] >> np.arange(ACTIONS) & 1).astype(bool).ravel()
_CODES = np.tile(2 * np.arange(ACTIONS), 256) + _BITS


def pack_moves(is_set: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """What is said of the moves, ``(..., 8)``, as eight times the byte whose bits say so,
    ``(...)``.

    Eight times, so that the number of an action can be added: together they are a row of a table
    of all bytes and actions.

    Examples
    --------
    >>> int(pack_moves(np.array([1, 0, 1, 0, 0, 0, 0, 0], dtype=bool)))  # 8 * 0b101
    40
    """
    byte = np.packbits(is_set, axis=-1, bitorder="little")[..., 0]
    return byte.astype(np.uint16) * np.uint16(ACTIONS)


def by_code(refused: Any, done: NDArray[Any]) -> NDArray[Any]:
    """A table by the code of a move: of each move ``(8,)``, what follows if it is refused, and if
    it is not; shape ``(16,)``.
    """
    return np.stack([np.full_like(done, refused), done], axis=-1).ravel()
