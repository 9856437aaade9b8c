"""`python -m eval verify`: submissions to the leaderboard, played anew and accepted or refused."""

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from eval.leaderboard.replay import verify
from eval.leaderboard.submission import Refusal, load
from eval.markdown import printable


def main(
    files: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="FILE [...]", help_behavior_hint="")
    ],
) -> int:
    """Play submissions anew in their environments, step by step, and accept or refuse each.

    The exit status is 0 where all are accepted, 1 where one is refused, and 2 where one cannot be
    read.

    Parameters
    ----------
    files
        Submissions, as `python -m eval submit` writes them.
    """
    if not files:
        print("python -m eval verify: name one file or more", file=sys.stderr)
        return 2

    return max(_verified(each) for each in files)


def _verified(file: Path) -> int:
    """Exit status for one file."""
    try:
        found = verify(load(file))
    except Refusal as error:
        print(f"{printable(str(file))}: refused: {printable(str(error))}", file=sys.stderr)
        return 1
    except (OSError, ValueError) as error:
        print(f"python -m eval verify: {printable(str(error))}", file=sys.stderr)
        return 2

    scores = found.scores
    print(
        f"{printable(str(file))}: accepted on {found.track.name}: success {scores.success:.4f}, "
        f"SPL {scores.spl:.4f}, {scores.optimal} of {len(found.outcomes)} episodes are optimal"
    )

    return 0
