"""`FloorPlan` and `Curve`: Bokeh's figures of the workbench, made once and then only filled."""

from collections.abc import Callable
from importlib import resources
from typing import Any

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    FixedTicker,
    HoverTool,
    LinearColorMapper,
    Range1d,
    Span,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from irs_gym.grid import Grid
from irs_gym.radio.scene import Scene
from irs_gym.rendering.background import COLOUR_MAP, OBSTACLE
from irs_gym.workbench.bench import Bench
from irs_gym.workbench.drawing import Drawing
from irs_gym.workbench.handle import Handle, Point, footprint_of, place_of

SIDE = 560  # px, the longer side of the floor
_MARGIN = 0.035  # of it, around: marks on walls lie half outside the floor
_CURVE = (380, 250)  # px
_DARK = "#{:02x}{:02x}{:02x}".format(*OBSTACLE)
_HELD = "#ff8c00"
_REFUSED = "#d7191c"
_BELOW = "#ffffffa0"  # over cells below the target
POLICY_COLOURS = ("#e7298a", "#00bfff", "#a65628", "#984ea3")

Rings = list[list[list[float]]]


def palette() -> list[str]:
    """256 colours of the pictures' colour map."""
    at = np.linspace(0, len(COLOUR_MAP) - 1, 256)
    channels = [np.interp(at, range(len(COLOUR_MAP)), each) for each in COLOUR_MAP.T]
    return [
        "#{:02x}{:02x}{:02x}".format(*rgb) for rgb in np.rint(np.stack(channels, 1)).astype(int)
    ]


