"""`PolicyResult`: a policy with what it did on each set of unseen scenes, over all its seeds."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.learning.local_configs import ExplorerConfig
from agents.learning.map_configs import PlannerConfig
from agents.learning.map_learner import first_network
from agents.registry import ALGORITHMS, observation_of
from agents.rollout.scene_set import SceneSetResults
from agents.runs.manifest import Config, GeneralistEntry
from agents.runs.pretrained import GeneralistPretrainedEntry
from agents.runs.run_folder import Run, RunError
from eval.scoreboard.results import COMPLETE, LeftOut, find_runs, read_curve, settings_text
from eval.unseen.page_sets import PAGE_SETS, SetFacts, Track, scenes_of
from eval.unseen.played import Found, Trial
from eval.unseen.scores import UNSEEN_REFERENCES, reference
from irs_gym.datasets.splits import FAMILIES, all_but, members_of

USUAL_SCENES = 3000
REFERENCE_TITLES = {
    "untrained_planner": "planning network, untrained",
    "replanning": "optimistic replanning",
    "untrained_explorer": "explorer, untrained",
    "greedy": "greedy (octile)",
    "greedy_margin": "greedy on the margin",
}
PAGE_REFERENCES = tuple(name for name in REFERENCE_TITLES if name in UNSEEN_REFERENCES)
_UNTRAINED: Mapping[str, Any] = {
    "untrained_planner": PlannerConfig,
    "untrained_explorer": ExplorerConfig,
}
# Where an agent learns makes no other of it.
_NO_SETTINGS = ("device",)

Sizes = Mapping[Track, int]
"""How many scenes of each set a track is scored on, where there are as many."""
Facts = Mapping[tuple[str, int], SetFacts]
"""By the name of a set and the number of its scenes."""


@dataclass(frozen=True, eq=False)
class PolicyResult:
    """Runs that differ in the seed alone, a model of ``models/``, or a reference policy.

    Attributes
    ----------
    algorithm, name, track
        What it is, how it is called on the page, and what it sees.
    scenes
        Training scenes; None for a reference.
    split
        What it learned on; None for a reference.
    seeds
        Of the runs, in order; that of a model of ``models/``; none for a reference.
    models
        SHA-256 of the file of each.
    runs
        In the order of their seeds; none for what has no run folder.
    episodes
        By the name of a set, one for each seed; a set that it does not play is missing.
    group
        Its name but for the family that was left out of what it learned on.
    """

    algorithm: str
    name: str
    track: Track
    scenes: int | None
    split: str | None = None
    seeds: tuple[int, ...] = ()
    models: tuple[str, ...] = ()
    runs: tuple[Run, ...] = ()
    episodes: Mapping[str, Sequence[SceneSetResults]] = field(default_factory=dict)
    group: str = ""

    @property
    def family(self) -> str | None:
        """The one that was left out of what it learned on."""
        return None if self.split is None else family_left_out(self.split)

    def table(
        self, name: str, value: Callable[[SceneSetResults], NDArray[Any]]
    ) -> NDArray[np.float64]:
        """A value of each episode in a set, ``(seeds, scenes)``."""
        return np.stack([value(each) for each in self.episodes[name]]).astype(np.float64)


# --- what it learned on ---------------------------------------------------------------------------


def family_left_out(split: str) -> str | None:
    """The family that a split of `irs_gym.datasets.splits.all_but` leaves out; None for another."""
    return next((each for each in FAMILIES if split == all_but(each)), None)


def learned_on(split: str) -> str:
    """A split to learn on, in words."""
    members = list(dict.fromkeys(members_of(split)))
    if "train" not in members:
        return ", ".join(each.removeprefix("train-") for each in members)

    missing = [each for each in FAMILIES if f"train-{each}" not in members]
    if len(missing) < len(members):
        return f"all kinds but {' and '.join(missing)}" if missing else "all kinds"

    return ", ".join(["usual", *(each for each in FAMILIES if each not in missing)])


def sets_of(algorithm: str, split: str | None, scenes: int | None) -> list[str]:
    """The sets that a policy is played on: of one that a family was left out for, that family; of
    one that is but a point of the curve over training scenes, the test scenes.
    """
    family = None if split is None else family_left_out(split)
    if family is not None:
        return [f"ood-{family}"]
    return ["test"] if is_point(algorithm, split, scenes) else list(PAGE_SETS)


def is_point(algorithm: str, split: str | None, scenes: int | None) -> bool:
    """Whether it is but a point of the planning network's curve over training scenes."""
    usual = ALGORITHMS["planner"].env.get("num_scenes", USUAL_SCENES)
    return algorithm == "planner" and split == "train" and scenes != usual


