"""Figures over the floor: the scene (the paper's Fig. 2), gain maps (Fig. 3), paths (Fig. 4) and
beyond.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from eval.paper.claim import PATHS_AT_DB
from eval.paper.figures import (
    ACCESS_POINT,
    GOAL,
    LINES,
    OBSTACLE,
    PANEL,
    START,
    draw_floor,
    minus,
    new_figure,
    save,
)
from eval.paper.study import CONTINUOUS, ONE_BIT, WITHOUT, Study
from irs_gym import Path as Route
from irs_gym import RadioMap, Scene
from irs_gym.radio.scene import IrsPanel, Obstacle
from irs_gym.units import Floats, wavelength_m

# Of a box's 8 corners, the bits of whose numbers are x, y and z: x low, x high, y low, y high ...
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def draw_scene(study: Study, folder: Path) -> None:
    """The scene in three dimensions: the paper's Fig. 2."""
    scene = study.scene

    with new_figure(7, 5) as figure:
        axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
        _draw_boxes(axes, scene)
        _draw_panels(axes, scene)
        _draw_marks(axes, scene)
        _frame_room(axes, scene)
        axes.legend(loc="upper right")
        header = ("part", "x_m", "y_m", "z_m", "size_x_m", "size_y_m", "size_z_m")
        save(figure, folder, "scene", header, _parts(scene))


def _draw_boxes(axes: Any, scene: Scene) -> None:
    for box in scene.obstacles:
        ends = zip(box.lower, box.upper, strict=True)
        corners = np.array(np.meshgrid(*ends, indexing="ij")).reshape(3, 8).T  # (8, 3)
        faces = corners[np.array(FACES)]  # (6, 4, 3)
        axes.add_collection3d(
            Poly3DCollection(faces, facecolor="#bdbdbd", edgecolor="#404040", linewidth=0.7)
        )


def _draw_panels(axes: Any, scene: Scene) -> None:
    for panel in scene.irs_panels:
        outline = [_outline(panel, scene)]
        axes.add_collection3d(Poly3DCollection(outline, facecolor="black", edgecolor="black"))


def _draw_marks(axes: Any, scene: Scene) -> None:
    """Access points, panels, start and goal, each with a plumb line down to the floor."""
    height = scene.antenna_height
    marks = (
        (ACCESS_POINT, "AP", [each.position for each in scene.access_points]),
        (PANEL, "IRS", [each.position for each in scene.irs_panels]),
        (START, "start", [(*scene.start, height)]),
        (GOAL, "goal", [(*scene.goal, height)]),
    )

    for style, label, points in marks:
        axes.plot(*zip(*points, strict=True), label=label, zorder=9, **style)

        for point in points:
            line = zip(point, (*point[:2], 0.0), strict=True)
            axes.plot(*line, color="#404040", linewidth=0.8, linestyle=":")


def _frame_room(axes: Any, scene: Scene) -> None:
    """The room from a corner above; heights are drawn 1.6 times as long as widths."""
    room = scene.room
    width = room.x_max - room.x_min
    depth = room.y_max - room.y_min
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    axes.locator_params(nbins=5)
    axes.set(xlim=(room.x_min, room.x_max), ylim=(room.y_min, room.y_max), zlim=(0, room.height))
    axes.set_box_aspect((width, depth, 1.6 * room.height), zoom=1.05)
    axes.view_init(elev=32, azim=-58)


def _outline(panel: IrsPanel, scene: Scene) -> Floats:
    """Corners (4, 3) of a panel on its wall."""
    pitch_m = panel.pitch_wavelengths * wavelength_m(scene.carrier_ghz)
    per_column, per_row = panel.elements_per_subsurface

    # half of the panel along the wall and upwards, (3,) each
    along = panel.columns * per_column * pitch_m / 2 * panel.along_wall
    up = panel.rows * per_row * pitch_m / 2 * np.array([0.0, 0.0, 1.0])
    corners = np.array([-along - up, along - up, along + up, up - along])

    return np.asarray(np.array(panel.position) + corners)


