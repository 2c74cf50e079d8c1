"""What a controller has learnt, on disk: the model it began with, and all that came since.

One npz and in it a JSON text. A file that pre-training made is read as well: one from which nothing
was learnt yet.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.files import MOST_MODEL_BYTES, ModelError, open_regular, save_npz
from daemon.learning.forward import pretrained_model
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings
from daemon.learning.samples.robot_fit import misfit_of, whose

Arrays = dict[str, NDArray[Any]]

KIND = "tentacled learnt controller/1"
_METADATA = "metadata"
_LWPR, _MOTIONS, _LEARNT = "lwpr/", "motions/", "learnt/"


@dataclass(frozen=True)
class LearntFile:
    """What is in it."""

    controller: str
    """Its name; empty: any, this is what pre-training made."""
    model: PretrainedModel | None
    arrays: Arrays = field(default_factory=dict)
    """What the controller itself has learnt; empty: nothing yet."""


def save_learnt(path: Path, learnt: LearntFile, robot: Robot) -> None:
    """A reader sees the old file or the whole new one. Raises OSError."""
    model = learnt.model
    metadata: dict[str, Any] = {"kind": KIND, "controller": learnt.controller, **whose(robot)}
    arrays = _prefixed(_LEARNT, learnt.arrays)
    if model is not None:
        metadata["model"] = {
            "metadata": dict(model.metadata),
            "lwpr": model.lwpr.settings.to_dict(),
            "sampling": model.sampling.to_dict(),
        }
        arrays |= _prefixed(_LWPR, model.lwpr.to_arrays())
        arrays |= _prefixed(_MOTIONS, model.motions.to_arrays())
    save_npz(path, {_METADATA: np.array(json.dumps(metadata, sort_keys=True)), **arrays})


def load_learnt(path: Path, controller: str, robot: Robot) -> LearntFile:
    """Raises ModelError for a file that is none, or not for this controller and robot; OSError."""
    try:
        with (
            open_regular(path, MOST_MODEL_BYTES) as file,
            np.load(file, allow_pickle=False) as stored,
        ):
            metadata = json.loads(str(stored[_METADATA]))
            if metadata["kind"] == pretrained_model.KIND:
                return LearntFile("", PretrainedModel.load(path, robot))
            if metadata["kind"] != KIND:
                raise KeyError("kind")
            arrays = {name: stored[name] for name in stored.files}
        model = None if metadata.get("model") is None else _model(metadata["model"], arrays)
    except (ValueError, TypeError, KeyError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path} is not what a controller has learnt: {error}") from None
    misfit = misfit_of(metadata, robot)
    if misfit:
        raise ModelError(f"{path} does not fit this robot: {misfit}")
    other = metadata.get("controller")
    if other != controller:
        raise ModelError(f"{path} does not fit: its controller is {other!r}, not {controller!r}")
    learnt = _stripped(_LEARNT, arrays)
    for name, array in learnt.items():
        if not np.isfinite(array).all():
            raise ModelError(f"{path} is damaged: {name} is not finite")
    return LearntFile(controller, model, learnt)


def _model(metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> PretrainedModel:
    settings = LwprSettings.from_dict(metadata["lwpr"])
    return PretrainedModel(
        Lwpr.from_arrays(settings, _stripped(_LWPR, arrays)),
        MotionTable.from_arrays(_stripped(_MOTIONS, arrays)),
        SamplingSettings.from_dict(metadata["sampling"]),
        metadata["metadata"],
    )


def _prefixed(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    return {prefix + name: array for name, array in arrays.items()}


def _stripped(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
