"""`python -m eval pretrain`: fills models/ with the best run of each algorithm on each problem."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.console import Console
from rich.progress import track
from rich.table import Table
from tyro.conf import Positional, arg

from agents.registry import ALGORITHMS, generalists, specialists
from agents.rollout.episode import arguments_of
from agents.runs.pretrained import (
    MODELS,
    GeneralistPretrainedEntry,
    Models,
    PretrainedEntry,
    PretrainedScore,
    load_pretrained,
    write_models,
)
from agents.runs.problem import Problem
from agents.runs.run_folder import Run
from eval.scoreboard.results import Result, find_runs, read_results
from eval.unseen.policy_results import find_generalists
from irs_gym.radio.scene import scene_names

if TYPE_CHECKING:
    Kept = str
else:
    # Those of one scene, then our own networks, then those of Stable-Baselines3; no tables.
    Kept = Literal[
        *(name for name in specialists() if ALGORITHMS[name].is_sb3),
        *(name for name in generalists() if ALGORITHMS[name].is_taught),
        *(name for name in generalists() if ALGORITHMS[name].is_sb3),
    ]


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path = MODELS,
    algorithms: tuple[Kept, ...] = (
        "ppo",
        "dqn",
        "planner",
        "planner_ppo",
        "unet",
        "unet_ppo",
        "explorer",
        "explorer_ppo",
    ),
) -> int:
    """Keep the best policy of each algorithm on each problem among all runs below a folder.

    Best is the shortest path, then the fewest steps to the optimum; of agents that learned on many
    scenes, the greatest SPL on the scenes that they were tested on, and of equals the most training
    scenes. Other models stay as they are.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth.
    out
        Folder of the models and their manifest.
    algorithms
        Algorithms whose models are kept.
    """
    try:
        runs, _ = find_generalists(folder)
        known = {run.folder for run in runs}
        others = [each for each in find_runs(folder) if each not in known]
        runs = [run for run in runs if run.config.algorithm in algorithms]
        results, left_out = read_results(track(others, "reading runs", transient=True))
        chosen = choose([each for each in results if each.config.algorithm in algorithms])
        if not chosen and not runs:
            raise ValueError(
                f"no complete run of {' or '.join(algorithms)} below {str(folder)!r} reached the goal"
            )

        entries = keep(chosen, out)
        generalists = keep_generalists(runs, out)
    except (OSError, ValueError) as error:
        print(f"python -m eval pretrain: {error}", file=sys.stderr)
        return 2

    for each in left_out:
        print(f"left out: {each.folder}: {each.reason}", file=sys.stderr)

    if entries:
        Console().print(_table(entries, out))

    for each in generalists:
        place = f"the best of {each.chosen_among}: success {each.success:.3f}, SPL {each.spl:.4f}"
        print(f"{out / each.file}: seed {each.config.seed}, {place}")

    return 0


def choose(results: Sequence[Result]) -> list[tuple[Result, int]]:
    """The best successful result of each algorithm on each problem, and how many runs it was chosen
    among.

    Raises
    ------
    ValueError
        Where one was trained on a scene or map of the user's own, which ``models/`` does not hold.
    """
    pairs: dict[tuple[Problem, str], list[Result]] = {}

    for each in results:
        pairs.setdefault((each.problem, each.config.algorithm), []).append(each)

    best = [(min(found, key=lambda each: each.rank), len(found)) for found in pairs.values()]
    best = [(each, count) for each, count in best if each.episode.is_success]
    own = [str(each.run.folder) for each, _ in best if each.problem.scene not in scene_names()]
    if own:
        raise ValueError(
            f"{own[0]!r} was trained on a scene or map of its own, which models/ does not hold"
        )

    return sorted(best, key=lambda pair: (pair[0].config.algorithm, pair[0].problem.order))


def keep(chosen: Sequence[tuple[Result, int]], out: Path) -> list[PretrainedEntry]:
    """Write the models and their manifest, and play each from its file; returns the entries
    written.

    Raises
    ------
    OSError
        Where a file cannot be written.
    ValueError
        Where a model that was written does not do what the run's did.
    """
    entries = []
    contents = {}

    for result, count in chosen:
        manifest = result.run.manifest
        content = result.run.read_model()
        entry = PretrainedEntry(
            file=f"{result.config.algorithm}-{result.problem.slug}.npz",
            sha256=manifest.models["best"].sha256,
            config=result.config,
            steps=manifest.models["best"].steps,
            chosen_among=count,
            score=PretrainedScore.of(result.episode),
            versions=manifest.versions,
            commit=manifest.commit,
        )
        entries.append(entry)
        contents[entry.file] = content

    replaced = set(contents)
    others = [each for each in Models.read(out).models if each.file not in replaced]
    both = sorted([*others, *entries], key=lambda each: (each.config.algorithm, each.problem.order))
    write_models(out, both, contents, Models.read(out).generalists)

    for entry in entries:
        found = load_pretrained(
            entry.config.algorithm, folder=out, **arguments_of(entry.task)
        ).play()
        if PretrainedScore.of(found) != entry.score:
            raise ValueError(
                f"{entry.file} does not do what its run did: {PretrainedScore.of(found)} is not {entry.score}"
            )

    return entries


def keep_generalists(runs: Sequence[Run], out: Path) -> list[GeneralistPretrainedEntry]:
    """Write the best model of each algorithm over many scenes, and the manifest; returns the
    entries written.

    Raises
    ------
    OSError
        Where a file cannot be written.
    ValueError
        Where a model is damaged or does not fit its configuration.
    """
    by_algorithm: dict[str, list[Run]] = {}

    for run in runs:
        by_algorithm.setdefault(run.config.algorithm, []).append(run)

    entries = []
    contents = {}

    for algorithm, found in sorted(by_algorithm.items()):
        best = max(found, key=_rank)
        best.load_model()  # what does not fit is not kept
        manifest = best.manifest
        content = best.read_model()
        model = manifest.models["best"]
        entries.append(
            GeneralistPretrainedEntry(
                file=f"{algorithm}.npz",
                sha256=model.sha256,
                config=best.config,
                steps=model.steps,
                chosen_among=len(found),
                success=model.success,
                spl=model.spl,
                versions=manifest.versions,
                commit=manifest.commit,
            )
        )
        contents[f"{algorithm}.npz"] = content

    kept = Models.read(out)
    others = [each for each in kept.generalists if each.file not in contents]
    both = sorted([*others, *entries], key=lambda each: each.config.algorithm)
    write_models(out, kept.models, contents, both)

    return entries


def _rank(run: Run) -> tuple[float, int, int]:
    """Sorts by SPL, then by the number of training scenes, then from the last seed to the first."""
    return run.manifest.models["best"].spl, run.config.env["num_scenes"], -run.config.seed


def _table(entries: Sequence[PretrainedEntry], out: Path) -> Table:
    rows = Table(caption=f"written to {out}")
    for column in ("file", "KiB", "seed", "of", "steps", "metres", "ratio"):
        rows.add_column(column, justify="left" if column == "file" else "right")

    for each in entries:
        size = f"{(out / each.file).stat().st_size / 1024:.0f}"
        run = (str(each.config.seed), str(each.chosen_among), f"{each.steps:,}")
        rows.add_row(each.file, size, *run, f"{each.score.distance:.3f}", f"{each.score.ratio:.3f}")

    return rows
