"""`dataset_metadata`, `scenes_metadata`: what data sets and scenes hold, as Croissant metadata.

Croissant 1.0 (MLCommons, 2024) is JSON-LD over schema.org's Dataset: files with their SHA-256, and
how records are read from them. `mlcroissant` reads it.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from hashlib import file_digest
from pathlib import Path
from typing import Any

CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
LICENSE = "https://spdx.org/licenses/MIT.html"
CITE_AS = "irs_gym: communication-aware navigation, scored against the exact optimum (CITATION.cff)"

# The terms of the specification by their short names.
_TERMS = (
    "citeAs", "column", "equivalentProperty", "extract", "field", "fileObject", "fileProperty",
    "fileSet", "format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField",
    "path", "recordSet", "references", "regex", "repeated", "replace", "samplingRate", "separator",
    "source", "subField", "transform",
)  # fmt: skip
CONTEXT: Mapping[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{name: f"cr:{name}" for name in _TERMS},
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "sc": "https://schema.org/",
}

Column = tuple[str, str, str]  # name, type of schema.org, description

EPISODES: Sequence[Column] = (
    ("episode", "sc:Integer", "its number in main_data.hdf5: the group episode_N"),
    ("scene", "sc:Text", "the scene that it plays in"),
    ("epsilon", "sc:Float", "how often an action is drawn among all eight, not the best"),
    ("steps", "sc:Integer", "number of actions"),
    ("is_success", "sc:Boolean", "whether it reaches the goal"),
    ("distance", "sc:Float", "metres travelled"),
    ("oracle_distance", "sc:Float", "metres of the shortest feasible path from its start"),
    ("refused", "sc:Integer", "refused moves"),
    ("regret", "sc:Float", "metres lost against the best actions, over all steps"),
    ("total_reward", "sc:Float", "undiscounted"),
)
SCENES: Sequence[Column] = (
    ("name", "sc:Text", "the scene's id in the environment"),
    ("target_db", "sc:Float", "lowest expected channel gain in dB that keeps a robot connected"),
    ("antenna_height", "sc:Float", "of the robot, in metres"),
    ("carrier_ghz", "sc:Float", "carrier frequency"),
    ("rician_factor_db", "sc:Float", "Rician factor of links in line of sight"),
)


def dataset_metadata(
    *, name: str, description: str, version: str, commit: str | None, folder: Path
) -> dict[str, Any]:
    """Metadata of a Minari data set in its folder, whose episodes.jsonl tells of each episode."""
    files = [
        _file(folder, "data/main_data.hdf5", "application/x-hdf5", "all steps, as Minari has them"),
        _file(folder, "data/metadata.json", "application/json", "spaces and environment"),
        _file(folder, "episodes.jsonl", "application/jsonlines", "a line an episode"),
    ]
    made = f" Made from commit {commit}." if commit else ""

    return _metadata(
        name=name,
        description=description + made,
        version=version,
        published=datetime.now(UTC).date(),
        files=files,
        records=[_records("episodes", "What came of each episode.", "episodes.jsonl", EPISODES)],
    )


def scenes_metadata(
    *, version: str, published: date, folder: Path, splits: Mapping[str, str]
) -> dict[str, Any]:
    """Metadata of scenes in files SPLIT.jsonl of a folder; ``splits`` describes each."""
    files = [
        _file(folder, f"{split}.jsonl", "application/jsonlines", description)
        for split, description in splits.items()
    ]
    records = [
        _records(split, f"The scenes of {split}: {what}.", f"{split}.jsonl", SCENES)
        for split, what in splits.items()
    ]

    return _metadata(
        name="irs-nav-scenes",
        description=(
            "The frozen scenes of IrsNavRandom-v0: factories with obstacles, an access point and "
            "reflecting surfaces, each with a target, a start and a goal. A line is a scene file "
            "of irs_gym; its expected channel gains and its shortest path follow exactly from it."
        ),
        version=version,
        published=published,
        files=files,
        records=records,
    )


def _metadata(
    *,
    name: str,
    description: str,
    version: str,
    published: date,
    files: Sequence[Mapping[str, Any]],
    records: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    return {
        "@context": dict(CONTEXT),
        "@type": "sc:Dataset",
        "name": name,
        "description": description,
        "conformsTo": CONFORMS_TO,
        "license": LICENSE,
        "citeAs": CITE_AS,
        "creator": {"@type": "sc:Organization", "name": "The irs_gym authors"},
        "datePublished": published.isoformat(),
        "version": version,
        "distribution": list(files),
        "recordSet": list(records),
    }


def _file(folder: Path, path: str, encoding: str, description: str) -> dict[str, Any]:
    """A file of the folder, with its size and SHA-256."""
    with (folder / path).open("rb") as file:
        digest = file_digest(file, "sha256").hexdigest()

    return {
        "@type": "cr:FileObject",
        "@id": path,
        "name": path.rpartition("/")[2],
        "description": description,
        "contentUrl": path,
        "contentSize": f"{(folder / path).stat().st_size} B",
        "encodingFormat": encoding,
        "sha256": digest,
    }


def _records(name: str, description: str, file: str, columns: Sequence[Column]) -> dict[str, Any]:
    """Records of a file of JSON lines."""
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": description,
        "key": {"@id": f"{name}/{columns[0][0]}"},
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{column}",
                "name": column,
                "description": what,
                "dataType": kind,
                "source": {"fileObject": {"@id": file}, "extract": {"column": column}},
            }
            for column, kind, what in columns
        ],
    }
