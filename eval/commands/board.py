"""`python -m eval board`: all runs below a folder on one scoreboard, with the references and every
run left out.
"""

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.progress import track
from tyro.conf import Positional, arg

from agents.registry import specialists
from agents.rollout.episode import EpisodeResult, evaluation_env
from agents.runs import provenance
from agents.runs.problem import Problem
from agents.runs.run_folder import Run
from eval import statistics
from eval.markdown import printable
from eval.scoreboard.learning_curves import draw_curves
from eval.scoreboard.overlay import draw_path_overlay
from eval.scoreboard.page import markdown
from eval.scoreboard.report import html
from eval.scoreboard.results import Group, LeftOut, Result, find_runs, read_results
from eval.scoreboard.seed_scores import (
    SeedScores,
    finite,
    group_names,
    learned,
    overall,
    references,
)
from irs_gym.files import write_file

FIGURES = "figures/scoreboard"


def main(
    folder: Annotated[Positional[Path], arg(metavar="DIR", help_behavior_hint="")],
    out: Path | None = None,
    model: Literal["best", "last"] = "best",
    episodes: int = 100,
    seed: int = 0,
    trained_by: str | None = None,
) -> int:
    """Put all runs below a folder on one scoreboard, beside the reference policies.

    Writes report.html, one page that holds everything, and into OUT board.json, scoreboard.md and
    its figures.

    Parameters
    ----------
    folder
        Folder with run folders, at any depth; report.html is written there.
    out
        Folder of the other files; by default the same.
    model
        Whether the best or the last state of each agent is scored.
    episodes
        Episodes of each random policy.
    seed
        Seed of the random policies.
    trained_by
        The command that trained the runs, to stand on the page.
    """
    out = out or folder

    try:
        if episodes < 1:
            raise ValueError(f"episodes={episodes} must be 1 or more")

        results, left_out = read_results(
            track(find_runs(folder), "reading runs", transient=True), model
        )
        if not results:
            reasons = "".join(f"\n  {each.folder}: {each.reason}" for each in left_out)
            raise ValueError(f"no complete run lies below {str(folder)!r}{reasons}")

        board, pictures = build(results, left_out, episodes, seed)
        board["commands"] = commands_of("board", trained_by)
        write(board, pictures, folder, out)
    except (OSError, ValueError) as error:
        print(f"python -m eval board: {error}", file=sys.stderr)
        return 2

    for each in left_out:
        print(f"left out: {each.folder}: {each.reason}", file=sys.stderr)

    print(
        f"{len(results)} runs, {len(left_out)} left out; written: {folder / 'report.html'}, {out / 'scoreboard.md'}"
    )

    return 0


def commands_of(name: str, trained_by: str | None) -> list[str]:
    """The commands that made a page: the one that trained, where it is known, and this call of
    `python -m eval`.
    """
    own = printable(shlex.join(["python", "-m", "eval", name, *sys.argv[2:]]))
    return [trained_by, own] if trained_by else [own]


def origins(runs: Sequence[Run]) -> dict[str, Any]:
    """Versions and commits that runs were trained with, each once, and those that score them."""
    manifests = [run.manifest for run in runs]
    return {
        "trained_with": _unique([each.versions for each in manifests]),
        "trained_from": _unique([each.commit for each in manifests]),
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }


