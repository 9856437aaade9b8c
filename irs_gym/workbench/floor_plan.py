"""`FloorPlan`: the figure of the floor seen from above, made once and then only filled."""

from collections.abc import Callable
from importlib import resources
from typing import Any

import numpy as np
import shapely
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    CustomJSHover,
    FixedTicker,
    HoverTool,
    LinearColorMapper,
    Range1d,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from irs_gym.grid import Grid
from irs_gym.radio.scene import Scene
from irs_gym.rendering.background import COLOUR_MAP, OBSTACLE
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.drawing import Drawing
from irs_gym.workbench.handle import Handle, Point, footprint_of, place_of
from irs_gym.workbench.sources import fill, image, line, polygons, rings, shifted, source

SIDE = 540  # px, the longer side of the floor
_MARGIN = 0.035  # of it, around: marks on walls lie half outside the floor
_DARK = "#{:02x}{:02x}{:02x}".format(*OBSTACLE)
_HELD = "#ff8c00"
_START = "#ff8c00"
_GOAL = "#d7191c"
_REFUSED = "#d7191c"
_BELOW = "#ffffffa0"  # over cells below the target
_GAIN = "return isFinite(value) ? value.toFixed(2) + ' dB' : 'none: an obstacle'"
POLICY_COLOURS = ("#e7298a", "#00bfff", "#a65628", "#984ea3")


def palette() -> list[str]:
    """256 colours of the pictures' colour map."""
    at = np.linspace(0, len(COLOUR_MAP) - 1, 256)
    channels = [np.interp(at, range(len(COLOUR_MAP)), each) for each in COLOUR_MAP.T]
    return [
        "#{:02x}{:02x}{:02x}".format(*rgb) for rgb in np.rint(np.stack(channels, 1)).astype(int)
    ]


