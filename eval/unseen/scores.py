"""`Player` and `UnseenScore`: how policies do on scenes that they did not learn on, with the hard
ones apart.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
import torch
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.learning.local_configs import ExplorerConfig
from agents.learning.map_configs import network_settings
from agents.learning.map_learner import first_network
from agents.policies.explorer_policy import Explorer
from agents.policies.heuristics import RULES
from agents.policies.model_file import read_network
from agents.policies.replanning import Replanner
from agents.registry import ALGORITHMS, Track, generalists, observation_of
from agents.rollout.episode import TOLERANCE
from agents.rollout.scene_set import SceneSetResults, follow, play_scene_set
from agents.runs import provenance
from agents.runs.pretrained import load_pretrained
from agents.runs.run_folder import Run, RunError
from irs_gym.datasets.generator import CELL_SIZE
from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.datasets.scene_set import SceneSet, build_scene_set, scene_set_of
from irs_gym.datasets.solved_scene import solve
from irs_gym.files import read_file, write_file
from irs_gym.grid import checked_cell_size, octile_distance
from irs_gym.mdp.task import Task
from irs_gym.radio.scene import load_scene, load_scenes

HARD = 1.2  # a detour (oracle's distance over octile distance) above which a scene is hard
PAPER_TARGETS_DB = (-63.0, -62.0, -61.8, -61.0, -60.0)
# the same in every episode
UNSEEN_REFERENCES = ("oracle", "replanning", "untrained_explorer", "greedy", "greedy_margin")


@dataclass(frozen=True)
class Player:
    """A policy that is scored on unseen scenes."""

    name: str
    episodes: Callable[[SceneSet], SceneSetResults]
    """Its episode in each scene of a pool; a ``ValueError`` says why there can be none."""
    sees: Track = "local"
    """Whether it sees the whole ``"map"`` or the patch around the robot."""


@dataclass(frozen=True)
class UnseenScore:
    """What a policy achieved on a set of scenes, one greedy episode each.

    Attributes
    ----------
    scenes
        Their number; 0 leaves all else None.
    success
        Share of them in which the goal was reached.
    spl
        Mean of success weighted by path length.
    ratio
        Mean distance over the oracle's in the successes; None without any.
    exact
        Share of the scenes whose path is as short as the oracle's.
    """

    scenes: int
    success: float | None
    spl: float | None
    ratio: float | None
    exact: float | None


Found = Mapping[str, tuple[SceneSetResults, UnseenScore, UnseenScore]]
"""By the name of a set: the episodes, and the scores on all scenes and on the hard ones."""


def player_of(run: Run, model: str = "best") -> Player:
    """The policy of a run over many scenes.

    Raises
    ------
    RunError
        Where the run's policy acts in its own scene alone, or its file is damaged.
    """
    algorithm: Any = run.config.algorithm
    if not run.is_generalist:
        raise RunError(
            f"{str(run.folder)!r} is a run of {algorithm}, which acts in its own scene alone"
        )

    observation = observation_of(algorithm)
    play = partial(play_scene_set, run.load_model(model), observation=observation)

    return Player(algorithm, play, ALGORITHMS[algorithm].track)


def reference(name: str) -> Player:
    """One of `UNSEEN_REFERENCES`."""
    planners = {"replanning": replan, "untrained_explorer": explore_untrained}
    play = planners.get(name) or partial(apply, name)
    return Player(name, play, "map" if name == "oracle" else "local")


def run_or_player(name: str) -> Run | Player:
    """A run folder, or what plays unseen scenes without one: a reference, a pretrained model, or
    the file of a network.

    Raises
    ------
    OSError
        Where a file cannot be read.
    ValueError
        Where it is none of these, or damaged.
    """
    if name in UNSEEN_REFERENCES:
        return reference(name)
    if name in generalists() and not Path(name).exists():
        play = partial(
            play_scene_set, load_pretrained(name).policy, observation=observation_of(name)
        )
        return Player(name, play, ALGORITHMS[name].track)
    if name.endswith(".npz"):
        policy = read_network(read_file(Path(name)))
        sees: Track = "local" if isinstance(policy, Explorer) else "map"
        return Player(name, partial(play_scene_set, policy), sees)

    return Run.open(name)


def replan(pool: SceneSet) -> SceneSetResults:
    """Episodes of optimistic replanning, which sees what a local agent sees."""
    return play_scene_set(Replanner(pool.shape, Task.patch_radius), pool)


def explore_untrained(pool: SceneSet) -> SceneSetResults:
    """Episodes of an explorer that has learned nothing: to it, all that is unknown costs about an
    eighth more.
    """
    config = ExplorerConfig()
    torch.manual_seed(0)
    return play_scene_set(Explorer(network_settings(config), first_network(config)), pool)


def apply(name: str, pool: SceneSet) -> SceneSetResults:
    """Episodes of one of `agents.policies.heuristics.RULES`."""
    worlds = build_worlds(RandomTask(scenes=pool))
    each = ((worlds.world(n), worlds.world(n).goal) for n in range(len(pool)))
    choices = np.stack([RULES[name](world, goal) for world, goal in each])  # (S, X, Y, 8)
    choices = choices.transpose(0, 3, 1, 2)

    return follow(choices.astype(np.float32), pool)


def score_of(episodes: SceneSetResults, chosen: NDArray[np.bool_] | None = None) -> UnseenScore:
    """Score over the episodes, or over those chosen, ``(S,)``."""
    chosen = np.ones(len(episodes.spl), dtype=bool) if chosen is None else chosen
    if not chosen.any():
        return UnseenScore(0, None, None, None, None)

    success = episodes.is_success[chosen]
    ratio = episodes.ratios[chosen]

    return UnseenScore(
        scenes=int(chosen.sum()),
        success=float(success.mean()),
        spl=float(episodes.spl[chosen].mean()),
        ratio=float(ratio[success].mean()) if success.any() else None,
        exact=float((success & (ratio <= 1.0 + TOLERANCE)).mean()),
    )


def detours(pool: SceneSet) -> NDArray[np.float64]:
    """The oracle's distance over the octile distance of each scene, ``(S,)``."""
    return pool.oracle_distance / (octile_distance(pool.goal - pool.start) * pool.cell_size)


