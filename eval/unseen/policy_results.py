"""`PolicyResult`: a policy with what it did on each set of unseen scenes, over all its seeds."""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from io import BytesIO
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track

from agents.registry import ALGORITHMS, observation_of
from agents.rollout.scene_set import SceneSetResults
from agents.runs.manifest import GeneralistEntry
from agents.runs.run_folder import Run, RunError
from eval.scoreboard.results import COMPLETE, LeftOut, find_runs, read_curve, settings_text
from eval.unseen.scores import Player, player_of, reference
from irs_gym.datasets.generator import VERSION
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.files import read_arrays, write_file

Track = Literal["map", "local"]
USUAL_SCENES = 3000
REFERENCE_TITLES = {
    "replanning": "optimistic replanning",
    "untrained_explorer": "explorer, untrained",
    "greedy": "greedy (octile)",
    "greedy_margin": "greedy on the margin",
}


@dataclass(frozen=True, eq=False)
class PolicyResult:
    """Runs that differ in the seed alone, or a reference policy.

    Attributes
    ----------
    algorithm, name, track
        What it is, how it is called on the page, and what it sees.
    scenes
        Training scenes; None for a reference.
    runs
        In the order of their seeds; none for a reference.
    episodes
        By the name of a set, one for each run; a set that it cannot play is missing.
    """

    algorithm: str
    name: str
    track: Track
    scenes: int | None
    runs: tuple[Run, ...]
    episodes: Mapping[str, Sequence[SceneSetResults]]

    @property
    def seeds(self) -> list[int]:
        """Of the runs."""
        return [run.config.seed for run in self.runs]

    def table(
        self, name: str, value: Callable[[SceneSetResults], NDArray[Any]]
    ) -> NDArray[np.float64]:
        """A value of each episode in a set, ``(seeds, scenes)``."""
        return np.stack([value(each) for each in self.episodes[name]]).astype(np.float64)


PlayedGroups = dict[tuple[str, str], list[tuple[Run, dict[str, SceneSetResults]]]]
"""By algorithm and settings: the runs that differ in the seed alone, and what each did."""


def find_generalists(folder: Path) -> tuple[list[Run], list[LeftOut]]:
    """Complete runs over many scenes below a folder, and the others."""
    runs = []
    left_out = []

    for each in find_runs(folder):
        try:
            run = Run.open(each)
            if not run.is_generalist:
                raise ValueError(
                    f"{run.config.algorithm} learned in one scene: it belongs on the scoreboard"
                )
            if run.manifest.status not in COMPLETE:
                raise ValueError(f"has not ended: its status is {run.manifest.status!r}")

            _check_generalist(run)
            runs.append(run)
        except Exception as error:
            left_out.append(LeftOut.of(each, error))

    return runs, left_out


def pace(run: Run) -> tuple[float, float]:
    """Steps and seconds of a run's whole training; raises ``OSError``, or `RunError` where they
    cannot be read.
    """
    last = read_curve(run)[-1]
    damaged = f"{str(run.folder / 'learning_curve.csv')!r} is damaged"

    try:
        steps = float(last["steps"])
        seconds = float(last["seconds"])
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{damaged}: {error!r}") from None

    if not (0 <= steps < inf and 0 < seconds < inf):
        raise RunError(f"{damaged}: {steps} steps in {seconds} seconds")

    return steps, seconds


def result_of_runs(
    runs: Sequence[Run],
    pools: Mapping[Track, Mapping[str, SceneSet]],
    jobs: int = 1,
    title: str | None = None,
) -> tuple[list[PolicyResult], list[LeftOut]]:
    """Play all runs on the sets of their tracks, so many at a time; what was played before is read
    from their folders.

    What is but a point of the curve over training scenes plays the test scenes alone. A progress
    bar is shown where it has a title. A run that cannot be played is left out, whatever it raises.
    """
    in_order = sorted(runs, key=lambda run: run.config.seed)
    groups: PlayedGroups = {}
    left_out = []

    # PyTorch works outside of the interpreter's lock. Of its own threads one each is enough: more
    # wait for each other.
    threads = ThreadPoolExecutor(jobs, initializer=partial(torch.set_num_threads, 1))

    try:
        playing = [
            threads.submit(_play, run, pools[track_of(run.config.algorithm)]) for run in in_order
        ]
        shown = track(playing, title or "", transient=True, disable=title is None)

        for run, played in zip(in_order, shown, strict=True):
            try:
                key = run.config.algorithm, _settings(run)
                episodes = played.result()
            except Exception as error:
                left_out.append(LeftOut.of(run.folder, error))
            else:
                groups.setdefault(key, []).append((run, episodes))
    finally:
        threads.shutdown(wait=False, cancel_futures=True)  # a Ctrl-C does not wait for them

    order = list(ALGORITHMS)
    entrants = [_result_of_group(groups, key) for key in groups]
    entrants.sort(key=lambda each: (order.index(each.algorithm), each.name, each.scenes or 0))

    return entrants, left_out


