"""Facts of files from elsewhere: sizes are known before anything is unpacked, damage is told,
nothing is unpickled.
"""

import io
import os
import subprocess
import sys
import threading
import warnings
import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from irs_gym import RadioMap, load_scene
from irs_gym.files import as_path, read_arrays, read_file
from irs_gym.radio.scene import load_scenes

ARRAYS = {
    "one": np.arange(6.0).reshape(2, 3),
    "two": np.array([True, False]),
    "text": np.array("é"),
}


def npz(arrays=ARRAYS, method=zipfile.ZIP_DEFLATED, change=lambda name, content: content) -> bytes:
    """An archive of arrays, each file changed."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", method) as archive:
        for name, array in arrays.items():
            one = io.BytesIO()
            np.save(one, array)
            archive.writestr(f"{name}.npy", change(name, one.getvalue()))
    return content.getvalue()


def header(text: str) -> bytes:
    """The start of an ``.npy`` file with that header."""
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


# --- what is read ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize(
    "array",
    [
        np.arange(24.0).reshape(2, 3, 4),
        np.asfortranarray(np.arange(6).reshape(2, 3)),
        np.float64(0.5),
        np.zeros((0, 3)),
        np.arange(3, dtype=">i4"),
        np.array([1 + 2j]),
        np.array(["ab", "é"]),
        np.array([b"ab", b""]),
        np.zeros(3, np.float16),
        np.array(["", ""]),
    ],
    ids=lambda array: f"{np.asarray(array).dtype}{np.shape(array)}",
)
def test_plain_arrays_are_read_as_numpy_reads_them(array, method):
    found = read_arrays(npz({"a": array}, method))["a"]
    np.testing.assert_array_equal(found, array)
    assert found.shape == np.shape(array)
    assert found.dtype == np.asarray(array).dtype.newbyteorder("=")


def test_what_numpy_writes_is_read(tmp_path):
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **ARRAYS)
        found = read_arrays(tmp_path / "a.npz", needed=ARRAYS)
        assert all(np.array_equal(found[name], array) for name, array in ARRAYS.items())


# --- what is refused ------------------------------------------------------------------------------


def encrypted() -> bytes:
    content = bytearray(npz())
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(signature) + offset] |= 1
    return bytes(content)


def overlapping() -> bytes:
    """A directory in which two names stand for one file's bytes."""
    content = npz({"one": np.zeros(3), "two": np.zeros(3)}, zipfile.ZIP_STORED)
    second = content.rindex(b"PK\x01\x02")
    return content[: second + 42] + (0).to_bytes(4, "little") + content[second + 46 :]


def duplicate() -> bytes:
    content = io.BytesIO(npz())
    with warnings.catch_warnings(), zipfile.ZipFile(content, "a") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("one.npy", b"")
    return content.getvalue()


def forged(text: str) -> bytes:
    return npz({"a": np.zeros(3)}, change=lambda *_: header(text) + bytes(24))


class Thief:
    """Would run code if it were unpickled."""

    def __reduce__(self):
        return os._exit, (1,)


DAMAGE = [
    (b"", "not a whole npz archive"),
    (b"PK\x03\x04", "not a whole npz archive"),
    (npz()[:-30], "not a whole npz archive"),
    (npz(method=zipfile.ZIP_LZMA), "compressed by method 14"),
    (npz(method=zipfile.ZIP_BZIP2), "compressed by method 12"),
    (encrypted(), "'one.npy' is encrypted"),
    (overlapping(), "overlaps another"),
    (duplicate(), "two arrays of one name"),
    (
        npz({f"a{n}": np.zeros(1) for n in range(1001)}, zipfile.ZIP_STORED),
        "1001 arrays, more than the 1000",
    ),
    (npz({"a": np.array([Thief()], dtype=object)}), r"a holds objects.*unpickled"),
    (npz({"a": np.zeros(2, [("x", "f8")])}), "a has a header that NumPy does not write"),
    (npz({"a": np.zeros(2, "M8[s]")}), r"values of the type '<M8\[s\]'"),
    (npz(change=lambda *_: b"text"), "one is not an array in NumPy's format"),
    (
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 9), }\n"),
        "but .* values .* are others",
    ),
    (
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }\n"),
        r"a has .* bytes, but \(4,\) values",
    ),
    (
        forged("{'descr': '<f8', 'fortran_order': False, 'shape': (-3,), }\n"),
        "a header that NumPy does not write",
    ),
    (
        forged("{'descr': __import__('os'), 'fortran_order': False, 'shape': (3,), }\n"),
        "NumPy does not write",
    ),
    (forged("(" * 2000), "a has a header that NumPy does not write"),
    (
        npz({"a": np.zeros(1)}, change=lambda *_: header(" " * 9000)),
        "header of 9000 bytes, more than the 4096",
    ),
    (
        npz({"a": np.array([True])}, change=lambda _, each: each[:-1] + b"\x07"),
        "neither True nor False",
    ),
    (
        npz({"a": np.array(["a"])}, change=lambda _, each: each[:-1] + b"\x7f"),
        "characters that there are not",
    ),
]


