"""Facts of writing and reading files: whole or not at all, and never through what somebody has put
in the way.
"""

import errno
import os
from pathlib import Path

import pytest

from irs_gym import files
from irs_gym.files import read_file, write_file


def test_file_has_the_rights_of_any_other(tmp_path):
    write_file(tmp_path / "ours", b"")
    (tmp_path / "any").write_bytes(b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "any").stat().st_mode


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links there")
def test_draft_that_is_there_already_is_neither_opened_nor_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "token_hex", lambda _: "0")  # as if somebody had guessed it
    draft = tmp_path / f".file.{os.getpid()}-0"
    draft.symlink_to(tmp_path / "victim")
    with pytest.raises(FileExistsError, match=r"/file'$"):
        write_file(tmp_path / "file", b"new")
    assert not (tmp_path / "victim").exists()
    assert draft.is_symlink()


def test_names_of_two_drafts_differ(tmp_path, monkeypatch):
    seen: list[Path] = []
    monkeypatch.setattr(files, "_move", lambda draft, path: seen.append(draft))
    write_file(tmp_path / "file", b"1")
    write_file(tmp_path / "file", b"2")
    assert seen[0] != seen[1]


def test_full_disk_is_told_with_the_file_and_leaves_nothing(tmp_path, monkeypatch):
    write_file(tmp_path / "file", b"old")

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*/file'"):
        write_file(tmp_path / "file", b"new")
    assert [each.read_bytes() for each in tmp_path.iterdir()] == [b"old"]


def test_what_is_no_file_or_too_large_is_not_read(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_file(tmp_path / "file", 5) == b"12345"
    with pytest.raises(ValueError, match="file' holds 5 bytes, and at most 4 are read"):
        read_file(tmp_path / "file", 4)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(ValueError, match="is not a regular file"):
            read_file(path, 5)
