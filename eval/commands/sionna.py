"""`python -m eval sionna`: the paper's room traced by Sionna RT, beside the statistical model's map
of it.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eval.markdown import page, picture, table
from eval.paper.claim import PATHS_AT_DB
from eval.paper.map_figures import draw_maps
from eval.paper.study import WITHOUT, Study
from eval.paper.traced import INSET_M, MATERIALS, trace
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
        print(
            f'python -m eval sionna: {error}: pip install "irs_gym[sionna]", on Debian also libllvm19',
            file=sys.stderr,
        )
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
    both = traced.free & again.free
    noise_db = float(np.std(traced.gain_db[both] - again.gain_db[both]) / np.sqrt(2))
    settings = {"rays": samples, "reflections": depth, "seed": seed, "noise_db": noise_db}
    settings["sionna-rt"] = version("sionna-rt")
    out.mkdir(parents=True, exist_ok=True)
    traced.save(out / "sionna.npz")
    write_file(out / "sionna.json", (json.dumps(settings, indent=2) + "\n").encode())


def write_page(study: Study, traced: RadioMap, settings: dict[str, Any], out: Path) -> None:
    """Write OUT/sionna.md and its figure."""
    model = study.radio_map(WITHOUT)
    ends = (study.start, study.goal)
    maps = {"statistical model": model, "traced by Sionna RT": traced}
    paths = {
        title: shortest_path(each.feasible(PATHS_AT_DB), *ends, CELL_SIZE)
        for title, each in maps.items()
    }
    found = {title: path for title, path in paths.items() if path is not None}
    draw_maps(study, maps, found, out / "figures", "sionna")
    curves = {title: trade_off(each.gain_db, *ends, CELL_SIZE) for title, each in maps.items()}
    rows = [
        (
            title,
            f"{maps[title].gain_db[maps[title].free].mean():.2f}",
            f"{max(curve.targets_db, default=-np.inf):.2f}",
            f"{curve.distance_at(PATHS_AT_DB):.3f}",
            "; ".join(f"{length:.2f} m to {target:.2f} dB" for target, length in zip(
                curve.targets_db, curve.distances, strict=True)),
        )
        for title, curve in curves.items()
    ]  # fmt: skip
    both = model.free & traced.free
    apart = traced.gain_db[both] - model.gain_db[both]
    header = (
        "map",
        "mean gain (dB)",
        "feasible up to (dB)",
        f"distance at {PATHS_AT_DB:g} dB (m)",
        "all steps",
    )
    materials = ", ".join(
        f"{part} of {thickness:g} m {name}" for part, (name, thickness) in MATERIALS.items()
    )
    text = page(
        "# A ray tracer in place of the model",
        "`irs_gym.from_sionna` takes the path-gain map of [Sionna RT](https://nvlabs.github.io/sionna/rt/), so that "
        "the environment, the oracle and the trade-off run on traced maps. `python -m eval sionna` traces the paper's "
        "room, without IRS (Sionna RT 2 has none), from meshes that it writes itself, and puts the map beside that of "
        "the statistical model.",
        f"Sionna RT {settings['sionna-rt']}, {settings['rays']:,} rays, up to {settings['reflections']} reflections, "
        f"one diffraction; {materials}; isotropic antennas. The access point hangs on a wall, and rays cannot start "
        f"within one, so it is moved {INSET_M:g} m into the room. Of another seed, a cell's gain differs by "
        f"{settings['noise_db'] * np.sqrt(2):.2f} dB (root mean square).",
        table(header, rows),
        f"Over the {np.count_nonzero(both):,} free cells the traced gain lies {apart.mean():+.2f} dB from the model's "
        f"on average, with a standard deviation of {apart.std():.2f} dB: the room reflects, and the shadows behind "
        "metal boxes are of all depths, where the model has one law for all.",
        picture(
            "sionna",
            f"Both maps on one scale, and the shortest path at {PATHS_AT_DB:g} dB on each.",
        ),
        "The saved map is an environment:",
        "```python\n"
        "import gymnasium\n\n"
        f'env = gymnasium.make("irs_gym:IrsNav-v0", radio_map="docs/sionna.npz", start={study.start}, '
        f"goal={study.goal}, target_db={PATHS_AT_DB})\n"
        "```",
        "On Debian 12, Sionna's LLVM backend needs `apt-get install libllvm19` and "
        "`DRJIT_LIBLLVM_PATH=/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1`; LLVM 14 and 15 abort on processors with "
        "AVX-512.",
    )
    write_file(out / "sionna.md", text.encode())
