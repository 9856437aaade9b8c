"""`build_board`: all results on one scoreboard, as JSON holds it, and its pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from agents.registry import specialists
from agents.rollout.episode import EpisodeResult, evaluation_env
from agents.runs.problem import Problem
from eval import statistics
from eval.estimates import finite
from eval.markdown import printable
from eval.origin import origins
from eval.scoreboard.learning_curves import draw_curves
from eval.scoreboard.overlay import draw_path_overlay, map_of
from eval.scoreboard.page import BANDS
from eval.scoreboard.results import Group, LeftOut, Result
from eval.scoreboard.seed_scores import (
    SeedScores,
    episode_record,
    group_names,
    learned,
    overall,
    references,
)


def build_board(
    results: Sequence[Result], left_out: Sequence[LeftOut], episodes: int, seed: int
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The scoreboard as JSON holds it, and its pictures by their names.

    ``episodes`` and ``seed`` are those of the random reference policies.
    """
    names = _names(results, left_out)
    by_group = _by_group(results, names)
    problems = sorted(
        {group.problem for group, found in by_group.items() if found}, key=lambda each: each.order
    )
    runs = {
        group: [_run_record(each, names[group]) for each in found]
        for group, found in by_group.items()
    }
    records = []
    pictures: dict[str, bytes] = {}

    for problem in problems:
        here = {group: found for group, found in by_group.items() if group.problem == problem}

        # the oracle first, then the algorithms, then the other references
        any_result = next(found[0] for found in here.values() if found)
        first, standings = references(any_result, episodes, seed)
        standings[1:1] = [
            learned(names[group], runs[group], _missing(left_out, group)) for group in here
        ]

        named = {names[group]: found for group, found in here.items() if found}
        drawn = _draw(problem, first["oracle"], named)
        pictures |= drawn
        records.append(_problem_record(problem, first["oracle"], standings, list(drawn)))

    board = {
        "format_version": 1,
        "confidence": statistics.CONFIDENCE,
        "bands": BANDS,
        "episodes": episodes,
        "problems": records,
        "overall": _overall(runs, names, len(problems)),
        "settings": {names[group]: group.values for group in by_group},
        "runs": [each for rows in runs.values() for each in rows],
        "left_out": [_left_out_record(each, names) for each in left_out],
        **origins([each.run for each in results]),
    }

    return board, pictures


def _names(results: Sequence[Result], left_out: Sequence[LeftOut]) -> dict[Group, str]:
    """Names of all groups, those included whose runs are all left out."""
    known = {each.group for each in results}
    known |= {each.group for each in left_out if each.group is not None}
    return group_names(sorted(known, key=lambda each: (each.problem.order, each.settings)))


def _by_group(results: Sequence[Result], names: Mapping[Group, str]) -> dict[Group, list[Result]]:
    """Results of each group by their seeds; the groups in the order of their algorithms."""
    order = {name: n for n, name in enumerate(specialists())}
    groups = sorted(
        names, key=lambda each: (order[each.algorithm], names[each], each.problem.order)
    )
    return {
        group: sorted((each for each in results if each.group == group), key=lambda each: each.seed)
        for group in groups
    }


def _draw(
    problem: Problem, oracle: EpisodeResult, found: Mapping[str, Sequence[Result]]
) -> dict[str, bytes]:
    """Learning curves of all seeds, and the path of the worst seed of each algorithm."""
    worst = {name: max(results, key=lambda each: each.rank) for name, results in found.items()}
    env = evaluation_env(next(iter(worst.values())).run.task)
    paths = {f"{name}, seed {each.seed}": each.episode for name, each in worst.items()}
    curves = {name: [each.curve for each in results] for name, results in found.items()}

    return {
        f"{problem.slug}-curves.png": draw_curves(curves),
        f"{problem.slug}-paths.png": draw_path_overlay(
            map_of(env), {"oracle": oracle, **paths}, dpi=100, in_palette=True
        ),
    }


def _overall(
    runs: Mapping[Group, list[dict[str, Any]]], names: Mapping[Group, str], problems: int
) -> list[dict[str, Any]]:
    """What each name did over all of its problems."""
    by_name: dict[str, list[list[dict[str, Any]]]] = {}

    for group, rows in runs.items():
        if rows:
            by_name.setdefault(names[group], []).append(rows)

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
        **episode_record(episode),
        "distance": episode.distance,
        "steps_to_optimum": finite(result.steps_to_optimum),
        "seconds_to_optimum": finite(result.seconds_to_optimum),
        "steps": curve.steps[-1],
        "seconds": curve.seconds[-1],
    }


def _left_out_record(left_out: LeftOut, names: Mapping[Group, str]) -> dict[str, Any]:
    group = left_out.group
    return {
        "folder": left_out.folder,
        "problem": group.problem.label if group else None,
        "policy": names[group] if group else None,
        "reason": left_out.reason,
    }


def _missing(left_out: Sequence[LeftOut], group: Group) -> int:
    """How many runs of a group are left out."""
    return sum(each.group == group for each in left_out)