class FloorPlan:
    """The floor seen from above: radio map, cells below the target, parts, and paths."""

    def __init__(self, policies: tuple[str, ...], act: Callable[[str, Point], None]) -> None:
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
        self._add_paths(policies)
        self._add_marks()
        self._listen(act)

    # --- made once --------------------------------------------------------------------------------

    def _add_maps(self) -> None:
        fig = self.figure
        self._mapper = LinearColorMapper(palette(), low=-80, high=-40, nan_color=_DARK)
        self._gain = _source("image", "x", "y", "dw", "dh")
        gain = fig.image(source=self._gain, color_mapper=self._mapper)
        self._below = _source("image", "x", "y", "dw", "dh")
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
        fig.add_tools(
            HoverTool(
                renderers=[gain],
                tooltips=[("gain", "@image{0.00} dB"), ("x, y", "$x{0.00}, $y{0.00} m")],
                visible=False,
            )
        )

    def _add_obstacles(self) -> None:
        fig = self.figure
        self._room = _source("xs", "ys")
        fig.multi_polygons(source=self._room, fill_color=None, line_color=_DARK, line_width=1.5)
        self._obstacles = _source("xs", "ys")
        fig.multi_polygons(
            source=self._obstacles, fill_color=_DARK, line_color="#bebec4", line_width=1.5
        )
        self._held = _source("xs", "ys")
        fig.multi_polygons(
            source=self._held, fill_color=_HELD, fill_alpha=0.25, line_color=_HELD, line_width=2.5
        )
        self._refused = _source("xs", "ys")
        fig.multi_polygons(
            source=self._refused,
            fill_color=_REFUSED,
            fill_alpha=0.15,
            line_color=_REFUSED,
            line_width=2.5,
            line_dash="dashed",
        )

    def _add_paths(self, policies: tuple[str, ...]) -> None:
        fig = self.figure
        self._path = _source("x", "y")
        fig.line("x", "y", source=self._path, line_color="white", line_width=6, line_cap="round")
        fig.line("x", "y", source=self._path, line_color="black", line_width=3, line_cap="round")

        self._policies = {name: _source("x", "y") for name in policies}
        for n, source in enumerate(self._policies.values()):
            colour = POLICY_COLOURS[n % len(POLICY_COLOURS)]
            fig.line("x", "y", source=source, line_color=colour, line_width=2.5, line_dash=[7, 4])

    def _add_marks(self) -> None:
        fig = self.figure
        self._ring = _source("x", "y", "colour")
        fig.scatter(
            "x", "y", source=self._ring, size=30, fill_color=None, line_color="colour", line_width=3
        )
        self._panels = _source("x", "y", "angle")
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
        self._marks = _source("x", "y", "marker", "colour")
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
        self._names = _source("x", "y", "text", "align", "dx", "dy")
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
        hand_on = CustomJS(args={"pointer": pointer, "drawn": drawn}, code=code)
        for event in ("panstart", "pan", "panend", "tap"):
            self.figure.js_on_event(event, hand_on)
        drawn.js_on_change("data", hand_on)

        def hear(attribute: str, old: Any, new: Any) -> None:
            try:
                act(new["act"][0], (float(new["x"][0]), float(new["y"][0])))
            finally:
                drawn.data = {"count": list(new["count"])}

        pointer.on_change("data", hear)
        self.pointer = pointer

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
            self._below.data = _image(self._is_below(drawing).astype(np.uint8), grid)
            cells = drawing.path.cells if drawing.path else np.empty((0, 2), np.int64)
            self._path.data = _line(cells, grid)
            self._show_parts(bench.scene, has_panels=bool(drawing.scene.irs_panels))

        self._shown = drawing
        self._show_hand(bench)

    def show_policy(self, name: str, cells: NDArray[np.int64] | None, grid: Grid) -> None:
        """Draw a policy's path ``(D, 2)``, or none."""
        self._policies[name].data = _line(np.empty((0, 2)) if cells is None else cells, grid)

    @staticmethod
    def _is_below(drawing: Drawing) -> NDArray[np.bool_]:
        return ~drawing.feasible & drawing.radio_map.free

    def _show_gain(self, drawing: Drawing) -> None:
        gain = drawing.radio_map.gain_db
        shown = np.where(np.isfinite(gain), gain, np.nan).astype(np.float32)
        self._gain.data = _image(shown, drawing.radio_map.grid)

        finite = gain[np.isfinite(gain)]
        if finite.size:
            low = 5 * np.floor(finite.min() / 5)
            high = 5 * np.ceil(finite.max() / 5)
            self._mapper.update(low=float(low), high=float(max(high, low + 5)))
            self._ticker.ticks = np.arange(low, high + 1, 5).tolist()

    def _show_parts(self, scene: Scene, *, has_panels: bool) -> None:
        footprints = [_rings(footprint_of(each)) for each in scene.obstacles]
        self._obstacles.data = _polygons(footprints)
        room = scene.room
        corners = [
            [(room.x_min, room.y_min), (room.x_max, room.y_min)],
            [(room.x_max, room.y_max), (room.x_min, room.y_max)],
        ]
        own = getattr(room, "shape", None)
        ring = [[list(point) for row in corners for point in row]] if own is None else None
        self._room.data = _polygons([[ring] if ring else _rings(own)])

        panels = scene.irs_panels if has_panels else ()
        self._panels.data = {
            "x": [each.position[0] for each in panels],
            "y": [each.position[1] for each in panels],
            "angle": [float(np.arctan2(*each.along_wall[1::-1])) for each in panels],
        }
        ends = [(scene.start, "diamond", "#ff8c00"), (scene.goal, "square", "#d7191c")]
        points = [
            *ends,
            *((each.position[:2], "triangle", "#1f1f23") for each in scene.access_points),
        ]
        self._marks.data = {
            "x": [point[0] for point, _, _ in points],
            "y": [point[1] for point, _, _ in points],
            "marker": [marker for _, marker, _ in points],
            "colour": [colour for _, _, colour in points],
        }
        named = [
            ("start", scene.start),
            ("goal", scene.goal),
            *_numbered("AP", [each.position for each in scene.access_points]),
            *_numbered("IRS", [each.position for each in panels]),
        ]
        self._names.data = self._names_of(scene, named)

    @staticmethod
    def _names_of(scene: Scene, named: list[tuple[str, Any]]) -> dict[str, list[Any]]:
        """Names beside their points, on the side that is inside the floor."""
        room = scene.room
        right = [point[0] > room.x_max - 0.15 * (room.x_max - room.x_min) for _, point in named]
        across = [-1 if is_right else 1 for is_right in right]
        return {
            "x": [point[0] for _, point in named],
            "y": [point[1] for _, point in named],
            "text": [text for text, _ in named],
            "align": ["right" if is_right else "left" for is_right in right],
            "dx": [
                (22 if text.startswith("IRS") else 14) * n
                for n, (text, _) in zip(across, named, strict=True)
            ],
            "dy": [
                -14
                if point[1] < room.y_min + 0.03 * (room.y_max - room.y_min)
                else 14
                if point[1] > room.y_max - 0.03 * (room.y_max - room.y_min)
                else 0
                for _, point in named
            ],
        }

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
            refused += [
                [[_shifted(ring, by) for ring in part] for part in each] for each in outline
            ]
            spots += [((spot[0] + by[0], spot[1] + by[1]), _REFUSED)] if spot else []

        self._held.data = _polygons(outlines)
        self._refused.data = _polygons(refused)
        self._ring.data = {
            "x": [spot[0] for spot, _ in spots],
            "y": [spot[1] for spot, _ in spots],
            "colour": [colour for _, colour in spots],
        }


