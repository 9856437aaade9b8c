"""`CodebookBoard`: what was learned where the robot switches the panel, as docs/codebook.json keeps
it from one reading of runs to the next; `codebook_section`: the same in words and tables.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from statistics import median
from typing import Any, Literal, Self

from pydantic import TypeAdapter, ValidationError

from agents.policies.codebook_heuristics import CODEBOOK_REFERENCES
from agents.registry import ALGORITHMS
from agents.rollout.episode import EpisodeResult, SceneTask, evaluation_env, roll_out
from agents.runs.problem import Problem, problem_of
from agents.runs.run_folder import Run
from eval.estimates import finite
from eval.markdown import page, printable, table, template, text
from eval.origin import commands_block, origin_text, origins
from eval.scoreboard.budget_page import left_out_text
from eval.scoreboard.results import Group, LeftOut, Result
from eval.scoreboard.seed_scores import group_names
from irs_gym.datasets.codebook_task import CodebookTask
from irs_gym.files import read_file

LEARNERS = ("ppo", "dqn", "maskable_ppo", "q_learning")
REFERENCES = {
    "oracle": "joint oracle",
    "never_switch": "never switch",
    "greedy_gain": "greedy on the gain",
}
# the problems of train/sweeps/codebook.toml, on the page with or without runs
TASKS: tuple[SceneTask, ...] = tuple(
    CodebookTask(codebook=("cover", size), switch_cost=0.5, target_db=target_db)
    for target_db in (-61.8, -60.0)
    for size in (4, 8, 16)
)
MOST_BYTES = 2**26  # of docs/codebook.json
HEADER = (
    *("policy", "runs", "at the joint optimum", "distance over the optimum's, median"),
    *("seconds to the optimum, median", "steps to the optimum, median", "switches"),
)


@dataclass(frozen=True)
class Played:
    """An episode from the fixed start."""

    distance: float
    """Metres, with the costs of switches."""
    ratio: float | None
    """Distance over the joint optimum's; None for a failure."""
    is_optimal: bool
    switches: int

    @classmethod
    def of(cls, episode: EpisodeResult) -> Self:
        """What is kept of an episode."""
        return cls(episode.distance, episode.ratio, episode.is_optimal, len(episode.switch_cells))


@dataclass(frozen=True)
class KeptRun:
    """What is kept of a run; None stands for an infinity."""

    seed: int
    episode: Played
    steps_to_optimum: float | None
    seconds_to_optimum: float | None
    commit: str | None

    @classmethod
    def of(cls, result: Result) -> "KeptRun":
        """What is kept of a result."""
        return cls(
            result.seed,
            Played.of(result.episode),
            finite(result.steps_to_optimum),
            finite(result.seconds_to_optimum),
            result.run.manifest.commit,
        )


@dataclass(frozen=True)
class Setting:
    """A problem, and what the reference policies do there, by their names."""

    problem: Problem
    references: dict[str, Played]


@dataclass(frozen=True)
class Learned:
    """The runs of a group, by their seeds."""

    group: Group
    runs: tuple[KeptRun, ...]


