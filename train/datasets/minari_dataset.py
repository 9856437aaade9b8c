"""`write_dataset`: labelled episodes as a Minari data set, also after an interruption."""

import json
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import irs_gym
from agents.runs import provenance
from irs_gym.files import read_arrays, write_file
from irs_gym.memory import check_memory
from train.datasets.croissant import dataset_metadata
from train.datasets.episodes import LABELS, STEPS, Source, collect

PART = 50  # episodes that are kept at a time
NAMESPACE = "irs-nav"
_INFO_BYTES = 200  # of a step


class DatasetError(ValueError):
    """Why there can be no such data set."""


@dataclass(frozen=True)
class Part:
    """Episodes in a row: arrays one behind the other, and where each ends."""

    epsilon: NDArray[np.float64]  # (n,)
    scenes: NDArray[np.str_]  # (n,)
    steps: NDArray[np.int64]  # (n,)
    arrays: dict[str, NDArray[Any]]

    @classmethod
    def collected(cls, source: Source, env: Any, first: int, count: int, bar: Any) -> "Part":
        """The episodes from ``first`` on."""
        episodes = []
        for number in range(first, first + count):
            episodes.append(collect(source, env, number))
            bar.update()

        arrays = [each.arrays() for each in episodes]
        return cls(
            epsilon=np.array([each.epsilon for each in episodes]),
            scenes=np.array([each.scene for each in episodes]),
            steps=np.array([len(each.actions) for each in episodes]),
            arrays={key: np.concatenate([each[key] for each in arrays]) for key in arrays[0]},
        )

    def to_bytes(self) -> bytes:
        """An ``.npz`` archive."""
        own = {"epsilon": self.epsilon, "scenes": self.scenes, "steps": self.steps}
        every: dict[str, Any] = {**own, **self.arrays}
        content = BytesIO()
        np.savez(content, **every)

        return content.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> "Part":
        """Part of an archive; never unpickles. Raises ``ValueError`` for a damaged one."""
        arrays = read_arrays(content, needed=("epsilon", "scenes", "steps", "actions"))
        own = {name: arrays.pop(name) for name in ("epsilon", "scenes", "steps")}
        if int(own["steps"].sum()) != len(arrays["actions"]):
            raise ValueError("its episodes are not whole")

        return cls(**own, arrays=arrays)

    def episodes(self) -> Iterator[dict[str, NDArray[Any]]]:
        """The arrays of each episode; observations and infos have one row more than steps."""
        ends = np.cumsum(self.steps)
        for n, (end, steps) in enumerate(zip(ends.tolist(), self.steps.tolist(), strict=True)):
            longer = slice(end - steps + n, end + n + 1)
            usual = slice(end - steps, end)
            yield {key: each[longer if "/" in key else usual] for key, each in self.arrays.items()}


def write_dataset(source: Source, name: str, root: Path, *, progress: bool = True) -> Path:
    """Collect a data set and write it; returns its folder, ``root / "irs-nav" / name``.

    Parts are kept beside it while it is collected: called again after an interruption, it goes on
    from there, and the data set is the same. It is there as a whole or not at all.

    Raises
    ------
    OSError
        Where something cannot be written.
    ValueError
        `DatasetError` where Minari is missing or there is such a data set already; else where the
        environment refuses its arguments.
    """
    missing = [each for each in ("minari", "h5py") if find_spec(each) is None]
    if missing:
        raise DatasetError(f'{missing[0]} is missing: pip install -e ".[datasets]"')

    root = root.resolve()  # which Minari needs
    target = root / NAMESPACE / name
    if target.exists():
        raise DatasetError(f"{str(target)!r} exists: name another data set")

    env = source.make_env()
    _check_memory(env, source.observation)
    definition = json.dumps({**asdict(source), "version": irs_gym.__version__}, sort_keys=True)
    parts = root / NAMESPACE / f".{name}-{sha256(definition.encode()).hexdigest()[:12]}"
    parts.mkdir(parents=True, exist_ok=True)

    with tqdm(total=source.episodes, desc=name, unit="episode", disable=not progress) as bar:
        files = [
            _kept(parts / f"{first}.npz", source, env, first, bar)
            for first in range(0, source.episodes, PART)
        ]

    draft = parts / "draft"
    shutil.rmtree(draft, ignore_errors=True)
    _assemble(source, name, env, files, draft)
    _write_metadata(source, draft / NAMESPACE / name, name)

    # the namespace's own file first, which Minari looks for
    told = draft / NAMESPACE / "namespace_metadata.json"
    if told.exists() and not (target.parent / told.name).exists():
        os.replace(told, target.parent / told.name)

    os.replace(draft / NAMESPACE / name, target)
    shutil.rmtree(parts)

    return target


