"""The cache: files that can be made anew at any time, in a folder of the user's; where it fails,
there is none.
"""

import os
import sys
from contextlib import suppress
from pathlib import Path

from irs_gym.files import write_file


def cache_folder() -> Path | None:
    """``IRS_GYM_CACHE``, else the user's folder for such files; None where there is none."""
    given = os.environ.get("IRS_GYM_CACHE")
    if given:
        return Path(given)

    try:
        if sys.platform == "win32":
            folder = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            folder = Path.home() / "Library" / "Caches"
        else:
            folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # no home
        return None

    return folder / "irs_gym"


def read_cached(folder: Path | None, name: str) -> bytes | None:
    """Content of a file, None where it cannot be read."""
    try:
        return None if folder is None else (folder / name).read_bytes()
    except OSError:
        return None


def write_cached(folder: Path | None, name: str, content: bytes) -> None:
    """Write a file, whole or not at all, whoever else writes it; a folder that cannot be written is
    no error.
    """
    if folder is None:
        return

    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / name, content)
