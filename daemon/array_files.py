"""What is learnt or collected, on disk: arrays in one npz, with a JSON text that says what they
are and whose: something learnt is used again only with the robot that it was learnt from.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.files import MOST_MODEL_BYTES, open_regular, whole_file

Arrays = dict[str, NDArray[Any]]


def save_npz(path: Path, arrays: Mapping[str, Any], compressed: bool = True) -> None:
    """As `write_whole` does. Raises OSError."""
    save: Any = np.savez_compressed if compressed else np.savez
    with whole_file(path) as file:
        save(file, allow_pickle=False, **arrays)


# Reading: whatever else is in a file under that name is told as a ModelError.


_LINE: Final = 200
"""Characters."""
_ZIP: Final = b"PK"
"""What every archive begins with."""


class ModelError(ValueError):
    """A file that cannot be loaded: not what it should be, or not one of this robot's."""


def in_a_line(error: Exception) -> str:
    """What a reader of files says that it has met, short enough to be told."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words}"[:_LINE]


@contextmanager
def read_as(path: Path, what: str) -> Iterator[None]:
    """Whatever a reader makes of bytes that are not `what` becomes a ModelError that says so.

    OSError and ModelError are left as they are.
    """
    try:
        yield
    except (OSError, ModelError):
        raise
    except Exception as error:  # of zip, zlib, numpy, JSON, and of who looks for what is missing
        raise ModelError(f"{path} is not {what}: {in_a_line(error)}") from None


def load_npz(path: Path, most_bytes: int = MOST_MODEL_BYTES) -> Arrays:
    """All arrays of a file. Raises OSError as `open_regular` does, and whatever else a reader makes
    of bytes that are none: to be called in `read_as`."""
    with open_regular(path, most_bytes) as file:
        if file.read(len(_ZIP)) != _ZIP:  # which numpy would take for pickled data, and say so
            raise ValueError("no NumPy archive (.npz)")
        file.seek(0)
        with np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}


@dataclass(frozen=True)
class ArrayFile:
    """Arrays, and what they are of."""

    about: dict[str, Any]
    """Its `kind`, whose it is (`whose`), and where it came from. For JSON."""
    arrays: Arrays

    def save(self, path: Path, text: str = "metadata") -> None:
        """Write it whole. text: the JSON text's name among the arrays. Raises OSError."""
        about = json.dumps(self.about, sort_keys=True)
        save_npz(path, {text: np.array(about), **self.arrays})

    @classmethod
    def load(
        cls,
        path: Path,
        kind: str | None = None,
        text: str = "metadata",
        most_bytes: int = MOST_MODEL_BYTES,
    ) -> Self:
        """Raises what `load_npz` does, and ValueError for another kind: call it in `read_as`.

        kind: is taken out of `about`. None: it is not looked at.
        """
        arrays = load_npz(path, most_bytes)
        about = json.loads(str(arrays.pop(text)))
        if not isinstance(about, dict):
            raise ValueError("does not say what it is")
        if kind is not None and (found := about.pop("kind", None)) != kind:
            raise ValueError(f"its kind is {found!r}, not {kind!r}")
        return cls(about, arrays)


def prefixed(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """The arrays of one part, under names that only this part has in its file."""
    return {prefix + name: array for name, array in arrays.items()}


def stripped(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """The arrays of one part again, out of all that a file holds."""
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }


# Whether something learnt belongs to a robot: its name, its axes, how far they go, by which scale,
# what they push.

PISTONS: Final = "piston_area_mm2"
"""The same travel pushes more gas with a wider bore, and the body goes elsewhere. Files that do not
say it are taken as they are."""
_SCALES: Final = "counts_per_unit"
"""Of each axis, as its lead, spool, gear and encoder make it, negative where it is inverted: where
one of them is put right, a mm is another way than it was. Files that do not say it are taken as
they are."""
_NOT_IN_ALL: Final = (PISTONS, _SCALES)


def whose(robot: Robot) -> dict[str, Any]:
    """What must be the same where something learnt is used again. For JSON."""
    return {
        "robot": robot.robot,
        "axes": [axis.name for axis in robot.axes],
        "travel": [list(axis.travel) for axis in robot.axes],
        _SCALES: [float(f"{axis.counts_per_unit:.9g}") for axis in robot.axes],
        **_pistons(robot),
    }


def _pistons(robot: Robot) -> dict[str, Any]:
    areas_mm2 = [axis.piston_area_mm2 for axis in robot.axes]
    return {PISTONS: areas_mm2} if any(areas_mm2) else {}


def misfit_of(about: Mapping[str, Any], robot: Robot) -> str:
    """What of `whose` is another robot's, in words; empty: nothing."""
    return misfit(about, whose(robot))


def misfit(about: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    """What of all that is expected is something else, in words; empty: nothing."""
    for name, one in expected.items():
        found = about.get(name, one if name in _NOT_IN_ALL else None)
        if found != one:
            return f"its {name} is {found!r}, not {one!r}"
    return ""