class FloorPlan:
    """The floor seen from above: radio map, cells below the target, parts, and paths."""

    def __init__(self, colours: dict[str, str], act: Callable[[str, Point], None]) -> None:
        self._shown: Drawing | None = None
        self._x = Range1d(0, 1)
        self._y = Range1d(0, 1)
        self.figure = fig = figure(
            x_range=self._x,
            y_range=self._y,
            tools="",
            toolbar_location=None,
            x_axis_label="x (m)",
            y_axis_label="y (m)",
            min_border=0,
            name="floor",
        )
        fig.grid.visible = False
        fig.outline_line_color = None

        self._add_maps()
        self._add_obstacles()
        self._add_paths(colours)
        self._add_marks()
        self._listen(act)

    # --- made once --------------------------------------------------------------------------------

    def _add_maps(self) -> None:
        fig = self.figure
        self._mapper = LinearColorMapper(palette(), low=-80, high=-40, nan_color=_DARK)
        self._gain = source("image", "x", "y", "dw", "dh")
        gain = fig.image(source=self._gain, color_mapper=self._mapper)
        self._below = source("image", "x", "y", "dw", "dh")
        fig.image(
            source=self._below,
            color_mapper=LinearColorMapper(["#ffffff00", _BELOW], low=0, high=1),
        )

        bar = ColorBar(
            color_mapper=self._mapper,
            title="expected channel gain (dB)",
            title_text_font_style="normal",
            title_text_font_size="12px",
            width=14,
            label_standoff=6,
            padding=8,
            ticker=FixedTicker(ticks=[]),
        )
        self._ticker = bar.ticker
        fig.add_layout(bar, "right")
        self._hover = HoverTool(
            renderers=[gain],
            tooltips=[("gain", "@image{custom}"), ("x, y", "$x{0.00}, $y{0.00} m")],
            formatters={"@image": CustomJSHover(code=_GAIN)},
            visible=False,
        )
        fig.add_tools(self._hover)

    def _add_obstacles(self) -> None:
        fig = self.figure
        self._room = source("xs", "ys")
        fig.multi_polygons(source=self._room, fill_color=None, line_color=_DARK, line_width=1.5)
        self._obstacles = source("xs", "ys")
        fig.multi_polygons(
            source=self._obstacles, fill_color=_DARK, line_color="#bebec4", line_width=1.5
        )
        self._held = source("xs", "ys")
        fig.multi_polygons(
            source=self._held, fill_color=_HELD, fill_alpha=0.25, line_color=_HELD, line_width=2.5
        )
        self._refused = source("xs", "ys")
        fig.multi_polygons(
            source=self._refused,
            fill_color=_REFUSED,
            fill_alpha=0.15,
            line_color=_REFUSED,
            line_width=2.5,
            line_dash="dashed",
        )

    def _add_paths(self, colours: dict[str, str]) -> None:
        fig = self.figure
        self._path = source("x", "y")
        fig.line("x", "y", source=self._path, line_color="white", line_width=6, line_cap="round")
        fig.line("x", "y", source=self._path, line_color="black", line_width=3, line_cap="round")

        self._policies = {name: source("x", "y") for name in colours}
        for name, each in self._policies.items():
            fig.line(
                "x", "y", source=each, line_color=colours[name], line_width=2.5, line_dash=[7, 4]
            )

    def _add_marks(self) -> None:
        fig = self.figure
        self._ring = source("x", "y", "colour")
        fig.scatter(
            "x", "y", source=self._ring, size=30, fill_color=None, line_color="colour", line_width=3
        )
        self._panels = source("x", "y", "angle")
        for colour, width, size in (("white", 12, 34), ("#c51b8a", 8, 30)):
            fig.scatter(
                "x",
                "y",
                angle="angle",
                source=self._panels,
                marker="dash",
                size=size,
                line_color=colour,
                line_width=width,
            )
        self._marks = source("x", "y", "marker", "colour")
        fig.scatter(
            "x",
            "y",
            marker="marker",
            source=self._marks,
            size=17,
            fill_color="colour",
            line_color="white",
            line_width=2,
        )
        self._names = source("x", "y", "text", "align", "dx", "dy")
        fig.text(
            "x",
            "y",
            text="text",
            source=self._names,
            x_offset="dx",
            y_offset="dy",
            text_align="align",
            text_baseline="middle",
            text_font_size="13px",
            text_font_style="bold",
            background_fill_color="white",
            background_fill_alpha=0.75,
            padding=2,
        )

    def _listen(self, act: Callable[[str, Point], None]) -> None:
        """Call ``act`` with the name of what the pointer does and the point (x, y) in metres."""
        pointer = ColumnDataSource(name="pointer")
        drawn = ColumnDataSource({"count": [0]}, name="drawn")
        code = resources.files("irs_gym.workbench").joinpath("pointer.js").read_text("utf-8")
        hand_on = CustomJS(
            args={"pointer": pointer, "drawn": drawn, "hover": self._hover}, code=code
        )
        for event in ("panstart", "pan", "panend", "tap"):
            self.figure.js_on_event(event, hand_on)
        drawn.js_on_change("data", hand_on)

        def hear(attribute: str, old: Any, new: Any) -> None:
            try:
                act(new["act"][0], (float(new["x"][0]), float(new["y"][0])))
            finally:
                drawn.data = {"count": list(new["count"])}

        pointer.on_change("data", hear)

    # --- filled ----------------------------------------------------------------------------------

    def fit(self, scene: Scene) -> None:
        """Take the shape of the scene's room."""
        room = scene.room
        width = room.x_max - room.x_min
        height = room.y_max - room.y_min
        margin = _MARGIN * max(width, height)
        px = SIDE / max(width, height)
        self._x.update(start=room.x_min - margin, end=room.x_max + margin)
        self._y.update(start=room.y_min - margin, end=room.y_max + margin)
        self.figure.update(
            frame_width=round((width + 2 * margin) * px),
            frame_height=round((height + 2 * margin) * px),
        )

    def show(self, bench: Bench) -> None:
        """Draw what has changed."""
        before = self._shown
        drawing = bench.drawing
        grid = drawing.radio_map.grid

        if before is None or drawing.radio_map is not before.radio_map:
            self._show_gain(drawing)
        if before is None or drawing is not before:
            self._below.data = image(self._is_below(drawing).astype(np.uint8), grid)
            cells = drawing.path.cells if drawing.path else np.empty((0, 2), np.int64)
            fill(self._path, line(cells, grid))
            self._show_parts(bench.scene, has_panels=bool(drawing.scene.irs_panels))

        self._shown = drawing
        self._show_hand(bench)

    def show_policy(self, name: str, cells: NDArray[np.int64] | None, grid: Grid) -> None:
        """Draw a policy's path ``(D, 2)``, or none."""
        fill(self._policies[name], line(np.empty((0, 2)) if cells is None else cells, grid))

    @staticmethod
    def _is_below(drawing: Drawing) -> NDArray[np.bool_]:
        return ~drawing.feasible & drawing.radio_map.free

    def _show_gain(self, drawing: Drawing) -> None:
        gain = drawing.radio_map.gain_db
        shown = np.where(np.isfinite(gain), gain, np.nan).astype(np.float32)
        self._gain.data = image(shown, drawing.radio_map.grid)

        finite = gain[np.isfinite(gain)]
        if finite.size:
            low = 5 * np.floor(finite.min() / 5)
            high = 5 * np.ceil(finite.max() / 5)
            self._mapper.update(low=float(low), high=float(max(high, low + 5)))
            self._ticker.ticks = np.arange(low, high + 1, 5).tolist()

    def _show_parts(self, scene: Scene, *, has_panels: bool) -> None:
        room = scene.room
        floor = getattr(room, "shape", shapely.box(*room.lower, *room.upper))
        fill(self._room, polygons([rings(floor)]))
        fill(self._obstacles, polygons([rings(footprint_of(each)) for each in scene.obstacles]))

        panels = scene.irs_panels if has_panels else ()
        fill(
            self._panels,
            {
                "x": [each.position[0] for each in panels],
                "y": [each.position[1] for each in panels],
                "angle": [float(np.arctan2(*each.along_wall[1::-1])) for each in panels],
            },
        )
        aps = [each.position for each in scene.access_points]
        marks: list[tuple[Any, str, str]] = [
            (scene.start, "diamond", _START),
            (scene.goal, "square", _GOAL),
            *((point, "triangle", _DARK) for point in aps),
        ]
        fill(
            self._marks,
            {
                "x": [point[0] for point, _, _ in marks],
                "y": [point[1] for point, _, _ in marks],
                "marker": [marker for _, marker, _ in marks],
                "colour": [colour for _, _, colour in marks],
            },
        )
        names = [
            ("start", scene.start),
            ("goal", scene.goal),
            *_numbered("AP", aps),
            *_numbered("IRS", [each.position for each in panels]),
        ]
        fill(self._names, _beside(names, room))

    def _show_hand(self, bench: Bench) -> None:
        """Mark the part that is held, and where it cannot be."""
        held = bench.held
        outlines: list[Any] = []
        spots: list[tuple[Point, str]] = []
        refused: list[Any] = []

        if held is not None:
            outline, spot = _shape_of(bench.scene, held)
            outlines += outline
            spots += [(spot, _HELD)] if spot else []
        if held is not None and bench.grip is not None and bench.refused_by is not None:
            outline, spot = _shape_of(bench.grip.scene, held)
            by = bench.refused_by
            refused += [shifted(each, by) for each in outline]
            spots += [((spot[0] + by[0], spot[1] + by[1]), _REFUSED)] if spot else []

        fill(self._held, polygons(outlines))
        fill(self._refused, polygons(refused))
        fill(
            self._ring,
            {
                "x": [spot[0] for spot, _ in spots],
                "y": [spot[1] for spot, _ in spots],
                "colour": [colour for _, colour in spots],
            },
        )


