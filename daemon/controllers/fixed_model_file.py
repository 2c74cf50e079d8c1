"""Learnt models on disk: one npz with arrays and a JSON text that says whose they are."""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from config.robot import Robot
from daemon.files import MOST_MODEL_BYTES, ModelError, open_regular, save_npz
from daemon.learning.samples.robot_fit import whose
from drivers.pose import Vector

_METADATA = "metadata"


def model_metadata(controller: str, robot: Robot) -> dict[str, Any]:
    """Whose model it is: a file is loaded again only where all of this is the same."""
    return {"controller": controller, **whose(robot)}


def save_model(path: Path, metadata: Mapping[str, Any], arrays: Mapping[str, Vector]) -> None:
    """Write a model; a reader sees the old file or the whole new one."""
    text = json.dumps(metadata, sort_keys=True)
    save_npz(path, {_METADATA: np.array(text), **arrays})


def load_model(
    path: Path, metadata: Mapping[str, Any], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, Vector]:
    """Arrays of these shapes from a model with this metadata.

    Raises ModelError that names what does not fit, OSError for a file that cannot be opened.
    """
    try:
        with (
            open_regular(path, MOST_MODEL_BYTES) as file,
            np.load(file, allow_pickle=False) as stored,
        ):
            text = str(stored[_METADATA])
            arrays = {name: np.asarray(stored[name], dtype=np.float64) for name in shapes}
        found = json.loads(text)
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ModelError(f"{path} is not a model of this kind: {error}") from None
    for key, expected in metadata.items():
        actual = found.get(key) if isinstance(found, dict) else None
        if actual != expected:
            raise ModelError(f"{path} does not fit: its {key} is {actual!r}, not {expected!r}")
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ModelError(f"{path} does not fit: {name} is {arrays[name].shape}, not {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ModelError(f"{path} is damaged: {name} is not finite")
    return arrays
