"""Figures of distances over the target (the paper's Fig. 5), over the elements (Fig. 6), and of
drawn channels.
"""

from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from eval.paper.claim import ELEMENTS_AT_DB
from eval.paper.distance_claims import element_counts
from eval.paper.figures import LINES, minus, new_figure, save
from eval.paper.monte_carlo import Evidence
from eval.paper.study import CONTINUOUS, SCHEMES, Study
from irs_gym import TradeOff, straight_line_bound

ROWS_SHOWN = 12  # rows of sub-surfaces on the axis of Fig. 6


def draw_distance_over_target(study: Study, folder: Path) -> None:
    """Exact step functions, each up to its highest feasible target: the paper's Fig. 5."""
    rows = []

    with new_figure(7.5, 4.6) as figure:
        axes = figure.subplots()
        curves = {scheme.name: study.curve(scheme) for scheme in SCHEMES}
        low = (
            min(
                (curve.targets_db[0] for curve in curves.values() if len(curve.targets_db)),
                default=0,
            )
            - 0.4
        )

        for name, curve in curves.items():
            _draw_steps(axes, name, curve, low)
            rows += [
                (name, *step)
                for step in zip(curve.targets_db.tolist(), curve.distances.tolist(), strict=True)
            ]

        axes.set(xlabel="target (dB)", ylabel="shortest distance (m)", xlim=(low, None))
        axes.set_title(
            f"M = {study.scene.irs_panels[0].elements}; × marks the highest feasible target"
        )
        axes.grid(alpha=0.3)
        axes.legend()
        save(
            figure,
            folder,
            "distance_over_target",
            ("scheme", "up_to_target_db", "distance_m"),
            rows,
        )


def _draw_steps(axes: Axes, name: str, curve: TradeOff, low: float) -> None:
    """One step function, marked at the upper end of every step."""
    targets = np.append(low, curve.targets_db)
    distances = curve.distances
    if not len(distances):
        return

    style = LINES[name] | {"marker": ""}
    axes.step(targets, np.append(distances[0], distances), where="pre", label=None, **style)
    axes.plot(curve.targets_db[:-1], distances[:-1], linestyle="none", marker=LINES[name]["marker"], markersize=5,
              color=LINES[name]["color"])  # fmt: skip
    axes.plot(curve.targets_db[-1], distances[-1], linestyle="none", marker="x", markersize=9, markeredgewidth=2,
              color=LINES[name]["color"])  # fmt: skip
    axes.plot([], [], label=name, markersize=5, **LINES[name])


def draw_distance_over_elements(study: Study, folder: Path) -> None:
    """Shortest distance over the number of elements M: the paper's Fig. 6."""
    counts = element_counts(study, ROWS_SHOWN)
    rows = []

    with new_figure(7.5, 4.6) as figure:
        axes = figure.subplots()
        for scheme in SCHEMES:
            lengths = [study.distance(scheme, ELEMENTS_AT_DB, elements=m) for m in counts]
            rows += [(scheme.name, m, length) for m, length in zip(counts, lengths, strict=True)]
            if min(lengths) < inf:
                axes.plot(
                    counts,
                    np.where(np.isinf(lengths), np.nan, lengths),
                    label=scheme.name,
                    **LINES[scheme.name],
                )
            else:
                axes.plot([], [], label=f"{scheme.name}: infeasible", **LINES[scheme.name])

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
    curve = study.curve(CONTINUOUS)
    radio_map = study.radio_map(CONTINUOUS)
    rows = [
        (
            target,
            distance,
            straight_line_bound(
                radio_map.feasible(target), study.start, study.goal, study.cell_size
            ),
        )
        for target, distance in zip(
            curve.targets_db.tolist(), curve.distances.tolist(), strict=True
        )
    ]

    with new_figure(7.5, 4.2) as figure:
        axes = figure.subplots()
        if rows:
            low = rows[0][0] - 0.4
            bound = TradeOff(curve.targets_db, np.array([each[2] for each in rows]), 0)

            for steps, label, style in (
                (curve, "oracle, eight directions", {"color": "black", "linewidth": 2}),
                (
                    bound,
                    "shortest path of any shape",
                    {"color": "#777777", "linewidth": 2, "linestyle": "--"},
                ),
            ):
                targets = np.append(low, steps.targets_db)
                distances = np.append(steps.distances[0], steps.distances)
                axes.step(targets, distances, where="pre", label=label, **style)

            axes.set(xlim=(low, None))

        axes.set(xlabel="target (dB)", ylabel="distance (m)", title="continuous phases")
        axes.grid(alpha=0.3)
        axes.legend()
        save(
            figure,
            folder,
            "cost_of_grid",
            ("up_to_target_db", "oracle_m", "straight_line_bound_m"),
            rows,
        )

    return rows


def draw_evidence(evidence: Sequence[Evidence], folder: Path) -> None:
    """Running means of the draws, with their standard errors, beside our formula and its rival."""
    rows = []

    with new_figure(11, 3.8) as figure:
        for axes, each in zip(figure.subplots(1, len(evidence)), evidence, strict=True):
            means, errors, draws = (values[1:] for values in (each.means, each.errors, each.draws))
            bounds = (means, means - 2 * errors, means + 2 * errors)
            db, low, high = (10 * np.log10(value / each.ours) for value in bounds)
            axes.fill_between(draws, low, high, color="#bbbbbb", label="± 2 standard errors")
            axes.plot(draws, db, color="black", linewidth=1.2, label="mean of draws")
            axes.axhline(
                0, color="#08306b", linestyle="--", linewidth=1.5, label="corrected formula"
            )
            rival = 10 * np.log10(each.rival / each.ours)
            axes.axhline(rival, color="#b35806", linestyle="-.", linewidth=2, label="as printed")
            outcome = f"{db[-1]:+.3f} ± {(high[-1] - low[-1]) / 4:.3f} dB"
            axes.set(title=f"{each.subject}\n{outcome}", xlabel="draws", xscale="log")
            rows += [(each.subject, *row) for row in zip(each.draws.tolist(), *(
                (values / each.ours).tolist() for values in (each.means, each.errors)), strict=True)]  # fmt: skip

        figure.axes[0].set_ylabel("dB over the corrected formula")
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=4,
            frameon=False,
        )
        save(
            figure,
            folder,
            "monte_carlo",
            ("subject", "draws", "mean_over_ours", "standard_error_over_ours"),
            rows,
        )
