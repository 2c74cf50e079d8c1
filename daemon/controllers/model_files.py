"""Models of controllers on disk: one npz and in it a JSON text, that says whose model it is."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from config.robot import Robot
from daemon.array_files import (
    ArrayFile,
    Arrays,
    ModelError,
    misfit,
    misfit_of,
    prefixed,
    read_as,
    stripped,
    whose,
)
from daemon.learning.forward import pretrained_model
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector

# Models of a fixed shape.


def model_metadata(controller: str, robot: Robot) -> dict[str, Any]:
    """Whose model it is: a file is loaded again only where all of this is the same."""
    return {"controller": controller, **whose(robot)}


def save_model(path: Path, metadata: Mapping[str, Any], arrays: Mapping[str, Vector]) -> None:
    """Write a model; a reader sees the old file or the whole new one. Raises OSError."""
    ArrayFile(dict(metadata), dict(arrays)).save(path)


def load_model(
    path: Path,
    metadata: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    optional: Mapping[str, tuple[int, ...]] = MappingProxyType({}),
) -> dict[str, Vector]:
    """Arrays of these shapes from a model with this metadata.

    optional: those that are read as well where the file has them.
    Raises ModelError that names what does not fit, OSError for a file that cannot be opened.
    """
    with read_as(path, "a model of this kind"):
        file = ArrayFile.load(path)
    if other := misfit(file.about, metadata):
        raise ModelError(f"{path} does not fit: {other}")
    shapes = {**shapes, **{name: optional[name] for name in optional.keys() & file.arrays.keys()}}
    with read_as(path, "a model of this kind"):
        arrays = {name: np.asarray(file.arrays[name], dtype=np.float64) for name in shapes}
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ModelError(f"{path} does not fit: {name} is {arrays[name].shape}, not {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ModelError(f"{path} is damaged: {name} is not finite")
    return arrays


# What a controller that goes on learning has: the model it began with, and all that came since. A
# file that pre-training made is read as well: one from which nothing was learnt yet.


KIND = "tentacled learnt controller/1"
_WHAT = "what a controller has learnt"
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
    arrays = prefixed(_LEARNT, learnt.arrays)
    if model is not None:
        metadata["model"] = {
            "metadata": dict(model.metadata),
            "lwpr": model.lwpr.settings.to_dict(),
            "sampling": model.sampling.to_dict(),
        }
        arrays |= prefixed(_LWPR, model.lwpr.to_arrays())
        arrays |= prefixed(_MOTIONS, model.motions.to_arrays())
    ArrayFile(metadata, arrays).save(path)


def load_learnt(path: Path, controller: str, robot: Robot) -> LearntFile:
    """Raises ModelError for a file that is none, or not for this controller and robot; OSError."""
    with read_as(path, _WHAT):
        file = ArrayFile.load(path)
        metadata, arrays = file.about, file.arrays
        if metadata["kind"] == pretrained_model.KIND:
            return LearntFile("", PretrainedModel.of_file(path, file, robot))
        if metadata["kind"] != KIND:
            raise ValueError(f"its kind is {metadata['kind']!r}")
        model = None if metadata.get("model") is None else _model(metadata["model"], arrays)
    if wrong := misfit_of(metadata, robot):
        raise ModelError(f"{path} does not fit this robot: {wrong}")
    other = metadata.get("controller")
    if other != controller:
        raise ModelError(f"{path} does not fit: its controller is {other!r}, not {controller!r}")
    learnt = stripped(_LEARNT, arrays)
    for name, array in learnt.items():
        if not np.isfinite(array).all():
            raise ModelError(f"{path} is damaged: {name} is not finite")
    return LearntFile(controller, model, learnt)


def _model(metadata: Mapping[str, Any], arrays: Arrays) -> PretrainedModel:
    settings = LwprSettings.from_dict(metadata["lwpr"])
    return PretrainedModel(
        Lwpr.from_arrays(settings, stripped(_LWPR, arrays)),
        MotionTable.from_arrays(stripped(_MOTIONS, arrays)),
        SamplingSettings.from_dict(metadata["sampling"]),
        metadata["metadata"],
    )
