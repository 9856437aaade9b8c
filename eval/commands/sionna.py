"""`python -m eval sionna`: the paper's room traced by Sionna RT, beside the statistical model's map
of it.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eval.markdown import picture, table, template
from eval.paper.claim import PATHS_AT_DB
from eval.paper.map_figures import draw_maps
from eval.paper.study import WITHOUT, Study
from eval.paper.traced import INSET_M, MATERIALS, trace
from irs_gym import Path as Route
from irs_gym import RadioMap, load_scene, shortest_path, trade_off
from irs_gym.files import write_file

CELL_SIZE = 0.5


def main(
    out: Path = Path("docs"),
    retrace: bool = True,
    samples: int = 10_000_000,
    depth: int = 6,
    seed: int = 1,
) -> int:
    """Trace the paper's room, save the map, and write a page with the oracle's path on it and on
    the model's map.

    Writes OUT/sionna.npz, OUT/sionna.json, OUT/sionna.md and OUT/figures/sionna.png, .svg and .csv.

    Parameters
    ----------
    out
        Folder of the page.
    retrace
        Trace anew, with sionna-rt; otherwise the map in OUT is used.
    samples
        Rays from the access point.
    depth
        Reflections of a ray.
    seed
        Seed of the rays.
    """
    study = Study(load_scene("paper"), CELL_SIZE)

    try:
        if retrace:
            trace_into(out, study, samples, depth, seed)

        radio_map = RadioMap.load(out / "sionna.npz")
        settings = json.loads((out / "sionna.json").read_text(encoding="utf-8"))
    except ModuleNotFoundError as error:
        remedy = 'pip install "irs_gym[sionna]", on Debian also libllvm19'
        print(f"python -m eval sionna: {error}: {remedy}", file=sys.stderr)
        return 2
    except (OSError, ValueError) as error:
        print(f"python -m eval sionna: {error}", file=sys.stderr)
        return 2

    write_page(study, radio_map, settings, out)
    print(f"written: {out / 'sionna.md'}, sionna.npz beside it, and {out / 'figures'}")

    return 0


def trace_into(out: Path, study: Study, samples: int, depth: int, seed: int) -> None:
    """Trace twice, by two seeds, and save the first map and how it was made."""
    traced, again = (
        trace(study.scene, study.cell_size, samples, depth, each) for each in (seed, seed + 1)
    )

    # The difference of two maps has twice the variance of one.
    both = traced.free & again.free
    noise_db = float(np.std(traced.gain_db[both] - again.gain_db[both]) / np.sqrt(2))
    settings = {
        "rays": samples,
        "reflections": depth,
        "seed": seed,
        "noise_db": noise_db,
        "sionna-rt": version("sionna-rt"),
    }

    out.mkdir(parents=True, exist_ok=True)
    traced.save(out / "sionna.npz")
    write_file(out / "sionna.json", (json.dumps(settings, indent=2) + "\n").encode())


def write_page(study: Study, traced: RadioMap, settings: dict[str, Any], out: Path) -> None:
    """Write OUT/sionna.md and its figure."""
    maps = {"statistical model": study.radio_map(WITHOUT), "traced by Sionna RT": traced}
    draw_maps(study, maps, _paths(study, maps), out / "figures", "sionna")
    write_file(out / "sionna.md", sionna_page(study, maps, settings).encode())


def sionna_page(study: Study, maps: dict[str, RadioMap], settings: dict[str, Any]) -> str:
    """The page: how the second map was traced, and how far the two are apart."""
    model, traced = maps.values()
    both = model.free & traced.free
    apart_db = traced.gain_db[both] - model.gain_db[both]  # (free cells,)
    materials = [f"{part} of {thick:g} m {name}" for part, (name, thick) in MATERIALS.items()]
    caption = f"Both maps on one scale, and the shortest path at {PATHS_AT_DB:g} dB on each."

    return template("sionna.md").format(
        version=settings["sionna-rt"],
        rays=settings["rays"],
        reflections=settings["reflections"],
        materials=", ".join(materials),
        inset_m=INSET_M,
        # of two maps with that noise each
        difference_db=settings["noise_db"] * np.sqrt(2),
        maps=_maps_table(study, maps),
        cells=np.count_nonzero(both),
        mean_db=apart_db.mean(),
        spread_db=apart_db.std(),
        picture=picture("sionna", caption),
        example=(
            "```python\n"
            "import gymnasium\n\n"
            'env = gymnasium.make("irs_gym:IrsNav-v0", radio_map="docs/sionna.npz", '
            f"start={study.start}, goal={study.goal}, target_db={PATHS_AT_DB})\n"
            "```"
        ),
    )


def _paths(study: Study, maps: dict[str, RadioMap]) -> dict[str, Route]:
    """The shortest path on each map that has one."""
    paths = {}

    for title, each in maps.items():
        path = shortest_path(each.feasible(PATHS_AT_DB), study.start, study.goal, CELL_SIZE)
        if path is not None:
            paths[title] = path

    return paths


def _maps_table(study: Study, maps: dict[str, RadioMap]) -> str:
    """Gains and distances on each map."""
    header = (
        "map",
        "mean gain (dB)",
        "feasible up to (dB)",
        f"distance at {PATHS_AT_DB:g} dB (m)",
        "all steps",
    )
    rows = []

    for title, each in maps.items():
        curve = trade_off(each.gain_db, study.start, study.goal, CELL_SIZE)
        steps = zip(curve.targets_db, curve.distances, strict=True)
        rows.append(
            (
                title,
                f"{each.gain_db[each.free].mean():.2f}",
                f"{max(curve.targets_db, default=-np.inf):.2f}",
                f"{curve.distance_at(PATHS_AT_DB):.3f}",
                "; ".join(f"{length:.2f} m to {target:.2f} dB" for target, length in steps),
            )
        )

    return table(header, rows)
