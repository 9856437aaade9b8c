"""Figures of codebooks: paths with the places where the panel switches, gains under each
configuration, and metres over size and cost.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from eval.paper.codebooks import CodebookStudy, Row, best_switches
from eval.paper.figures import draw_floor, minus, new_figure, save
from eval.paper.map_figures import add_floor_legend, draw_cell_values
from eval.paper.study import CONTINUOUS, Study
from irs_gym import JointPath

# One for each configuration of a path in turn, told apart by lightness too.
COLOURS = ("#08306b", "#e08214", "#35978f", "#762a83", "#b2182b", "#4d4d4d")
SWITCH: dict[str, Any] = {
    "marker": "o",
    "markersize": 9,
    "color": "white",
    "markeredgecolor": "black",
    "markeredgewidth": 1.5,
    "linestyle": "none",
}
FOCUS: dict[str, Any] = {"marker": "*", "markersize": 13, "markeredgecolor": "white"}
DESIGN_LINES: dict[str, dict[str, Any]] = {
    "cover": {"color": "#08306b", "linestyle": "-", "marker": "o"},
    "focused": {"color": "#e08214", "linestyle": "--", "marker": "s"},
    "DFT": {"color": "#762a83", "linestyle": ":", "marker": "^"},
}
SPAN_DB = 8  # of the scale of gains, from 4 below the target on


def draw_switch_paths(codebooks: CodebookStudy, row: Row, folder: Path) -> None:
    """One floor for each point of a front: its path, by configuration, and where it switches."""
    paths = row.front.paths if row.front else ()
    table: list[tuple[object, ...]] = []

    with new_figure(3.9 * len(paths), 4.6) as figure:
        every = figure.subplots(1, len(paths), sharey=True, squeeze=False)[0]
        for axes, path in zip(every, paths, strict=True):
            draw_floor(axes, codebooks.study.scene)
            _draw_joint_path(axes, codebooks.study, path)
            title = f"{path.switches} switch{'es' * (path.switches != 1)}, {path.distance:.2f} m"
            axes.set(title=title, ylabel="y (m)" if axes is every[0] else "")
            table += _path_rows(codebooks.study, path)

        figure.suptitle(f"target {minus(row.target_db)} dB", fontsize="medium")
        add_floor_legend(figure, every[-1])
        header = ("switches", "step", "configuration", "i", "j", "x_m", "y_m")
        save(figure, folder, "codebook_paths", header, table)


def draw_configurations(codebooks: CodebookStudy, row: Row, folder: Path) -> None:
    """One floor for each configuration of a front's best path: its gains, and its part of the
    path.
    """
    if row.front is None:
        return

    path = row.front.paths[-1]
    used = list(dict.fromkeys(path.configurations.tolist()))
    gain_db = codebooks.focused(used)
    radio_map = codebooks.study.radio_map(CONTINUOUS)
    scale = Normalize(row.target_db - SPAN_DB / 2, row.target_db + SPAN_DB / 2)
    centres = radio_map.grid.centres()
    levels = np.array([row.target_db])

    with new_figure(3.9 * len(used), 4.9) as figure:
        every = figure.subplots(1, len(used), sharey=True, squeeze=False)[0]
        for n, (axes, configuration) in enumerate(zip(every, used, strict=True)):
            draw_cell_values(axes, radio_map, gain_db[n], scale)
            shown = np.where(np.isfinite(gain_db[n]), gain_db[n], gain_db[n].max() - 99)
            line = {"colors": "white", "linewidths": 1.2, "linestyles": "solid"}
            axes.contour(*centres.transpose(2, 0, 1), shown, levels, **line)
            axes.plot([], [], color="#bbbbbb", linewidth=1.2, label="the target")
            draw_floor(axes, codebooks.study.scene)

            x, y = centres[tuple(path.cells.T)].T
            axes.plot(x, y, color="black", linewidth=1, linestyle=":", zorder=4)
            held = path.configurations == configuration
            own = np.where(held, y, np.nan)  # NaN is not drawn
            axes.plot(x, own, color="white", linewidth=4.5, zorder=4)
            axes.plot(x, own, color="black", linewidth=2.2, zorder=4, label="path under it")
            focus = centres[tuple(codebooks.cells[configuration])]
            axes.plot(*focus, color="black", linestyle="none", zorder=6, label="focus", **FOCUS)
            axes.set(title=f"configuration {n + 1}", ylabel="y (m)" if axes is every[0] else "")

        figure.colorbar(
            ScalarMappable(scale, "viridis"),
            ax=every,
            label="expected channel gain (dB)",
            shrink=0.8,
            extend="both",
        )
        add_floor_legend(figure, every[-1])
        header = ("i", "j", "x_m", "y_m", *(f"configuration_{n + 1}_db" for n in range(len(used))))
        cells = np.ndindex(radio_map.grid.shape)
        rows = [(*cell, *centres[cell].tolist(), *gain_db[:, *cell].tolist()) for cell in cells]
        save(figure, folder, "codebook_maps", header, rows)


def draw_sizes(
    metres: Mapping[tuple[float, str], Sequence[float]],
    following: Mapping[float, float],
    sizes: Sequence[int],
    folder: Path,
) -> None:
    """Metres over the codebook's size, a design a line and a target a panel."""
    targets = list(following)

    with new_figure(4.4 * len(targets), 4.2) as figure:
        every = figure.subplots(1, len(targets), sharey=True, squeeze=False)[0]
        for axes, target_db in zip(every, targets, strict=True):
            axes.axhline(following[target_db], color="#777777", linewidth=1)
            for design, style in DESIGN_LINES.items():
                shown = np.array(metres[target_db, design])
                shown[np.isinf(shown)] = np.nan  # NaN is not drawn
                label = design if np.isfinite(shown).any() else f"{design}: none"
                axes.plot(sizes, shown, label=label, **style)

            axes.set_xscale("log", base=2)
            axes.set_xlim(sizes[0] / 1.2, sizes[-1] * 1.2)
            axes.set_xticks(sizes, [str(size) for size in sizes], minor=False)
            axes.set(xlabel="configurations K", title=f"target {minus(target_db)} dB")
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small")

        every[0].set_ylabel("shortest distance (m)")
        rows = [
            (target_db, design, size, length)
            for (target_db, design), lengths in metres.items()
            for size, length in zip(sizes, lengths, strict=True)
        ]
        save(figure, folder, "codebook_sizes", ("target_db", "design", "size", "distance_m"), rows)


