"""Files that somebody has named: regular ones only, of a bounded size, without waiting.

And where those are kept that may be named.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EFBIG, EINVAL
from pathlib import Path
from typing import BinaryIO, Final

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
