"""`model_cards`: what is to be known of each pretrained model, as the pages beside its file.

A card is in the form of model hubs: facts for programs on top, then words for people.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from agents.registry import ALGORITHMS
from agents.runs.pretrained import GeneralistPretrainedEntry, Models, PretrainedEntry
from agents.runs.problem import Problem
from eval.markdown import code, page, table, text
from irs_gym.mdp.task import Task

INDEX = "README.md"
SEES = {
    "map": "the whole radio map",
    "local": "the patch around the robot",
}


def model_cards(models: Models) -> dict[str, str]:
    """The cards by the names of their files, and `README.md`, which lists them."""
    cards = {_name(each): _scene_card(each) for each in models.models}
    cards |= {_name(each): _generalist_card(each) for each in models.generalists}

    return {**cards, INDEX: _index(models)}


def _name(entry: PretrainedEntry | GeneralistPretrainedEntry) -> str:
    return str(Path(entry.file).with_suffix(".md"))


def _title(entry: PretrainedEntry | GeneralistPretrainedEntry) -> str:
    name = ALGORITHMS[entry.config.algorithm].title
    if isinstance(entry, PretrainedEntry):
        return f"{name}, {entry.problem.label}"

    return f"{name}, scenes never seen"


def _scene_card(entry: PretrainedEntry) -> str:
    score = entry.score
    arguments = "".join(f", {name}={value!r}" for name, value in _asked(entry.task).items())
    rows = [
        ("distance", f"{score.distance:.3f} m"),
        ("the oracle's", f"{score.oracle_distance:.3f} m"),
        ("SPL", f"{score.spl:.3f}"),
        ("moves, of which refused", f"{score.steps}, {score.refused}"),
    ]

    return page(
        _front(entry, "IrsNav-v0", {"SPL": score.spl, "metres": score.distance}),
        f"# {text(_title(entry))}",
        "A policy for one factory and one target, which it has learned by heart: others are not "
        "what it is for. Its scores are those of its likeliest move.",
        _load(entry, arguments),
        "## Score",
        "One greedy episode from the scene's own start, as `models/manifest.json` has it; a test "
        "plays it again.",
        table(("", ""), rows),
        *_training(entry),
    )


def _generalist_card(entry: GeneralistPretrainedEntry) -> str:
    row = ALGORITHMS[entry.config.algorithm]
    split = entry.config.env["test_split"]
    scenes = entry.config.env["test_scenes"]

    return page(
        _front(entry, "IrsNavRandom-v0", {"SPL": entry.spl, "success": entry.success}),
        f"# {text(_title(entry))}",
        f"A policy for factories that it has never seen. It sees {SEES[row.track]}: the "
        f"*{row.track}* track.",
        _load(entry, ', split="test"'),
        "## Score",
        f"Greedy episodes in {scenes} scenes of the split {code(split)}, by which it was chosen. "
        "How it does on test scenes and on scenes of other kinds stands in "
        "`docs/generalisation.md`.",
        table(("", ""), [("success", f"{entry.success:.3f}"), ("SPL", f"{entry.spl:.4f}")]),
        *_training(entry),
    )


def _asked(task: Task) -> Mapping[str, Any]:
    """The arguments that make the problem, where they differ from the defaults."""
    names = [each.name for each in fields(Problem) if hasattr(task, each.name)]
    kept = {name: getattr(task, name) for name in names}

    return {name: value for name, value in kept.items() if value != getattr(Task(), name)}


def _front(
    entry: PretrainedEntry | GeneralistPretrainedEntry, env_id: str, metrics: Mapping[str, float]
) -> str:
    """The facts on top, as YAML."""
    found = [{"type": name, "name": name, "value": value} for name, value in metrics.items()]
    result = {
        "task": {"type": "reinforcement-learning"},
        "dataset": {"name": env_id, "type": env_id},
        "metrics": found,
    }
    facts = {
        "license": "mit",
        "library_name": "irs_gym",
        "tags": ["reinforcement-learning", "gymnasium", env_id, entry.config.algorithm],
        "model-index": [{"name": Path(entry.file).stem, "results": [result]}],
    }

    return f"---\n{yaml.safe_dump(facts, sort_keys=False).strip()}\n---"


def _load(entry: PretrainedEntry | GeneralistPretrainedEntry, arguments: str) -> str:
    return (
        "```python\nfrom irs_gym.lab import load_pretrained\n\n"
        f'model = load_pretrained("{entry.config.algorithm}"{arguments})\n'
        "env = model.make_env()\n```"
    )


def _training(entry: PretrainedEntry | GeneralistPretrainedEntry) -> Sequence[str]:
    """How it was trained, and what the file is."""
    config = entry.config
    settings = json.dumps({"env": config.env, "agent": config.agent}, indent=1)
    among = f"the best of {entry.chosen_among} runs" if entry.chosen_among > 1 else "the only run"

    return (
        "## Training",
        f"`{config.algorithm}` with seed {config.seed}, {among}, for {entry.steps:,} steps, from "
        f"commit {code(entry.commit or 'unknown')} with "
        + ", ".join(f"{text(name)} {text(each)}" for name, each in entry.versions.items())
        + ".",
        f"```json\n{settings}\n```",
        "## The file",
        f"`models/{entry.file}` holds the weights that act as plain arrays; nothing in it is "
        f"unpickled, and it is read only where its SHA-256 is `{entry.sha256}`.",
    )


def _index(models: Models) -> str:
    one = [
        (
            f"[{text(_title(each))}]({_name(each)})",
            f"{each.score.distance:.3f}",
            f"{each.score.oracle_distance:.3f}",
            f"{each.steps:,}",
        )
        for each in models.models
    ]
    many = [
        (
            f"[{text(_title(each))}]({_name(each)})",
            f"{each.success:.3f}",
            f"{each.spl:.4f}",
            f"{each.steps:,}",
        )
        for each in models.generalists
    ]

    return page(
        "# Pretrained models",
        "Policies that come with the package, each with its card. `python -m eval pretrain` keeps "
        "them, `python -m eval cards` writes these pages from `manifest.json`.",
        "## For one factory",
        table(("model", "metres", "the oracle's", "steps"), one),
        "## For factories never seen",
        "Scores are those on validation scenes, by which the models were chosen.",
        table(("model", "success", "SPL", "steps"), many),
    )
