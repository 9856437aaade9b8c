"""`python -m eval leaderboard`: docs/leaderboard.md, from files that are each played anew."""

import re
import sys
from pathlib import Path

from rich.progress import track as progress

from eval.leaderboard.page import leaderboard_page
from eval.leaderboard.replay import Verified, verify
from eval.leaderboard.submission import load
from eval.leaderboard.track import TRACKS
from eval.markdown import printable
from eval.origin import commands_block, commands_of
from irs_gym.files import write_file

FILE = re.compile(r"[\w-][\w.-]*\.json(\.gz)?")


def main(folder: Path = Path("docs/leaderboard"), out: Path = Path("docs")) -> int:
    """Verify all submissions of a folder, and write leaderboard.md.

    A file that is refused keeps the page from being written.

    Parameters
    ----------
    folder
        Folder of submissions, TRACK/NAME.json.gz; it lies in OUT.
    out
        Folder of the page.
    """
    try:
        files = _files(folder)
        found = {}

        for file in progress(files, "playing anew", transient=True):
            found[file.relative_to(out)] = _verified(file)

        shown = folder.as_posix()
        commands = commands_block(commands_of("leaderboard", None))
        out.mkdir(parents=True, exist_ok=True)
        write_file(out / "leaderboard.md", leaderboard_page(found, shown, commands).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval leaderboard: {printable(str(error))}", file=sys.stderr)
        return 2

    print(f"{len(files)} submissions accepted; written: {out / 'leaderboard.md'}")

    return 0


def _files(folder: Path) -> list[Path]:
    """The submissions of a folder, in order; a ``ValueError`` where something else lies there."""
    files = sorted(each for each in folder.glob("*/*") if not each.name.startswith("."))
    if not files:
        raise ValueError(f"no submission lies in {str(folder)!r}, as TRACK/NAME.json.gz")

    for file in files:
        if not FILE.fullmatch(file.name) or file.parent.name not in TRACKS:
            raise ValueError(f"{str(file)!r} is not named TRACK/NAME.json.gz")

    return files


def _verified(file: Path) -> Verified:
    """A submission that lies in the folder of its track; a ``ValueError`` names the file."""
    try:
        found = verify(load(file))
        if found.track.name != file.parent.name:
            raise ValueError(f"it is of the track {found.track.name}")
    except ValueError as error:
        raise ValueError(f"{str(file)!r}: {error}") from None

    return found
