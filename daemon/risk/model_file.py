"""Learned models of the body on disk: one NPZ file with arrays and, as JSON, what they are of.

Beside the arrays of `safety.risk.model.risk_model` there is `about`, a JSON object: `format`,
`robot`, `points_activation`, `shapes_activation`, and what else the trainer has to say of their
origin.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.array_files import PISTONS, ArrayFile, in_a_line, load_npz, whose
from daemon.files import MOST_MODEL_BYTES, read_regular
from safety.risk.model.mixture import FloatArray
from safety.risk.model.risk_model import RiskModel, RiskModelError, risk_model

FORMAT: Final = 1
_ABOUT: Final = "about"
_SAID: Final = ("robot", "points_activation", "shapes_activation")
_NUMBERS: Final = "fiu"
_HEAVIEST_G: Final = 1e6
_DIGESTS: Final = "configurations_sha256"
_SAME: Final = 1e-3
"""Of a network's inputs, whose spread is about one: configurations nearer to each other are one,
written down or measured twice. Those of a training are hundreds of times as far apart."""


@dataclass(frozen=True, slots=True)
class ModelFile:
    """A model, and what its file says of itself."""

    model: RiskModel
    about: dict[str, Any]
    sha256: str = ""
    """Of the file, in hexadecimal digits; empty: it was not read from one."""

    @property
    def robot(self) -> str:
        """Which robot it is of."""
        return str(self.about["robot"])

    def misfit(self, robot: Robot) -> str:
        """Why it is not of this robot, as "FILE ..." goes on, with what helps; empty: it is."""
        axes = [axis.name for axis in robot.axes]
        if self.robot != robot.robot or self.model.inputs != len(axes):
            return (
                f"is of the robot {self.robot!r} with {self.model.inputs} axes, and this is "
                f"{robot.robot!r} with {len(axes)}: name its own model under risk"
            )
        if (learnt := self.about.get("axes", axes)) != axes:
            return (
                f"was made with the axes {learnt}, and this robot has {axes}: put them in that "
                "order, or train a model of these"
            )
        pistons = whose(robot).get(PISTONS)
        if (learnt := self.about.get(PISTONS, pistons)) != pistons:
            return (
                f"was made with pistons of {_areas(learnt)} mm², and bore_mm makes this robot's "
                f"{_areas(pistons)}: the same travel bends it otherwise. Correct bore_mm, or train "
                "a model with these"
            )
        return ""

    def learnt_at(self, u: FloatArray) -> NDArray[np.bool_]:
        """(n,) which of (n, m) configurations it was trained at, those that told when to stop too.

        By what they are: whoever has collected them, in whatever order they are.
        """
        return np.array([self.model.distance(one) < _SAME for one in u], np.bool_)

    def learnt_from(self, digests: Sequence[str]) -> NDArray[np.bool_]:
        """(n,) which of a `CloudDataset`'s digests are of clouds that it was trained with."""
        known = set(self.about.get(_DIGESTS, ()))
        return np.array([one in known for one in digests], np.bool_)


def read_model(path: Path) -> ModelFile:
    """Raises RiskModelError, which names the file and what is wrong with it."""
    try:
        arrays, about, sha256 = _read(path)
        model = risk_model(arrays, *(about[name] for name in _SAID[1:]))
    except RiskModelError as error:
        raise RiskModelError(f"{path}: {error}") from None
    return ModelFile(model, about, sha256)


def write_model(path: Path, arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> None:
    """Write a model that can be read again, whole or not at all. Raises RiskModelError, OSError."""
    metadata = {"format": FORMAT, **about}
    _check(metadata)
    risk_model(arrays, *(metadata[name] for name in _SAID[1:]))
    ArrayFile(metadata, dict(arrays)).save(path, _ABOUT)


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any], str]:
    try:
        sha256 = hashlib.sha256(read_regular(path, MOST_MODEL_BYTES)).hexdigest()
        arrays = load_npz(path)
    except OSError as error:
        raise RiskModelError(error.strerror or "cannot be read") from None
    except Exception as error:  # whatever a reader makes of bytes that are no model
        raise RiskModelError(f"is no model: {in_a_line(error)}") from None
    try:
        about = json.loads(str(arrays.pop(_ABOUT)))
    except (KeyError, ValueError, RecursionError):
        raise RiskModelError("does not say what it is") from None
    _check(about)
    for name, array in arrays.items():
        if array.dtype.kind not in _NUMBERS:
            raise RiskModelError(f"{name}: must be numbers, and is of {array.dtype}")
    return arrays, about, sha256


def _check(about: object) -> None:
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise RiskModelError(f"is not of format {FORMAT}: train it again")
    for name in _SAID:
        if not isinstance(about.get(name), str):
            raise RiskModelError(f"{_ABOUT}: {name} is missing")
    load_g = about.get("tip_load_g", 0.0)
    if not isinstance(load_g, int | float) or not abs(load_g) < _HEAVIEST_G:
        raise RiskModelError(f"{_ABOUT}: tip_load_g must be a number of grams")
    pistons = about.get(PISTONS, [])
    if not isinstance(pistons, list) or not all(
        isinstance(one, int | float | None) for one in pistons
    ):
        raise RiskModelError(f"{_ABOUT}: {PISTONS} must be a list of areas")
    digests = about.get(_DIGESTS, [])
    if not isinstance(digests, list) or not all(isinstance(one, str) for one in digests):
        raise RiskModelError(f"{_ABOUT}: {_DIGESTS} must be a list of words")


def _areas(areas_mm2: Sequence[float | None] | None) -> str:
    """In words, each that there is once."""
    each = dict.fromkeys(f"{one:.4g}" if one else "no" for one in areas_mm2 or (None,))
    return ", ".join(each)