def _parts(scene: Scene) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = [
        ("obstacle", *box.center, box.size[2] / 2, *box.size)
        for box in scene.obstacles
        if isinstance(box, Obstacle)
    ]
    rows += [("access point", *each.position, "", "", "") for each in scene.access_points]

    for panel in scene.irs_panels:
        low, high = _outline(panel, scene)[[0, 2]]
        rows.append(("IRS", *panel.position, *np.abs(high - low).tolist()))

    for name, point in (("start", scene.start), ("goal", scene.goal)):
        rows.append((name, *point, scene.antenna_height, "", "", ""))

    return rows


def draw_gain_maps(study: Study, folder: Path) -> None:
    """Gain without and with IRS on one scale: the paper's Fig. 3."""
    maps = {
        "without IRS": study.radio_map(WITHOUT),
        "with IRS, continuous phases": study.radio_map(CONTINUOUS),
    }
    draw_maps(study, maps, {}, folder, "gain_maps")


def draw_maps(
    study: Study, maps: dict[str, RadioMap], paths: dict[str, Route], folder: Path, name: str
) -> None:
    """Maps side by side on one scale, by their titles, each with the path of its title, if there is
    one.
    """
    scale = _scale(*(each.gain_db for each in maps.values()))
    steps = {title: np.zeros(each.grid.shape, dtype=int) for title, each in maps.items()}

    with new_figure(5 * len(maps), 4.8) as figure:
        panels = figure.subplots(1, len(maps), sharey=True)
        for axes, (title, radio_map) in zip(panels, maps.items(), strict=True):
            draw_cell_values(axes, radio_map, radio_map.gain_db, scale)
            has_irs = "with IRS" in title
            draw_floor(axes, study.scene if has_irs else study.scene.with_irs_elements(0))
            if title in paths:
                steps[title] = _draw_path(axes, radio_map, paths[title], "shortest path")

            axes.set(title=title, ylabel="" if axes is panels[-1] else "y (m)")

        _colour_bar(figure, panels, scale, "expected channel gain (dB)")
        add_floor_legend(figure, panels[-1])

        columns = {f"{_word(title)}_db": each.gain_db for title, each in maps.items()}
        columns |= {f"{_word(title)}_step_of_path": steps[title] for title in paths}
        save(figure, folder, name, *_cell_table(study, columns))


def _word(title: str) -> str:
    """A title as a column's name."""
    return title.split(",", maxsplit=1)[0].lower().replace(" ", "_")


def draw_paths(study: Study, folder: Path) -> None:
    """Shortest paths at one target: the paper's Fig. 4."""
    floor = study.radio_map(WITHOUT).grid.centres()
    rows = []

    with new_figure(6, 5.6) as figure:
        axes = figure.subplots()
        draw_floor(axes, study.scene)

        for scheme, width in ((ONE_BIT, 4.5), (CONTINUOUS, 1.8), (WITHOUT, 1.8)):
            path = study.path(scheme, PATHS_AT_DB)
            if path is None:
                continue

            x, y = floor[tuple(path.cells.T)].T
            style = LINES[scheme.name] | {"linewidth": width, "marker": ""}
            axes.plot(x, y, zorder=4, label=f"{scheme.name}, {path.distance:.2f} m", **style)
            cells = zip(path.cells.tolist(), x.tolist(), y.tolist(), strict=True)
            rows += [(scheme.name, n, *cell, *at) for n, (cell, *at) in enumerate(cells)]

        axes.set_title(f"target {minus(PATHS_AT_DB)} dB, M = {study.scene.irs_panels[0].elements}")
        add_floor_legend(figure, axes)
        save(figure, folder, "paths", ("scheme", "step", "i", "j", "x_m", "y_m"), rows)


def draw_optimal_gain(study: Study, folder: Path) -> None:
    """What the best levels gain over rounding, for 1 bit."""
    nearest, optimal = (
        study.radio_map(ONE_BIT, quantiser).gain_db for quantiser in ("nearest", "optimal")
    )

    # NaN in obstacles, where both are minus infinity and have no difference
    free = np.isfinite(nearest)
    raised = np.where(free, optimal - np.where(free, nearest, 0), np.nan)  # (X, Y)
    scale = Normalize(0, np.nanmax(raised))

    with new_figure(6.2, 5.2) as figure:
        axes = figure.subplots()
        draw_cell_values(axes, study.radio_map(ONE_BIT), raised, scale)
        draw_floor(axes, study.scene)
        _colour_bar(figure, axes, scale, "optimal over nearest levels, 1 bit (dB)")
        add_floor_legend(figure, axes)

        columns = {"nearest_db": nearest, "optimal_db": optimal}
        save(figure, folder, "optimal_quantiser", *_cell_table(study, columns))


