"""Figures of distances over the target (the paper's Fig. 5), over the elements (Fig. 6), and of
drawn channels.
"""

from collections.abc import Iterable, Sequence
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from eval.paper.claim import ELEMENTS_AT_DB
from eval.paper.distance_claims import element_counts
from eval.paper.figures import LINES, minus, new_figure, save
from eval.paper.monte_carlo import Evidence
from eval.paper.study import CONTINUOUS, SCHEMES, Study
from irs_gym import TradeOff, straight_line_bound

ROWS_SHOWN = 12  # rows of sub-surfaces on the axis of Fig. 6
MARGIN_DB = 0.4  # of the axis of targets, below the lowest step
ORACLE: dict[str, Any] = {"label": "oracle, eight directions", "color": "black", "linewidth": 2}
BOUND: dict[str, Any] = {
    "label": "shortest path of any shape",
    "color": "#777777",
    "linewidth": 2,
    "linestyle": "--",
}


def draw_distance_over_target(study: Study, folder: Path) -> None:
    """Exact step functions, each up to its highest feasible target: the paper's Fig. 5."""
    rows = []

    with new_figure(7.5, 4.6) as figure:
        axes = figure.subplots()
        curves = {scheme.name: study.curve(scheme) for scheme in SCHEMES}
        lowest = [curve.targets_db[0] for curve in curves.values() if len(curve.targets_db)]
        low = min(lowest, default=0) - MARGIN_DB

        for name, curve in curves.items():
            _draw_steps(axes, name, curve, low)
            rows += [(name, *step) for step in _steps_of(curve)]

        elements = study.scene.irs_panels[0].elements
        axes.set(xlabel="target (dB)", ylabel="shortest distance (m)", xlim=(low, None))
        axes.set_title(f"M = {elements}; × marks the highest feasible target")
        axes.grid(alpha=0.3)
        axes.legend()

        header = ("scheme", "up_to_target_db", "distance_m")
        save(figure, folder, "distance_over_target", header, rows)


def _steps_of(curve: TradeOff) -> Iterable[tuple[float, float]]:
    """The highest target of each step, and its distance."""
    return zip(curve.targets_db.tolist(), curve.distances.tolist(), strict=True)


def _draw_steps(axes: Axes, name: str, curve: TradeOff, low: float) -> None:
    """One step function, marked at the upper end of every step."""
    targets = curve.targets_db
    distances = curve.distances
    if not len(distances):
        return

    _draw_line(axes, curve, low, LINES[name] | {"marker": ""})

    # the scheme's own mark at each step but the last, which ends in a cross
    dots = {"linestyle": "none", "color": LINES[name]["color"]}
    axes.plot(targets[:-1], distances[:-1], marker=LINES[name]["marker"], markersize=5, **dots)
    axes.plot(targets[-1], distances[-1], marker="x", markersize=9, markeredgewidth=2, **dots)

    # line and mark as one in the legend
    axes.plot([], [], label=name, markersize=5, **LINES[name])


def _draw_line(axes: Axes, curve: TradeOff, low: float, style: dict[str, Any]) -> None:
    """The line of a step function, from a low target on."""
    targets = np.append(low, curve.targets_db)
    distances = np.append(curve.distances[0], curve.distances)
    axes.step(targets, distances, where="pre", **style)


def draw_distance_over_elements(study: Study, folder: Path) -> None:
    """Shortest distance over the number of elements M: the paper's Fig. 6."""
    counts = element_counts(study, ROWS_SHOWN)
    rows = []

    with new_figure(7.5, 4.6) as figure:
        axes = figure.subplots()
        for scheme in SCHEMES:
            lengths = [study.distance(scheme, ELEMENTS_AT_DB, elements=m) for m in counts]
            rows += [(scheme.name, m, length) for m, length in zip(counts, lengths, strict=True)]

            style = LINES[scheme.name]
            if min(lengths) < inf:
                shown = np.where(np.isinf(lengths), np.nan, lengths)  # NaN is not drawn
                axes.plot(counts, shown, label=scheme.name, **style)
            else:
                axes.plot([], [], label=f"{scheme.name}: infeasible", **style)

        axes.set(
            xlabel="number of IRS elements M",
            ylabel="shortest distance (m)",
            xticks=[0, *counts][::2],
        )
        axes.set_title(f"target {minus(ELEMENTS_AT_DB)} dB")
        axes.grid(alpha=0.3)
        axes.legend()
        save(figure, folder, "distance_over_elements", ("scheme", "elements", "distance_m"), rows)


