"""`ExactField`: what Lemma 1 says of points and segments of a scene, with obstacles as they are."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from irs_gym.mdp.continuous_maps import ContinuousMaps, Point
from irs_gym.mdp.segment import BELOW, OBSTACLE, OPEN, Walk, Walks
from irs_gym.radio.irs import Hardware
from irs_gym.radio.radio_map import serve
from irs_gym.units import linear_to_db

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Metres: a segment is judged at points no further apart, its end among them.
RESOLUTION = 1e-3
_BLOCK = 2**18  # points that are judged at a time: bounds memory


class ExactField:
    """The expected gain at any point of a scene; points are in cells.

    ``walk``, ``rate``, ``gain_db`` and ``sees`` are those of a
    `irs_gym.mdp.continuous_rules.Judge`.
    """

    def __init__(self, maps: ContinuousMaps, scene: int) -> None:
        world = maps.world(scene)
        if world.scene is None:
            raise ValueError("field='exact' needs scenes, and this is a map without one")

        task = world.task
        self._scene = world.scene
        self._hardware = Hardware(task.phase_bits, task.quantiser, task.array_model)
        self._grid = self._scene.grid(maps.cell_size)
        self._target_db = float(maps.target_db[scene])
        self._rules = maps.rules
        self._is_costly = maps.is_costly
        self._known: dict[Point, float] = {}  # gains of the latest points of a single robot

    # --- of many points and segments --------------------------------------------------------------

    def gains_db(self, points: Floats) -> Floats:
        """Expected gains at points ``(n, 2)`` in dB; -inf in obstacles and off the floor."""
        is_on = ((points >= 0.0) & (points <= self._grid.shape)).all(axis=1)
        floor = points * self._grid.cell_size + self._grid.origin
        free = np.flatnonzero(is_on & ~self._scene.floor.is_covered(floor))
        height = np.full((len(free), 1), self._scene.antenna_height)
        gains = np.full(len(points), -np.inf)
        if len(free):
            positions = np.concatenate([floor[free], height], axis=1)
            gains[free] = linear_to_db(
                serve(self._scene, self._hardware, positions, needs_shifts=False)[0]
            )

        return gains

    def kinds(self, gains_db: Floats, *, is_costly: bool | None = None) -> NDArray[np.uint8]:
        """What a robot may do where the gains are those, any shape; where below the target is open
        is told by the rules unless it is given.
        """
        is_costly = self._is_costly if is_costly is None else is_costly
        meets = np.isfinite(gains_db) if is_costly else gains_db >= self._target_db
        kinds = np.where(meets, OPEN, np.where(np.isfinite(gains_db), BELOW, OBSTACLE))

        return np.asarray(kinds.astype(np.uint8))

    def rates(self, gains_db: Floats) -> Floats:
        """What a second costs where the gains are those, any shape; 0 in obstacles."""
        if not self._is_costly:
            return np.zeros(gains_db.shape)

        below = np.maximum(self._target_db - gains_db, 0.0)
        costs = below if self._rules.cost == "deficit" else (below > 0.0).astype(np.float64)

        return np.where(np.isfinite(gains_db), costs, 0.0)

    def walk_many(self, start: Floats, end: Floats, until: Floats) -> Walks:
        """`irs_gym.mdp.segment.walk_many`, at points `RESOLUTION` apart; ``start`` and ``end`` are
        of the shape ``(2, n)``, ``until`` ``(n,)``.

        A robot stops at the last point before the first that it cannot be at.
        """
        walks = Walks(until.copy(), end.copy(), np.full(len(until), -1), np.zeros(len(until)))
        length = np.sqrt(((end - start) ** 2).sum(axis=0)) * until * self._grid.cell_size
        pieces = np.maximum(np.ceil(length / RESOLUTION), 1.0).astype(np.int64)  # (n,)
        blocks = np.unique(np.cumsum(pieces) // _BLOCK, return_index=True)[1]

        for robots in np.split(np.arange(len(until)), blocks[1:]):
            some = self._judged(
                start[:, robots], (end - start)[:, robots], until[robots], pieces[robots]
            )
            for array, its in zip((walks.share, walks.blocked, walks.paid), some, strict=True):
                array[robots] = its

        is_whole = (walks.share == 1.0) & (walks.blocked < 0)
        walks.at[:] = np.where(is_whole, end, start + walks.share * (end - start))

        return walks

    def _judged(
        self, start: Floats, delta: Floats, until: Floats, pieces: Ints
    ) -> tuple[Floats, Ints, Floats]:
        """Shares, kinds of what is in the way (-1 for nothing) and what is paid, ``(n,)`` each."""
        robot = np.repeat(np.arange(len(pieces)), pieces)  # (P,)
        first = np.cumsum(pieces) - pieces  # (n,)
        number = np.arange(len(robot)) - first[robot] + 1  # (P,): from 1 on
        share = until[robot] * (number / pieces[robot])
        points = start[:, robot] + share * delta[:, robot]  # (2, P)
        gains = self.gains_db(points.T)
        kinds = self.kinds(gains)

        # of each robot, the first piece that it cannot go
        is_blocked = kinds != OPEN
        ends = np.where(is_blocked, number, pieces[robot] + 1)
        gone = np.minimum.reduceat(ends, first) - 1  # (n,)
        is_stopped = gone < pieces
        after = first + np.minimum(gone, pieces - 1)
        blocked = np.where(is_stopped, kinds[after], -1)

        # each piece costs what its end does
        rates = np.where(number <= gone[robot], self.rates(gains), 0.0)
        paid = np.add.reduceat(rates, first) * until / pieces

        return np.where(is_stopped, until * (gone / pieces), until), blocked, paid

    def see(self, start: Floats, end: Floats) -> NDArray[np.bool_]:
        """Whether straight lines between points ``(2, n)`` may be part of a path to success."""
        is_seen = np.empty(start.shape[1], dtype=bool)
        is_budget = self._rules.constraint == "budget"

        for n, (here, there) in enumerate(zip(start.T, end.T, strict=True)):
            length = float(np.hypot(*(there - here))) * self._grid.cell_size
            shares = np.linspace(0.0, 1.0, int(np.ceil(length / RESOLUTION)) + 2)[:, None]
            gains = self.gains_db(here + shares * (there - here))
            is_seen[n] = (self.kinds(gains, is_costly=is_budget) == OPEN).all()

        return is_seen

    # --- of one robot -----------------------------------------------------------------------------

    def walk(self, start: Point, end: Point, until: float) -> Walk:  # noqa: D102
        share, at, blocked, paid = self.walk_many(
            np.array([start]).T, np.array([end]).T, np.array([until])
        )
        return Walk(
            float(share[0]), float(at[0, 0]), float(at[1, 0]), int(blocked[0]), float(paid[0])
        )

    def rate(self, x: float, y: float) -> float:  # noqa: D102
        return float(self.rates(np.array(self.gain_db(x, y)))) if self._is_costly else 0.0

    def gain_db(self, x: float, y: float) -> float:  # noqa: D102
        if (x, y) not in self._known:
            self._known = {(x, y): float(self.gains_db(np.array([[x, y]]))[0])}

        return self._known[x, y]

    def kind(self, x: float, y: float) -> int:
        """Whether a robot can be at a point, and what is in its way if not."""
        return int(self.kinds(np.array(self.gain_db(x, y))))

    def sees(self, start: Point, end: Point) -> bool:  # noqa: D102
        return bool(self.see(np.array([start]).T, np.array([end]).T)[0])


@lru_cache(maxsize=32)
def exact_field(maps: ContinuousMaps, scene: int) -> ExactField:
    """Field of a scene; kept."""
    return ExactField(maps, scene)
