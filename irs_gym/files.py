"""`write_file`: a file that is written as a whole, or not at all."""

import os
from pathlib import Path
from threading import get_ident


def write_file(path: Path, content: bytes) -> None:
    """Write a file: whoever reads it, at any moment and after any crash, finds the old content or the new.

    Raises ``OSError`` where it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{get_ident()}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
