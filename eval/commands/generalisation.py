"""`python -m eval generalisation`: all runs over many scenes on one page, on scenes that none of
them has seen.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import torch
from tyro.conf import Positional, arg

from agents.registry import observation_of
from agents.rollout.episode import TOLERANCE, roll_out
from agents.rollout.scene_set import SceneSetResults
from agents.runs.pretrained import MODELS, Models, load_pretrained
from eval.origin import commands_of, origins
from eval.pictures import write_pictures
from eval.scoreboard.results import LeftOut, tell_left_out
from eval.unseen.gallery import Scenery, choose_scenes, draw_gallery
from eval.unseen.page import FIGURES, draw_scenes_curve, unseen_page
from eval.unseen.page_sets import PAGE_SETS, SetFacts, Track, page_scene_set, scenes_of
from eval.unseen.played import Episodes, Found, play_all
from eval.unseen.policy_results import (
    PAGE_REFERENCES,
    Policy,
    PolicyResult,
    find_generalists,
    learned_on,
    pace,
    results_of,
)
from eval.unseen.record import (
    RECORD,
    SCORES,
    VERSION,
    estimated_anew,
    kept_rows,
    read_record,
    with_kept_rows,
)
from eval.unseen.scene_scores import SceneScores, key_of
from eval.unseen.scores import HARD, detours
from eval.unseen.throughput import throughput
from irs_gym.datasets.cache import cache_folder
from irs_gym.files import write_file

GALLERY = ("planner_ppo", "unet_ppo", "unet", "explorer", "local_ppo")

TrackFacts = Mapping[Track, Mapping[str, SetFacts]]
"""What each track is scored on, by the names of the sets."""


def main(
    folder: Annotated[Positional[Path | None], arg(metavar="[DIR]", help_behavior_hint="")] = None,
    out: Path = Path("docs"),
    num_scenes: int = 1000,
    local_scenes: int = 1000,
    jobs: int = 2,
    kept: Path | None = None,
    trained_by: str | None = None,
    keep_rows: bool = False,
    drop_rows: tuple[str, ...] = (),
) -> int:
    """Write generalisation.md, its data and its figures from all runs over many scenes below a
    folder, and from the models that come with the package.

    What a policy does on a set of scenes is kept, by the checksums of both, so that a call that was
    interrupted goes on, and one with some new runs plays these alone.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth; none: the models that come with the package alone.
    out
        Folder of the page.
    num_scenes
        Scenes of each set in the map track, from the first on; all where there are no more.
    local_scenes
        The same in the local track, where every step costs a plan.
    jobs
        Processes that play at a time.
    kept
        Folder of what was played; by default, one in the user's cache.
    trained_by
        The commands that trained the runs, to stand on the page, separated by semicolons.
    keep_rows
        Keep the rows of the page in --out that no run below the folder is of. They must be of the
        same scenes.
    drop_rows
        Names of rows that are not kept all the same, such as those of a network of old.
    """
    try:
        if min(num_scenes, local_scenes, jobs) < 1:
            given = f"num_scenes={num_scenes}, local_scenes={local_scenes} and jobs={jobs}"
            raise ValueError(f"{given} must be 1 or more")

        runs, left_out = ([], []) if folder is None else find_generalists(folder)
        if folder is not None and not runs:
            raise ValueError(f"no complete run over many scenes lies below {str(folder)!r}")

        torch.set_num_threads(1)  # more wait for each other
        sizes: dict[Track, int] = {"map": num_scenes, "local": local_scenes}
        facts = facts_of(sizes)
        shown: TrackFacts = {
            track: {name: facts[name, scenes_of(name, size)] for name in PAGE_SETS}
            for track, size in sizes.items()
        }
        if drop_rows and not keep_rows:
            raise ValueError(f"drop_rows={drop_rows} needs keep_rows: otherwise no row is kept")
        if keep_rows:  # what cannot be kept is told before anything is played
            before = read_record(out / RECORD), SceneScores.read(out / SCORES)
            _drop(before[0], drop_rows)
            algorithms = {run.config.algorithm for run in runs}
            kept_rows(before[0], _sets_record(shown), lambda row: row["algorithm"] in algorithms)

        policies = policies_of(runs)
        trials = [each for policy in policies for each in policy.trials(sizes, facts).values()]
        found = play_all(trials, facts, _folder_of(kept), jobs, "playing")

        entrants, damaged = results_of(policies, sizes, facts, found)
        left_out += damaged
        if runs and not any(each.runs for each in entrants):
            reasons = "".join(f"\n  {each.folder}: {each.reason}" for each in left_out)
            raise ValueError(f"no run below {str(folder)!r} can be played{reasons}")

        record, scores = record_of(entrants, left_out, shown)
        record["commands"] = [*(trained_by or "").split("; "), *commands_of("generalisation", None)]
        record["playing"] = playing_seconds(policies, found)
        if keep_rows:
            record, scores = with_kept_rows(record, scores, *before)
        record["earlier"] = earlier_of(out / RECORD, record)
        record = estimated_anew(record, scores)
        figures = {
            "scenes.png": draw_scenes_curve(record),
            "gallery.png": gallery(entrants),
        }
        write(record, figures, out)
        scores.write(out / SCORES)
    except (OSError, ValueError) as error:
        print(f"python -m eval generalisation: {error}", file=sys.stderr)
        return 2

    tell_left_out(left_out)
    played = sum(len(each.runs) for each in entrants)
    print(f"{played} runs, {len(left_out)} left out; written: {out / 'generalisation.md'}")

    return 0


def _drop(record: dict[str, Any], names: tuple[str, ...]) -> None:
    """Take rows of these names out of the data of a page; a ``ValueError`` where there is none."""
    there = [each["name"] for each in record["entrants"] if each["is_run"]]
    for name in names:
        if name not in there:
            raise ValueError(f"drop_rows: {name!r} must be one of the rows of runs {there}")

    record["entrants"] = [each for each in record["entrants"] if each["name"] not in names]


def facts_of(sizes: Mapping[Track, int]) -> dict[tuple[str, int], SetFacts]:
    """Of all sets in the numbers of scenes that the tracks play."""
    asked = [(name, scenes_of(name, size)) for name in PAGE_SETS for size in sizes.values()]
    return {each: SetFacts.of(page_scene_set(*each)) for each in dict.fromkeys(asked)}


def policies_of(runs: Sequence[Any]) -> list[Policy]:
    """All that stands on the page: runs, models of ``models/`` that are none of those that play all
    sets, and references.
    """
    played = [Policy.of_run(run) for run in runs]
    seeds = {each.model for each in played if each.sets == list(PAGE_SETS)}
    pretrained = [Policy.of_pretrained(each) for each in Models.read(MODELS).generalists]
    references = [Policy.of_reference(name) for name in PAGE_REFERENCES]

    return [*played, *(each for each in pretrained if each.model not in seeds), *references]


def _folder_of(kept: Path | None) -> Path | None:
    if kept is not None:
        return kept

    cache = cache_folder()
    return None if cache is None else cache / "played"


def write(record: dict[str, Any], figures: dict[str, bytes], out: Path) -> None:
    """Write the figures, the data and the page."""
    write_pictures(out / FIGURES, figures)
    data = json.dumps(record, indent=1, allow_nan=False) + "\n"
    write_file(out / RECORD, data.encode())
    write_file(out / "generalisation.md", unseen_page(record, FIGURES).encode())


def record_of(
    entrants: Sequence[PolicyResult], left_out: Sequence[LeftOut], facts: TrackFacts
) -> tuple[dict[str, Any], SceneScores]:
    """What the page tells, as JSON holds it, but for its figures, and the scores that these come
    from.
    """
    told = [_entrant_record(each, facts[each.track]) for each in entrants]
    tables = {
        key_of(record): {name: each.table(name, lambda one: one.spl) for name in each.episodes}
        for record, each in zip(told, entrants, strict=True)
    }
    record = {
        "format_version": VERSION,
        "hard": HARD,
        "sets": _sets_record(facts),
        "entrants": told,
        "left_out": [{"folder": each.folder, "reason": each.reason} for each in left_out],
        "throughput": throughput(),
        **origins([run for each in entrants for run in each.runs]),
    }

    return record, SceneScores.of(tables, facts)


def earlier_of(file: Path, record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Earlier runs on the page that is there, whose files are gone: of algorithms that this record
    has no runs of.
    """
    if not file.exists():
        return []

    kept = read_record(file)
    run_anew = {each["algorithm"] for each in record["entrants"] if each["is_run"]}

    return [each for each in kept.get("earlier", ()) if each["algorithm"] not in run_anew]


