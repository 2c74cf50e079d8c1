"""A file that takes what it is given even while the disk does not: it waits for room, in memory."""

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

_WRITE_FROM: Final = 1 << 16


class PatientFile:
    """Append only, new, and locked against a recovery while it is open.

    What the disk refuses is kept and tried again at the next flush, in order, so that the file is
    at any time the beginning of what was written to it. Who writes looks at `pending`.
    """

    def __init__(self, path: Path) -> None:
        """Raises OSError; FileExistsError where there is such a file."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._fd = os.open(path, flags, 0o644)
        with suppress(OSError):  # not every file system has locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._pending = bytearray()
        self.written = 0
        """Bytes that the operating system has taken."""
        self.failed = ""
        """Why it does not take more; empty: it does."""
        self.deleted = False
        """Whether its name is gone, as of the last `sync`."""

    @property
    def pending(self) -> int:
        """Bytes that wait."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        """Take all of `data`."""
        self._pending += data
        if len(self._pending) >= _WRITE_FROM and not self.failed:
            self.flush()
        return len(data)

    def tell(self) -> int:
        """Where the next byte will stand."""
        return self.written + len(self._pending)

    def flush(self) -> None:
        """Hand what waits to the operating system, as far as it takes it."""
        try:
            while self._pending:
                taken = os.write(self._fd, self._pending)
                self.written += taken
                del self._pending[:taken]
            self.failed = "the file was deleted" if self.deleted else ""
        except OSError as error:
            self.failed = error.strerror or str(error)

    def sync(self) -> None:
        """Wait until the disk has what was handed over."""
        try:
            os.fdatasync(self._fd)
            if os.fstat(self._fd).st_nlink == 0:
                self.deleted, self.failed = True, "the file was deleted"
        except OSError as error:
            self.failed = error.strerror or str(error)

    def close(self) -> None:
        """Give up what still waits."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def sync_folder(folder: Path) -> None:
    """Make a new name in `folder` outlive a power cut. Raises OSError."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
