"""`play_all`: the episodes of many policies on many sets, in several processes, each kept once
played.
"""

import ast
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from io import BytesIO
from multiprocessing import get_context
from pathlib import Path
from time import process_time

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track

import agents.networks
import agents.policies
import agents.rollout
from agents.rollout.scene_set import SceneSetResults
from agents.runs.run_folder import Run
from eval.scoreboard.results import LeftOut
from eval.unseen.page_sets import SetFacts, checksum_of, page_scene_set
from eval.unseen.scores import Player, player_of, run_or_player
from irs_gym.files import read_arrays, write_file

# Whose modules say what a policy does with a model.
_CODE = (agents.networks, agents.policies, agents.rollout)


@dataclass(frozen=True)
class Trial:
    """A policy on the first scenes of a set.

    Attributes
    ----------
    policy
        A run folder, or what `eval.unseen.scores.run_or_player` knows by name.
    model
        SHA-256 of its file; of a reference, what names it.
    scenes
        A name of `eval.unseen.page_sets.PAGE_SETS`.
    count
        How many scenes of it.
    """

    policy: Path | str
    model: str
    scenes: str
    count: int


@dataclass(frozen=True, eq=False)
class Episodes:
    """What a policy did in each scene of a set, ``(S,)``, and the seconds of one core it took."""

    is_success: NDArray[np.bool_]
    distance: NDArray[np.float64]
    seconds: float

    def results(self, oracle_distance: NDArray[np.float64]) -> SceneSetResults:
        """Beside the oracle's distances."""
        return SceneSetResults(self.is_success, self.distance, oracle_distance)


Found = dict[Trial, Episodes | LeftOut]
"""Of each trial, what was played, or why nothing was."""


def play_all(
    trials: Sequence[Trial],
    facts: Mapping[tuple[str, int], SetFacts],
    folder: Path | None,
    jobs: int = 1,
    title: str | None = None,
) -> Found:
    """Play all trials but those that were played before, so many at a time.

    Parameters
    ----------
    trials
        What is to be played.
    facts
        Of each set and number of scenes.
    folder
        Where episodes are kept, by the checksums of models and sets; None: nowhere. What is there
        when a call is interrupted is not played again by the next.
    jobs
        Processes; with one, all is played in this one.
    title
        Of a progress bar; None: there is none.
    """
    found: Found = {}
    waiting = []
    for each in dict.fromkeys(trials):
        known = facts[each.scenes, each.count]
        kept = _read(_file(folder, each.model, known.checksum), known.oracle_distance)
        if kept is None:
            waiting.append(each)
        else:
            found[each] = kept

    # a set stays in memory while all play it
    waiting.sort(key=lambda each: (each.scenes, str(each.policy)))
    outcomes = _played(waiting, folder, min(jobs, len(waiting)))
    for trial, outcome in track(
        outcomes, title or "", len(waiting), transient=True, disable=title is None
    ):
        found[trial] = outcome

    return found


def play(trial: Trial, folder: Path | None = None) -> Episodes | LeftOut:
    """Play a trial, and keep the episodes; where it cannot be played, that is told, whatever was
    raised.
    """
    try:
        pool = page_scene_set(trial.scenes, trial.count)
        player = _player(trial.policy)
        torch.set_num_threads(1)  # more wait for each other

        begin = process_time()
        found = player.episodes(pool)
        played = Episodes(found.is_success, found.distance, process_time() - begin)
    except Exception as error:  # a damaged run raises anything
        return LeftOut.of(Path(trial.policy), error)

    file = _file(folder, trial.model, checksum_of(pool))
    if file is not None:
        _write(file, played)

    return played


def _played(
    trials: Sequence[Trial], folder: Path | None, jobs: int
) -> Iterator[tuple[Trial, Episodes | LeftOut]]:
    """Each trial with its outcome, as they come."""
    if jobs <= 1:
        for each in trials:
            yield each, play(each, folder)

        return

    # not forked, as PyTorch's threads do not survive that
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))
    try:
        playing = {pool.submit(play, each, folder): each for each in trials}
        for done in as_completed(playing):
            yield playing[done], done.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # a Ctrl-C does not wait for them


def _player(policy: Path | str) -> Player:
    found = Run.open(policy) if isinstance(policy, Path) else run_or_player(policy)
    return player_of(found) if isinstance(found, Run) else found


# --- what is kept ---------------------------------------------------------------------------------


def _file(folder: Path | None, model: str, checksum: str) -> Path | None:
    """Named after all that the episodes depend on."""
    key = sha256(json.dumps([code_checksum(), model, checksum]).encode()).hexdigest()
    return None if folder is None else folder / f"{key[:40]}.npz"


@cache
def code_checksum() -> str:
    """SHA-256 of the modules that say what a policy does, without comments and docstrings."""
    files = [file for each in _CODE for file in Path(each.__path__[0]).rglob("*.py")]
    return sha256(
        "\n".join(code_of(file.read_text()) for file in sorted(files)).encode()
    ).hexdigest()


def code_of(source: str) -> str:
    """What a module does, as text: two that differ in comments, docstrings and layout alone are
    equal.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not _is_text(each)]  # type: ignore[attr-defined]

    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    """Whether it is a string that stands alone: a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _write(file: Path, played: Episodes) -> None:
    content = BytesIO()
    np.savez_compressed(
        content,
        is_success=played.is_success,
        distance=played.distance,
        seconds=np.array(played.seconds),
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    write_file(file, content.getvalue())


def _read(file: Path | None, oracle_distance: NDArray[np.float64]) -> Episodes | None:
    """Episodes from a file; None where there is none, or one that is damaged or forged."""
    if file is None:
        return None

    try:
        arrays = read_arrays(file, needed=("is_success", "distance", "seconds"))
    except (OSError, ValueError):
        return None

    is_success, distance, seconds = (arrays[name] for name in ("is_success", "distance", "seconds"))
    is_whole = (
        is_success.shape == distance.shape == oracle_distance.shape
        and is_success.dtype == np.bool_
        and distance.dtype == np.float64
        and seconds.shape == ()
        and seconds.dtype == np.float64
    )
    # NaN is in no range; nobody arrives by a shorter way than the oracle's, but for rounding
    if (
        not is_whole
        or not np.all((distance >= 0) & (distance < np.inf))
        or not 0 <= seconds < np.inf
        or np.any(distance[is_success] < oracle_distance[is_success] * (1 - 1e-9))
    ):
        return None

    return Episodes(is_success, distance, float(seconds))
