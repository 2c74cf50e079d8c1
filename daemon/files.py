"""Files that somebody has named: regular ones only, of a bounded size, without waiting.

And where those are kept that may be named.
"""

import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

MOST_MODEL_BYTES: Final = 1 << 28
"""A learnt model with 10 000 fields and as many samples has some 20 MB."""


@contextmanager
def open_regular(path: Path, most_bytes: int) -> Iterator[BinaryIO]:
    """The file, open for reading. A pipe, a device or a socket would be waited for, or never end.

    Raises OSError, also for what is not a regular file and for what is larger than `most_bytes`.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(EINVAL, "not a regular file", str(path))
        if found.st_size > most_bytes:
            raise OSError(EFBIG, f"more than {most_bytes} bytes", str(path))
        yield file


def read_regular(path: Path, most_bytes: int) -> bytes:
    """What is in the file. Raises OSError, as `open_regular` does."""
    with open_regular(path, most_bytes) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:  # it has grown meanwhile, or has no true size
        raise OSError(EFBIG, f"more than {most_bytes} bytes", str(path))
    return content


def models_directory() -> Path:
    """Where learnt models are kept, and whatever else a client may name."""
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "tentacled" / "models"


# Arrays on disk: one npz, whole or not at all.


_LINE: Final = 200
"""Characters."""


class ModelError(ValueError):
    """A file that cannot be loaded: not a model, or not one of this robot's."""


def in_a_line(error: Exception) -> str:
    """What a reader of files says that it has met, short enough to be told."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words}"[:_LINE]


def save_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """A reader sees the old file or the whole new one, however many write it. Raises OSError."""
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def prefixed(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays of one part, under names that only this part has in its file."""
    return {prefix + name: array for name, array in arrays.items()}


def stripped(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays of one part again, out of all that a file holds."""
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