def _result_of_group(groups: PlayedGroups, key: tuple[str, str]) -> PolicyResult:
    """One of the groups, named by what sets it apart from those of the same algorithm."""
    algorithm, settings = key
    found = groups[key]
    first, sets = found[0]
    others = [json.loads(other) for name, other in groups if name == algorithm]

    return PolicyResult(
        algorithm=algorithm,
        name=", ".join([ALGORITHMS[algorithm].title, *_differences(json.loads(settings), others)]),
        track=track_of(algorithm),
        scenes=first.config.env["num_scenes"],
        runs=tuple(run for run, _ in found),
        episodes={name: [each[name] for _, each in found] for name in sets},
    )


def result_of_reference(name: str, pools: Mapping[str, SceneSet], folder: Path) -> PolicyResult:
    """Play a reference of the local track; what was played before is read from the folder."""
    player = reference(name)
    episodes = {
        each: [kept(folder / f"{name}-{each}.npz", pool, "", player)]
        for each, pool in pools.items()
    }
    return PolicyResult(name, REFERENCE_TITLES[name], "local", None, (), episodes)


def is_point(algorithm: str, scenes: int | None) -> bool:
    """Whether it is but a point of the planning network's curve over training scenes."""
    return algorithm == "planner" and scenes != USUAL_SCENES


def track_of(algorithm: str) -> Track:
    """What an algorithm's policies see."""
    return "map" if observation_of(algorithm) == "map" else "local"


def kept(file: Path, pool: SceneSet, model: str, player: Player) -> SceneSetResults:
    """Episodes from a file, if they are those of this model, generator and pool; else played, and
    written there.
    """
    names = json.dumps([VERSION, model, pool.names]).encode()
    key = sha256(names + pool.oracle_distance.tobytes()).hexdigest()
    kept_before = _read_episodes(file, key, pool)
    if kept_before is not None:
        return kept_before

    found = player.episodes(pool)
    content = BytesIO()
    np.savez_compressed(
        content, key=np.array(key), is_success=found.is_success, distance=found.distance
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    write_file(file, content.getvalue())

    return found


def _read_episodes(file: Path, key: str, pool: SceneSet) -> SceneSetResults | None:
    """Episodes from a file with that key; None where there is none, another's, or a damaged one."""
    try:
        arrays = read_arrays(file, needed=("key", "is_success", "distance"))
    except (OSError, ValueError):
        return None

    is_success = arrays["is_success"]
    distance = arrays["distance"]
    is_whole = (
        is_success.shape == distance.shape == (len(pool),)
        and is_success.dtype == np.bool_
        and distance.dtype == np.float64
    )
    if not is_whole or arrays["key"].tolist() != key:
        return None

    # NaN is in no range; who arrives has gone some way
    in_range = np.all((distance >= 0) & (distance < np.inf))
    if not in_range or np.any(is_success & (distance == 0)):
        return None

    return SceneSetResults(is_success, distance, pool.oracle_distance)


def _check_generalist(run: Run) -> None:
    """Refuse a run over many scenes that cannot stand on a page."""
    scenes = run.config.env.get("num_scenes")
    if not isinstance(scenes, int) or scenes < 1:
        raise RunError(f"num_scenes={scenes!r} in its config.json must be a positive integer")
    if not isinstance(run.manifest.models.get("best"), GeneralistEntry):
        raise RunError("its manifest lists no best model over many scenes")

    _settings(run)
    pace(run)


def _play(run: Run, pools: Mapping[str, SceneSet]) -> dict[str, SceneSetResults]:
    if is_point(run.config.algorithm, run.config.env["num_scenes"]):
        pools = {"test": pools["test"]}

    player = player_of(run)
    played = {}

    for name, pool in pools.items():
        try:
            played[name] = kept(
                run.folder / f"unseen-{name}.npz", pool, run.manifest.models["best"].sha256, player
            )
        except ValueError:  # a policy of SB3 sees maps of one size
            if run.config.algorithm != "map_ppo":
                raise

    return played


def _settings(run: Run) -> str:
    """All that runs of one group share; of weights to begin with, that is whose they are."""
    agent = {**run.config.agent, "weights": _maker(run.config.agent.get("weights"))}
    return settings_text({"agent": agent, "env": run.config.env})


def _maker(weights: str | None) -> str | None:
    """The algorithm of the run that has trained some weights."""
    if weights is None:
        return None

    try:
        return f"of {Run.open(weights).config.algorithm}"
    except RunError:
        return "from elsewhere"


def _differences(own: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> list[str]:
    """The agent's settings that set it apart from others of the same algorithm."""
    agents = [each["agent"] for each in others]
    return [
        f"{name} {value}"
        for name, value in own["agent"].items()
        if value is not None and any(each.get(name) != value for each in agents)
    ]
