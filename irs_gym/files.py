"""Files from anywhere: read within limits, never unpickled, written as a whole or not at all."""

import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Collection
from io import BytesIO
from math import prod
from pathlib import Path
from secrets import token_hex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irs_gym.memory import check_memory

MEMBERS = 1000  # arrays in an archive
_AXES = 32  # of an array
_HEADER = 4096  # bytes of an array's header
# The header as NumPy writes it. Python would read more, but then a stranger chooses what Python
# reads.
_DESCRIPTION = re.compile(
    r"\s*\{\s*'descr':\s*'(?P<type>[^']*)',\s*'fortran_order':\s*(?P<order>True|False),"
    r"\s*'shape':\s*\((?P<shape>[\d, ]*)\),?\s*\}\s*"
)
_TYPES = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|c8|c16|[SU]\d{1,9})")
_DAMAGE = (
    EOFError,
    KeyError,
    IndexError,
    OSError,
    OverflowError,
    RuntimeError,
    struct.error,
    zlib.error,
)


# --- reading --------------------------------------------------------------------------------------


def as_path(value: Any, name: str) -> Path:
    """The path of a file; a ``ValueError`` names the field where the value is none (a number would
    be an open file).
    """
    wrong = ValueError(f"{name}={value!r} must be the path of a file")
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise wrong
    try:
        is_path = b"\0" not in os.fsencode(value)
    except UnicodeEncodeError:  # half a character
        is_path = False
    if not is_path:
        raise wrong

    return Path(value)


def read_file(path: Path, most: int | None = None) -> bytes:
    """Content of a regular file: pipes and devices, which may never end, are not opened.

    Parameters
    ----------
    most
        Bytes that the file may have; by default as many as may be held in memory.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    OSError
        Where it cannot be read.
    ValueError
        Where it is no regular file, or larger than the limit.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError(f"{str(path)!r} is not a regular file")

    # Should it be replaced by a pipe just now, opening does not wait for a writer.
    descriptor = os.open(
        path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    )
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise ValueError(f"{str(path)!r} is not a regular file")

        _check_size(f"{str(path)!r}", found.st_size, most)
        return file.read(found.st_size)


def read_arrays(
    source: bytes | Path, *, limit: int | None = None, needed: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Arrays of an ``.npz`` archive by their names, of real or complex numbers, bools or strings;
    never unpickles.

    All sizes are read from the archive's directory and from the arrays' headers, and held against
    the limit, before anything is unpacked.

    Parameters
    ----------
    source
        The path of the archive, or its content.
    limit
        Bytes that file and arrays may have; by default as many as may be held in memory.
    needed
        Names of arrays that must be there.

    Raises
    ------
    FileNotFoundError, OSError
        Where the file cannot be read.
    ValueError
        Where it is no such archive, or damaged; where it holds more than the limit.
    """
    content = read_file(source, limit) if isinstance(source, Path) else source
    _check_size("the archive", len(content), limit)

    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            members = _members(archive, limit)
            missing = sorted(set(needed) - set(members))
            if missing:
                raise ValueError(f"{', '.join(missing)} is not a file in the archive")

            headers = {name: _header(archive, name, each) for name, each in members.items()}

            return {
                name: _array(archive, members[name], *header) for name, header in headers.items()
            }
    except zipfile.BadZipFile as error:
        raise ValueError(f"it is not a whole npz archive: {error}") from None
    except _DAMAGE as error:
        raise ValueError(f"the archive is damaged: {error}") from None


def _check_size(what: str, size: int, limit: int | None) -> None:
    if limit is None:
        check_memory(what, size)
    elif size > limit:
        raise ValueError(f"{what} holds {size:,} bytes, and at most {limit:,} are read")