def draw_costs(rows: Sequence[Row], most: float, folder: Path) -> None:
    """The best sum of metres and switches over the cost of a switch, a target a line."""
    costs = np.linspace(0, most, 241)
    table: list[tuple[object, ...]] = []

    with new_figure(7.5, 4.4) as figure:
        axes = figure.subplots()
        for n, (row, colour) in enumerate(zip(rows, COLOURS, strict=False)):
            if row.front is None:
                continue

            points = [best_switches(row.front, cost) for cost in costs.tolist()]
            switches = row.front.switches[points]
            total = row.front.distances[points] + costs * switches
            changes = [0, *(1 + np.flatnonzero(np.diff(switches)))]
            said = ", ".join(str(switches[at]) for at in changes)
            label = f"{minus(row.target_db)} dB: {said}"
            # the first is the widest, as lines may lie on each other
            axes.plot(costs, total, color=colour, label=label, linewidth=6 - 0.9 * n)
            axes.plot(costs[changes], total[changes], "o", markersize=6, color=colour)

            table += [
                (row.target_db, *each)
                for each in zip(
                    costs.tolist(),
                    switches.tolist(),
                    row.front.distances[points].tolist(),
                    total.tolist(),
                    strict=True,
                )
            ]

        axes.set(xlabel="cost of a switch (m)", ylabel="metres and switches (m)", xlim=(0, most))
        axes.grid(alpha=0.3)
        figure.legend(
            loc="outside right upper", title="target: switches\nfrom each mark on", fontsize="small"
        )
        header = ("target_db", "switch_cost_m", "switches", "distance_m", "sum_m")
        save(figure, folder, "codebook_costs", header, table)


def _draw_joint_path(axes: Axes, study: Study, path: JointPath) -> None:
    """The path in a colour a configuration, and a ring where the panel switches."""
    centres = study.scene.grid(study.cell_size).centres()
    x, y = centres[tuple(path.cells.T)].T

    for n, configuration in enumerate(dict.fromkeys(path.configurations.tolist())):
        own = np.where(path.configurations == configuration, y, np.nan)  # NaN is not drawn
        axes.plot(x, own, color=COLOURS[n % len(COLOURS)], linewidth=3, zorder=4)

    if path.switches:
        switches = centres[tuple(path.switch_cells.T)].T
        axes.plot(*switches, zorder=6, label="the panel switches", **SWITCH)


def _path_rows(study: Study, path: JointPath) -> list[tuple[object, ...]]:
    centres = study.scene.grid(study.cell_size).centres()
    return [
        (path.switches, n, configuration, *cell, *centres[tuple(cell)].tolist())
        for n, (cell, configuration) in enumerate(
            zip(path.cells.tolist(), path.configurations.tolist(), strict=True)
        )
    ]
