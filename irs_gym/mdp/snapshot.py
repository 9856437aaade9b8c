"""`Snapshot`: where an episode stands, as a few bytes from which it goes on."""

from struct import Struct
from typing import NamedTuple
from zlib import crc32

_LAYOUT = Struct("<8sIIIIdIdd??")
_CHECK = Struct("<I")


class Snapshot(NamedTuple):
    """What the next steps of an episode depend on; cells are flat indices.

    Examples
    --------
    >>> here = Snapshot(b"8 bytes.", 0, 5, 1599, 46, 0.5, 2, 0.0, 0.0, False, True)
    >>> Snapshot.from_bytes(here.to_bytes()) == here
    True
    """

    rules: bytes  # 8, `World.fingerprint`: of the map and the rules
    scene: int  # its number; 0 where there is one
    start: int
    goal: int
    cell: int
    distance: float  # metres travelled
    refused: int
    budget: float  # total cost that the episode may come to, and what it has come to; 0 without one
    spent: float
    has_violated: bool
    is_running: bool

    def to_bytes(self) -> bytes:
        """The snapshot as 58 bytes, the last four of them a checksum."""
        content = _LAYOUT.pack(*self)
        return content + _CHECK.pack(crc32(content))

    @classmethod
    def from_bytes(cls, state: bytes) -> "Snapshot":
        """What `to_bytes` made; a ``ValueError`` where a byte of it is lost or changed."""
        size = _LAYOUT.size + _CHECK.size
        if not isinstance(state, bytes) or len(state) != size:
            raise ValueError(f"state must be the {size} bytes that get_state() gives")

        content = state[: _LAYOUT.size]
        check = state[_LAYOUT.size :]
        if check != _CHECK.pack(crc32(content)):
            raise ValueError("state is damaged: it is not what get_state() gave")

        return cls(*_LAYOUT.unpack(content))
