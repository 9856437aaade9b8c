"""`Snapshot`: where an episode stands, as a few bytes from which it goes on."""

from struct import Struct
from typing import NamedTuple
from zlib import crc32

_LAYOUT = Struct("<8sIIIIdIdd??")
_SWITCHES = Struct("<Id")
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
    budget: float  # total cost that the episode may come to, and what is left; 0 without one
    budget_left: float
    has_violated: bool
    is_running: bool
    # where the panel is switched, and configurations are part of start and cell
    switches: int | None = None
    metres: float | None = None  # of the distance, the part that is no switch's

    def to_bytes(self) -> bytes:
        """The snapshot as 58 bytes, the last four of them a checksum; 70 where switches count."""
        content = _LAYOUT.pack(*self[:-2])
        if self.switches is not None:
            content += _SWITCHES.pack(*self[-2:])

        return sealed(content)

    @classmethod
    def from_bytes(cls, state: bytes, *, has_switches: bool = False) -> "Snapshot":
        """What `to_bytes` made; a ``ValueError`` where a byte of it is lost or changed."""
        size = _LAYOUT.size + _SWITCHES.size * has_switches
        content = unsealed(state, size)
        switches = _SWITCHES.unpack(content[_LAYOUT.size :]) if has_switches else ()

        return cls(*_LAYOUT.unpack(content[: _LAYOUT.size]), *switches)


def sealed(content: bytes) -> bytes:
    """The content with a checksum of four bytes behind it."""
    return content + _CHECK.pack(crc32(content))


def unsealed(state: bytes, size: int) -> bytes:
    """The content of that many bytes that was `sealed`; a ``ValueError`` where a byte of it is lost
    or changed.

    Examples
    --------
    >>> unsealed(sealed(b"here"), 4)
    b'here'
    """
    whole = size + _CHECK.size
    if not isinstance(state, bytes) or len(state) != whole:
        raise ValueError(f"state must be the {whole} bytes that get_state() gives")

    content = state[:size]
    if state[size:] != _CHECK.pack(crc32(content)):
        raise ValueError("state is damaged: it is not what get_state() gave")

    return content
