"""Figures of a measured room, a panel for each receiver: maps of mean power and outage, trade-offs
and Pareto fronts.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from eval.paper.figures import ACCESS_POINT, GOAL, START, minus, new_figure, save
from eval.paper.map_figures import draw_cell_values
from eval.paper.measured_room import COSTS, LEVEL_DBM, Receiver
from eval.pictures import as_png, write_pictures
from irs_gym import cost_map
from irs_gym.units import Floats

_COLUMNS = 4
_STYLES: dict[str, dict[str, Any]] = {
    "violation": {"color": "#e08214", "marker": "s", "markersize": 4},
    "outage": {"color": "#08306b", "marker": "D", "markersize": 3},
}


def draw_means(receivers: Sequence[Receiver], folder: Path) -> None:
    """Mean power of each walkable cell, and a shortest path at the highest feasible target."""
    values = [np.where(r.radio_map.free, r.radio_map.gain_db, np.nan) for r in receivers]
    every = np.concatenate([each[np.isfinite(each)] for each in values])
    scale = Normalize(np.floor(every.min()), np.ceil(every.max()))
    _draw_maps(receivers, values, scale, "mean received power (dBm)", folder, "measured_mean")


def draw_outages(receivers: Sequence[Receiver], folder: Path) -> None:
    """Share of each walkable cell's histogram below the level, and the same path."""
    values = [cost_map(each.radio_map, LEVEL_DBM, "outage") for each in receivers]
    label = f"share of the histogram below {minus(LEVEL_DBM)} dBm"
    _draw_maps(receivers, values, Normalize(0, 1), label, folder, "measured_outage")


def _draw_maps(
    receivers: Sequence[Receiver],
    values: Sequence[Floats],
    scale: Normalize,
    label: str,
    folder: Path,
    name: str,
) -> None:
    """Pictures alone: their numbers are the data of others."""
    rows = -(-len(receivers) // _COLUMNS)
    with new_figure(13, 2.75 * rows + 0.6) as figure:
        panels = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
        for axes, each, cells in zip(panels.ravel(), receivers, values, strict=False):
            axes.set_facecolor("#bdbdbd")  # where nobody walks
            draw_cell_values(axes, each.radio_map, cells, scale)
            _draw_way(axes, each)
            axes.set_title(each.name, fontsize=9)

        for axes in panels[-1]:
            axes.set_xlabel("x (m)")
        for axes in panels[:, 0]:
            axes.set_ylabel("y (m)")

        _hide_the_rest(panels, len(receivers))
        figure.colorbar(ScalarMappable(scale, "viridis"), ax=panels, label=label, shrink=0.6)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
        write_pictures(folder, {f"{name}.png": as_png(figure, 110)})


def _draw_way(axes: Axes, each: Receiver) -> None:
    centres = each.radio_map.grid.centres()
    x, y = centres[tuple(each.path.cells.T)].T
    axes.plot(x, y, color="white", linewidth=3, zorder=3)
    axes.plot(x, y, color="black", linewidth=1.3, zorder=4, label="path at the highest target")
    marks = [
        (START, "start", centres[each.start]),
        (GOAL, "goal", centres[each.goal]),
        (ACCESS_POINT, "receiver", each.place),
    ]

    for style, label, at in marks:
        if at is not None:
            small = {**style, "markersize": 7}
            axes.plot(*at, label=label, zorder=5, clip_on=False, **small)


def draw_trade_offs(receivers: Sequence[Receiver], folder: Path) -> None:
    """Shortest distance over the target of the mean power."""

    def draw(axes: Axes, each: Receiver) -> list[tuple[object, ...]]:
        targets = each.trade_off.targets_db
        distances = each.trade_off.distances
        low = targets[0] - 1.0
        axes.step(
            np.append(low, targets), np.append(distances[0], distances), where="pre", color="black"
        )
        axes.plot(targets[-1], distances[-1], marker="x", color="black", markeredgewidth=2)
        return [
            (float(target), float(distance))
            for target, distance in zip(targets, distances, strict=True)
        ]

    _draw_curves(
        receivers,
        draw,
        ("target of the mean (dBm)", ("up_to_target_dbm", "distance_m")),
        folder,
        "measured_trade_off",
    )


def draw_fronts(receivers: Sequence[Receiver], folder: Path) -> None:
    """Distance over cost of all paths that are on a front, and the hulls of the fronts."""

    def draw(axes: Axes, each: Receiver) -> list[tuple[object, ...]]:
        rows: list[tuple[object, ...]] = []
        for kind in COSTS:
            front = each.fronts[kind]
            hull = front.hull()
            style = _STYLES[kind]
            axes.plot(front.costs, front.distances, linestyle="none", label=kind, **style)
            axes.plot(hull.costs, hull.distances, color=style["color"], linewidth=1)
            rows += [
                (kind, float(cost), float(distance))
                for cost, distance in zip(front.costs, front.distances, strict=True)
            ]
        return rows

    label = f"cells below {minus(LEVEL_DBM)} dBm: of means (violation), expected (outage)"
    header = ("cost", "total", "distance_m")
    _draw_curves(receivers, draw, (label, header), folder, "measured_fronts")


def _draw_curves(
    receivers: Sequence[Receiver],
    draw: Callable[[Axes, Receiver], list[tuple[object, ...]]],
    said: tuple[str, tuple[str, ...]],
    folder: Path,
    name: str,
) -> None:
    """A panel for each receiver; ``said`` is the label of x and the header of the data."""
    label, header = said
    rows: list[tuple[object, ...]] = []
    count = -(-len(receivers) // _COLUMNS)

    with new_figure(12, 2.4 * count + 0.6) as figure:
        panels = figure.subplots(count, _COLUMNS, sharey=True, squeeze=False)
        for axes, each in zip(panels.ravel(), receivers, strict=False):
            rows += [(each.name, *row) for row in draw(axes, each)]
            axes.set_title(each.name, fontsize=9)
            axes.grid(alpha=0.3)
            axes.margins(0.08)
            axes.locator_params(axis="x", nbins=4)

        _hide_the_rest(panels, len(receivers))
        figure.supxlabel(label, fontsize=10)
        figure.supylabel("distance (m)", fontsize=10)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
        save(figure, folder, name, ("receiver", *header), rows)


def _hide_the_rest(panels: Any, used: int) -> None:
    for axes in panels.ravel()[used:]:
        axes.set_visible(False)
