"""`build_shards`: the first scenes of a split, a hundred at a time, from the cache or built."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from hashlib import sha256
from pathlib import Path
from typing import Any

from irs_gym.datasets.cache import read_cached, write_cached
from irs_gym.datasets.shard import Shard, build_shard, definition_of
from irs_gym.datasets.splits import split_of

SHARD_SCENES = 100  # what is built in one go, and kept in one file


def build_shards(
    split: str, count: int, *, jobs: int | None, progress: bool | None, folder: Path | None
) -> Shard:
    """The first ``count`` scenes of a split; see `irs_gym.datasets.scene_set.build_scene_set`.
    Takes them as they are drawn.
    """
    from tqdm import tqdm

    if jobs is not None and jobs < 1:
        raise ValueError(
            f"jobs={jobs} must be 1 or more processes, or None for as many as there are processors"
        )

    # by the number of each shard's first scene; the last one may be smaller
    sizes = {first: min(SHARD_SCENES, count - first) for first in range(0, count, SHARD_SCENES)}
    shards = {first: _from_cache(folder, split, first, size) for first, size in sizes.items()}

    missing = {first: size for first, size in sizes.items() if not shards[first]}
    ready = count - sum(missing.values())
    if missing:
        title = f"{split} scenes, built once"
        hidden = None if progress is None else not progress

        with tqdm(
            total=count, initial=ready, desc=title, unit="scene", delay=1.0, disable=hidden
        ) as bar:
            processes = min(len(missing), jobs or _processors())
            # Each is kept as soon as it is there: a build that is interrupted goes on from there.
            for first, shard in _built(split, missing, processes, bar.update):
                shards[first] = shard
                definition = definition_of(split, first, missing[first])
                write_cached(folder, file_of(definition, split, first), shard.to_bytes(definition))

    return Shard.joined([shard for shard in shards.values() if shard], count)


def _built(
    split: str, missing: Mapping[int, int], jobs: int, report: Callable[[int], Any]
) -> Iterator[tuple[int, Shard]]:
    """Each missing shard by its first scene; ``report`` is called with how many scenes are new."""
    if jobs == 1:
        for first, count in missing.items():
            yield first, build_shard(split, first, count, lambda: report(1))

        return

    # Each thread waits for a process of its own. Where that fails, this process builds the shard.
    threads = ThreadPoolExecutor(jobs)
    try:
        waiting = {threads.submit(built_elsewhere, split, *each): each for each in missing.items()}
        for done in as_completed(waiting):
            first, count = waiting[done]
            yield first, done.result() or build_shard(split, first, count)
            report(count)
    finally:
        threads.shutdown(cancel_futures=True)


def built_elsewhere(split: str, first: int, count: int) -> Shard | None:
    """The shard, built in a process of its own; None where that fails.

    The process is a plain one of this module's own and not one of `multiprocessing`, which would
    run a script without a main guard again in each.
    """
    command = [sys.executable, "-P", "-m", "irs_gym.datasets.shard", split, str(first), str(count)]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)),
        "OMP_NUM_THREADS": "1",
    }

    try:
        done = subprocess.run(command, env=environment, capture_output=True, check=True)
        return Shard.from_bytes(done.stdout, definition_of(split, first, count))
    except (OSError, ValueError, subprocess.CalledProcessError):
        return None


def _from_cache(folder: Path | None, split: str, first: int, count: int) -> Shard | None:
    """The shard from the cache, or the first scenes of a larger one; None where it holds neither,
    or a damaged one.
    """
    for size in dict.fromkeys((SHARD_SCENES, count)):
        if first + size > split_of(split).size:
            continue

        definition = definition_of(split, first, size)
        content = read_cached(folder, file_of(definition, split, first))

        try:
            if content is not None:
                return Shard.joined([Shard.from_bytes(content, definition)], count)
        except ValueError:  # damaged, or another's
            continue

    return None


def file_of(definition: str, split: str, first: int) -> str:
    """Name of a shard's file, after a hash of all that its content depends on."""
    return f"{split}-{first}-{sha256(definition.encode()).hexdigest()[:16]}.npz"


def _processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
