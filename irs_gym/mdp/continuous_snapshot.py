"""`ContinuousSnapshot`: where an episode anywhere on the floor stands, as a few bytes from which it
goes on.
"""

from struct import Struct
from typing import NamedTuple

from irs_gym.mdp.snapshot import sealed, unsealed

_LAYOUT = Struct("<8sI6d2dIIdd??")


class ContinuousSnapshot(NamedTuple):
    """What the next steps of an episode depend on; points are in cells.

    Examples
    --------
    >>> here = ContinuousSnapshot(
    ...     b"8 bytes.", 0, (0.5, 1.0), (3.5, 1.0), (1.0, 1.0), 0.25, 0.5, 1, 0, 0.0, 0.0, False,
    ...     True
    ... )
    >>> ContinuousSnapshot.from_bytes(here.to_bytes()) == here
    True
    """

    rules: bytes  # 8, `ContinuousMaps.fingerprint`: of the maps and the rules
    scene: int  # its number; 0 where there is one
    start: tuple[float, float]
    goal: tuple[float, float]
    at: tuple[float, float]
    distance: float  # metres travelled
    seconds: float
    steps: int
    refused: int
    budget: float  # total cost that the episode may come to, and what is left; 0 without one
    budget_left: float
    has_violated: bool
    is_running: bool

    def to_bytes(self) -> bytes:
        """The snapshot as bytes, the last four of them a checksum."""
        points = (*self.start, *self.goal, *self.at)
        return sealed(_LAYOUT.pack(self.rules, self.scene, *points, *self[5:]))

    @classmethod
    def from_bytes(cls, state: bytes) -> "ContinuousSnapshot":
        """What `to_bytes` made; a ``ValueError`` where a byte of it is lost or changed."""
        values = _LAYOUT.unpack(unsealed(state, _LAYOUT.size))
        points = (values[2:4], values[4:6], values[6:8])
        return cls._make((*values[:2], *points, *values[8:]))