def _shape_of(scene: Scene, handle: Handle) -> tuple[list[Any], Point | None]:
    """The outline of an obstacle, or the point of any other part."""
    if handle.kind == "obstacles":
        return [rings(footprint_of(scene.obstacles[handle.number]))], None
    return [], place_of(scene, handle)


def _numbered(name: str, points: list[Any]) -> list[tuple[str, Any]]:
    if len(points) == 1:
        return [(name, points[0])]
    return [(f"{name} {n}", point) for n, point in enumerate(points)]


def _beside(names: list[tuple[str, Any]], room: Any) -> dict[str, list[Any]]:
    """Names beside their points ``(x, y, ...)``, on the side that is inside the floor."""
    width = room.x_max - room.x_min
    height = room.y_max - room.y_min
    columns: dict[str, list[Any]] = {name: [] for name in ("x", "y", "text", "align", "dx", "dy")}

    for text, point in names:
        is_right = point[0] > room.x_max - 0.15 * width
        away = 22 if text.startswith("IRS") else 14  # px; a panel is wider than a mark
        is_low = point[1] < room.y_min + 0.03 * height
        is_high = point[1] > room.y_max - 0.03 * height
        columns["x"].append(point[0])
        columns["y"].append(point[1])
        columns["text"].append(text)
        columns["align"].append("right" if is_right else "left")
        columns["dx"].append(-away if is_right else away)
        columns["dy"].append(14 * (int(is_high) - int(is_low)))

    return columns
