"""`python -m eval generalisation`: all runs over many scenes on one page, on scenes that none of
them has seen.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import torch
from tyro.conf import Positional, arg

from agents.registry import observation_of
from agents.rollout.episode import TOLERANCE, roll_out
from agents.rollout.scene_set import SceneSetResults
from agents.runs import provenance
from eval.origin import commands_of, origins
from eval.pictures import write_pictures
from eval.scoreboard.results import LeftOut, tell_left_out
from eval.unseen.gallery import Scenery, choose_scenes, draw_gallery
from eval.unseen.page import FIGURES, draw_scenes_curve, unseen_page
from eval.unseen.policy_results import (
    PolicyResult,
    Track,
    find_generalists,
    pace,
    result_of_reference,
    result_of_runs,
)
from eval.unseen.pretrained_scores import score_pretrained
from eval.unseen.record import DATA_BYTES, SCORES, estimated_anew
from eval.unseen.scene_scores import SceneScores, key_of
from eval.unseen.scores import HARD, detours, paper_scene_set
from eval.unseen.throughput import throughput
from irs_gym.datasets.generator import Difficulty, generate_scene
from irs_gym.datasets.scene_set import SceneSet, build_scene_set, scene_set_of
from irs_gym.files import read_file, write_file

SETS = ("test", "ood-clutter", "ood-irs", "ood-size", "ood-rooms")
PRETRAINED_SET = "ood-rooms"
LARGE = "ood-size"
LARGEST = "160x160"
LARGEST_SCENES = 20
GALLERY = ("planner_ppo", "unet_ppo", "unet", "explorer", "local_ppo")
PAGE_REFERENCES = ("replanning", "untrained_explorer", "greedy", "greedy_margin")

ScenePools = Mapping[Track, Mapping[str, SceneSet]]
"""What each track is scored on, by the names of the sets."""


def main(
    folder: Annotated[Positional[Path | None], arg(metavar="[DIR]", help_behavior_hint="")] = None,
    out: Path = Path("docs"),
    num_scenes: int = 1000,
    local_large_scenes: int = 200,
    jobs: int = 2,
    trained_by: str | None = None,
) -> int:
    """Write generalisation.md, its data and its figures from all runs over many scenes below a
    folder.

    What a run does on a set of scenes is kept in its folder, so that a second call is fast. Without
    a folder, the page stays as it is but for the pretrained models, which are scored anew.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth; none: the runs are those of the page.
    out
        Folder of the page.
    num_scenes
        Scenes of each set, from the first on.
    local_large_scenes
        Scenes of the set of large maps in the local track, where every step costs a plan.
    jobs
        Runs played at a time.
    trained_by
        The commands that trained the runs, to stand on the page, separated by semicolons.
    """
    try:
        if min(num_scenes, local_large_scenes, jobs) < 1:
            given = (
                f"num_scenes={num_scenes}, local_large_scenes={local_large_scenes} and jobs={jobs}"
            )
            raise ValueError(f"{given} must be 1 or more")

        if folder is None:
            rewrite(out, num_scenes)
            print(f"written: {out / 'generalisation.md'}")
            return 0

        runs, left_out = find_generalists(folder)
        if not runs:
            raise ValueError(f"no complete run over many scenes lies below {str(folder)!r}")

        torch.set_num_threads(1)  # of PyTorch in a run: more wait for each other
        large_scenes = min(num_scenes, local_large_scenes)
        pools: ScenePools = {
            "map": page_scene_sets("map", num_scenes, large_scenes),
            "local": page_scene_sets("local", num_scenes, large_scenes),
        }
        entrants, damaged = result_of_runs(runs, pools, jobs, "playing")
        left_out += damaged
        if not entrants:
            reasons = "".join(f"\n  {each.folder}: {each.reason}" for each in left_out)
            raise ValueError(
                f"no run over many scenes below {str(folder)!r} can be played{reasons}"
            )

        entrants += [
            result_of_reference(name, pools["local"], folder / "references")
            for name in PAGE_REFERENCES
        ]
        record, scores = record_of(entrants, left_out, pools)
        record["pretrained"] = _pretrained(num_scenes)
        record["commands"] = [*(trained_by or "").split("; "), *commands_of("generalisation", None)]
        figures = {
            "scenes.png": draw_scenes_curve(record["entrants"]),
            "gallery.png": gallery(entrants, pools),
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


def rewrite(out: Path, num_scenes: int) -> None:
    """Score the pretrained models on scenes of their own set, and put them on the page that is
    there.
    """
    content = read_file(out / "generalisation.json", DATA_BYTES)
    record = json.loads(content)
    record["pretrained"] = _pretrained(num_scenes)
    write(record, {}, out)


def _pretrained(num_scenes: int) -> dict[str, Any]:
    torch.set_num_threads(1)
    scores = score_pretrained(PRETRAINED_SET, build_scene_set(PRETRAINED_SET, num_scenes))
    return {**scores, "commit": provenance.commit()}


def write(record: dict[str, Any], figures: dict[str, bytes], out: Path) -> None:
    """Write the figures, the data and the page."""
    write_pictures(out / FIGURES, figures)
    data = json.dumps(record, indent=1, allow_nan=False) + "\n"
    write_file(out / "generalisation.json", data.encode())
    write_file(out / "generalisation.md", unseen_page(record, FIGURES).encode())


def page_scene_sets(track: Track, num_scenes: int, local_large_scenes: int) -> dict[str, SceneSet]:
    """The sets that a track is scored on."""
    sizes = dict.fromkeys(SETS, num_scenes)
    if track == "local":
        sizes[LARGE] = local_large_scenes

    found = {name: build_scene_set(name, size) for name, size in sizes.items()}
    if track == "map":
        found[LARGEST] = largest_scene_set(min(LARGEST_SCENES, num_scenes))

    return {**found, "paper": paper_scene_set()}


@lru_cache(maxsize=1)
def largest_scene_set(scenes: int) -> SceneSet:
    """Scenes of four times the usual sides, with as many boxes for the area: maps of 112 to 160
    cells a side.
    """
    level = Difficulty(sides=(56.0, 80.0), boxes=(48, 192))
    drawn = [generate_scene(np.random.default_rng([160, n]), level) for n in range(scenes)]
    return scene_set_of(drawn, [f"large-{n}" for n in range(scenes)], frame=(160, 160))


def record_of(
    entrants: Sequence[PolicyResult], left_out: Sequence[LeftOut], pools: ScenePools
) -> tuple[dict[str, Any], SceneScores]:
    """All that the page tells, as JSON holds it, and the scores that its figures come from."""
    told = [_entrant_record(each, pools[each.track]) for each in entrants]
    tables = {
        key_of(record): {name: each.table(name, lambda one: one.spl) for name in each.episodes}
        for record, each in zip(told, entrants, strict=True)
    }
    scores = SceneScores.of(tables, pools)
    record = {
        "format_version": 1,
        "hard": HARD,
        "sets": {
            track: {name: _set_record(pool) for name, pool in some.items()}
            for track, some in pools.items()
        },
        "entrants": told,
        "left_out": [{"folder": each.folder, "reason": each.reason} for each in left_out],
        "throughput": throughput(),
        **origins([run for each in entrants for run in each.runs]),
    }

    return estimated_anew(record, scores), scores


def gallery(entrants: Sequence[PolicyResult], pools: ScenePools) -> bytes:
    """Four test scenes of one policy in a row: two long detours that it mastered, and its two
    worst.
    """
    sceneries = []
    shown = [next((each for each in entrants if each.algorithm == name), None) for name in GALLERY]

    for each in shown:
        if each is None:
            continue

        pool = pools[each.track]["test"]
        run = each.runs[0]
        policy = run.load_model()
        observation = observation_of(run.config.algorithm)
        env = gymnasium.make("irs_gym:IrsNavRandom-v0", scenes=pool, observation=observation)

        for n in choose_scenes(each.episodes["test"][0].spl, detours(pool)):
            episode = roll_out(policy, env, options={"scene_id": n})
            inner: Any = env.unwrapped
            sceneries.append(
                Scenery(each.name, pool.names[n], inner.world, episode, inner.oracle.cells)
            )

    return draw_gallery(sceneries)


def _set_record(pool: SceneSet) -> dict[str, Any]:
    return {
        "scenes": len(pool),
        "cells": list(pool.shape),
        "hard": int((detours(pool) > HARD).sum()),
    }


def _entrant_record(entrant: PolicyResult, pools: Mapping[str, SceneSet]) -> dict[str, Any]:
    return {
        "algorithm": entrant.algorithm,
        "name": entrant.name,
        "track": entrant.track,
        "training_scenes": entrant.scenes,
        "seeds": entrant.seeds,
        "models": [run.manifest.models["best"].sha256 for run in entrant.runs],
        **_pace(entrant),
        "paper": _paper(entrant, pools["paper"]) if "paper" in entrant.episodes else None,
    }


def _paper(entrant: PolicyResult, pool: SceneSet) -> list[dict[str, Any]]:
    """The paper's scene at each of its targets: seeds that reached the goal, and the mean ratio of
    these.
    """

    def at_target(n: int) -> dict[str, Any]:
        won: list[SceneSetResults] = [
            each for each in entrant.episodes["paper"] if each.is_success[n]
        ]
        ratios = [float(each.ratios[n]) for each in won]
        return {
            "target_db": float(pool.target_db[n]),
            "successes": len(won),
            "exact": sum(ratio <= 1.0 + TOLERANCE for ratio in ratios),
            "of": len(entrant.episodes["paper"]),
            "ratio": float(np.mean(ratios)) if ratios else None,
        }

    return [at_target(n) for n in range(len(pool))]


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
