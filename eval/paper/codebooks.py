"""`CodebookStudy`: what codebooks of a scene's panels can do, for the page on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eval.paper.study import CONTINUOUS, Scheme, Study
from irs_gym import (
    Codebook,
    SwitchFront,
    codebook_gain_db,
    cover_codebook,
    dft_codebook,
    fewest_configurations,
    focused_codebook,
    switch_front,
)

DESIGNS = ("cover", "focused", "DFT")


@dataclass(frozen=True)
class Row:
    """What one resolution of the phase shifters can do at one target."""

    scheme: Scheme
    target_db: float
    following: float  # metres where the phases follow the robot; +inf where there is no path
    front: SwitchFront | None  # None where no configurations make a path

    def metres(self, switches: int) -> float:
        """Least metres with at most so many switches."""
        return np.inf if self.front is None else self.front.distance_with(switches)


@dataclass(frozen=True)
class CodebookStudy:
    """A scene on a grid, and its panels' configurations."""

    study: Study

    def row(self, scheme: Scheme, target_db: float) -> Row:
        """The front of one scheme at one target."""
        following = self.study.distance(scheme, target_db)
        try:
            found = fewest_configurations(
                self.study.scene, target_db, self.study.cell_size, phase_bits=scheme.phase_bits
            )
        except ValueError:  # infeasible
            return Row(scheme, target_db, following, None)

        return Row(scheme, target_db, following, found.front)

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """The free cells ``(K, 2)``, each with a configuration of its own."""
        return np.argwhere(self.study.radio_map(CONTINUOUS).free)

    def focused(self, configurations: Sequence[int]) -> NDArray[np.float64]:
        """Gains ``(K, X, Y)`` of some of all focused configurations, continuous phases."""
        cells = self.cells[list(configurations)]
        codebook = focused_codebook(self.study.scene, cells, self.study.cell_size)
        return codebook_gain_db(self.study.scene, codebook, self.study.cell_size)

    def codebook(self, design: str, size: int, target_db: float) -> Codebook:
        """Codebook of that design, continuous phases."""
        if design == "cover":
            return cover_codebook(self.study.scene, size, target_db, self.study.cell_size)
        if design == "DFT":
            return dft_codebook(self.study.scene, size)

        path = self.study.path(CONTINUOUS, target_db)
        if path is None:
            raise ValueError(f"target_db={target_db} is infeasible: there is no path to focus on")
        # the middles of equal parts of the path
        places = (np.arange(size) + 0.5) / size * len(path.cells)
        cells = path.cells[places.astype(int)]

        return focused_codebook(self.study.scene, cells, self.study.cell_size)

    def metres(self, design: str, size: int, target_db: float) -> float:
        """The shortest path with a codebook when switches cost nothing; +inf where none is."""
        codebook = self.codebook(design, size, target_db)
        gain_db = codebook_gain_db(self.study.scene, codebook, self.study.cell_size)
        try:
            front = switch_front(
                gain_db, target_db, self.study.start, self.study.goal, self.study.cell_size
            )
        except ValueError:  # infeasible
            return np.inf

        return float(front.distances[-1])


def best_switches(front: SwitchFront, cost: float) -> int:
    """The point of the front of the least metres and switches together, the fewest switches of
    equal ones.
    """
    return int(np.argmin(front.distances + cost * front.switches))


def turning_points(front: SwitchFront) -> list[tuple[float, int]]:
    """From which cost of a switch on each point of the front is the best: costs in metres, rising
    from 0, and points.
    """
    at = best_switches(front, 0.0)
    found = [(0.0, at)]

    while at > 0:
        # metres that each switch saves against the points of fewer switches
        saved = (front.distances[:at] - front.distances[at]) / (
            front.switches[at] - front.switches[:at]
        )
        cost = float(saved.min())
        at = int(np.flatnonzero(np.isclose(saved, cost, rtol=0, atol=1e-9))[0])
        found.append((cost, at))

    return found