def build(
    results: Sequence[Result], left_out: Sequence[LeftOut], episodes: int, seed: int
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The scoreboard as JSON holds it, and its pictures by their names."""
    known = {each.group for each in [*results, *left_out] if each.group is not None}
    names = group_names(sorted(known, key=lambda each: (each.problem.order, each.settings)))
    order = {name: n for n, name in enumerate(specialists())}
    groups = sorted(
        names, key=lambda each: (order[each.algorithm], names[each], each.problem.order)
    )
    by_group = {
        group: sorted((each for each in results if each.group == group), key=lambda each: each.seed)
        for group in groups
    }
    problems = []
    pictures = {}

    for problem in sorted(
        {group.problem for group in groups if by_group[group]}, key=lambda each: each.order
    ):
        here = {group: found for group, found in by_group.items() if group.problem == problem}
        first, standings = references(
            next(found[0] for found in here.values() if found), episodes, seed
        )
        standings[1:1] = [
            learned(names[group], found, _missing(left_out, group)) for group, found in here.items()
        ]
        named = {names[group]: found for group, found in here.items() if found}
        drawn = _draw(problem, first["oracle"], named)
        pictures |= drawn
        problems.append(_problem_record(problem, first["oracle"], standings, list(drawn)))

    record = {
        "format_version": 1,
        "confidence": statistics.CONFIDENCE,
        "resamples": statistics.RESAMPLES,
        "episodes": episodes,
        "problems": problems,
        "overall": _overall(by_group, names, len(problems)),
        "settings": {names[group]: group.values for group in groups},
        "runs": [
            _run_record(each, names[group]) for group, found in by_group.items() for each in found
        ],
        "left_out": [_left_out_record(each, names) for each in left_out],
        **origins([each.run for each in results]),
    }

    return record, pictures


def write(board: dict[str, Any], pictures: dict[str, bytes], folder: Path, out: Path) -> None:
    """Write the report into the folder of the runs, all else into ``out``."""
    (out / FIGURES).mkdir(parents=True, exist_ok=True)

    for name, content in pictures.items():
        write_file(out / FIGURES / name, content)

    write_file(out / "board.json", (json.dumps(board, indent=1, allow_nan=False) + "\n").encode())
    write_file(out / "scoreboard.md", markdown(board, FIGURES).encode())
    write_file(folder / "report.html", html(board, pictures).encode())


def _draw(
    problem: Problem, oracle: EpisodeResult, found: dict[str, list[Result]]
) -> dict[str, bytes]:
    """Learning curves of all seeds, and the path of the worst seed of each algorithm."""
    worst = {name: max(results, key=lambda each: each.rank) for name, results in found.items()}
    world = evaluation_env(next(iter(worst.values())).run.task).unwrapped.world  # type: ignore[attr-defined]
    paths = {f"{name}, seed {each.seed}": each.episode for name, each in worst.items()}
    curves = {name: [each.curve for each in results] for name, results in found.items()}

    return {
        f"{problem.slug}-curves.png": draw_curves(curves),
        f"{problem.slug}-paths.png": draw_path_overlay(
            world, {"oracle": oracle, **paths}, dpi=100, in_palette=True
        ),
    }


def _overall(
    by_group: dict[Group, list[Result]], names: dict[Group, str], problems: int
) -> list[dict[str, Any]]:
    by_name: dict[str, list[list[Result]]] = {}
    for group, found in by_group.items():
        if found:
            by_name.setdefault(names[group], []).append(found)

    return [overall(name, found, problems) for name, found in by_name.items()]


def _problem_record(
    problem: Problem, oracle: EpisodeResult, standings: Sequence[SeedScores], figures: Sequence[str]
) -> dict[str, Any]:
    return {
        "label": problem.label,
        "slug": problem.slug,
        "problem": asdict(problem),
        "oracle_distance": oracle.distance,
        "standings": [each.as_json() for each in standings],
        "figures": list(figures),
    }


def _run_record(result: Result, name: str) -> dict[str, Any]:
    episode = result.episode
    curve = result.curve
    return {
        "folder": printable(str(result.run.folder)),
        "problem": result.problem.label,
        "policy": name,
        "seed": result.seed,
        "status": result.run.manifest.status,
        "is_success": episode.is_success,
        "is_optimal": episode.is_optimal,
        "distance": episode.distance,
        "ratio": episode.ratio,
        "spl": episode.spl,
        "soft_spl": episode.soft_spl,
        "refused": episode.refused,
        "steps_to_optimum": finite(result.steps_to_optimum),
        "seconds_to_optimum": finite(result.seconds_to_optimum),
        "steps": curve.steps[-1],
        "seconds": curve.seconds[-1],
    }


def _left_out_record(left_out: LeftOut, names: dict[Group, str]) -> dict[str, Any]:
    group = left_out.group
    known = (
        {"problem": group.problem.label, "policy": names[group]}
        if group
        else {"problem": None, "policy": None}
    )
    return {"folder": left_out.folder, **known, "reason": left_out.reason}


def _missing(left_out: Sequence[LeftOut], group: Group) -> int:
    return sum(each.group == group for each in left_out)


def _unique(items: Sequence[Any]) -> list[Any]:
    return [each for n, each in enumerate(items) if each not in items[:n]]