def draw_cost_of_grid(study: Study, folder: Path) -> list[tuple[float, float, float]]:
    """The oracle's distance and the straight-line bound, continuous phases; returns target,
    distance, bound.
    """
    rows = _bounds(study)

    with new_figure(7.5, 4.2) as figure:
        axes = figure.subplots()
        if rows:
            low = rows[0][0] - MARGIN_DB
            oracle = study.curve(CONTINUOUS)
            bound = TradeOff(oracle.targets_db, np.array([each[2] for each in rows]), 0)
            _draw_line(axes, oracle, low, ORACLE)
            _draw_line(axes, bound, low, BOUND)
            axes.set(xlim=(low, None))

        axes.set(xlabel="target (dB)", ylabel="distance (m)", title="continuous phases")
        axes.grid(alpha=0.3)
        axes.legend()

        header = ("up_to_target_db", "oracle_m", "straight_line_bound_m")
        save(figure, folder, "cost_of_grid", header, rows)

    return rows


def _bounds(study: Study) -> list[tuple[float, float, float]]:
    """Target, distance and straight-line bound at each step of the trade-off."""
    radio_map = study.radio_map(CONTINUOUS)
    rows = []

    for target_db, distance in _steps_of(study.curve(CONTINUOUS)):
        feasible = radio_map.feasible(target_db)
        bound = straight_line_bound(feasible, study.start, study.goal, study.cell_size)
        rows.append((target_db, distance, bound))

    return rows


def draw_evidence(evidence: Sequence[Evidence], folder: Path) -> None:
    """Running means of the draws, with their standard errors, beside our formula and its rival."""
    rows: list[tuple[str | float, ...]] = []

    with new_figure(11, 3.8) as figure:
        for axes, each in zip(figure.subplots(1, len(evidence)), evidence, strict=True):
            _draw_running_mean(axes, each)
            means = (each.means / each.ours).tolist()
            errors = (each.errors / each.ours).tolist()
            draws = each.draws.tolist()
            rows += [(each.subject, *row) for row in zip(draws, means, errors, strict=True)]

        figure.axes[0].set_ylabel("dB over the corrected formula")
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=4,
            frameon=False,
        )

        header = ("subject", "draws", "mean_over_ours", "standard_error_over_ours")
        save(figure, folder, "monte_carlo", header, rows)


def _draw_running_mean(axes: Axes, evidence: Evidence) -> None:
    # from the second batch on
    means, errors, draws = (
        values[1:] for values in (evidence.means, evidence.errors, evidence.draws)
    )
    bounds = (means, means - 2 * errors, means + 2 * errors)
    mean_db, low_db, high_db = (10 * np.log10(value / evidence.ours) for value in bounds)
    rival_db = 10 * np.log10(evidence.rival / evidence.ours)

    axes.fill_between(draws, low_db, high_db, color="#bbbbbb", label="± 2 standard errors")
    axes.plot(draws, mean_db, color="black", linewidth=1.2, label="mean of draws")
    axes.axhline(0, color="#08306b", linestyle="--", linewidth=1.5, label="corrected formula")
    axes.axhline(rival_db, color="#b35806", linestyle="-.", linewidth=2, label="as printed")

    # the band is four standard errors wide
    outcome = f"{mean_db[-1]:+.3f} ± {(high_db[-1] - low_db[-1]) / 4:.3f} dB"
    axes.set(title=f"{evidence.subject}\n{outcome}", xlabel="draws", xscale="log")