def track_of(algorithm: str) -> Track:
    """What an algorithm's policies see."""
    return "map" if observation_of(algorithm) == "map" else "local"


# --- runs -----------------------------------------------------------------------------------------


def find_generalists(folder: Path) -> tuple[list[Run], list[LeftOut]]:
    """Complete runs over many scenes below a folder, and the others."""
    runs = []
    left_out = []

    for each in find_runs(folder):
        try:
            run = Run.open(each)
            if not run.is_generalist:
                raise ValueError(
                    f"{run.config.algorithm} learned in one scene: it belongs on the scoreboard"
                )
            if run.manifest.status not in COMPLETE:
                raise ValueError(f"has not ended: its status is {run.manifest.status!r}")

            _check_generalist(run)
            runs.append(run)
        except Exception as error:
            left_out.append(LeftOut.of(each, error))

    return runs, left_out


def pace(run: Run) -> tuple[float, float]:
    """Steps and seconds of a run's whole training; raises ``OSError``, or `RunError` where they
    cannot be read.
    """
    last = read_curve(run)[-1]
    damaged = f"{str(run.folder / 'learning_curve.csv')!r} is damaged"

    try:
        steps = float(last["steps"])
        seconds = float(last["seconds"])
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{damaged}: {error!r}") from None

    if not (0 <= steps < inf and 0 < seconds < inf):
        raise RunError(f"{damaged}: {steps} steps in {seconds} seconds")

    return steps, seconds


@dataclass(frozen=True, eq=False)
class Policy:
    """A policy to be played: a run folder, a model of ``models/``, or a reference.

    Attributes
    ----------
    source
        What `eval.unseen.played.Trial` calls it.
    model
        SHA-256 of its file, or what names a reference.
    algorithm
        Its own, or the reference's name.
    config, run
        Where it has learned.
    """

    source: Path | str
    model: str
    algorithm: str
    config: Config | None = None
    run: Run | None = None

    @classmethod
    def of_run(cls, run: Run) -> "Policy":
        """The best model of a run folder."""
        sha256 = run.manifest.models["best"].sha256
        return cls(run.folder, sha256, run.config.algorithm, run.config, run)

    @classmethod
    def of_pretrained(cls, entry: GeneralistPretrainedEntry) -> "Policy":
        """A model that comes with the package."""
        algorithm = entry.config.algorithm
        return cls(algorithm, entry.sha256, algorithm, entry.config)

    @classmethod
    def of_reference(cls, name: str) -> "Policy":
        """A reference; one that has not learned is named after its weights."""
        return cls(name, untrained_sha256(name) if name in _UNTRAINED else name, name)

    @property
    def split(self) -> str | None:
        """What it learned on."""
        return self.config.env["split"] if self.config else None

    @property
    def scenes(self) -> int | None:
        """How many."""
        return self.config.env["num_scenes"] if self.config else None

    @property
    def track(self) -> Track:
        """What it sees."""
        is_map = (track_of if self.config else _sees)(self.algorithm) == "map"
        return "map" if is_map else "local"

    @property
    def sets(self) -> list[str]:
        """What it is played on: all, but for some runs."""
        if self.run is None:
            return list(PAGE_SETS)

        return sets_of(self.algorithm, self.split, self.scenes)

    def trials(self, sizes: Sizes, facts: Facts) -> dict[str, Trial]:
        """What it plays, by the name of a set. A policy of SB3 sees maps of one size."""
        found = {}
        for name in self.sets:
            count = scenes_of(name, sizes[self.track])
            frames = [facts[each, scenes_of(each, sizes["map"])].shape for each in ("test", name)]
            if self.algorithm != "map_ppo" or frames[0] == frames[1]:
                found[name] = Trial(self.source, self.model, name, count)

        return found


def results_of(
    policies: Sequence[Policy], sizes: Sizes, facts: Facts, found: Found
) -> tuple[list[PolicyResult], list[LeftOut]]:
    """What all policies did, runs that differ in the seed alone together; a run that could not be
    played is left out.
    """
    left_out = []
    groups: dict[tuple[str, str], list[tuple[Policy, dict[str, SceneSetResults]]]] = {}

    for policy in sorted(policies, key=lambda each: each.config.seed if each.config else 0):
        trials = policy.trials(sizes, facts)
        played = {}
        for name, trial in trials.items():
            outcome = found[trial]
            if isinstance(outcome, LeftOut):
                left_out.append(outcome)
                break

            played[name] = outcome.results(facts[name, trial.count].oracle_distance)
        else:
            groups.setdefault(_group_of(policy), []).append((policy, played))

    results = [_result_of_group(key, groups) for key in groups]
    order = [*ALGORITHMS, *REFERENCE_TITLES]
    results.sort(key=lambda each: (order.index(each.algorithm), each.name, each.scenes or 0))

    return results, left_out


