"""`draw_path_overlay`: paths of policies over the radio map, as a PNG."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from agents.rollout.episode import EpisodeResult
from eval.pictures import add_legend, as_png
from irs_gym.mdp.codebook_rules import CodebookMaps, reach_world
from irs_gym.mdp.task import World
from irs_gym.rendering.episode_view import room_grid

BROAD: dict[str, Any] = {"color": "white", "linewidth": 5.0, "linestyle": "-"}
COLOURS = ("tab:orange", "tab:red", "tab:cyan", "magenta", "lime")
DASHES = ("--", ":", "-.")
RIM: list[patheffects.AbstractPathEffect] = [
    patheffects.withStroke(linewidth=7.0, foreground="black")
]


def draw_path_overlay(
    world: World, paths: Mapping[str, EpisodeResult], dpi: int = 150, *, in_palette: bool = False
) -> bytes:
    """A picture of the map, the obstacles, the cells below the target, and paths, each with its
    length.

    The first path is drawn broadest, so that the others show on it. ``dpi`` and ``in_palette`` are
    those of `as_png`.
    """
    figure = Figure(figsize=(8.0, 6.6), layout="constrained")
    axes = figure.add_subplot()
    image = draw_feasible_map(axes, world)

    # the target as a line over the scale
    bar = figure.colorbar(image, ax=axes, label="expected channel gain (dB)")
    bar.ax.axhline(world.target_db, color="white", linewidth=4)
    bar.ax.axhline(world.target_db, color="black", linewidth=1.5)

    for n, (name, episode) in enumerate(paths.items()):
        points = episode.path  # (T, 2)
        if points.dtype.kind == "i":  # cells
            points = world.radio_map.grid.centres()[tuple(points.T)]
        failure = "" if episode.is_success else ", goal not reached"
        label = f"{name}: {episode.distance:.3f} m{failure}"
        line = axes.plot(*points.T, label=label, solid_capstyle="round", **_style(n))[0]
        if n == 0:
            line.set_path_effects(RIM)

        places = world.radio_map.grid.centres()[tuple(episode.switch_cells.T)]  # (switches, 2)
        if len(places):
            axes.plot(
                *places.T,
                "X",
                color=line.get_color(),
                markeredgecolor="black",
                markersize=12 - 2 * n,
                zorder=3,
                label=f"{name}: {len(places)} switches",
            )

    draw_ends(axes, world)

    handles, _ = axes.get_legend_handles_labels()
    handles += [
        Patch(facecolor="black", label="obstacle"),
        Patch(facecolor="0.8", edgecolor="0.35", hatch="////", label="below the target"),
    ]
    add_legend(figure, handles)
    axes.set(title=_title(world), xlabel="x (m)", ylabel="y (m)")

    return as_png(figure, dpi, in_palette=in_palette)


def map_of(env: Any) -> World:
    """The map that paths in an environment are drawn over: where the panel is switched, of all that
    its configurations reach.
    """
    robot = env.unwrapped
    maps = getattr(robot, "maps", None)
    return reach_world(maps, 0) if isinstance(maps, CodebookMaps) else robot.world


def _style(n: int) -> dict[str, Any]:
    """Colour and dashes of path n: all but the second have gaps, through which others show; 15 look
    different.
    """
    if n == 0:
        return BROAD
    return {
        "color": COLOURS[(n - 1) % 5],
        "linestyle": DASHES[n % 3] if n > 1 else "-",
        "linewidth": 2.2,
    }


def draw_feasible_map(axes: Axes, world: World) -> AxesImage:
    """Gain in colour, obstacles in black, cells below the target pale and hatched."""
    grid = room_grid(world.scene, world.radio_map.grid)
    (left, bottom), (right, top) = grid.origin, grid.upper
    own = (slice(grid.shape[0]), slice(grid.shape[1]))
    free = world.radio_map.free[own]

    # What is not free is not drawn: there the axes are seen. imshow takes rows first, so y first.
    gain_db = np.where(free, world.radio_map.gain_db[own], np.nan)  # (X, Y)
    image = axes.imshow(gain_db.T, origin="lower", extent=(left, right, bottom, top))
    axes.set_facecolor("black")

    below = np.argwhere(free & ~world.feasible[own])  # (n, 2)
    if len(below):  # one shape of all squares, so that the hatching runs through
        corners = [grid.origin + cell * grid.cell_size for cell in below]
        squares = [
            Path.unit_rectangle().transformed(Affine2D().scale(grid.cell_size).translate(*at))
            for at in corners
        ]
        shape = Path.make_compound_path(*squares)
        axes.add_patch(
            PathPatch(shape, facecolor=(1, 1, 1, 0.55), edgecolor="0.35", hatch="////", linewidth=0)
        )

    return image


def draw_ends(axes: Axes, world: World, size: float = 10.0) -> None:
    """Start and goal, access points and panels; the last two are not known for a map from
    elsewhere.
    """
    grid = world.radio_map.grid
    marks = [
        ("start", "D", "white", [grid.centre(world.start)]),
        ("goal", "s", "white", [grid.centre(world.goal)]),
    ]
    if world.scene is not None:
        access_points = [each.position[:2] for each in world.scene.access_points]
        panels = [each.position[:2] for each in world.scene.irs_panels]
        marks += [
            ("access point", "^", "tab:red", access_points),
            ("IRS", "P", "tab:cyan", panels),
        ]

    for label, marker, colour, points in marks:
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(
                x,
                y,
                marker,
                color=colour,
                markeredgecolor="black",
                markersize=size,
                label=label,
                clip_on=False,
            )


def _title(world: World) -> str:
    task = world.task
    if world.scene is None:
        radio = "given map"
    elif not world.scene.irs_panels:
        radio = f"scene {world.scene.name!r} without IRS"
    else:
        phases = "continuous phases"
        if task.phase_bits is not None:
            phases = f"{task.phase_bits}-bit phases ({task.quantiser})"

        radio = f"scene {world.scene.name!r} with IRS, {phases}"

    return f"{radio}, target {world.target_db:g} dB"
