"""`origins`, `origin_text`: the commits and versions behind a page; `commands_of`: the commands."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from agents.runs import provenance
from agents.runs.run_folder import Run
from eval.markdown import printable, text


def commands_of(name: str, trained_by: str | None) -> list[str]:
    """The commands that made a page: the one that trained, where it is known, and this call of
    `python -m eval`.
    """
    own = printable(shlex.join(["python", "-m", "eval", name, *sys.argv[2:]]))
    return [trained_by, own] if trained_by else [own]


def commands_block(commands: Sequence[str]) -> str:
    """Commands as a block of code in Markdown."""
    return "\n".join(f"    {each}" for each in commands if each)


def origins(runs: Sequence[Run]) -> dict[str, Any]:
    """Versions and commits that runs were trained with, each once, and those that score them."""
    manifests = [run.manifest for run in runs]
    return {
        "trained_with": _unique([each.versions for each in manifests]),
        "trained_from": _unique([each.commit for each in manifests]),
        "versions": provenance.versions(),
        "commit": provenance.commit(),
    }


def origin_text(record: Mapping[str, Any]) -> str:
    """Commits and versions of a record, in a sentence or two."""
    commits = ", ".join(text(each or "unknown") for each in record["trained_from"])
    trained = "; ".join(_listed(each) for each in record["trained_with"])

    return (
        f"Trained from commit {commits} with {trained}. "
        f"Scored from commit {record['commit'] or 'unknown'} with {_listed(record['versions'])}."
    )


def merged(*lists: Sequence[Any]) -> list[Any]:
    """All that is in any of some lists, each once."""
    return _unique([each for some in lists for each in some])


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{text(name)} {text(version)}" for name, version in versions.items())


def _unique(items: Sequence[Any]) -> list[Any]:
    # neither a set nor a dict: versions are dicts, which have no hash
    return [each for n, each in enumerate(items) if each not in items[:n]]