@pytest.mark.parametrize(("content", "message"), DAMAGE, ids=[message for _, message in DAMAGE])
def test_an_archive_that_is_damaged_or_means_harm_is_refused_with_the_reason(content, message):
    with pytest.raises(ValueError, match=message):
        read_arrays(content)


def test_every_turned_bit_is_told_or_changes_nothing():
    whole = npz()
    for place in range(len(whole)):
        content = whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :]
        try:
            found = read_arrays(content)
        except ValueError:
            continue
        assert all(np.array_equal(found[name], ARRAYS[name]) for name in {*found} & {*ARRAYS}), (
            place
        )


def test_a_bomb_is_refused_by_the_size_that_it_tells(monkeypatch, tmp_path):
    monkeypatch.setenv("IRS_GYM_MEMORY", "1MiB")
    path = tmp_path / "bomb.npz"
    path.write_bytes(npz({"gain_db": np.zeros((1000, 1000))}))
    assert path.stat().st_size < 20_000
    with pytest.raises(
        ValueError,
        match=r"bomb\.npz' is not a radio map: what the archive unpacks to would take 7\.6",
    ):
        RadioMap.load(path)


def test_a_bomb_that_lies_about_its_size_is_never_unpacked(tmp_path):
    content = npz({"a": np.zeros(10**7)})
    size = (80_000_128).to_bytes(4, "little")
    assert content.count(size) == 2
    content = content.replace(size, (800).to_bytes(4, "little"))
    program = (
        "import resource, sys\nfrom irs_gym.files import read_arrays\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try:\n    read_arrays(sys.stdin.buffer.read())\nexcept ValueError:\n"
        "    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], input=content, capture_output=True, check=True
    )
    assert int(done.stdout) * (1 if sys.platform == "darwin" else 1024) < 40_000_000


# --- what is no file ------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [5, 0, True, None, b"map.npz", 1.5, ["map.npz"], "a\0b"])
def test_what_is_no_path_is_refused_and_never_opened(value):
    with pytest.raises(ValueError, match=r"radio_map=.* must be the path of a file"):
        RadioMap.load(value)
    with pytest.raises(ValueError, match=r"scene=.* must be the path of a file"):
        load_scene(value)
    with pytest.raises(ValueError, match="out="):
        as_path(value, "out")


@pytest.mark.parametrize("value", [5, True])
def test_an_environment_refuses_a_number_in_place_of_a_map(value):
    with pytest.raises(ValueError, match=f"radio_map={value} must be the path of a file"):
        gymnasium.make("irs_gym:IrsNav-v0", radio_map=value, start=(0, 0), goal=(1, 1))


def within(seconds: float, work) -> list[BaseException]:
    """What work raised; fails where it has not ended in time."""
    raised: list[BaseException] = []

    def run():
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    assert not thread.is_alive()
    return raised


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are a thing of POSIX")
def test_pipes_and_devices_are_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", Path("/dev/zero")):
        for read in (RadioMap.load, load_scene, read_file):
            (error,) = within(20, lambda read=read, path=path: read(path))
            assert isinstance(error, ValueError | FileNotFoundError)
            assert str(path) in str(error)
    (error,) = within(20, lambda: load_scenes(tmp_path))
    assert "pipe.json" in str(error)


def test_a_folder_is_no_map(tmp_path):
    with pytest.raises(ValueError, match="is not a regular file"):
        RadioMap.load(tmp_path)


def test_a_file_of_10_gigabytes_is_refused_by_its_size(tmp_path, monkeypatch):
    monkeypatch.setenv("IRS_GYM_MEMORY", "1GiB")
    for name in ("map.npz", "scene.json"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(10 * 10**9)  # a hole: takes no room on the disk
    with pytest.raises(
        ValueError, match=r"map\.npz' would take 9\.313 GiB of memory, more than the limit of 1 GiB"
    ):
        RadioMap.load(tmp_path / "map.npz")
    with pytest.raises(
        ValueError,
        match=r"scene\.json' holds 10,000,000,000 bytes, and at most 16,777,216 are read",
    ):
        load_scene(tmp_path / "scene.json")
