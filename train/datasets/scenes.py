"""`write_scenes`: the frozen scenes as files of JSON lines, with their metadata."""

import json
from collections.abc import Sequence
from datetime import date
from hashlib import sha256
from pathlib import Path

import irs_gym
from irs_gym.datasets.scene_set import build_scene_set
from irs_gym.datasets.splits import SPLITS, frozen
from irs_gym.files import write_file
from train.datasets.croissant import scenes_metadata

PUBLISHED = date(2026, 11, 26)  # the day of these scenes, which never change
DESCRIPTIONS = {
    "val": "the training scenes' kind, to choose agents by",
    "test": "the training scenes' kind, to score agents on",
    "ood-clutter": "more obstacles than in any training scene",
    "ood-irs": "no panel, two, or one with fewer or more elements than any training scene's",
    "ood-size": "twice the sides, and as many obstacles for the area",
    "ood-rooms": "walls with doors",
    "ood-maze": "mazes and corridors, whose walls alone decide the way",
    "ood-doors": "many rooms with doors, whose walls alone decide the way",
    "ood-spiral": "spirals, whose walls alone decide the way",
    "ood-zigzag": "zigzags, whose walls alone decide the way",
    "ood-trap": "U-shaped traps, whose walls alone decide the way",
    "ood-racks": "racks of a warehouse, whose walls alone decide the way",
    "ood-hall": "long halls of 30 x 12 m",
    "ood-aps": "several access points",
}


def write_scenes(folder: Path, splits: Sequence[str] = tuple(DESCRIPTIONS)) -> None:
    """Write SPLIT.jsonl for frozen splits, and croissant.json beside them.

    Raises
    ------
    OSError
        Where they cannot be written.
    ValueError
        Where a split is none of the frozen ones, or its scenes come out as others than those whose
        SHA-256 is kept.
    """
    for split in splits:
        if split not in DESCRIPTIONS:
            raise ValueError(f"split={split!r} must be one of {', '.join(DESCRIPTIONS)}")

    folder.mkdir(parents=True, exist_ok=True)
    for split in splits:
        scenes = build_scene_set(split, SPLITS[split].size).scenes
        content = b"".join(scene.model_dump_json().encode() + b"\n" for scene in scenes)
        if sha256(content).hexdigest() != frozen()[split].sha256:
            raise ValueError(f"split={split!r}: its scenes are not those that were frozen")

        write_file(folder / f"{split}.jsonl", content)

    metadata = scenes_metadata(
        version=irs_gym.__version__,
        published=PUBLISHED,
        folder=folder,
        splits={split: DESCRIPTIONS[split] for split in splits},
    )
    write_file(folder / "croissant.json", (json.dumps(metadata, indent=1) + "\n").encode())
