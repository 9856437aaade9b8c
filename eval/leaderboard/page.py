"""`leaderboard_page`: all accepted submissions, as a page."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eval.leaderboard.replay import Verified
from eval.leaderboard.track import SEED, TRACKS, Track
from eval.markdown import code, page, table, template, text


def leaderboard_page(
    found: Mapping[Path, Verified], folder: str, commands: str, tracks: Mapping[str, Track] = TRACKS
) -> str:
    """The page of verified submissions by their files, whose paths are those from the page.

    ``folder`` is where they lie, ``commands`` what made the page.
    """
    boards = [_board(each, found) for each in tracks.values()]
    return template("leaderboard.md").format(
        commands=commands,
        folder=folder,
        tracks=table(
            ("track", "scenes", "agents may see", "env_id", "arguments", "seed"),
            [
                (
                    each.name,
                    f"{len(each.scenes):,}",
                    "all" if each.sees == "all" else "the patch around the robot",
                    code(each.env_id),
                    code(json.dumps(dict(each.arguments))),
                    SEED,
                )
                for each in tracks.values()
            ],
        ),
        boards=page(*boards).strip(),
    )


def _board(track: Track, found: Mapping[Path, Verified]) -> str:
    """A section of what was handed in for a track, the best first."""
    own = {file: each for file, each in found.items() if each.track.name == track.name}
    if not own:
        return ""

    rows = [_row(file, own[file]) for file in sorted(own, key=lambda file: _order(file, own[file]))]
    header = (
        "agent",
        "authors",
        "version",
        "success",
        "SPL",
        "ratio",
        "optimal",
        "refused",
        "file",
    )

    return page(f"## {track.name}", table(header, rows))


def _order(file: Path, each: Verified) -> tuple[Any, ...]:
    """The greatest SPL first, then the most optimal episodes, then by name."""
    scores = each.scores
    return -scores.spl, -scores.optimal, each.submission.agent.name, file.as_posix()


def _row(file: Path, each: Verified) -> Sequence[str]:
    agent = each.submission.agent
    scores = each.scores
    commit = f", {agent.commit[:8]}" if agent.commit else ""

    return (
        text(agent.name),
        text(agent.authors),
        text(f"{agent.version}{commit}"),
        f"{scores.success:.4f}",
        f"{scores.spl:.4f}",
        "–" if scores.ratio is None else f"{scores.ratio:.4f}",
        f"{scores.optimal:,} of {len(each.outcomes):,}",
        f"{sum(outcome.refused for outcome in each.outcomes):,}",
        f"[actions]({file.as_posix()})",
    )