def playing_seconds(policies: Sequence[Policy], found: Found) -> dict[str, float]:
    """Seconds on one core that all episodes took when they were played, by track."""
    tracks = {each.source: each.track for each in policies}
    seconds = {"map": 0.0, "local": 0.0}
    for trial, outcome in found.items():
        if isinstance(outcome, Episodes):
            seconds[tracks[trial.policy]] += outcome.seconds

    return seconds


def gallery(entrants: Sequence[PolicyResult]) -> bytes:
    """Four test scenes of one policy in a row: two long detours that it mastered, and its two
    worst.
    """
    sceneries = []
    shown = [
        next((each for each in entrants if each.algorithm == name and not each.family), None)
        for name in GALLERY
    ]

    for each in shown:
        if each is None:
            continue

        spl = each.episodes["test"][0].spl
        pool = page_scene_set("test", len(spl))
        policy = (
            each.runs[0].load_model()
            if each.runs
            else load_pretrained(each.algorithm, scenes=pool).policy
        )
        observation = observation_of(each.algorithm)
        env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=pool, observation=observation)

        for n in choose_scenes(spl, detours(pool)):
            episode = roll_out(policy, env, options={"scene_id": n})
            inner: Any = env.unwrapped
            sceneries.append(
                Scenery(each.name, pool.names[n], inner.world, episode, inner.oracle.cells)
            )

    return draw_gallery(sceneries)


