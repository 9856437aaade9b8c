"""`python -m eval score`: a run's policy beside the reference policies, as a table, as JSON and as
a picture.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from tyro.conf import Positional, arg

from agents.rollout.episode import evaluation_env
from agents.runs import provenance
from agents.runs.run_folder import Run
from agents.single.mixture import Mixture
from eval.estimates import finite
from eval.scoreboard.expected_cost import expectation
from eval.scoreboard.overlay import draw_path_overlay, map_of
from eval.scoreboard.results import LeftOut
from eval.scoreboard.score import PolicyScore, play_references, score
from eval.unseen.scores import (
    Player,
    player_of,
    run_or_player,
    scene_sets_of,
    score_unseen,
    unseen_table,
    write_unseen,
)
from irs_gym.datasets.generator import CELL_SIZE
from irs_gym.datasets.scene_set import SceneSet
from irs_gym.files import write_file

SplitName = Literal[
    "train",
    "val",
    "test",
    "ood-clutter",
    "ood-irs",
    "ood-size",
    "ood-rooms",
    "ood-maze",
    "ood-doors",
    "ood-spiral",
    "ood-zigzag",
    "ood-trap",
    "ood-racks",
    "ood-hall",
    "ood-aps",
]


def main(
    runs: Annotated[
        Positional[tuple[str, ...]], arg(metavar="RUN|MODEL [...]", help_behavior_hint="")
    ],
    model: Literal["best", "last"] = "best",
    episodes: int = 100,
    seed: int = 0,
    env: Literal["IrsNav-v0", "IrsNavRandom-v0"] | None = None,
    split: tuple[SplitName, ...] = ("test",),
    num_scenes: int = 1000,
    scenes: Path | None = None,
    cell_size: float = CELL_SIZE,
) -> int:
    """Score runs against the oracle.

    Agents of one task play it from its fixed start: scores.json and paths.png are written into each
    run folder. Agents that learned on many scenes play scenes that they have never seen, and the
    paper's: unseen.json is written into each run folder.

    Parameters
    ----------
    runs
        Run folders; for unseen scenes also pretrained models (planner, explorer ...), their files,
        and reference policies (oracle, untrained_planner, replanning, untrained_explorer, greedy,
        greedy_margin).
    model
        Whether the best or the last state of the agent is scored.
    episodes
        Episodes of each random policy.
    seed
        Seed of the random policies.
    env
        What is played; by default that which the run learned in.
    split
        Sets of unseen scenes.
    num_scenes
        Scenes of each set, from the first on.
    scenes
        Folder of scene files to play in place of those sets; each says its own target.
    cell_size
        Metres: edge of a cell of the maps of unseen scenes.
    """
    if not runs or episodes < 1 or not split:
        print(
            "python -m eval score: name one run folder or more, 1 episode or more, and a split",
            file=sys.stderr,
        )
        return 2

    left_out: list[LeftOut] = []
    try:
        opened = _opened(runs, left_out)
        if env == "IrsNav-v0" and any(isinstance(each, Player) for each in opened.values()):
            raise ValueError(
                "env='IrsNav-v0' plays run folders alone, with all reference policies beside them"
            )

        unseen = {
            name for name, each in opened.items() if _is_unseen(each, env, scenes is not None)
        }
        scene_sets = scene_sets_of(split, num_scenes, scenes, cell_size) if unseen else {}
    except (OSError, ValueError) as error:
        print(f"python -m eval score: {error}", file=sys.stderr)
        return 2

    for name, each in opened.items():
        try:
            if isinstance(each, Player):
                score_player(each, scene_sets)
            elif name in unseen:
                score_generalist(each, model, scene_sets)
            else:
                score_run(each, model, episodes, seed)
        except Exception as error:  # a damaged run may raise any, and keeps no other from a score
            left_out.append(LeftOut.of(Path(name), error))

    for out in left_out:
        print(f"python -m eval score: {out.folder}: {out.reason}", file=sys.stderr)

    return 2 if left_out else 0


def _is_unseen(each: Run | Player, env: str | None, has_scenes: bool) -> bool:
    """Whether it plays scenes that it did not learn on."""
    if isinstance(each, Player):
        return True
    if env is None and not has_scenes:
        return each.is_generalist

    return env != "IrsNav-v0"


def _opened(names: Sequence[str], left_out: list[LeftOut]) -> dict[str, Run | Player]:
    """What can be opened of runs and players by their names; the others join those left out."""
    opened = {}

    for name in names:
        try:
            opened[name] = run_or_player(name)
        except Exception as error:
            left_out.append(LeftOut.of(Path(name), error))

    return opened


def score_run(run: Run, model: str, episodes: int, seed: int) -> list[PolicyScore]:
    """Score one run: prints the table, writes ``scores.json`` and ``paths.png``, and returns the
    table's rows.

    Raises
    ------
    OSError
        Where a file of the run cannot be read, or the results cannot be written.
    ValueError
        Where the run is damaged; the message names the file.
    """
    env = evaluation_env(run.task)
    policy = run.load_model(model)
    played = play_references(env, {run.config.algorithm: policy}, episodes, seed)
    scores = [score(name, each) for name, each in played.items()]
    entry = run.manifest.models[model]
    learned = played[run.config.algorithm][0]

    expected: dict[str, Any] = {}
    if isinstance(policy, Mixture):
        task: Any = run.task  # of one scene, which holds a budget
        cost, distance = expectation(policy, task)
        found = {"cost": finite(cost), "distance": finite(distance), "bound": task.budget}
        expected = {"expected": {**found, "shares": policy.shares.tolist()}}

    record = {
        "format_version": 1,
        "model": {"name": model, **entry.model_dump()},
        "config": run.config.model_dump(),
        "oracle_distance": learned.oracle_distance,
        "scores": [asdict(each) for each in scores],
        **expected,
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }
    data = json.dumps(record, indent=2, allow_nan=False) + "\n"
    write_file(run.folder / "scores.json", data.encode())

    paths = {"oracle": played["oracle"][0], run.config.algorithm.upper(): learned}
    world = map_of(env)
    write_file(run.folder / "paths.png", draw_path_overlay(world, paths))

    print(f"{run.folder}: {model} model, after {entry.steps:,} steps, at {world.target_db:g} dB")
    Console().print(table(scores))
    if expected:
        print(f"expected: cost {cost:.3f} of {task.budget} at most, {distance:.3f} m")

    print(f"written: {run.folder / 'scores.json'} and paths.png beside it")

    return scores


def score_player(player: Player, scene_sets: Mapping[str, SceneSet]) -> None:
    """Score what has no run folder on sets of unseen scenes, and print the table."""
    print(player.name)
    Console().print(unseen_table(score_unseen(player, scene_sets)))


def score_generalist(run: Run, model: str, scene_sets: Mapping[str, SceneSet]) -> None:
    """Score one run on sets of unseen scenes: prints the table and writes ``unseen.json``.

    Raises
    ------
    OSError
        Where a file of the run cannot be read, or the results cannot be written.
    ValueError
        Where the run is damaged, or its policy acts in its own scene alone.
    """
    found = score_unseen(player_of(run, model), scene_sets)
    path = write_unseen(run, model, found)
    print(f"{run.folder}: {model} model, after {run.manifest.models[model].steps:,} steps")
    Console().print(unseen_table(found))
    print(f"written: {path}")


def table(scores: Sequence[PolicyScore]) -> Table:
    """The scores as a table for the terminal."""
    rows = Table(
        caption="metres, ratio to the oracle's: means over successes",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    rows.add_column("policy", no_wrap=True)

    for column in ("episodes", "success", "metres", "ratio", "SPL", "soft-SPL", "refused"):
        rows.add_column(column, justify="right", no_wrap=True)

    for each in scores:
        rows.add_row(
            each.policy.replace("_", " "),
            str(each.episodes),
            f"{each.success:.0%}",
            "–" if each.distance is None else f"{each.distance:.3f}",
            "–" if each.ratio is None else f"{each.ratio:.3f}",
            f"{each.spl:.3f}",
            f"{each.soft_spl:.3f}",
            f"{each.refused:.1f}",
        )

    return rows
