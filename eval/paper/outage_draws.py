"""`OutageDraws`: draws of the instantaneous gain beside its distribution in closed form, where the
robot stands and for panels of any size.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from scipy.stats import kstest, kstwobign

from eval.paper.monte_carlo import BATCH, draw_gains
from irs_gym import Scene, build_radio_map, load_scene
from irs_gym.grid import Cell
from irs_gym.radio.fading import RicianFading
from irs_gym.radio.irs import Channel, Hardware, channel
from irs_gym.radio.propagation import Link
from irs_gym.radio.scene import IrsPanel
from irs_gym.units import Floats, db_to_linear, linear_to_db

THRESHOLDS_DB = np.arange(-30.0, 8.1, 0.5)  # from the mean gain
# Columns and rows of single elements; the last is the paper's panel.
PANELS = (
    (1, 1),
    (2, 1),
    (2, 2),
    (4, 2),
    (4, 4),
    (8, 4),
    (8, 8),
    (16, 8),
    (16, 16),
    (32, 16),
    (10, 120),
)
# Small panels are drawn more often, as a draw of theirs costs less.
_AS_MUCH_WORK = 128  # elements: up to so many
_MOST = 25  # times as many draws
HARDWARE = {"continuous": Hardware(), "1 bit": Hardware(1)}


@dataclass(frozen=True, eq=False)
class OutageDraws:
    """Draws of abs(c)^2 at one place, element by element.

    Attributes
    ----------
    place, phases
        What is drawn.
    elements
        M of all panels.
    fading
        The closed form, of arrays of the shape ``()``.
    gains
        The draws, linear, shape ``(n,)``.
    """

    place: str
    phases: str
    elements: int
    fading: RicianFading
    gains: Floats

    @property
    def mean_gain_db(self) -> float:
        """The expected gain."""
        return float(linear_to_db(self.fading.los_gain + self.fading.scattered_gain))

    @property
    def los_over_scatter_db(self) -> float:
        """A^2 / tau."""
        return float(linear_to_db(self.fading.los_gain / self.fading.scattered_gain))

    @cached_property
    def worst_error(self) -> float:
        """Largest distance of the drawn share from the closed form, over all thresholds."""
        return float(kstest(self.gains, self._distribution).statistic)

    @property
    def sampling_error(self) -> float:
        """What the worst error stays below in 999 of 1,000 cases where the closed form is right."""
        return float(kstwobign.ppf(0.999)) / sqrt(len(self.gains))

    def exact(self, thresholds_db: Floats) -> Floats:
        """Outage in closed form at thresholds ``(T,)`` in dB."""
        los, scattered = (np.full(len(thresholds_db), each) for each in self._parts)
        return RicianFading(los, scattered).outage(thresholds_db)

    def drawn(self, thresholds_db: Floats) -> Floats:
        """Share of the draws below thresholds ``(T,)`` in dB."""
        ordered = np.sort(linear_to_db(self.gains))
        return np.asarray(np.searchsorted(ordered, thresholds_db) / len(ordered))

    @property
    def _parts(self) -> tuple[Floats, Floats]:
        return self.fading.los_gain, self.fading.scattered_gain

    def _distribution(self, gains: Floats) -> Floats:
        return self.exact(linear_to_db(gains))


# --- cells ----------------------------------------------------------------------------------------


def draw_cells(draws: int, seed: int) -> list[OutageDraws]:
    """Cells of each kind of the paper's room, and one of the workshop with its two access points
    and panels; each for continuous and for 1-bit phases.
    """
    paper = load_scene("paper")
    workshop = load_scene("workshop")
    places = [(name, paper, cell) for name, cell in paper_cells(paper).items()]
    places.append(("workshop, two APs and panels", workshop, _median_cell(workshop)))
    jobs = [(*place, phases) for place in places for phases in HARDWARE]

    return [
        _draw(name, phases, _site(scene, cell, phases), draws, [seed, n])
        for n, (name, scene, cell, phases) in enumerate(track(jobs, "cells", transient=True))
    ]


def paper_cells(scene: Scene) -> dict[str, Cell]:
    """A cell of each kind: of those that see AP, panel, both or neither the one of median gain, and
    the one where the panel scatters the largest share.
    """
    radio_map = build_radio_map(scene)
    free = np.argwhere(radio_map.free)  # (n, 2)
    places = np.concatenate(
        [radio_map.grid.centres()[tuple(free.T)], np.full((len(free), 1), scene.antenna_height)],
        axis=1,
    )
    site = channel(scene, scene.access_points[0], places)
    (cascade,) = site.cascades
    sees_ap = site.direct.rician_factor > 0  # (n,)
    sees_panel = cascade.robot_link.rician_factor > 0
    kinds = {
        "sees AP and panel": sees_ap & sees_panel,
        "sees the AP alone": sees_ap & ~sees_panel,
        "sees the panel alone": ~sees_ap & sees_panel,
        "sees neither": ~sees_ap & ~sees_panel,
    }
    gain_db = radio_map.gain_db[tuple(free.T)]  # (n,)
    chosen = {name: _median(gain_db, which) for name, which in kinds.items()}
    chosen["beside the panel"] = int(np.argmax(cascade.scattered_power / site.scattered_power()))

    return {name: (int(free[n, 0]), int(free[n, 1])) for name, n in chosen.items()}


def _median(values: Floats, which: NDArray[np.bool_]) -> int:
    """Number of the one among some that is nearest to their median."""
    away = np.abs(values - np.median(values[which]))
    return int(np.argmin(np.where(which, away, np.inf)))


def _median_cell(scene: Scene) -> Cell:
    """The cell of median gain of those with more line of sight than scatter."""
    radio_map = build_radio_map(scene)
    fading: Any = radio_map.fading  # of a scene, it is Rician
    is_clear = fading.los_gain > fading.scattered_gain  # (X, Y)
    return radio_map.grid.cell_at(_median(radio_map.gain_db.ravel(), is_clear.ravel()))


def _site(scene: Scene, cell: Cell, phases: str) -> Channel:
    """The channel to a cell from the access point that serves it best."""
    grid = scene.grid(0.5)
    position = np.array([[*grid.centre(cell), scene.antenna_height]])
    sites = [channel(scene, each, position) for each in scene.access_points]
    return max(sites, key=lambda site: float(site.expected_gain(HARDWARE[phases])[0]))


# --- panels of any size ---------------------------------------------------------------------------


def draw_panels(draws: int, seed: int) -> dict[str, list[OutageDraws]]:
    """Panels from one element to the paper's, where they are all that is received, with lines of
    sight and without, and beside the access point in the paper's room.
    """
    paper = load_scene("paper")
    factor = float(db_to_linear(paper.rician_factor_db))
    cases: dict[str, Callable[[Channel], Channel]] = {
        "panel alone, both links blocked": lambda site: _without_direct(site, 0.0, 0.0),
        "panel alone, robot's link blocked": lambda site: _without_direct(site, factor, 0.0),
        "panel alone, both links clear": lambda site: _without_direct(site, factor, factor),
        "beside the panel of the paper's room": lambda site: site,
    }
    cell = paper_cells(paper)["beside the panel"]
    found: dict[str, list[OutageDraws]] = {name: [] for name in cases}

    for n, (columns, rows) in enumerate(track(PANELS, "panels", transient=True)):
        scene = paper.model_copy(update={"irs_panels": (_panel(paper, columns, rows),)})
        site = _site(scene, cell, "continuous")
        own = int(draws * np.clip(_AS_MUCH_WORK / (columns * rows), 1, _MOST))
        for k, (name, change) in enumerate(cases.items()):
            found[name].append(_draw(name, "continuous", change(site), own, [seed, n, k]))

    return found


def _panel(scene: Scene, columns: int, rows: int) -> IrsPanel:
    """The scene's panel with other sub-surfaces, of one element each."""
    (panel,) = scene.irs_panels
    return panel.model_copy(
        update={"columns": columns, "rows": rows, "elements_per_subsurface": (1, 1)}
    )


