"""What the cameras have seen of a body: clouds at many configurations, each come to from several.

One npz with the arrays of `CloudDataset`, and a JSON text that says whose they are and how they
were made. Nothing is read that is not whole: a NaN among millions of numbers is found and named.
"""

import hashlib
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.array_files import ArrayFile, in_a_line, load_npz, misfit_of, whose
from daemon.robot.axes import AxisRanges
from safety.risk.model.mixture import FloatArray

SingleArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

_KIND: Final = "tentacled clouds/3"
_PROVENANCE: Final = "provenance"
_MOST_BYTES: Final = 1 << 36
_TRUE: Final = "true_centrelines_mm"
_PERIOD: Final = "period"
_DIGITS: Final = 16
"""Of a hash: none of some thousand others is the same by chance."""
_FARTHEST: Final = 2.0
"""Nothing of a body is farther from its base than so many times its length."""


class CloudDatasetError(ValueError):
    """No clouds, or not of this robot; the text says which and why."""


@dataclass(frozen=True, eq=False)
class CloudDataset:
    """n configurations of m axes, come to from s others each. Made by `checked`."""

    configurations: FloatArray
    """(n, m) mm or rad."""
    starts: FloatArray
    """(n, s, m) where it came from, on a straight line."""
    clouds_mm: SingleArray
    """(n, s, p, 3) seen at arrival, in the base frame."""
    centrelines_mm: SingleArray
    """(n, s, nodes, 3) from base to tip, at arrival, as fitted to the clouds."""
    fit_error_mm: FloatArray
    """(nodes,) root mean square of how far the fitted centrelines are off, across the body, as the
    clouds themselves tell: see `camera_alignment`."""
    forces: SingleArray
    """(n, s, m) on the axes at arrival, N or N·mm."""
    test: BoolArray
    """(n,) kept back to test with, of the others' kind."""
    block: BoolArray
    """(n,) in that part of the configurations that can be kept back as a whole."""
    radius_mm: float
    """Of the body."""
    provenance: dict[str, Any]
    """Whose it is, and how it was made. For JSON."""
    true_centrelines_mm: SingleArray | None = None
    """(n, s, nodes, 3) of an emulated body, to judge the fit by: nothing is learnt from them. None:
    nobody knows."""

    @classmethod
    def checked(cls, arrays: dict[str, NDArray[Any]], provenance: dict[str, Any]) -> Self:
        """Raises CloudDatasetError."""
        names = [field.name for field in fields(cls) if field.name != _PROVENANCE]
        for name in names:
            if name not in arrays and name != _TRUE:
                raise CloudDatasetError(f"{name} is missing")
        parts: dict[str, Any] = {name: arrays[name] for name in names if name in arrays}
        parts["radius_mm"] = float(parts["radius_mm"])
        made = cls(**parts, provenance=provenance)
        _check_shapes(made)
        _check_period(made)
        _check_values(made)
        return made

    @classmethod
    def load(cls, path: Path, robot: Robot) -> Self:
        """Raises CloudDatasetError, which names the file."""
        try:
            arrays = load_npz(path, _MOST_BYTES)
            provenance = json.loads(str(arrays.pop(_PROVENANCE)))
            if not isinstance(provenance, dict) or provenance.get("kind") != _KIND:
                raise CloudDatasetError("is of another version: collect it again")
            if misfit := misfit_of(provenance, robot):
                raise CloudDatasetError(f"does not fit this robot: {misfit}")
            return cls.checked(arrays, provenance)
        except CloudDatasetError as error:
            raise CloudDatasetError(f"{path}: {error}") from None
        except OSError as error:
            raise CloudDatasetError(f"{path}: {error.strerror or 'cannot be read'}") from None
        except Exception as error:  # whatever a reader makes of other bytes
            raise CloudDatasetError(f"{path}: no clouds: {in_a_line(error)}") from None

    def save(self, path: Path) -> None:
        """Whole or not at all. Raises OSError."""
        ArrayFile({**self.provenance, "kind": _KIND}, self._arrays()).save(path, _PROVENANCE)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: np.asarray(part)
            for name, part in parts.items()
            if name != _PROVENANCE and part is not None
        }

    @property
    def sha256(self) -> str:
        """Of all numbers."""
        digest = hashlib.sha256()
        for name, array in self._arrays().items():
            digest.update(f"{name} {array.dtype} {array.shape} ".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def digests(self, chosen: BoolArray) -> list[str]:
        """What was seen at each chosen configuration, in whatever order it was come to there."""
        found = []
        for clouds in self.clouds_mm[chosen]:
            each = sorted(hashlib.sha256(one.tobytes()).digest() for one in clouds)
            found.append(hashlib.sha256(b"".join(each)).hexdigest()[:_DIGITS])
        return found

    @property
    def period(self) -> FloatArray:
        """(m,) after how much of each axis the body is where it was; 0: never."""
        none = [0.0] * self.configurations.shape[1]
        return np.array(self.provenance.get(_PERIOD, none), np.float64)

    def __len__(self) -> int:
        return len(self.configurations)

    def points_mm(self, chosen: BoolArray) -> SingleArray:
        """(k, s·p, 3) the clouds of each chosen configuration, from all its starts."""
        clouds = self.clouds_mm[chosen]
        return clouds.reshape(len(clouds), -1, 3)


def origin(robot: Robot) -> dict[str, Any]:
    """What the provenance of all clouds of this robot begins with: whose they are."""
    period = AxisRanges.of(robot).period
    return {**whose(robot), **({_PERIOD: period.tolist()} if period.any() else {})}


def _check_shapes(made: CloudDataset) -> None:
    n, m = made.configurations.shape if made.configurations.ndim == 2 else (0, 0)
    s = made.starts.shape[1] if made.starts.ndim == 3 else 0
    points, nodes = made.clouds_mm.shape[2:3], made.centrelines_mm.shape[2:3]
    shapes = {
        "starts": (n, s, m),
        "clouds_mm": (n, s, *points, 3),
        "centrelines_mm": (n, s, *nodes, 3),
        "fit_error_mm": nodes,
        "forces": (n, s, m),
        "test": (n,),
        "block": (n,),
    }
    if not n or not m or not s or points == (0,) or not nodes or nodes[0] < 2:
        raise CloudDatasetError("configurations (n, m), starts (n, s, m) or nodes are missing")
    if made.true_centrelines_mm is not None:
        shapes[_TRUE] = shapes["centrelines_mm"]
    for name, shape in shapes.items():
        if getattr(made, name).shape != shape:
            raise CloudDatasetError(f"{name} is {getattr(made, name).shape}, not {shape}")
    for name in ("test", "block"):
        if getattr(made, name).dtype != np.bool_:
            raise CloudDatasetError(f"{name} must be true or false")


def _check_period(made: CloudDataset) -> None:
    try:
        right = made.period.shape == made.configurations.shape[1:] and (made.period >= 0.0).all()
    except (TypeError, ValueError):
        right = False
    if not right:
        raise CloudDatasetError("period must be one number for each axis, and not below 0")


def _check_values(made: CloudDataset) -> None:
    names = ["configurations", "starts", "clouds_mm", "centrelines_mm", "fit_error_mm", "forces"]
    for name in [*names, _TRUE] if made.true_centrelines_mm is not None else names:
        array = getattr(made, name)
        if array.dtype.kind != "f":
            raise CloudDatasetError(f"{name} must be numbers")
        finite = np.isfinite(array)
        if not finite.all():
            place = tuple(int(i) for i in np.argwhere(~finite)[0])
            raise CloudDatasetError(
                f"{name}: {np.size(finite) - np.count_nonzero(finite)} numbers are not finite, the "
                f"first at {place}"
            )
    if not (made.fit_error_mm >= 0.0).all():
        raise CloudDatasetError("fit_error_mm must not be negative")
    if not 0.0 < made.radius_mm < np.inf:
        raise CloudDatasetError("radius_mm must be positive")
    lengths = np.linalg.norm(np.diff(made.centrelines_mm, axis=2), axis=3).sum(axis=2)
    usual = float(np.median(lengths))
    if not (lengths > 0.5 * usual).all() or not (lengths < 2.0 * usual).all():
        raise CloudDatasetError("centrelines_mm: some are twice or half as long as the others")
    base = made.centrelines_mm[:, :, :1]
    away = np.linalg.norm(made.clouds_mm - base, axis=3)
    if not (away < _FARTHEST * usual).all():
        place = tuple(int(i) for i in np.argwhere(~(away < _FARTHEST * usual))[0])
        raise CloudDatasetError(f"clouds_mm: the point at {place} is nowhere near the body")
    _check_apart(made)


def _check_apart(made: CloudDataset) -> None:
    """No configuration is both for learning and for tests."""
    _, which = np.unique(made.configurations, axis=0, return_inverse=True)
    tests = np.zeros(len(made), np.int64)
    np.add.at(tests, which.ravel(), made.test)
    mixed = (tests[which.ravel()] > 0) & ~made.test
    if mixed.any():
        number = int(np.argmax(mixed))
        raise CloudDatasetError(
            f"configuration {number} is to learn from, and there again to test with"
        )
