"""Figures of outages: the closed form beside drawn shares, and its error over the panel's size."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eval.paper.figures import LINES, new_figure, save
from eval.paper.outage_draws import THRESHOLDS_DB, OutageDraws

_LOWEST = 1e-4  # probability on the axis
_CASES: tuple[dict[str, Any], ...] = (
    {"color": "#762a83", "linestyle": "-", "marker": "v"},
    {"color": "#e08214", "linestyle": "-", "marker": "s"},
    {"color": "#08306b", "linestyle": "-", "marker": "D"},
    {"color": "#777777", "linestyle": ":", "marker": "o"},
)


def draw_outages(cells: Sequence[OutageDraws], folder: Path) -> None:
    """Outage over the threshold in each place: lines in closed form, marks drawn."""
    places = list(dict.fromkeys(each.place for each in cells))
    rows: list[tuple[object, ...]] = []

    with new_figure(11, 6.4) as figure:
        panels = figure.subplots(2, -(-len(places) // 2), sharex=True, sharey=True)
        for axes, place in zip(panels.ravel(), places, strict=True):
            for each in [cell for cell in cells if cell.place == place]:
                style = LINES[each.phases]
                thresholds_db = each.mean_gain_db + THRESHOLDS_DB
                exact = each.exact(thresholds_db)
                drawn = each.drawn(thresholds_db)
                line = {**style, "marker": ""}
                axes.semilogy(THRESHOLDS_DB, exact, label=f"{each.phases}: closed form", **line)

                # with bars of two standard errors
                error = 2 * np.sqrt(exact * (1 - exact) / len(each.gains))
                axes.errorbar(
                    THRESHOLDS_DB[::4],
                    np.where(drawn > 0, drawn, np.nan)[::4],
                    error[::4],
                    fmt=style["marker"],
                    color=style["color"],
                    markersize=4,
                    linewidth=1,
                    label=f"{each.phases}: drawn",
                )
                rows += [
                    (place, each.phases, *map(float, row))
                    for row in zip(thresholds_db, exact, drawn, strict=True)
                ]

            axes.set(title=place, ylim=(_LOWEST, 1.5))
            axes.grid(alpha=0.3)

        for axes in panels[-1]:
            axes.set_xlabel("threshold over the mean gain (dB)")
        for axes in panels[:, 0]:
            axes.set_ylabel("outage probability")

        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
        header = ("place", "phases", "threshold_db", "closed_form", "drawn")
        save(figure, folder, "outage", header, rows)


def draw_errors(panels: Mapping[str, Sequence[OutageDraws]], folder: Path) -> None:
    """Worst error of the closed form over M, beside what sampling alone makes of it."""
    rows: list[tuple[object, ...]] = []

    with new_figure(7.5, 4.8) as figure:
        axes = figure.subplots()
        for style, (case, sizes) in zip(_CASES, panels.items(), strict=True):
            elements = np.array([each.elements for each in sizes])
            errors = np.array([each.worst_error for each in sizes])
            bounds = np.array([each.sampling_error for each in sizes])
            axes.loglog(elements, errors, label=case, **style)
            columns = (elements.tolist(), errors.tolist(), bounds.tolist())
            rows += [(case, *row) for row in zip(*columns, strict=True)]

        label = "sampling alone stays below, 999 times in 1,000"
        axes.loglog(elements, bounds, color="black", linestyle="--", linewidth=1, label=label)
        axes.loglog(elements, 0.18 / elements, color="#cccccc", linewidth=1, label="0.18 / M")
        axes.loglog(
            elements, 0.05 / np.sqrt(elements), color="#aaaaaa", linestyle="-.", label="0.05 / √M"
        )
        axes.set(xlabel="elements M", ylabel="worst error of the probability, over all thresholds")
        axes.set_ylim(bottom=3e-4)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
        header = ("case", "elements", "worst_error", "sampling_error")
        save(figure, folder, "outage_error", header, rows)