def _members(archive: zipfile.ZipFile, limit: int | None) -> dict[str, zipfile.ZipInfo]:
    """The archive's members by the names of their arrays, when its directory is one that NumPy
    could have written.
    """
    entries = archive.infolist()
    if len(entries) > MEMBERS:
        raise ValueError(
            f"the archive holds {len(entries)} arrays, more than the {MEMBERS} that are read here"
        )

    # Members that overlap are how a small file unpacks to a very large one.
    end = 0
    for entry in sorted(entries, key=lambda each: each.header_offset):
        if entry.flag_bits & 1:
            raise ValueError(f"{entry.filename!r} is encrypted")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(
                f"{entry.filename!r} is compressed by method {entry.compress_type}, "
                "not deflated or stored"
            )
        if entry.header_offset < end:
            raise ValueError(f"{entry.filename!r} overlaps another member")

        end = entry.header_offset + entry.compress_size

    _check_size("what the archive unpacks to", sum(entry.file_size for entry in entries), limit)

    members = {
        entry.filename.removesuffix(".npy"): entry
        for entry in entries
        if entry.filename.endswith(".npy")
    }
    if len(members) < len(entries):
        raise ValueError("the archive holds two arrays of one name, or files that are no arrays")

    return members


def _header(
    archive: zipfile.ZipFile, name: str, entry: zipfile.ZipInfo
) -> tuple[int, np.dtype[Any], str, list[int]]:
    """Where an array's numbers begin, their type, their order and the array's shape; nothing else
    is unpacked.
    """
    with archive.open(entry) as file:
        # magic string, version, and the header's length: in 2 bytes in version 1, 4 later
        start = file.read(12)
        if start[:6] != b"\x93NUMPY" or start[6:8] not in (b"\x01\x00", b"\x02\x00", b"\x03\x00"):
            raise ValueError(f"{name} is not an array in NumPy's format")

        prefix = 10 if start[6] == 1 else 12
        length = int.from_bytes(start[8:prefix], "little")
        if length > _HEADER:
            raise ValueError(
                f"{name} has a header of {length} bytes, more than the {_HEADER} that are read here"
            )

        text = (start[prefix:] + file.read(prefix + length - 12)).decode("latin1")

    found = _DESCRIPTION.fullmatch(text)
    if found is None:
        raise ValueError(
            f"{name} has a header that NumPy does not write for an array of plain numbers"
        )
    if found["type"].lstrip("|") == "O":
        raise ValueError(
            f"{name} holds objects, which would have to be unpickled (allow_pickle=False)"
        )
    if not _TYPES.fullmatch(found["type"]):
        raise ValueError(
            f"{name} holds values of the type {found['type']!r}, not numbers, bools or strings"
        )

    kind = np.dtype(found["type"])
    shape = [int(part) for part in found["shape"].split(",") if part.strip()]
    if len(shape) > _AXES or any(length >= 2**62 for length in shape):
        raise ValueError(f"{name} has a shape that no array has")
    if prefix + length + kind.itemsize * prod(shape) != entry.file_size:
        raise ValueError(
            f"{name} has {entry.file_size} bytes, "
            f"but {tuple(shape)} values of the type {kind} are others"
        )

    return prefix + length, kind, "F" if found["order"] == "True" else "C", shape


def _array(
    archive: zipfile.ZipFile,
    entry: zipfile.ZipInfo,
    start: int,
    kind: np.dtype[Any],
    order: str,
    shape: list[int],
) -> NDArray[Any]:
    """The array of a member whose header has been read."""
    content = archive.read(entry)
    if kind.itemsize == 0 or not prod(shape):
        return np.zeros(shape, kind)

    flat = np.frombuffer(content, kind, offset=start)
    array = flat.reshape(shape, order=order)  # type: ignore[call-overload]
    # Values that NumPy itself would never write, and that crash or surprise those who use them.
    if kind.kind == "b" and (array.view(np.uint8) > 1).any():
        raise ValueError(f"{entry.filename!r} holds bools that are neither True nor False")
    if (
        kind.kind == "U"
        and (np.frombuffer(content, f"{kind.byteorder}u4", offset=start) > 0x10FFFF).any()
    ):
        raise ValueError(f"{entry.filename!r} holds characters that there are not")

    return np.asarray(array.astype(kind.newbyteorder("=")))


# --- writing --------------------------------------------------------------------------------------


def write_file(path: Path, content: bytes) -> None:
    """Write a file: whoever reads it, at any moment and after any crash, finds the old content or
    the new.

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


def _move(draft: Path, path: Path) -> None:
    try:
        os.replace(draft, path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
