"""Learnt models of a fixed shape on disk: an `ArrayFile` that says which controller's it is."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from config.robot import Robot
from daemon.array_files import ArrayFile, ModelError, read_as, whose
from drivers.pose import Vector


def model_metadata(controller: str, robot: Robot) -> dict[str, Any]:
    """Whose model it is: a file is loaded again only where all of this is the same."""
    return {"controller": controller, **whose(robot)}


def save_model(path: Path, metadata: Mapping[str, Any], arrays: Mapping[str, Vector]) -> None:
    """Write a model; a reader sees the old file or the whole new one. Raises OSError."""
    ArrayFile(dict(metadata), dict(arrays)).save(path)


def load_model(
    path: Path, metadata: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, Vector]:
    """Arrays of these shapes from a model with this metadata.

    Raises ModelError that names what does not fit, OSError for a file that cannot be opened.
    """
    with read_as(path, "a model of this kind"):
        file = ArrayFile.load(path)
    for key, expected in metadata.items():
        actual = file.about.get(key)
        if actual != expected:
            raise ModelError(f"{path} does not fit: its {key} is {actual!r}, not {expected!r}")
    with read_as(path, "a model of this kind"):
        arrays = {name: np.asarray(file.arrays[name], dtype=np.float64) for name in shapes}
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ModelError(f"{path} does not fit: {name} is {arrays[name].shape}, not {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ModelError(f"{path} is damaged: {name} is not finite")
    return arrays