def paper_scene_set(cell_size: float = CELL_SIZE) -> SceneSet:
    """The paper's scene at each of `PAPER_TARGETS_DB`, which no agent learns on."""
    paper = load_scene("paper")
    scenes = [paper.model_copy(update={"target_db": target}) for target in PAPER_TARGETS_DB]
    names = [f"paper at {target:g} dB" for target in PAPER_TARGETS_DB]
    return scene_set_of(scenes, names, cell_size=cell_size)


def score_unseen(player: Player, pools: Mapping[str, SceneSet]) -> Found:
    """What a policy does on each pool; raises ``ValueError`` where it cannot play on one."""
    played = {name: (player.episodes(pool), pool) for name, pool in pools.items()}
    return {
        name: (episodes, score_of(episodes), score_of(episodes, detours(pool) > HARD))
        for name, (episodes, pool) in played.items()
    }


def write_unseen(run: Run, model: str, found: Found) -> Path:
    """Write the scores into the run folder; returns the file."""
    record: dict[str, Any] = {
        "format_version": 1,
        "model": {"name": model, **run.manifest.models[model].model_dump()},
        "config": run.config.model_dump(mode="json"),
        "scores": {
            name: {"all": asdict(whole), "hard": asdict(hard)}
            for name, (_, whole, hard) in found.items()
        },
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }
    path = run.folder / "unseen.json"
    write_file(path, (json.dumps(record, indent=2, allow_nan=False) + "\n").encode())

    return path


def scene_sets_of(
    splits: Sequence[str], num_scenes: int, scenes: Path | None, cell_size: float = CELL_SIZE
) -> dict[str, SceneSet]:
    """What is scored on: the first scenes of each split and the paper's, or else the scene files of
    a folder; in cells of any size.

    Warns
    -----
    UserWarning
        Where scenes of a split, which are feasible in cells of 0.5 m, are not in others: they are
        left out.

    Raises
    ------
    FileNotFoundError
        Where there is no such folder.
    ValueError
        Where it holds no valid scene, or one whose target is infeasible, or cells do not fit.
    """
    cell_size = checked_cell_size(cell_size)
    if scenes is not None:
        return {str(scenes): scene_set_of(load_scenes(scenes), cell_size=cell_size)}

    return {
        **{split: _in_cells_of(build_scene_set(split, num_scenes), cell_size) for split in splits},
        "paper": paper_scene_set(cell_size),
    }


def _in_cells_of(pool: SceneSet, cell_size: float) -> SceneSet:
    """The scenes of a set in cells of another size, without those that are infeasible there."""
    if cell_size == pool.cell_size:
        return pool

    kept = []
    lost = []
    for scene in pool.scenes:
        try:
            solve(scene, cell_size)
            kept.append(scene)
        except ValueError as error:
            lost.append(f"{scene.name}: {error}")

    if not kept:
        raise ValueError(f"cell_size={cell_size}: no scene can be played: {lost[0]}")
    if lost:
        warn(
            f"{len(lost)} of {len(pool)} scenes are left out at cell_size={cell_size}: {lost[0]}",
            stacklevel=3,
        )

    return scene_set_of(kept, cell_size=cell_size)


def unseen_table(found: Found) -> Table:
    """The scores as a table for the terminal."""
    rows = Table(
        caption=f"hard: a detour above {HARD:g}; ratio: over successes",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )

    for column in ("scenes", "number", "success", "SPL", "ratio", "exact"):
        rows.add_column(column, justify="left" if column == "scenes" else "right", no_wrap=True)

    for name, (_, whole, hard) in found.items():
        for label, each in ((name, whole), ("  hard", hard)):
            numbers = (each.success, each.spl, each.ratio, each.exact)
            rows.add_row(
                label,
                str(each.scenes),
                *("–" if value is None else f"{value:.4f}" for value in numbers),
            )

    return rows