def draw_own_scene(study: Study, target_db: float, folder: Path) -> None:
    """Map and path of a scene of any number of access points and panels."""
    radio_map = study.radio_map(CONTINUOUS)
    path = study.path(CONTINUOUS, target_db)
    scale = _scale(radio_map.gain_db)
    room = study.scene.room
    height = 9 * (room.y_max - room.y_min) / (room.x_max - room.x_min) + 0.6  # and the legend

    with new_figure(9, height) as figure:
        axes = figure.subplots()
        draw_cell_values(axes, radio_map, radio_map.gain_db, scale)
        draw_floor(axes, study.scene)

        label = f"shortest path at {minus(target_db)} dB"
        on_path = np.zeros(radio_map.grid.shape, dtype=int)
        if path is not None:
            on_path = _draw_path(axes, radio_map, path, f"{label}, {path.distance:.2f} m")

        _colour_bar(figure, axes, scale, "expected channel gain (dB)")
        add_floor_legend(figure, axes)
        columns = {"gain_db": radio_map.gain_db, "step_of_path": on_path}
        save(figure, folder, study.scene.name, *_cell_table(study, columns))


# --- parts ----------------------------------------------------------------------------------------


def draw_cell_values(axes: Axes, radio_map: RadioMap, values: Floats, scale: Normalize) -> None:
    """Values of the cells as colours; obstacle cells are left blank."""
    (left, bottom), (right, top) = radio_map.grid.origin, radio_map.grid.upper
    axes.imshow(
        np.ma.masked_invalid(values).T,  # imshow takes rows first: y, then x
        origin="lower",
        extent=(left, right, bottom, top),
        cmap="viridis",
        norm=scale,
        interpolation="nearest",
    )


def _draw_path(axes: Axes, radio_map: RadioMap, path: Route, label: str) -> NDArray[np.int64]:
    """Draw a path; returns the number of the step in which it visits each cell, from 1; 0 where it
    does not.
    """
    cells = tuple(path.cells.T)
    x, y = radio_map.grid.centres()[cells].T
    axes.plot(x, y, color="white", linewidth=4.5, zorder=3)
    axes.plot(x, y, color="black", linewidth=2, zorder=4, label=label)
    steps = np.zeros(radio_map.grid.shape, dtype=np.int64)
    steps[cells] = 1 + np.arange(len(path.cells))

    return steps


def _scale(*gains: Floats) -> Normalize:
    """From the lowest gain to the highest, cut where less than 1 % of the cells lie."""
    values = np.concatenate([gain[np.isfinite(gain)] for gain in gains])
    return Normalize(np.floor(values.min()), np.ceil(np.quantile(values, 0.99)))


def _colour_bar(figure: Figure, axes: Any, scale: Normalize, label: str) -> None:
    above = "max" if label.startswith("expected") else "neither"
    figure.colorbar(
        ScalarMappable(scale, "viridis"), ax=axes, label=label, shrink=0.9, extend=above
    )


def add_floor_legend(figure: Figure, axes: Axes) -> None:
    """A legend below the figure, of all that is labelled on one floor."""
    handles, labels = axes.get_legend_handles_labels()
    handles = [
        Patch(**OBSTACLE) if label == "obstacle" else handle
        for handle, label in zip(handles, labels, strict=True)
    ]
    columns = len(labels) if len(labels) <= 6 else -(-len(labels) // 2)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)


def _cell_table(
    study: Study, columns: dict[str, Floats]
) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """Header and rows, one a cell."""
    centres = study.scene.grid(study.cell_size).centres()
    cells = np.ndindex(centres.shape[:2])
    rows = [
        (*cell, *centres[cell].tolist(), *(each[cell].item() for each in columns.values()))
        for cell in cells
    ]

    return ("i", "j", "x_m", "y_m", *columns), rows
