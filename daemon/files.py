"""Files: read only where they are regular and not too large, written whole or not at all."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EACCES, EFBIG, EINVAL, EISDIR, ENOTDIR, EROFS
from pathlib import Path
from threading import get_native_id
from typing import BinaryIO, Final

MOST_MODEL_BYTES: Final = 1 << 28
"""A learnt model with 10 000 fields and as many samples has some 20 MB."""


@contextmanager
def open_regular(path: Path, most_bytes: int) -> Iterator[BinaryIO]:
    """The file, open for reading. A pipe, a device or a socket would be waited for, or never end.

    Raises OSError, also for what is not a regular file and for what is larger than `most_bytes`.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        found = os.fstat(descriptor)
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(path))
        if not stat.S_ISREG(found.st_mode):
            raise OSError(EINVAL, "not a regular file", str(path))
        if found.st_size > most_bytes:
            raise OSError(EFBIG, f"more than {most_bytes} bytes", str(path))
    except OSError:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as file:
        try:
            yield file
        except OSError as error:  # a descriptor does not know its name
            error.filename = error.filename or str(path)
            raise


def read_regular(path: Path, most_bytes: int) -> bytes:
    """What is in the file. Raises OSError, as `open_regular` does."""
    with open_regular(path, most_bytes) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:  # it has grown meanwhile, or has no true size
        raise OSError(EFBIG, f"more than {most_bytes} bytes", str(path))
    return content


class CannotMakeError(OSError):
    """A file or folder cannot be made where it is to be."""


@contextmanager
def _making() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise CannotMakeError(error.errno, error.strerror, error.filename) from None


@_making()
def make_folder(path: Path) -> None:
    """The folder `path` with those above it, where it is not there yet. Raises CannotMakeError."""
    path.mkdir(parents=True, exist_ok=True)


@_making()
def check_can_be_made(path: Path) -> None:
    """Before long work whose result shall be the file `path`. Raises CannotMakeError."""
    try:
        if stat.S_ISDIR(path.stat().st_mode):
            raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(path))
    except FileNotFoundError:
        pass
    folder = path.parent
    if not stat.S_ISDIR(folder.stat().st_mode):
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(folder))
    _check_writable(folder)


@_making()
def check_folder_can_be_made(path: Path) -> None:
    """That files can be made in the folder `path`, which need not be there yet. Raises
    CannotMakeError."""
    place = path.absolute()
    while not os.path.lexists(place) and place.parent != place:
        place = place.parent
    if not stat.S_ISDIR(place.stat().st_mode):
        raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(place))
    _check_writable(place)


def _check_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        read_only = os.statvfs(folder).f_flag & os.ST_RDONLY  # to which no rights would help
        number = EROFS if read_only else EACCES
        raise OSError(number, os.strerror(number), str(folder))


def models_directory() -> Path:
    """Where learnt models are kept, and whatever else a client may name."""
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "tentacled" / "models"


# Writing: a reader sees the old file or the whole new one.


@contextmanager
def whole_file(path: Path, mode: int | None = None) -> Iterator[BinaryIO]:
    """A file to write, which is under its name once all of it is on the disk, and else never.

    However many write it at the same time. mode: its permissions, from its first byte on; None:
    what the umask leaves. Raises OSError.
    """
    partial = path.with_name(f".{path.name}.{get_native_id()}.partial")
    partial.unlink(missing_ok=True)

    def opened(name: str, flags: int) -> int:
        return os.open(name, flags | os.O_CLOEXEC, 0o666 if mode is None else 0o600)

    try:
        with open(partial, "xb", opener=opened) as file:
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file that is either there with all of `data`, or as it was before. Raises OSError."""
    with whole_file(path, mode) as file:
        file.write(data)
