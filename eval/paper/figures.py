"""`save`: a figure as PNG and SVG with its data as CSV beside it, and what all figures share."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import matplotlib
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path as Outline

from irs_gym import Scene
from irs_gym.files import write_file

# Told apart by lightness and dashes alone, so that they survive a grey print.
LINES: dict[str, dict[str, Any]] = {
    "without IRS": {"color": "#000000", "linestyle": "--", "linewidth": 1.4, "marker": "o"},
    "1 bit": {"color": "#e08214", "linestyle": "-", "linewidth": 2.2, "marker": "s"},
    "2 bit": {"color": "#b8ddb0", "linestyle": "-", "linewidth": 3.2, "marker": "^"},
    "3 bit": {"color": "#762a83", "linestyle": "-.", "linewidth": 1.6, "marker": "v"},
    "continuous": {"color": "#08306b", "linestyle": ":", "linewidth": 2.0, "marker": "D"},
}
# The ends of the way in white, what is mounted in black.
_END: dict[str, Any] = {"color": "white", "markeredgecolor": "black", "linestyle": "none"}
_MOUNTED: dict[str, Any] = {"color": "black", "markeredgecolor": "white", "linestyle": "none"}
START = {"marker": "D", "markersize": 9, **_END}
GOAL = {"marker": "s", "markersize": 9, **_END}
ACCESS_POINT = {"marker": "^", "markersize": 11, **_MOUNTED}
PANEL = {"marker": "s", "markersize": 10, **_MOUNTED}
OBSTACLE: dict[str, Any] = {
    "facecolor": "#d9d9d9",
    "edgecolor": "#666666",
    "hatch": "////",
    "linewidth": 0.8,
}

STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.grid": False,
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "svg.hashsalt": "irs_gym",  # the same file for the same data
    "svg.fonttype": "path",
    "legend.framealpha": 0.95,
    "hatch.linewidth": 0.6,
}


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """An empty figure of so many inches, in the style of all."""
    # from the defaults on, so that no matplotlibrc of the user changes a figure
    settings = {**matplotlib.rcParamsDefault, "backend": matplotlib.get_backend(), **STYLE}
    with matplotlib.rc_context(settings):
        yield Figure(figsize=(width, height), layout="constrained")


def save(
    figure: Figure, folder: Path, name: str, header: Sequence[str], rows: Iterable[Sequence[Any]]
) -> None:
    """Write ``name.png``, ``name.svg`` and ``name.csv`` into a folder, each as a whole."""
    folder.mkdir(parents=True, exist_ok=True)

    # Neither dates nor versions, so that nothing but the data changes a file.
    for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None, "Creator": None})):
        picture = BytesIO()
        figure.savefig(picture, format=suffix, metadata=metadata)
        write_file(folder / f"{name}.{suffix}", picture.getvalue())

    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(
        [f"{value:.9g}" if isinstance(value, float) else value for value in row] for row in rows
    )
    write_file(folder / f"{name}.csv", text.getvalue().encode())


def minus(number: float) -> str:
    """The number with the minus sign of the axes."""
    return f"{number:g}".replace("-", "\N{MINUS SIGN}")


def _outline(shape: Any) -> Outline:
    """The rings of a ``shapely`` area as one path, each closed."""
    polygons = shapely.get_parts(shape)
    rings = [ring for each in polygons for ring in (each.exterior, *each.interiors)]
    return Outline.make_compound_path(*(Outline(ring.coords[:], closed=True) for ring in rings))


def draw_floor(axes: Axes, scene: Scene) -> None:
    """Room, obstacles, access points, panels, start and goal, seen from above."""
    room = scene.room

    boxes = scene.floor.boxes
    corners = zip(boxes.lower.tolist(), (boxes.upper - boxes.lower).tolist(), strict=True)
    patches: list[Patch] = [
        Rectangle((x, y), width, depth, zorder=2, **OBSTACLE)
        for (x, y, _), (width, depth, _) in corners
    ]
    patches += [
        PathPatch(_outline(shape), zorder=2, **OBSTACLE)
        for shape in scene.floor.footprints[len(boxes.lower) :]
    ]
    for patch in patches:
        axes.add_patch(patch)
    if patches:
        patches[0].set_label("obstacle")  # once in the legend

    if scene.floor.room is not None:
        axes.add_patch(PathPatch(_outline(scene.floor.room), zorder=3, fill=False))

    for style, points, label in (
        (ACCESS_POINT, [each.position for each in scene.access_points], "AP"),
        (PANEL, [each.position for each in scene.irs_panels], "IRS"),
        (START, [scene.start], "start"),
        (GOAL, [scene.goal], "goal"),
    ):
        if points:
            x = [point[0] for point in points]
            y = [point[1] for point in points]
            axes.plot(x, y, label=label, zorder=5, clip_on=False, **style)

    axes.set(
        xlim=(room.x_min, room.x_max),
        ylim=(room.y_min, room.y_max),
        aspect="equal",
        xlabel="x (m)",
        ylabel="y (m)",
    )
