"""Arrays on disk: one npz, whole or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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