def _group_of(policy: Policy) -> tuple[str, str]:
    """What seeds of one row have in common: algorithm and settings."""
    if policy.run is None:
        return policy.algorithm, "as it is"

    return policy.algorithm, _settings(policy.run)


def _result_of_group(
    key: tuple[str, str],
    groups: Mapping[tuple[str, str], list[tuple[Policy, dict[str, SceneSetResults]]]],
) -> PolicyResult:
    """One of the groups, named by what sets it apart from those of the same algorithm."""
    algorithm, settings = key
    found = groups[key]
    first, sets = found[0]

    if first.config is None:
        group = REFERENCE_TITLES[algorithm]
    elif first.run is None:
        group = f"{ALGORITHMS[algorithm].title}, pretrained"
    else:
        own = json.loads(settings)
        others = [json.loads(each) for of, each in groups if of == algorithm and each[0] == "{"]
        group = ", ".join([ALGORITHMS[algorithm].title, *_differences(own, others)])

    family = None if first.split is None else family_left_out(first.split)
    name = group if family is None else f"{group}, {learned_on(str(first.split))}"

    return PolicyResult(
        algorithm=algorithm,
        name=name,
        group=group,
        track=first.track,
        scenes=first.scenes,
        split=first.split,
        seeds=tuple(each.config.seed for each, _ in found if each.config),
        models=tuple(each.model for each, _ in found if each.config),
        runs=tuple(each.run for each, _ in found if each.run),
        episodes={name: [each[name] for _, each in found] for name in sets},
    )


@cache
def untrained_sha256(name: str) -> str:
    """SHA-256 of settings and weights of a reference that has a network."""
    torch.manual_seed(0)
    config = _UNTRAINED[name]()
    digest = sha256(repr(config).encode())
    for key, each in first_network(config).state_dict().items():
        digest.update(key.encode() + each.numpy().tobytes())

    return digest.hexdigest()


def _sees(name: str) -> str:
    return reference(name).sees


def _check_generalist(run: Run) -> None:
    """Refuse a run over many scenes that cannot stand on a page."""
    scenes = run.config.env.get("num_scenes")
    if not isinstance(scenes, int) or scenes < 1:
        raise RunError(f"num_scenes={scenes!r} in its config.json must be a positive integer")
    if not isinstance(run.config.env.get("split"), str):
        raise RunError("split in its config.json must name what it learned on")
    if not isinstance(run.manifest.models.get("best"), GeneralistEntry):
        raise RunError("its manifest lists no best model over many scenes")

    _settings(run)
    pace(run)


def _settings(run: Run) -> str:
    """All that runs of one group share; of weights to begin with, that is whose they are."""
    agent = {**run.config.agent, "weights": _maker(run.config.agent.get("weights"))}
    for name in _NO_SETTINGS:
        agent.pop(name, None)

    return settings_text({"agent": agent, "env": run.config.env})


def _maker(weights: str | None) -> str | None:
    """The algorithm of the run that has trained some weights."""
    if weights is None:
        return None

    try:
        return f"of {Run.open(weights).config.algorithm}"
    except RunError:
        return "from elsewhere"


def _differences(own: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> list[str]:
    """What sets it apart from others of the same algorithm: what it learned on, which is said of
    the usual alone where others learned on something else, and the agent's settings where others
    learned on the same. All that a family was left out for count as one.
    """
    kinds = [_kind(each) for each in others]
    kind = _kind(own)
    alike = [each["agent"] for each, other in zip(others, kinds, strict=True) if other == kind]
    found = [
        f"{name} {value}"
        for name, value in own["agent"].items()
        if value is not None and any(each.get(name) != value for each in alike)
    ]
    if kind is not None and (kind != "train" or len({*kinds} - {None}) > 1):
        found.append(learned_on(kind))

    return found


def _kind(settings: Mapping[str, Any]) -> str | None:
    """What it learned on; None where a family was left out."""
    split: str = settings["env"]["split"]
    return None if family_left_out(split) else split
