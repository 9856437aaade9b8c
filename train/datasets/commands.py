"""`python -m train dataset` and `python -m train scenes`: data sets and scenes, as files."""

import os
import re
import sys
from pathlib import Path

from train.datasets.episodes import Source
from train.datasets.minari_dataset import NAMESPACE, write_dataset
from train.datasets.scenes import DESCRIPTIONS, write_scenes

NAME = re.compile(r"\w[\w-]*-v\d+")


def dataset(
    source: Source,
    name: str | None = None,
    out: Path | None = None,
    progress: bool = True,
) -> int:
    """Collect a Minari data set of labelled episodes, with Croissant metadata.

    Each step has exact labels among its infos: optimal_actions (8,), distance_to_go in metres, and
    the regret of the step before in metres. The same settings and seed give the same data set; one
    that was interrupted goes on.

    Parameters
    ----------
    source
        Where the episodes come from.
    name
        Its name, irs-nav/NAME to Minari, ending in a version; by default after scenes and policy:
        paper-oracle-v0.
    out
        Folder of Minari's data sets; by default MINARI_DATASETS_PATH, else ~/.minari/datasets.
    progress
        Whether to show a progress bar.
    """
    scenes = Path(source.scene).stem if source.env == "IrsNav-v0" else source.split
    name = name or f"{scenes}-{source.policy}-v0"
    root = out or Path(
        os.environ.get("MINARI_DATASETS_PATH") or Path.home() / ".minari" / "datasets"
    )

    try:
        if not NAME.fullmatch(name):
            raise ValueError(f"name={name!r} must be of letters, digits, - and _, ending in -v0")
        folder = write_dataset(source, name, root, progress=progress)
    except (OSError, ValueError) as error:
        print(f"python -m train dataset: {error}", file=sys.stderr)
        return 2

    print(f"{NAMESPACE}/{name}: {source.episodes:,} episodes; written: {folder}")

    return 0


def scenes(split: tuple[str, ...] = tuple(DESCRIPTIONS), out: Path = Path("runs/scenes")) -> int:
    """Write the frozen scenes as JSON lines, with Croissant metadata.

    Parameters
    ----------
    split
        Frozen splits; all by default.
    out
        Folder of the files.
    """
    try:
        write_scenes(out, split)
    except (OSError, RuntimeError, ValueError) as error:
        print(f"python -m train scenes: {error}", file=sys.stderr)
        return 2

    print(f"{', '.join(split)}; written: {out / 'croissant.json'}")

    return 0
