"""How a running daemon is found on its machine, and that there is only one per robot."""

import fcntl
import grp
import os
import pwd
import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from daemon.files import write_whole

DAEMON_FILE: Final = "daemon.json"
LOCK_FILE: Final = "daemon.lock"
UNIX_SOCKET: Final = "zenoh.sock"
STOP_SOCKET: Final = "stop.sock"


class RunningDaemon(msgspec.Struct, frozen=True, kw_only=True):
    """What a daemon leaves in its runtime folder while it runs."""

    robot: str
    pid: int
    version: str
    simulated: bool
    unix_socket: str | None
    tls: str | None
    stop_socket: str | None = None
    """Where every datagram is a STOP."""

    @property
    def runs(self) -> bool:
        """Whether its process is there, as far as a process identifier can tell."""
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            return True
        return True


class SecondDaemonError(RuntimeError):
    """A daemon for this robot is running already."""


class FolderError(RuntimeError):
    """The runtime folder is not safe to use; the text says what to do."""


class RuntimeFolder:
    """The folder, taken by one daemon from `take` to `give_back`."""

    def __init__(self, path: Path, *, group: bool) -> None:
        """group: whether the daemon's group may look into it."""
        self.path = path
        self._group = group
        self._lock = -1

    def take(self) -> None:
        """Make the folder and lock it. Raises SecondDaemonError, FolderError."""
        if self._lock >= 0:
            return
        self._make()
        while self._lock < 0:
            lock = os.open(self.path / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(lock)
                raise SecondDaemonError(self._who_runs()) from None
            if _is_file(lock, self.path / LOCK_FILE):
                self._lock = lock
            else:  # another one was giving it back, and has removed what we have locked
                os.close(lock)

    def announce(self, daemon: RunningDaemon) -> None:
        """Let it be found."""
        told = msgspec.json.format(msgspec.json.encode(daemon)) + b"\n"
        write_whole(self.path / DAEMON_FILE, told, 0o640 if self._group else 0o600)

    def give_back(self) -> None:
        """Let another daemon have it."""
        if self._lock < 0:
            return
        (self.path / DAEMON_FILE).unlink(missing_ok=True)
        (self.path / LOCK_FILE).unlink(missing_ok=True)
        os.close(self._lock)
        self._lock = -1

    def _make(self) -> None:
        mode = 0o750 if self._group else 0o700
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.path.mkdir(exist_ok=True, mode=mode)
            found = self.path.stat()
            moved_by = who_may_move(self.path)
        except OSError as error:
            raise FolderError(f"no runtime folder {self.path}: {error.strerror}") from None
        if moved_by:
            raise FolderError(f"{self.path} is not safe: {moved_by}; or name another folder")
        if found.st_uid not in (os.getuid(), 0):
            raise FolderError(f"{self.path} belongs to somebody else: name another runtime folder")
        if found.st_mode & stat.S_IWOTH:
            raise FolderError(f"anybody can write to {self.path}: chmod o-w, or name another")

    def _who_runs(self) -> str:
        daemon = read_daemon(self.path)
        who = f"process {daemon.pid}" if daemon else "another process"
        return f"a daemon is running in {self.path} ({who}): only one may, end that one first"


def who_may_move(path: Path) -> str:
    """Why another user could put another folder in the place of `path`; empty: none could.

    Whoever may write to a folder may rename what is in it, unless it is sticky as /tmp is; and
    whoever owns a folder or a link may change it. Root could do anything. Raises OSError.
    """
    trusted = (0, os.getuid())
    absolute, real = path.absolute(), path.resolve()
    for link in (absolute, *absolute.parents):
        if link.is_symlink() and link.lstat().st_uid not in trusted:
            return f"somebody else's link, {link}, leads there"
    for folder in sorted({*absolute.parents, *real.parents}, key=lambda one: len(one.parts)):
        found = folder.stat()
        if found.st_uid not in trusted:
            return f"{folder} belongs to somebody else"
        if found.st_mode & stat.S_ISVTX:
            continue
        if found.st_mode & stat.S_IWOTH:
            return f"anybody can move it out of {folder}: chmod +t {folder}"
        if found.st_mode & stat.S_IWGRP and not _private_group(found.st_gid):
            return f"its group can move it out of {folder}: chmod g-w {folder}"
    return ""


def _private_group(number: int) -> bool:
    """Whether only one user is in the group, as where each has one of the same name."""
    if number == 0:
        return True
    try:
        group, user = grp.getgrgid(number), pwd.getpwuid(os.getuid())
    except KeyError:
        return False
    return group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def _is_file(descriptor: int, path: Path) -> bool:
    """Whether the open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def read_daemon(folder: Path) -> RunningDaemon | None:
    """What the daemon in `folder` says of itself, or said before it was killed."""
    with suppress(OSError, msgspec.MsgspecError):
        return msgspec.json.decode((folder / DAEMON_FILE).read_bytes(), type=RunningDaemon)
    return None


def running_daemons(root: Path) -> list[Path]:
    """The folders below `root` in which daemons run."""
    folders = sorted(path.parent for path in root.glob(f"*/{DAEMON_FILE}"))
    return [folder for folder in folders if (found := read_daemon(folder)) and found.runs]
