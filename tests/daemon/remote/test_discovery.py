"""The folder of a running daemon: whose it is, who can get at it, and how it is found."""

import fcntl
import os
from pathlib import Path

import pytest

from config.remote import Remote
from daemon.host.clock import run_in_real_time
from daemon.remote.discovery import (
    FolderError,
    RuntimeFolder,
    SecondDaemonError,
    read_daemon,
    running_daemons,
    who_may_move,
)
from tests.daemon.remote.rig import ROBOT, serving

_NOBODY = 65534


def test_only_the_own_user_can_get_at_the_socket_unless_the_group_may(tmp_path: Path) -> None:
    async def test() -> None:
        for group, folder_mode, socket_mode in ((False, 0o700, 0o600), (True, 0o750, 0o660)):
            folder = tmp_path / str(group)
            async with serving(folder, settings=Remote(group_may_connect=group)):
                assert folder.stat().st_mode & 0o777 == folder_mode
                assert (folder / "zenoh.sock").stat().st_mode & 0o777 == socket_mode

    run_in_real_time(test())


def test_a_folder_that_anybody_can_write_to_is_refused(tmp_path: Path) -> None:
    async def test() -> None:
        folder = tmp_path / "open"
        folder.mkdir()
        folder.chmod(0o777)
        with pytest.raises(FolderError, match="anybody can write to"):
            async with serving(folder):
                pass

    run_in_real_time(test())


def test_a_folder_that_another_user_could_move_away_is_refused(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    folder = shared / "robots" / "one"
    for mode, by in ((0o777, "anybody"), (0o775, "its group")):
        shared.chmod(mode)
        if by == "its group":
            os.chown(shared, -1, _some_other_group())
        with pytest.raises(FolderError, match=f"{by} can move it out of {shared}: chmod"):
            RuntimeFolder(folder, group=False).take()
    shared.chmod(0o1777)  # as /tmp is
    taken = RuntimeFolder(folder, group=False)
    taken.take()
    taken.give_back()
    assert who_may_move(folder) == ""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_a_folder_below_somebody_elses_or_behind_their_link_is_refused(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    (theirs / "ours").mkdir(parents=True)
    os.chown(theirs, _NOBODY, -1)
    with pytest.raises(FolderError, match=f"{theirs} belongs to somebody else"):
        RuntimeFolder(theirs / "ours", group=False).take()
    public = tmp_path / "public"
    public.mkdir()
    public.chmod(0o1777)
    link = public / "link"
    link.symlink_to(tmp_path)
    RuntimeFolder(link / "folder", group=False)._make()
    os.chown(link, _NOBODY, -1, follow_symlinks=False)
    with pytest.raises(FolderError, match=f"somebody else's link, {link}, leads there"):
        RuntimeFolder(link / "folder", group=False).take()


def _some_other_group() -> int:
    """One that is not only ours; where we may give files to none, the test does with our own."""
    return _NOBODY if os.getuid() == 0 else os.getgroups()[-1]


def test_a_lock_file_that_is_removed_under_our_hands_is_not_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another daemon gives the folder back between our opening of the file and our locking it."""
    first = RuntimeFolder(tmp_path, group=False)
    first.take()
    lock = fcntl.flock

    def late(file: int, how: int) -> None:
        first.give_back()
        monkeypatch.setattr(fcntl, "flock", lock)
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    second = RuntimeFolder(tmp_path, group=False)
    second.take()
    with pytest.raises(SecondDaemonError):
        RuntimeFolder(tmp_path, group=False).take()
    second.give_back()


def test_a_running_daemon_can_be_found(tmp_path: Path) -> None:
    async def test() -> None:
        assert running_daemons(tmp_path) == []
        async with serving(tmp_path / ROBOT):
            assert running_daemons(tmp_path) == [tmp_path / ROBOT]
            found = read_daemon(tmp_path / ROBOT)
            assert found is not None
            assert (found.robot, found.version, found.simulated) == (ROBOT, "1.2.3", True)
        assert running_daemons(tmp_path) == []

    run_in_real_time(test())
