"""`python -m eval score`: a run's policy beside the reference policies, as a table, as JSON and as a picture."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from tyro.conf import Positional, arg

from agents import provenance
from agents.algorithms import GENERALISTS, read_network
from agents.checkpoint import Run
from agents.heuristics import REFERENCES
from agents.policy import Policy
from agents.pool_rollout import play as play_pool
from agents.pretrained import load_pretrained
from agents.rollout import Episode, evaluation_env, roll_out
from eval.overlay import draw_paths
from eval.results import LeftOut
from eval.unseen import REFERENCES as UNSEEN_REFERENCES
from eval.unseen import Player, player_of, pools_of, reference, score_unseen, unseen_table, write_unseen
from irs_gym.files import write_file
from irs_gym.pool import Pool

RANDOM = ("masked_random", "random")  # judged by many episodes; from a fixed start the others always do the same


@dataclass(frozen=True)
class Score:
    """What a policy achieved over its episodes.

    Attributes
    ----------
    success
        Share of the episodes that reached the goal.
    distance, ratio
        Means of the metres travelled, and of these over the oracle's, in the successful episodes; None without any.
    spl, soft_spl
        Success weighted by path length, and the same with progress in place of success: means over all episodes.
    refused, steps
        Means over all episodes of the refused moves and of all moves.
    """

    policy: str
    episodes: int
    success: float
    distance: float | None
    ratio: float | None
    spl: float
    soft_spl: float
    refused: float
    steps: float


def score(policy: str, episodes: Sequence[Episode]) -> Score:
    """Score of the policy of that name from its episodes, one or more."""
    successes = [each for each in episodes if each.is_success]
    return Score(
        policy=policy,
        episodes=len(episodes),
        success=len(successes) / len(episodes),
        distance=_mean([each.distance for each in successes]),
        ratio=_mean([each.distance / each.oracle_distance for each in successes]),
        spl=float(np.mean([each.spl for each in episodes])),
        soft_spl=float(np.mean([each.soft_spl for each in episodes])),
        refused=float(np.mean([each.refused for each in episodes])),
        steps=float(np.mean([each.steps for each in episodes])),
    )


def play(
    env: gymnasium.Env[Any, Any], learned: dict[str, Policy], episodes: int, seed: int
) -> dict[str, list[Episode]]:
    """Episodes of each policy by its name: the oracle's, those of the learned policies, those of the other references.

    ``episodes`` is how many the random policies play; one is enough for all others.
    """
    references = {name: make(env, seed) for name, make in REFERENCES.items()}
    policies = {"oracle": references.pop("oracle"), **learned, **references}
    return {
        name: [roll_out(policy, env) for _ in range(episodes if name in RANDOM else 1)]
        for name, policy in policies.items()
    }


def main(
    runs: Annotated[Positional[tuple[str, ...]], arg(metavar="RUN|MODEL [...]", help_behavior_hint="")],
    model: Literal["best", "last"] = "best",
    episodes: int = 100,
    seed: int = 0,
    env: Literal["IrsNav-v0", "IrsNavRandom-v0"] | None = None,
    split: tuple[Literal["train", "val", "test", "ood-clutter", "ood-irs", "ood-size"], ...] = ("test",),
    num_scenes: int = 1000,
    scenes: Path | None = None,
) -> int:
    """Score runs against the oracle.

    Agents of one task play it from its fixed start: scores.json and paths.png are written into each run folder.
    Agents that learned on many scenes play scenes that they have never seen, and the paper's: unseen.json is written
    into each run folder.

    Parameters
    ----------
    runs
        Run folders; for unseen scenes also pretrained models (planner, explorer ...), their files, and reference
        policies (oracle, replanning, untrained_explorer, greedy, greedy_margin).
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
    """
    if not runs or episodes < 1 or not split:
        print("python -m eval score: name one run folder or more, 1 episode or more, and a split", file=sys.stderr)
        return 2
    left_out: list[LeftOut] = []
    try:
        opened = _opened(runs, left_out)
        is_unseen = [
            isinstance(each, Player) or (each.is_generalist if env is None and scenes is None else env != "IrsNav-v0")
            for each in opened.values()
        ]
        if env == "IrsNav-v0" and any(isinstance(each, Player) for each in opened.values()):
            raise ValueError("env='IrsNav-v0' plays run folders alone, with all reference policies beside them")
        pools = pools_of(split, num_scenes, scenes) if any(is_unseen) else {}
    except (OSError, ValueError) as error:
        print(f"python -m eval score: {error}", file=sys.stderr)
        return 2

    for (name, each), unseen in zip(opened.items(), is_unseen, strict=True):
        try:
            if isinstance(each, Player):
                print(each.name)
                Console().print(unseen_table(score_unseen(each, pools)))
            elif unseen:
                score_generalist(each, model, pools)
            else:
                score_run(each, model, episodes, seed)
        except Exception as error:  # a damaged run may raise any, and keeps no other from being scored
            left_out.append(LeftOut.of(Path(name), error))
    for told in left_out:
        print(f"python -m eval score: {told.folder}: {told.reason}", file=sys.stderr)
    return 2 if left_out else 0


def _opened(names: Sequence[str], left_out: list[LeftOut]) -> dict[str, Run | Player]:
    """What can be opened of runs and players by their names; the others join those left out."""
    opened = {}
    for name in names:
        try:
            opened[name] = _open(name)
        except Exception as error:
            left_out.append(LeftOut.of(Path(name), error))
    return opened


def _open(name: str) -> Run | Player:
    """A run folder, or what plays unseen scenes without one."""
    if name in UNSEEN_REFERENCES:
        return reference(name)
    if name in GENERALISTS and not Path(name).exists():
        return Player(name, partial(play_pool, load_pretrained(name).policy))
    if name.endswith(".npz"):
        return Player(name, partial(play_pool, read_network(Path(name).read_bytes())))
    return Run.open(name)


def score_run(run: Run, model: str, episodes: int, seed: int) -> list[Score]:
    """Score one run: prints the table, writes ``scores.json`` and ``paths.png``, and returns the table's rows.

    Raises
    ------
    OSError
        Where a file of the run cannot be read, or the results cannot be written.
    ValueError
        Where the run is damaged; the message names the file.
    """
    env = evaluation_env(run.task)
    played = play(env, {run.config.algorithm: run.load_model(model)}, episodes, seed)
    scores = [score(name, each) for name, each in played.items()]
    entry = run.manifest.models[model]
    learned = played[run.config.algorithm][0]

    record = {
        "format_version": 1,
        "model": {"name": model, **entry.model_dump()},
        "config": run.config.model_dump(),
        "oracle_distance": learned.oracle_distance,
        "scores": [asdict(each) for each in scores],
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }
    write_file(run.folder / "scores.json", (json.dumps(record, indent=2, allow_nan=False) + "\n").encode())
    paths = {"oracle": played["oracle"][0], run.config.algorithm.upper(): learned}
    world = env.unwrapped.world  # type: ignore[attr-defined]
    write_file(run.folder / "paths.png", draw_paths(world, paths))
    print(f"{run.folder}: {model} model, after {entry.steps:,} steps, at {world.target_db:g} dB")
    Console().print(table(scores))
    print(f"written: {run.folder / 'scores.json'} and paths.png beside it")
    return scores


def score_generalist(run: Run, model: str, pools: dict[str, Pool]) -> None:
    """Score one run on sets of unseen scenes: prints the table and writes ``unseen.json``.

    Raises
    ------
    OSError
        Where a file of the run cannot be read, or the results cannot be written.
    ValueError
        Where the run is damaged, or its policy acts in its own scene alone.
    """
    found = score_unseen(player_of(run, model), pools)
    path = write_unseen(run, model, found)
    print(f"{run.folder}: {model} model, after {run.manifest.models[model].steps:,} steps")
    Console().print(unseen_table(found))
    print(f"written: {path}")


def table(scores: Sequence[Score]) -> Table:
    """The scores as a table for the terminal."""
    rows = Table(caption="metres, ratio to the oracle's: means over successes", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
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


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