class Curve:
    """Shortest distance over the target, with the target that is set and the highest feasible."""

    def __init__(self) -> None:
        self._shown: Drawing | None = None
        self._x = Range1d(-70, -50)
        self._y = Range1d(0, 1)
        self.figure = fig = figure(
            x_range=self._x,
            y_range=self._y,
            frame_width=_CURVE[0] - 70,
            frame_height=_CURVE[1] - 50,
            tools="",
            toolbar_location=None,
            x_axis_label="target (dB)",
            y_axis_label="shortest distance (m)",
            name="curve",
        )
        fig.outline_line_color = None
        fig.grid.grid_line_alpha = 0.5

        self._steps = _source("x", "y")
        self._corners = _source("x", "y")
        self._now = _source("x", "y")
        self._highest = Span(
            dimension="height", line_color=_REFUSED, line_dash="dashed", line_width=2
        )
        self._target = Span(dimension="height", line_color="black", line_width=2)
        fig.add_layout(self._highest)
        fig.add_layout(self._target)
        fig.line("x", "y", source=self._steps, line_color="#26828e", line_width=3)
        fig.scatter("x", "y", source=self._corners, size=7, color="#26828e")
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
        self._steps.data = {
            "x": np.stack([begins, targets], axis=1).ravel(),
            "y": np.repeat(distances, 2),
        }
        self._corners.data = {"x": targets, "y": distances}
        now = float(drawing.trade_off.distance_at(target))
        self._now.data = {"x": [target], "y": [now]} if np.isfinite(now) else {"x": [], "y": []}
        self._target.location = target
        self._highest.update(
            location=float(targets[-1]) if len(targets) else low, visible=bool(len(targets))
        )


# --- data of sources ------------------------------------------------------------------------------


def _source(*columns: str) -> Any:
    return ColumnDataSource({name: [] for name in columns})


def _image(values: NDArray[Any], grid: Grid) -> dict[str, list[Any]]:
    """Values ``(X, Y)`` as an image over the floor, whose rows run along x, from below."""
    x, y = grid.origin
    return {
        "image": [np.ascontiguousarray(values.T)],
        "x": [x],
        "y": [y],
        "dw": [grid.upper[0] - x],
        "dh": [grid.upper[1] - y],
    }


def _line(cells: NDArray[Any], grid: Grid) -> dict[str, Any]:
    """The line through the centres of cells ``(D, 2)``."""
    return {
        "x": grid.origin[0] + (cells[:, 0] + 0.5) * grid.cell_size,
        "y": grid.origin[1] + (cells[:, 1] + 0.5) * grid.cell_size,
    }


def _rings(shape: Any) -> list[Rings]:
    """Rings of a polygon or polygons of ``shapely``: the outer one first, then the holes."""
    parts = getattr(shape, "geoms", [shape])
    return [
        [[list(point) for point in ring.coords] for ring in (part.exterior, *part.interiors)]
        for part in parts
    ]


def _polygons(shapes: list[Any]) -> dict[str, Any]:
    """Shapes, each a list of polygons, each a list of rings, as Bokeh's ``multi_polygons``."""
    return {
        name: [
            [[[point[axis] for point in ring] for ring in part] for part in each] for each in shapes
        ]
        for axis, name in enumerate(("xs", "ys"))
    }


def _shape_of(scene: Scene, handle: Handle) -> tuple[list[Any], Point | None]:
    """The outline of an obstacle, or the point of any other part."""
    if handle.kind == "obstacles":
        return [_rings(footprint_of(scene.obstacles[handle.number]))], None
    return [], place_of(scene, handle)


def _shifted(ring: list[list[float]], by: Point) -> list[list[float]]:
    return [[x + by[0], y + by[1]] for x, y in ring]


def _numbered(name: str, points: list[Any]) -> list[tuple[str, Any]]:
    if len(points) == 1:
        return [(name, points[0])]
    return [(f"{name} {n}", point) for n, point in enumerate(points)]
