"""Learned models of the body on disk: one NPZ file with arrays and, as JSON, what they are of.

Beside the arrays of `safety.risk.risk_model` there is `about`, a JSON object: `format`, `robot`,
`points_activation`, `shapes_activation`, and whatever else the trainer has to say of their origin.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.risk_model import RiskModel, RiskModelError, risk_model

FORMAT: Final = 1
_ABOUT: Final = "about"
_SAID: Final = ("robot", "points_activation", "shapes_activation")


@dataclass(frozen=True, slots=True)
class ModelFile:
    """A model, and what its file says of itself."""

    model: RiskModel
    about: dict[str, Any]

    @property
    def robot(self) -> str:
        """Which robot it is of."""
        return str(self.about["robot"])


def read_model(path: Path) -> ModelFile:
    """Raises RiskModelError, which names the file and what is wrong with it."""
    try:
        arrays, about = _read(path)
        model = risk_model(arrays, *(about[name] for name in _SAID[1:]))
    except RiskModelError as error:
        raise RiskModelError(f"{path}: {error}") from None
    return ModelFile(model, about)


def write_model(path: Path, arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any]) -> None:
    """Write a model that can be read again, whole or not at all. Raises RiskModelError, OSError."""
    told = {"format": FORMAT, **about}
    _check(told)
    risk_model(arrays, *(told[name] for name in _SAID[1:]))
    partly = path.with_suffix(f".{os.getpid()}.part")
    content: dict[str, Any] = {**arrays, _ABOUT: np.array(json.dumps(told, sort_keys=True))}
    try:
        with partly.open("wb") as file:
            np.savez_compressed(file, **content)
        partly.replace(path)
    except OSError:
        partly.unlink(missing_ok=True)
        raise


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except OSError as error:
        raise RiskModelError(error.strerror or "cannot be read") from None
    except Exception as error:  # whatever a reader makes of bytes that are no model
        raise RiskModelError(f"is no model: {type(error).__name__}: {error}") from None
    try:
        about = json.loads(str(arrays.pop(_ABOUT)))
    except (KeyError, json.JSONDecodeError):
        raise RiskModelError("does not say what it is") from None
    _check(about)
    return arrays, about


def _check(about: object) -> None:
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise RiskModelError(f"is not of format {FORMAT}: train it again")
    for name in _SAID:
        if not isinstance(about.get(name), str):
            raise RiskModelError(f"{_ABOUT}: {name} is missing")
