"""`python -m eval scenes`: writes docs/scenes.md, the scenes of the package and what scenes may be
made of.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from eval.markdown import page, table, template, template_sections
from eval.pictures import write_pictures
from irs_gym.files import write_file
from irs_gym.mdp.task import Task, World, build_world
from irs_gym.oracle.shortest_path import highest_feasible_target, shortest_path
from irs_gym.radio.path_loss import PRESETS, MultiWall, PathLoss, PathLossCoefficients
from irs_gym.radio.radio_map import build_radio_map
from irs_gym.radio.scene import Scene, load_scene, scene_names
from irs_gym.rendering import draw_frame
from irs_gym.rendering.episode_view import view_of

PAGE = "scenes.md"
FIGURES = "figures/scenes"
ORDER = ("paper", "workshop", "ward", "warehouse")
SIDE = 200.0  # metres: of the hall whose map is timed
KINDS = {"boxes": 1000, "polygons": 1000, "a raster": 1}
RASTER_CELLS = 400
PICTURE_SIZE = 720  # px


def main(out: Path = Path("docs")) -> int:
    """Draw the scenes of the package, time maps past a thousand obstacles, and write scenes.md.

    Parameters
    ----------
    out
        Folder of the page.
    """
    try:
        worlds = {name: build_world(Task(scene=name)) for name in sorted(scene_names(), key=_place)}
        write_pictures(
            out / FIGURES, {f"{name}.png": picture(world) for name, world in worlds.items()}
        )
        write_file(out / PAGE, scenes_page(worlds).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval scenes: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / PAGE}")
    return 0


def scenes_page(worlds: Mapping[str, World]) -> str:
    """The page, with what is computed in its places."""
    load = os.getloadavg()[0]
    words = template_sections(PAGE)
    header = (
        "scene",
        "metres",
        "obstacles",
        "access points",
        "panels",
        "path loss",
        "target (dB)",
        "shortest (m)",
        "at the target (m)",
        "highest target (dB)",
        "without IRS (dB)",
    )
    first, *_ = template(PAGE).split("\n## ")
    top = first.format(
        scenes=len(worlds),
        cell_size=Task().cell_size,
        rows=table(header, [scene_row(name, world) for name, world in worlds.items()]),
    )
    each = [
        f"{words[name].strip()}\n\n![{name}]({FIGURES}/{name}.png)"
        for name in worlds
        if name in words
    ]
    timed = {kind: time_map(kind) for kind in KINDS}
    rows = [
        (f"{KINDS[kind]:,} {kind}" if kind != "a raster" else _RASTER, *_figures(found))
        for kind, found in timed.items()
    ]
    sight = words["Obstacles of any shape"].format(
        cells=next(iter(timed.values()))["cells"],
        load=load,
        line_of_sight=table(("past", "free cells", "seconds", "memory (MiB)"), rows),
    )
    presets = words["Path loss by name"].format(
        presets=table(("name", "with line of sight (dB)", "without, the greatest of"), _presets())
    )

    return page(top, *each, sight, presets)


def scene_row(name: str, world: World) -> tuple[str, ...]:
    """What a scene is, and what its target makes of the way through it."""
    scene = load_scene(name)
    radio_map = world.radio_map
    start, goal = world.start, world.goal
    without = build_radio_map(scene, irs_elements=0)
    lengths = [
        shortest_path(allowed, start, goal, radio_map.grid.cell_size)
        for allowed in (radio_map.free, world.feasible)
    ]
    sides = np.subtract(scene.room.upper, scene.room.lower)

    return (
        f"`{name}`",
        " x ".join(f"{side:g}" for side in sides),
        str(len(scene.obstacles)),
        str(len(scene.access_points)),
        ", ".join(f"{each.elements:,}" for each in scene.irs_panels),
        _model_name(scene.path_loss),
        f"{world.target_db:g}",
        *("-" if path is None else f"{path.distance:.3f}" for path in lengths),
        f"{highest_feasible_target(radio_map.gain_db, start, goal):.2f}",
        f"{highest_feasible_target(without.gain_db, start, goal):.2f}",
    )


def picture(world: World) -> bytes:
    """The scene with its map and the oracle's path, as a PNG."""
    view = replace(view_of(world, world.start, world.goal), size=PICTURE_SIZE)
    content = BytesIO()
    Image.fromarray(draw_frame(view, [world.start])).save(content, format="png", optimize=True)

    return content.getvalue()