@dataclass(frozen=True)
class CodebookBoard:
    """All that the section on learning says."""

    settings: tuple[Setting, ...] = ()
    learned: tuple[Learned, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    """Folders and reasons."""
    commands: tuple[str, ...] = ()
    """That made the runs and the page."""
    trained_with: tuple[dict[str, str], ...] = ()
    versions: dict[str, str] = field(default_factory=dict)
    commit: str | None = None
    format_version: Literal[1] = 1

    @classmethod
    def load(cls, path: Path) -> "CodebookBoard":
        """The board of a file; an empty one where there is none. Raises ``ValueError`` where it is
        damaged.
        """
        if not path.exists():
            return cls()

        try:
            return _ADAPTER.validate_json(read_file(path, MOST_BYTES))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise ValueError(f"{str(path)!r} is damaged at {where!r}: {first['msg']}") from None

    def as_json(self) -> bytes:
        """The content of its file."""
        return _ADAPTER.dump_json(self, indent=1) + b"\n"

    def extended(self, results: Sequence[Result], left_out: Sequence[LeftOut]) -> "CodebookBoard":
        """The board with more runs; one that repeats a seed of a group takes its place. The
        references are played on problems that are new.
        """
        switching = [each for each in results if each.problem.codebook is not None]
        tasks = {problem_of(task): task for task in TASKS}
        tasks |= {each.problem: each.run.task for each in switching if each.problem not in tasks}
        known = {each.problem: each for each in self.settings}
        settings = [
            known.get(problem) or Setting(problem, _references(task))
            for problem, task in tasks.items()
        ]

        runs = {(each.group, run.seed): run for each in self.learned for run in each.runs}
        runs |= {(each.group, each.seed): KeptRun.of(each) for each in switching}
        by_group: dict[Group, list[KeptRun]] = {}
        for (group, _), run in sorted(runs.items(), key=lambda item: item[0][1]):
            by_group.setdefault(group, []).append(run)

        # what was left out of a folder counts until that folder is read again
        read = {printable(str(each.run.folder)) for each in results}
        reasons = {folder: why for folder, why in self.left_out if folder not in read}
        reasons |= {each.folder: each.reason for each in left_out}

        board = self._scored([each.run for each in switching]) if switching else self
        return replace(
            board,
            settings=(*settings, *(known[each] for each in known if each not in tasks)),
            learned=tuple(Learned(group, tuple(found)) for group, found in by_group.items()),
            left_out=tuple(reasons.items()),
        )

    def _scored(self, runs: Sequence[Run]) -> "CodebookBoard":
        """The board with where runs come from that are scored now."""
        origin = origins(runs)
        new = [each for each in origin["trained_with"] if each not in self.trained_with]
        return replace(
            self,
            trained_with=(*self.trained_with, *new),
            versions=origin["versions"],
            commit=origin["commit"],
        )

    @property
    def runs(self) -> list[KeptRun]:
        """All runs."""
        return [run for each in self.learned for run in each.runs]


_ADAPTER = TypeAdapter(CodebookBoard)


def _references(task: SceneTask) -> dict[str, Played]:
    env = evaluation_env(task)
    return {
        name: Played.of(roll_out(CODEBOOK_REFERENCES[name](env, 0), env)) for name in REFERENCES
    }


def codebook_section(board: CodebookBoard) -> str:
    """The section of the page."""
    names = group_names([each.group for each in board.learned])
    runs = board.runs
    commits = list(dict.fromkeys(each.commit for each in runs))
    left_out = [{"folder": folder, "reason": why} for folder, why in board.left_out]

    return template("codebook_board.md").format(
        made=f"Made of {len(runs)} runs by\n\n{commands_block(board.commands)}" if runs else "",
        settings=page(
            *(setting_part(each, board.learned, names) for each in board.settings)
        ).strip(),
        left_out=left_out_text(left_out),
        origin=origin_text({**vars(board), "trained_from": commits}) if runs else "",
    )


def setting_part(setting: Setting, learned: Iterable[Learned], names: Mapping[Group, str]) -> str:
    """Optimum and table of one problem."""
    optimum = setting.references["oracle"]
    here = [each for each in learned if each.group.problem == setting.problem]
    rows = [_reference_row(REFERENCES[name], one) for name, one in setting.references.items()]

    for algorithm in LEARNERS:
        found = [each for each in here if each.group.algorithm == algorithm]
        rows += [_learned_row(names[each.group], each.runs) for each in found]
        if not found:
            rows.append((ALGORITHMS[algorithm].title, "none", *["–"] * 5))

    rows += [
        _learned_row(names[each.group], each.runs)
        for each in here
        if each.group.algorithm not in LEARNERS
    ]

    return page(
        f"### {text(setting.problem.label)}",
        f"The joint optimum: {optimum.distance:.3f} m, the costs of {optimum.switches} switches "
        "included.",
        table(HEADER, rows),
    )


def _reference_row(name: str, episode: Played) -> tuple[Any, ...]:
    said = "yes" if episode.is_optimal else "no"
    return name, "–", said, _ratio([episode]), "–", "–", episode.switches


def _learned_row(name: str, runs: Sequence[KeptRun]) -> tuple[Any, ...]:
    episodes = [each.episode for each in runs]
    exact = sum(each.is_optimal for each in episodes)
    switches = sorted({each.switches for each in episodes})

    return (
        text(name),
        len(runs),
        f"{exact} of {len(runs)}",
        _ratio(episodes),
        _clock([each.seconds_to_optimum for each in runs]),
        _clock([each.steps_to_optimum for each in runs]),
        " to ".join(map(str, dict.fromkeys((switches[0], switches[-1])))),
    )


def _ratio(episodes: Sequence[Played]) -> str:
    middle = median([inf if each.ratio is None else each.ratio for each in episodes])
    return f"{middle:.4f}" if middle < inf else "does not arrive"


def _clock(times: Sequence[float | None]) -> str:
    """The median; None where half of the runs or more did not get there."""
    middle = median([inf if each is None else each for each in times])
    return f"{middle:,.0f}" if middle < inf else "none"
