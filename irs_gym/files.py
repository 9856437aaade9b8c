"""`write_file`: a file that is written as a whole, or not at all; `read_file`: a small one, or an error."""

import os
import stat
from pathlib import Path
from secrets import token_hex


def write_file(path: Path, content: bytes) -> None:
    """Write a file: whoever reads it, at any moment and after any crash, finds the old content or the new.

    Raises ``OSError``, with the path, where it cannot be written.
    """
    # Nobody can tell the draft's name, and a file or link that has it all the same is never opened.
    draft = path.with_name(f".{path.name}.{os.getpid()}-{token_hex(8)}")

    try:
        with draft.open("xb") as file:
            try:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            except BaseException:
                draft.unlink(missing_ok=True)
                raise
        _move(draft, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def read_file(path: Path, most: int) -> bytes:
    """Content of a regular file of so many bytes or fewer; never waits for a pipe.

    Raises
    ------
    OSError
        Where it cannot be read.
    ValueError
        Where it is a pipe, a device or a folder, or larger.
    """
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        found = os.fstat(number)
        if not stat.S_ISREG(found.st_mode):
            raise ValueError(f"{str(path)!r} is not a regular file")
        with open(number, "rb", closefd=False) as file:
            content = file.read(most + 1)
    finally:
        os.close(number)

    if len(content) > most:
        raise ValueError(f"{str(path)!r} holds {found.st_size:,} bytes, and at most {most:,} are read")
    return content


def _move(draft: Path, path: Path) -> None:
    try:
        os.replace(draft, path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
