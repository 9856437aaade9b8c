"""`python -m eval pretrain`: fills models/ with the best run of each algorithm on each problem."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from rich.console import Console
from rich.progress import track
from rich.table import Table
from tyro.conf import Positional, arg

from agents.registry import ALGORITHMS, generalists, specialists
from agents.rollout.episode import arguments_of
from agents.runs.manifest import GeneralistEntry
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
from eval.scoreboard.results import Result, find_runs, read_results, tell_left_out
from eval.unseen.policy_results import family_left_out, find_generalists
from irs_gym.radio.scene import scene_names

if TYPE_CHECKING:
    Kept = str
else:
    # Those of one scene, then our own networks, then those of Stable-Baselines3; no tables,
    # no mixtures.
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
    scenes; those that a family was left out for are not asked. Other models stay as they are.

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
        runs = [
            run
            for run in runs
            if run.config.algorithm in algorithms and not family_left_out(run.config.env["split"])
        ]
        results, left_out = read_results(track(others, "reading runs", transient=True))
        wanted = [each for each in results if each.config.algorithm in algorithms]
        chosen = choose_results(wanted)
        if not chosen and not runs:
            names = " or ".join(algorithms)
            raise ValueError(f"no complete run of {names} below {str(folder)!r} reached the goal")

        entries = keep_results(chosen, out)
        generalists = keep_generalists(runs, out)
    except (OSError, ValueError) as error:
        print(f"python -m eval pretrain: {error}", file=sys.stderr)
        return 2

    tell_left_out(left_out)
    if entries:
        Console().print(_table(entries, out))

    for entry in generalists:
        score = f"success {entry.success:.3f}, SPL {entry.spl:.4f}"
        rank = f"seed {entry.config.seed}, the best of {entry.chosen_among}"
        print(f"{out / entry.file}: {rank}: {score}")

    return 0


def choose_results(results: Sequence[Result]) -> list[tuple[Result, int]]:
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


def keep_results(chosen: Sequence[tuple[Result, int]], out: Path) -> list[PretrainedEntry]:
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
        entry = _entry(result, count)
        entries.append(entry)
        contents[entry.file] = result.run.read_model()

    kept = Models.read(out)
    others = [each for each in kept.models if each.file not in contents]
    both = sorted([*others, *entries], key=lambda each: (each.config.algorithm, each.problem.order))
    write_models(out, both, contents, kept.generalists)

    for entry in entries:
        _check_kept(entry, out)

    return entries


def _entry(result: Result, chosen_among: int) -> PretrainedEntry:
    manifest = result.run.manifest
    model = manifest.models["best"]
    return PretrainedEntry(
        file=f"{result.config.algorithm}-{result.problem.slug}.npz",
        sha256=model.sha256,
        config=result.config,
        steps=model.steps,
        chosen_among=chosen_among,
        score=PretrainedScore.of(result.episode),
        versions=manifest.versions,
        commit=manifest.commit,
    )


def _check_kept(entry: PretrainedEntry, out: Path) -> None:
    """Play a model from its file; raises ``ValueError`` where it does not do what its run did."""
    arguments = arguments_of(entry.task)
    model: Any = load_pretrained(entry.config.algorithm, folder=out, **arguments)
    found = PretrainedScore.of(model.play())
    if found != entry.score:
        raise ValueError(f"{entry.file} does not do what its run did: {found} is not {entry.score}")


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

    for _, found in sorted(by_algorithm.items()):
        best = max(found, key=_rank)
        best.load_model()  # what does not fit is not kept
        entry = _generalist_entry(best, len(found))
        entries.append(entry)
        contents[entry.file] = best.read_model()

    kept = Models.read(out)
    others = [each for each in kept.generalists if each.file not in contents]
    both = sorted([*others, *entries], key=lambda each: each.config.algorithm)
    write_models(out, kept.models, contents, both)

    return entries


def _generalist_entry(run: Run, chosen_among: int) -> GeneralistPretrainedEntry:
    model = _best_model(run)
    return GeneralistPretrainedEntry(
        file=f"{run.config.algorithm}.npz",
        sha256=model.sha256,
        config=run.config,
        steps=model.steps,
        chosen_among=chosen_among,
        success=model.success,
        spl=model.spl,
        versions=run.manifest.versions,
        commit=run.manifest.commit,
    )


def _rank(run: Run) -> tuple[float, int, int]:
    """Sorts by SPL, then by the number of training scenes, then from the last seed to the first."""
    return _best_model(run).spl, run.config.env["num_scenes"], -run.config.seed


def _best_model(run: Run) -> GeneralistEntry:
    """Of a run that `find_generalists` has found, which has one."""
    return cast("GeneralistEntry", run.manifest.models["best"])


def _table(entries: Sequence[PretrainedEntry], out: Path) -> Table:
    rows = Table(caption=f"written to {out}")
    for column in ("file", "KiB", "seed", "of", "steps", "metres", "ratio"):
        rows.add_column(column, justify="left" if column == "file" else "right")

    for each in entries:
        size = f"{(out / each.file).stat().st_size / 1024:.0f}"
        run = (str(each.config.seed), str(each.chosen_among), f"{each.steps:,}")
        rows.add_row(each.file, size, *run, f"{each.score.distance:.3f}", f"{each.score.ratio:.3f}")

    return rows
