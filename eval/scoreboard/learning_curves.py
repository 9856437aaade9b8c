"""`draw_curves`: how algorithms learned on one problem, with bands over seeds, as a PNG."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from eval.pictures import add_legend, as_png
from eval.scoreboard.results import Curve
from eval.statistics import band

DASHES = ("-", "--", "-.", ":")


def draw_curves(algorithms: Mapping[str, Sequence[Curve]]) -> bytes:
    """Left: mean SPL of the tests over training steps, with its 95 % band. Right: seeds at the
    optimum over seconds.

    A run that stopped keeps its last SPL, as its policy does.
    """
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)

    for n, (name, curves) in enumerate(algorithms.items()):
        style = {"color": f"C{n % 10}", "linestyle": DASHES[n % len(DASHES)], "linewidth": 1.8}
        label = f"{name} ({len(curves)} seed{'s' * (len(curves) > 1)})"

        steps, spl = align(curves)  # (T,), (seeds, T)
        middle, low, high = band(spl)  # (T,) each
        left.plot(steps, middle, label=label, **style)
        left.fill_between(steps, low, high, color=style["color"], alpha=0.2, linewidth=0)
        _draw_arrivals(right, curves, style)

    left.set(
        xlabel="training steps", ylabel="SPL of the tested policy", ylim=(-0.03, 1.03), xscale="log"
    )
    right.set(
        xlabel="seconds of training",
        ylabel="seeds at the optimum",
        ylim=(-0.03, 1.03),
        xscale="log",
    )
    right.yaxis.set_major_formatter(PercentFormatter(1.0))

    for axes in (left, right):
        axes.grid(alpha=0.3)

    add_legend(figure, left.get_legend_handles_labels()[0])

    return as_png(figure, dpi=110, in_palette=True)


def align(curves: Sequence[Curve]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """SPL of curves ``(seeds, T)`` at all steps ``(T,)`` where one of them was tested.

    Between its tests a curve holds the SPL of the latest; before the first it is 0, since nothing
    has been learned.
    """
    steps = np.unique(np.concatenate([each.steps for each in curves]))

    # How many tests lie behind each step is the place of the latest, counted from the 0 in front.
    latest = [np.searchsorted(each.steps, steps, side="right") for each in curves]
    spl = [np.append(0.0, each.spl)[at] for each, at in zip(curves, latest, strict=True)]

    return steps, np.stack(spl)


def _draw_arrivals(axes: Axes, curves: Sequence[Curve], style: Mapping[str, Any]) -> None:
    """Share of the seeds that have been at the optimum, up to the end of the longest run."""
    arrivals = np.sort([each.first_optimum(each.seconds) for each in curves])
    arrived = arrivals[np.isfinite(arrivals)]
    first = min(each.seconds[0] for each in curves)
    end = max(each.seconds[-1] for each in curves)

    seconds = np.concatenate([[first], arrived, [end]])
    share = np.concatenate([[0], np.arange(1, len(arrived) + 1), [len(arrived)]]) / len(curves)
    axes.step(seconds, share, where="post", **style)