def _without_direct(site: Channel, ap_factor: float, robot_factor: float) -> Channel:
    """The channel over the panel alone, with other Rician factors of its two links."""
    (cascade,) = site.cascades
    changed = replace(
        cascade,
        ap_link=_with_factor(cascade.ap_link, ap_factor),
        robot_link=_with_factor(cascade.robot_link, robot_factor),
    )
    silent = replace(site.direct, path_gain=0.0 * site.direct.path_gain)

    return replace(site, direct=silent, cascades=(changed,))


def _with_factor(link: Link, factor: float) -> Link:
    return replace(link, rician_factor=np.full_like(link.rician_factor, factor))


# --- draws ----------------------------------------------------------------------------------------


def _draw(place: str, phases: str, site: Channel, draws: int, seed: list[int]) -> OutageDraws:
    hardware = HARDWARE[phases]
    rng = np.random.default_rng(seed)
    shifts = site.phase_shifts(hardware)[0]  # (N,)
    batches = [draw_gains(site, shifts, rng) for _ in range(-(-draws // BATCH))]

    scattered = site.scattered_power()[0]
    los = max(site.expected_gain(hardware)[0] - scattered, 0.0)

    return OutageDraws(
        place=place,
        phases=phases,
        elements=sum(cascade.panel.elements for cascade in site.cascades),
        fading=RicianFading(np.asarray(los), np.asarray(scattered)),
        gains=np.concatenate(batches),
    )