def _kept(file: Path, source: Source, env: Any, first: int, bar: Any) -> Path:
    """A file of the episodes from ``first`` on: the one that is there where it is whole, else
    collected.
    """
    count = min(PART, source.episodes - first)
    try:
        if len(Part.from_bytes(file.read_bytes()).steps) == count:
            bar.update(count)
            return file
    except (FileNotFoundError, ValueError):
        pass

    write_file(file, Part.collected(source, env, first, count, bar).to_bytes())

    return file


def _check_memory(env: gymnasium.Env[Any, Any], observation: str) -> None:
    """Refuse observations of which a part does not fit."""
    each = env.observation_space
    spaces = list(each.values()) if isinstance(each, gymnasium.spaces.Dict) else [each]
    size = sum(int(np.prod(own.shape or (1,))) * 8 for own in spaces) + _INFO_BYTES
    check_memory(f"observation={observation!r}: {PART} episodes", 2.0 * PART * STEPS * size)


def _assemble(source: Source, name: str, env: Any, files: list[Path], draft: Path) -> None:
    """The Minari data set of all parts, below the draft, and its episodes in a table."""
    import minari
    from minari.data_collector import EpisodeBuffer

    dataset: Any = None
    rows: list[dict[str, Any]] = []

    with _datasets_in(draft):
        for file in files:
            part = Part.from_bytes(file.read_bytes())
            first = len(rows)
            buffers = []

            for n, arrays in enumerate(part.episodes()):
                buffers.append(EpisodeBuffer(id=first + n, **_grouped(arrays)))
                rows.append(_row(first + n, part, n, arrays))

            if dataset is not None:
                dataset.update_dataset_from_buffer(buffers)
                continue

            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # that it has no e-mail address
                dataset = minari.create_dataset_from_buffers(
                    dataset_id=f"{NAMESPACE}/{name}",
                    buffer=buffers,
                    env=env,
                    eval_env=source.make_env(random_start=False),
                    algorithm_name=source.policy,
                    author="The irs_gym authors",
                    description=_description(source),
                    data_format="hdf5",
                )

    lines = "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows)
    write_file(draft / NAMESPACE / name / "episodes.jsonl", lines.encode())


def _grouped(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Arrays of an episode as Minari's buffers hold them."""
    found: dict[str, Any] = {"observations": {}, "infos": {}}
    for key, each in arrays.items():
        group, _, own = key.partition("/")
        if group not in found:
            found[group] = each
        elif own:
            found[group][own] = each
        else:
            found[group] = each

    return found


def _row(number: int, part: Part, n: int, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """What is told of an episode in the table."""
    return {
        "episode": number,
        "scene": str(part.scenes[n]),
        "epsilon": float(part.epsilon[n]),
        "steps": int(part.steps[n]),
        "is_success": bool(arrays["infos/is_success"][-1]),
        "distance": float(arrays["infos/distance"][-1]),
        "oracle_distance": float(arrays["infos/oracle_distance"][0]),
        "refused": int(arrays["infos/refused"][-1]),
        "regret": float(arrays["infos/regret"].sum()),
        "total_reward": float(arrays["rewards"].sum()),
    }


def _description(source: Source) -> str:
    labels = "; ".join(f"{name}: {what}" for name, what in LABELS.items())
    return (
        f"{source.episodes:,} episodes of {source.env}, policy {source.policy}, "
        f"settings {json.dumps(asdict(source), sort_keys=True)}. Exact labels among the infos, of "
        f"which the first are those of the reset: {labels}."
    )


def _write_metadata(source: Source, folder: Path, name: str) -> None:
    """Write croissant.json beside the files that it describes."""
    metadata = dataset_metadata(
        name=f"{NAMESPACE}-{name}",
        description=_description(source),
        version=irs_gym.__version__,
        commit=provenance.commit(),
        folder=folder,
    )
    write_file(folder / "croissant.json", (json.dumps(metadata, indent=1) + "\n").encode())


@contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Lets Minari write below a folder; it takes it from the environment alone."""
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before