def _sets_record(facts: TrackFacts) -> dict[str, Any]:
    return {
        track: {
            name: {
                "scenes": len(each),
                "cells": list(each.shape),
                "hard": int(each.is_hard.sum()),
                "longest": float(each.oracle_distance.max()),
            }
            for name, each in some.items()
        }
        for track, some in facts.items()
    }


def _entrant_record(entrant: PolicyResult, facts: Mapping[str, SetFacts]) -> dict[str, Any]:
    return {
        "algorithm": entrant.algorithm,
        "name": entrant.name,
        "group": entrant.group,
        "track": entrant.track,
        "training_scenes": entrant.scenes,
        "split": entrant.split,
        "learned_on": None if entrant.split is None else learned_on(entrant.split),
        "family": entrant.family,
        "is_run": bool(entrant.runs),
        "seeds": list(entrant.seeds),
        "models": list(entrant.models),
        **_pace(entrant),
        "paper": _paper(entrant, facts["paper"]) if "paper" in entrant.episodes else None,
    }


def _paper(entrant: PolicyResult, facts: SetFacts) -> list[dict[str, Any]]:
    """The paper's scene at each of its targets: seeds that reached the goal, and the mean ratio of
    these.
    """

    def at_target(n: int) -> dict[str, Any]:
        won: list[SceneSetResults] = [
            each for each in entrant.episodes["paper"] if each.is_success[n]
        ]
        ratios = [float(each.ratios[n]) for each in won]
        return {
            "target_db": float(facts.target_db[n]),
            "successes": len(won),
            "exact": sum(ratio <= 1.0 + TOLERANCE for ratio in ratios),
            "of": len(entrant.episodes["paper"]),
            "ratio": float(np.mean(ratios)) if ratios else None,
        }

    return [at_target(n) for n in range(len(facts))]


def _pace(entrant: PolicyResult) -> dict[str, float | None]:
    """Medians over runs, tests included: seconds, and steps a second; in imitation of whole maps,
    scenes a second.
    """
    if not entrant.runs:
        return {"steps_per_second": None, "seconds": None}

    steps, seconds = np.array([pace(run) for run in entrant.runs]).T
    return {
        "steps_per_second": float(np.median(steps / seconds)),
        "seconds": float(np.median(seconds)),
    }
