"""`Curve`: the figure of the shortest distance over the target, made once and then only filled."""

import numpy as np
from bokeh.models import HoverTool, Range1d, Span
from bokeh.plotting import figure

from irs_gym.workbench.drawing import Drawing
from irs_gym.workbench.sources import fill, source

_SIZE = (345, 240)  # px
_LINE = "#26828e"
HIGHEST = "#d7191c"


class Curve:
    """Shortest distance over the target, with the target that is set and the highest feasible."""

    def __init__(self) -> None:
        self._shown: Drawing | None = None
        self._x = Range1d(-70, -50)
        self._y = Range1d(0, 1)
        self.figure = fig = figure(
            x_range=self._x,
            y_range=self._y,
            frame_width=_SIZE[0] - 70,
            frame_height=_SIZE[1] - 50,
            tools="",
            toolbar_location=None,
            x_axis_label="target (dB)",
            y_axis_label="shortest distance (m)",
            name="curve",
        )
        fig.outline_line_color = None
        fig.grid.grid_line_alpha = 0.5

        self._steps = source("x", "y")
        self._corners = source("x", "y")
        self._now = source("x", "y")
        self._highest = Span(
            dimension="height", line_color=HIGHEST, line_dash="dashed", line_width=2
        )
        self._target = Span(dimension="height", line_color="black", line_width=2)
        fig.add_layout(self._highest)
        fig.add_layout(self._target)
        fig.line("x", "y", source=self._steps, line_color=_LINE, line_width=3)
        fig.scatter("x", "y", source=self._corners, size=7, color=_LINE)
        fig.scatter("x", "y", source=self._now, size=12, color="black", line_color="white")
        fig.add_tools(
            HoverTool(
                renderers=[fig.renderers[1]],
                tooltips=[("up to", "@x{0.000} dB"), ("distance", "@y{0.000} m")],
                visible=False,
            )
        )

    def show(self, drawing: Drawing) -> None:
        """Draw the trade-off and the target."""
        if drawing is self._shown:
            return
        self._shown = drawing

        targets = drawing.trade_off.targets_db  # (S,)
        distances = drawing.trade_off.distances  # (S,)
        target = drawing.scene.target_db
        ends = [*targets[[0, -1]].tolist(), target] if len(targets) else [target]
        low = float(np.floor(min(ends) - 1))
        high = float(np.ceil(max(ends) + 1))
        self._x.update(start=low, end=high)
        if len(distances):
            margin = max(0.5, 0.08 * float(distances[-1] - distances[0]))
            least = float(np.floor(distances[0] - margin))
            self._y.update(start=least, end=float(np.ceil(distances[-1] + margin)))

        # each step from the target before it to its own
        begins = np.concatenate([[low], targets[:-1]]) if len(targets) else targets
        fill(
            self._steps,
            {
                "x": np.stack([begins, targets], axis=1).ravel(),
                "y": np.repeat(distances, 2),
            },
        )
        fill(self._corners, {"x": targets, "y": distances})
        now = float(drawing.trade_off.distance_at(target))
        fill(self._now, {"x": [target], "y": [now]} if np.isfinite(now) else {"x": [], "y": []})
        self._target.location = target
        self._highest.update(
            location=float(targets[-1]) if len(targets) else low, visible=bool(len(targets))
        )
