"""`Study`: the maps, paths and trade-offs of one scene, for each scheme that the paper compares."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from irs_gym import Path, RadioMap, Scene, TradeOff, build_radio_map, shortest_path, trade_off
from irs_gym.grid import Cell
from irs_gym.radio.irs import Hardware, Quantiser, channel
from irs_gym.units import linear_to_db

QUANTISERS: tuple[Quantiser, ...] = get_args(Quantiser)


class Scheme(NamedTuple):
    """A curve of the paper's Figs. 4 to 6."""

    name: str
    has_irs: bool
    phase_bits: int | None


WITHOUT = Scheme("without IRS", False, None)
ONE_BIT, TWO_BIT, THREE_BIT = (Scheme(f"{bits} bit", True, bits) for bits in (1, 2, 3))
CONTINUOUS = Scheme("continuous", True, None)
SCHEMES = (WITHOUT, ONE_BIT, TWO_BIT, THREE_BIT, CONTINUOUS)


@dataclass(frozen=True)
class Study:
    """A scene on a grid. Results are kept, so asking again costs nothing.

    Attributes
    ----------
    scene
        The scene.
    cell_size
        Edge of a cell in metres.
    """

    scene: Scene
    cell_size: float = 0.5

    @property
    def start(self) -> Cell:
        """The cell of the scene's start."""
        return self.scene.grid(self.cell_size).cell_of(self.scene.start)

    @property
    def goal(self) -> Cell:
        """The cell of the scene's goal."""
        return self.scene.grid(self.cell_size).cell_of(self.scene.goal)

    def antennas(self) -> NDArray[np.float64]:
        """Places of the robot's antenna over all cell centres in metres, shape ``(X, Y, 3)``."""
        floor = self.scene.grid(self.cell_size).centres()
        return np.concatenate(
            [floor, np.full((*floor.shape[:2], 1), self.scene.antenna_height)], axis=-1
        )

    def radio_map(
        self, scheme: Scheme, quantiser: Quantiser = "nearest", elements: int | None = None
    ) -> RadioMap:
        """Map of a scheme, with so many elements on each panel; None: as the scene says."""
        if not scheme.has_irs:
            elements = 0

        # the scheme says the resolution, not the scene
        continuous = self.scene.model_copy(update={"phase_bits": None})
        return _radio_map(continuous, self.cell_size, elements, scheme.phase_bits, quantiser)

    def curve(
        self, scheme: Scheme, quantiser: Quantiser = "nearest", elements: int | None = None
    ) -> TradeOff:
        """Shortest distance over the target, exactly."""
        return _curve(self.radio_map(scheme, quantiser, elements), self.start, self.goal)

    def threshold(self, scheme: Scheme, quantiser: Quantiser = "nearest") -> float:
        """Highest feasible target in dB; -inf where there is none."""
        return float(max(self.curve(scheme, quantiser).targets_db, default=-np.inf))

    def distance(
        self,
        scheme: Scheme,
        target_db: float,
        quantiser: Quantiser = "nearest",
        elements: int | None = None,
    ) -> float:
        """Shortest distance in metres at a target; +inf where it is infeasible."""
        return float(self.curve(scheme, quantiser, elements).distance_at(target_db))

    def path(self, scheme: Scheme, target_db: float) -> Path | None:
        """The oracle's path at a target."""
        return shortest_path(
            self.radio_map(scheme).feasible(target_db), self.start, self.goal, self.cell_size
        )

    def gain_at(
        self, points: NDArray[np.float64], scheme: Scheme = CONTINUOUS
    ) -> NDArray[np.float64]:
        """Expected gain in dB at any places (..., 2) in metres, not cell centres alone, for
        continuous phases.
        """
        scene = self.scene if scheme.has_irs else self.scene.with_irs_elements(0)
        places = np.concatenate(
            [points, np.full((*points.shape[:-1], 1), scene.antenna_height)], axis=-1
        )
        flat = places.reshape(-1, 3)

        # the access point of the highest gain serves
        gains = [channel(scene, ap, flat).expected_gain(Hardware()) for ap in scene.access_points]

        return linear_to_db(np.max(gains, axis=0)).reshape(points.shape[:-1])


@cache
def _radio_map(
    scene: Scene, cell_size: float, elements: int | None, bits: int | None, quantiser: Quantiser
) -> RadioMap:
    return build_radio_map(scene, cell_size, elements, bits, quantiser)


@cache
def _curve(radio_map: RadioMap, start: Cell, goal: Cell) -> TradeOff:
    return trade_off(radio_map.gain_db, start, goal, radio_map.grid.cell_size)