def time_map(kind: str) -> dict[str, Any]:
    """Seconds and memory of a map past many obstacles, measured in a process of its own."""
    code = f"from eval.commands.scenes import timed; timed({kind!r})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)

    return found


def timed(kind: str) -> None:
    """Build the map of a hall with obstacles of a kind, and print what it took as JSON."""
    import resource
    from time import perf_counter

    scene = hall(kind)
    began = perf_counter()
    radio_map = build_radio_map(scene)
    seconds = perf_counter() - began
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KiB on Linux, bytes on a Mac
    print(
        json.dumps(
            {
                "cells": radio_map.gain_db.size,
                "free": int(radio_map.free.sum()),
                "seconds": seconds,
                "mebibytes": held / (2**20 if sys.platform == "darwin" else 2**10),
            }
        )
    )


def hall(kind: str) -> Scene:
    """A square hall with the paper's radio, full of obstacles at random places."""
    rng = np.random.default_rng(0)
    data = load_scene("paper").to_data()
    data |= {"format_version": 2, "name": "hall", "start": [0.25, 0.25]}
    data["goal"] = [SIDE - 0.25, SIDE - 0.25]
    data["room"] = {"x_min": 0.0, "x_max": SIDE, "y_min": 0.0, "y_max": SIDE, "height": 8.0}
    data["access_points"] = [{"position": [SIDE / 2, SIDE, 7.0]}]
    data["irs_panels"][0]["position"] = [SIDE / 2, 0.0, 4.0]
    data["obstacles"] = (
        [_raster(rng)] if kind == "a raster" else [_block(rng, kind) for _ in range(KINDS[kind])]
    )

    return Scene.from_data(data)


def _block(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """A box of half a metre to 4 m, or the same at any angle as a polygon; none at the ends."""
    centre = rng.uniform(8.0, SIDE - 8.0, 2)
    width, depth, height = rng.uniform(0.5, 4.0, 3).tolist()
    angle = rng.uniform(0.0, np.pi)
    if kind == "boxes":
        return {"center": centre.tolist(), "size": [width, depth, height]}

    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (width / 2, depth / 2)
    return {"polygon": (corners @ turn.T + centre).tolist(), "height": height}


def _raster(rng: np.random.Generator) -> dict[str, Any]:
    """Cells over the whole hall, one in twelve blocked; none at the ends."""
    is_filled = rng.random((RASTER_CELLS, RASTER_CELLS)) < 1 / 12
    is_filled[:4, :] = False
    is_filled[-4:, :] = False
    rows = ["".join("#" if each else "." for each in row) for row in is_filled]

    return {"origin": [0.0, 0.0], "cell_size": SIDE / RASTER_CELLS, "rows": rows, "height": 3.0}


_RASTER = f"a raster of {RASTER_CELLS} x {RASTER_CELLS} cells"


def _figures(found: dict[str, Any]) -> tuple[str, ...]:
    return f"{found['free']:,}", f"{found['seconds']:.1f}", f"{found['mebibytes']:.0f}"


def _presets() -> list[tuple[str, str, str]]:
    return [
        (name, _formula(with_sight), "; ".join(map(_formula, (with_sight, *without))))
        for name, (with_sight, without) in PRESETS.items()
    ]


def _formula(each: PathLossCoefficients) -> str:
    return (
        f"{each.intercept_db:.2f} + {each.distance_slope_db:g} log d "
        f"+ {each.frequency_slope_db:g} log f"
    )


def _model_name(model: Any) -> str:
    if isinstance(model, MultiWall):
        return f"{model.wall_loss_db:g} dB a wall"
    return "coefficients" if isinstance(model, PathLoss) else str(model)


def _place(name: str) -> tuple[int, str]:
    """Where a scene stands on the page: the older ones first."""
    return (ORDER.index(name) if name in ORDER else len(ORDER)), name
