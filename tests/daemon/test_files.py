"""Files that are written whole or not at all, with the permissions that were asked for."""

import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from daemon.files import (
    CannotMakeError,
    check_can_be_made,
    check_folder_can_be_made,
    read_regular,
    write_whole,
)


def _mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_file_is_whole_or_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.json"
    write_whole(path, b"old")

    def fail(fd: int) -> None:
        raise OSError("the disk is gone")

    monkeypatch.setattr("daemon.files.os.fsync", fail)
    with pytest.raises(OSError, match="gone"):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_are_as_asked_for_whatever_the_umask_is(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        write_whole(tmp_path / "group", b"", 0o640)
        write_whole(tmp_path / "usual", b"")
        os.umask(0o000)
        write_whole(tmp_path / "secret", b"", 0o600)
    finally:
        os.umask(before)
    assert [_mode(tmp_path / name) for name in ("group", "usual", "secret")] == [
        0o640,
        0o600,
        0o600,
    ]


def test_what_somebody_has_put_in_the_way_is_not_written_to(tmp_path: Path) -> None:
    """A link under the name of the unfinished file would lead a secret to somewhere else."""
    elsewhere = tmp_path / "elsewhere"
    path = tmp_path / "lease.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daemon.files.get_native_id", lambda: 7)
        (tmp_path / ".lease.json.7.partial").symlink_to(elsewhere)
        write_whole(path, b"token", 0o600)
    assert not elsewhere.exists()
    assert path.read_bytes() == b"token"
    assert not path.is_symlink()


def test_however_many_write_it_a_reader_sees_one_whole(tmp_path: Path) -> None:
    path = tmp_path / "model"
    contents = [bytes([i]) * 100_000 for i in range(8)]
    write_whole(path, contents[0])
    with ThreadPoolExecutor(8) as threads:
        jobs = [threads.submit(write_whole, path, content) for content in contents * 5]
        seen = [read_regular(path, 1 << 20) for _ in range(50)]
        for job in jobs:
            job.result()
    assert set(seen) <= set(contents)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("flag", "told"), [(os.ST_RDONLY, "Read-only file system"), (0, "Permission denied")]
)
def test_a_disk_that_is_read_only_is_not_taken_for_missing_rights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flag: int, told: str
) -> None:
    monkeypatch.setattr("daemon.files.os.access", lambda *_: False)
    monkeypatch.setattr("daemon.files.os.statvfs", lambda _: SimpleNamespace(f_flag=flag))
    with pytest.raises(CannotMakeError, match=told):
        check_can_be_made(tmp_path / "report.html")
    with pytest.raises(CannotMakeError, match=told):
        check_folder_can_be_made(tmp_path / "runs" / "today")
