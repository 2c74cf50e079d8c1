"""A regression that goes on learning with another memory than the one it was trained with.

Pre-training ends with a memory of 1e5 samples: at three samples a second a change of the body would
be learnt in a day.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr.model import Lwpr

_SUMS = ("energy", "covariance", "weight", "error", "trace_h", "trace_k")
"""What a direction keeps that grows with the weight of the samples."""


def with_memory(model: Lwpr, samples: float) -> Lwpr:
    """A copy whose fields remember so many of the samples that reach them, and of what they know
    believe no more than as many would tell. No new fields come.
    """
    forgetting = 1.0 - 1.0 / samples
    settings = replace(
        model.settings,
        forgetting_initial=forgetting,
        forgetting_final=forgetting,
        generate_below=0.0,
    )
    arrays: dict[str, NDArray[Any]] = {**model.to_arrays()}
    if model.settings == settings:
        return Lwpr.from_arrays(settings, arrays)
    for prefix in {name.rpartition("/")[0] for name in arrays}:
        directions = arrays[f"{prefix}/directions"]
        weight = directions["weight"][:, :, :1]
        kept = np.minimum(1.0, samples / np.maximum(weight, np.finfo(float).tiny))
        for name in _SUMS:
            directions[name] *= kept
        directions["forgetting"] = forgetting
        for name in ("along_sum", "load_sum"):
            arrays[f"{prefix}/{name}"] *= kept[..., None]
        arrays[f"{prefix}/outputs"]["transient"] *= kept[:, :, 0]
    return Lwpr.from_arrays(settings, arrays)
