"""`sign`: the HMAC of a content with a key of this user's own, by which what was made here is known
again.

The key is made on demand: a file that this user alone can read, at the path in ``IRS_GYM_KEY``,
else in the user's folder for settings. Machines that share runs may share such a file.
"""

import hmac
import os
import secrets
import stat
import sys
from hashlib import sha256
from pathlib import Path

_BYTES = 32


class NoKeyError(Exception):
    """There is no key of this user's own, and none can be made; the message says why."""


def sign(content: bytes) -> str:
    """HMAC-SHA-256 of a content with this user's key; `NoKeyError` where there can be none."""
    return hmac.new(_key(), content, sha256).hexdigest()


def verify(content: bytes, signature: str | None) -> bool:
    """Whether that is the content's signature by this user; raises `NoKeyError` where there can be
    no key.
    """
    return hmac.compare_digest(sign(content), signature or "")


def key_file() -> Path:
    """Where the key is kept; raises `NoKeyError` where this user has no home."""
    given = os.environ.get("IRS_GYM_KEY")
    if given:
        return Path(given)

    try:
        if sys.platform == "win32":
            folder = Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
        elif sys.platform == "darwin":
            folder = Path.home() / "Library" / "Application Support"
        else:
            folder = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    except RuntimeError as error:
        raise NoKeyError(str(error)) from None

    return folder / "irs_gym" / "key"


def _key() -> bytes:
    path = key_file()
    try:
        if not path.exists():
            _make(path)

        found = path.stat()
        if not stat.S_ISREG(found.st_mode) or found.st_size != _BYTES:
            raise NoKeyError(
                f"{str(path)!r} is not a file of {_BYTES} bytes: remove it, and a new key is made"
            )
        if os.name == "posix" and (found.st_uid != os.geteuid() or found.st_mode & 0o077):
            raise NoKeyError(
                f"{str(path)!r} must belong to this user, and nobody else may read it: chmod 600"
            )

        return path.read_bytes()
    except OSError as error:
        raise NoKeyError(f"{str(path)!r}: {error.strerror}") from None


def _make(path: Path) -> None:
    """Make a key, unless another process is first: a key is there whole, or not at all, and never
    replaced.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    descriptor = os.open(
        draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600
    )

    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(secrets.token_bytes(_BYTES))
            file.flush()
            os.fsync(file.fileno())

        os.link(draft, path)
    except FileExistsError:
        pass
    finally:
        draft.unlink()
