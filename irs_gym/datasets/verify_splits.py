"""The check that the frozen splits are what they were, and that no scene is in two of them.

``python -m irs_gym.proof`` draws all frozen scenes, as many of the training set as asked for and a
fiftieth as many of each family's, holds the frozen ones against what is kept of them in
``splits.json``, and looks for scenes that are in two places, turned or mirrored ones included.
"""

# ruff: noqa: E402  # a Ctrl-C during the imports is to end in one line as well
import os
import signal
import sys


def _end(number: int, frame: object) -> None:
    os.write(2, b"python -m irs_gym.proof: interrupted\n")
    os._exit(128 + number)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, _end)

import argparse
import json
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from irs_gym.datasets.build_shards import build_shards
from irs_gym.datasets.cache import cache_folder
from irs_gym.datasets.generator import VERSION
from irs_gym.datasets.scene_hash import scene_hash
from irs_gym.datasets.splits import SPLITS, digest
from irs_gym.radio.scene import Scene, load_scene, scene_names

KEPT = Path(__file__).with_name("splits.json")
_PER_LINE = 12  # digests
_OF_A_FAMILY = 50  # a training set of one family is looked at for so many times fewer scenes


def entry_of(texts: Iterable[bytes]) -> dict[str, Any]:
    """What is kept of a frozen split, from the JSON of its scenes in order."""
    lines = list(texts)
    digits = [digest(text) for text in lines]
    return {
        "sha256": sha256(b"".join(text + b"\n" for text in lines)).hexdigest(),
        "scenes": ["".join(digits[n : n + _PER_LINE]) for n in range(0, len(digits), _PER_LINE)],
    }


def shared(scenes: Mapping[str, Iterable[Scene]]) -> list[tuple[str, str]]:
    """Pairs of equal scenes, whether turned or mirrored, within a set or in two; named ``SET:
    SCENE``.
    """
    places: dict[str, str] = {}
    pairs = []

    for name, members in scenes.items():
        for scene in members:
            place = f"{name}: {scene.name}"
            first = places.setdefault(scene_hash(scene), place)
            if first != place:
                pairs.append((first, place))

    return pairs


def main() -> int:
    """Draw, compare and tell; the exit status is 1 where a scene has changed or is in two
    places.
    """
    parser = argparse.ArgumentParser(prog="python -m irs_gym.proof", description=main.__doc__)
    parser.add_argument(
        "--train", type=int, default=10_000, help="training scenes to look among (10000)"
    )
    parser.add_argument(
        "--jobs", type=int, default=None, help="processes (as many as there are processors)"
    )
    parser.add_argument(
        "--write", action="store_true", help="keep what was found: for a new version of the splits"
    )
    given = parser.parse_args()

    texts = {
        name: _texts(
            name, split.size if split.is_frozen else _looked_at(name, given.train), given.jobs
        )
        for name, split in SPLITS.items()
    }
    entries = {name: entry_of(texts[name]) for name, split in SPLITS.items() if split.is_frozen}
    pairs = shared(
        {
            "package": map(load_scene, scene_names()),
            **{name: _read(each) for name, each in texts.items()},
        }
    )
    counts = {"package": len(scene_names()), **{name: len(each) for name, each in texts.items()}}
    found = {
        "format_version": 1,
        "generator_version": VERSION,
        "splits": entries,
        "proof": {"scenes": counts, "in_two_places": len(pairs), "numpy": np.__version__},
    }

    for name, entry in entries.items():
        print(f"{name}: {counts[name]:,} scenes, SHA-256 {entry['sha256']}")

    print(
        f"{sum(counts.values()):,} scenes, of which {counts['train']:,} for training: "
        f"{len(pairs)} are in two places"
    )
    for one, other in pairs:
        print(f"  {one} is {other}")

    if given.write:
        KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(f"written: {KEPT}")
        return int(bool(pairs))

    kept = json.loads(KEPT.read_bytes())
    changed = [name for name, entry in entries.items() if kept["splits"].get(name) != entry]
    print(f"changed since they were frozen: {', '.join(changed) or 'none'}")

    return int(bool(pairs or changed))


def _looked_at(split: str, train: int) -> int:
    """Scenes of a training set."""
    return train if split == "train" else max(1, train // _OF_A_FAMILY)


def _texts(split: str, count: int, jobs: int | None) -> list[bytes]:
    texts: list[bytes] = build_shards(
        split, count, jobs=jobs, progress=True, folder=cache_folder()
    ).texts.tolist()
    return texts


def _read(texts: Iterable[bytes]) -> Iterable[Scene]:
    return (Scene.model_validate_json(text, strict=True) for text in texts)


if __name__ == "__main__":
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # now there may be something to clean up
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        _end(signal.SIGINT, None)
