"""`Continuous`: the proved bounds of the continuous problem beside the distances of the paper's
grid, and a figure of the cells that prove them.
"""

from dataclasses import dataclass
from math import nan
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Rectangle

from eval.paper.figures import draw_floor, new_figure, save
from eval.paper.map_figures import add_floor_legend
from irs_gym import (
    Bounds,
    Scene,
    build_radio_map,
    certified_bounds,
    load_scene,
    shortest_path,
    straight_line_bound,
)

TARGETS_DB = (-64.0, -62.5, -62.0, -61.8, -61.2, -60.0)
WITHOUT_IRS_DB = (-64.0, -62.5, -62.1)
DRAWN_DB = -61.8
CELL_SIZE = 0.5

_COLOURS = {1: "#c7e0f4", 0: "#fdd49e", -1: "#ffffff"}
_LABELS = {1: "feasible as a whole", 0: "undecided", -1: "infeasible as a whole"}


@dataclass(frozen=True, eq=False)
class Continuous:
    """One target: metres over the grid, metres of any path over its cells, and proved bounds.

    Attributes
    ----------
    target_db
        The target.
    has_irs
        Whether the panel is there.
    grid
        The oracle's distance over the grid; nan where there is no path.
    any_angle
        That of `irs_gym.straight_line_bound` over the same cells.
    bounds
        Between the centres of the same cells.
    seconds
        Of one core that the bounds took.
    """

    target_db: float
    has_irs: bool
    grid: float
    any_angle: float
    bounds: Bounds
    seconds: float

    @property
    def cost(self) -> tuple[float, float]:
        """How much longer the grid's path is than the continuous optimum: at least and at most."""
        return self.grid / self.bounds.upper - 1, self.grid / self.bounds.lower - 1


def continuous_of_paper(tolerance: float) -> list[Continuous]:
    """All targets of the page, with the panel and without."""
    cases = [(target_db, True) for target_db in TARGETS_DB]
    cases += [(target_db, False) for target_db in WITHOUT_IRS_DB]
    scene = load_scene("paper")

    return [compare(scene, target_db, tolerance, has_irs=has_irs) for target_db, has_irs in cases]


def compare(scene: Scene, target_db: float, tolerance: float, *, has_irs: bool) -> Continuous:
    """One target of a scene."""
    irs_elements = None if has_irs else 0
    radio_map = build_radio_map(scene, CELL_SIZE, irs_elements)
    feasible = radio_map.feasible(target_db)
    start = radio_map.grid.cell_of(scene.start)
    goal = radio_map.grid.cell_of(scene.goal)
    path = shortest_path(feasible, start, goal, CELL_SIZE)

    begin = process_time()
    bounds = certified_bounds(
        scene,
        target_db,
        tolerance,
        start=radio_map.grid.centre(start),
        goal=radio_map.grid.centre(goal),
        irs_elements=irs_elements,
    )
    seconds = process_time() - begin

    return Continuous(
        target_db=target_db,
        has_irs=has_irs,
        grid=nan if path is None else path.distance,
        any_angle=straight_line_bound(feasible, start, goal, CELL_SIZE),
        bounds=bounds,
        seconds=seconds,
    )


def draw_cells(found: Continuous, folder: Path) -> None:
    """The cells of one target by what is proved of them, and the path; on the right, where it bends
    first.
    """
    scene = load_scene("paper")
    bounds = found.bounds
    bend = bounds.path[1]

    with new_figure(11, 5.6) as figure:
        for number, axes in enumerate(figure.subplots(1, 2)):
            boxes = [
                Rectangle((x0, y0), x1 - x0, y1 - y0) for x0, y0, x1, y1 in bounds.cells.tolist()
            ]
            axes.add_collection(
                PatchCollection(
                    boxes,
                    facecolor=[_COLOURS[state] for state in bounds.states.tolist()],
                    edgecolor="#909090",
                    linewidth=0.25,
                    zorder=1,
                    rasterized=True,  # thousands of them
                )
            )
            draw_floor(axes, scene)
            axes.add_collection(
                LineCollection([bounds.path], colors="#b2182b", linewidths=1.8, zorder=4)
            )
            if number == 1:
                axes.set(xlim=bend[0] + np.array([-0.3, 0.3]), ylim=bend[1] + np.array([-0.3, 0.3]))
                axes.set_title("about the first bend")
                for line in axes.lines:
                    line.set_clip_on(True)

        axes = figure.axes[0]
        axes.set_title(f"{found.target_db:g} dB: {bounds.lower:.3f} to {bounds.upper:.3f} m")
        axes.plot([], [], color="#b2182b", linewidth=1.8, label="proved path")
        for state, label in _LABELS.items():
            axes.add_patch(
                Rectangle((0, 0), 0, 0, facecolor=_COLOURS[state], edgecolor="#909090", label=label)
            )
        add_floor_legend(figure, axes)
        rows = [("path", x, y, "", "") for x, y in bounds.path.tolist()]
        rows += [
            (_LABELS[state], *cell)
            for state, cell in zip(bounds.states.tolist(), bounds.cells.tolist(), strict=True)
        ]
        save(figure, folder, "bounds", ("part", "x0_m", "y0_m", "x1_m", "y1_m"), rows)
