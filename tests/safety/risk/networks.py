"""Networks with random weights, as a trainer would hand them over."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


def random_arrays(
    inputs: int = 4,
    trunk: Sequence[int] = (128, 128, 128),
    heads: Sequence[int] = (),
    components: int = 5,
    dimensions: int = 3,
    seed: int = 0,
    dtype: type = np.float32,
) -> Arrays:
    """heads: sizes of the hidden layers of each head."""
    random = np.random.default_rng(seed)
    entries = dimensions * (dimensions + 1) // 2
    ends = {
        "means": components * dimensions,
        "factors": components * entries,
        "weights": components,
    }
    arrays: Arrays = {}
    stacks = {"trunk": (inputs, *trunk)}
    stacks |= {name: (trunk[-1], *heads, end) for name, end in ends.items()}
    for name, sizes in stacks.items():
        for layer, (before, after) in enumerate(pairwise(sizes)):
            weight = random.normal(0.0, 1.0 / np.sqrt(before), (after, before))
            arrays[f"{name}.{layer}.weight"] = weight.astype(dtype)
            arrays[f"{name}.{layer}.bias"] = random.normal(0.0, 0.3, after).astype(dtype)
    return arrays | {
        "input_offset": random.normal(0.0, 1.0, inputs),
        "input_scale": random.uniform(1.0, 5.0, inputs),
        "output_offset_mm": random.normal(0.0, 20.0, dimensions),
        "output_scale_mm": np.array(40.0),
        "log_diagonal_limits": np.array([-2.0, 4.0]),
    }


def model_arrays(
    coefficients: int = 6, dimensions: int = 3, shape_inputs: int = 4, nodes: int = 11
) -> Arrays:
    """Everything that a model's file holds."""
    random = np.random.default_rng(9)
    points = random_arrays(4, (16, 16), (), 5, dimensions)
    shapes = random_arrays(shape_inputs, (16,), (), 2, coefficients, seed=1)
    arrays = {f"points/{name}": array for name, array in points.items()}
    arrays |= {f"shapes/{name}": array for name, array in shapes.items()}
    along = np.linspace(0.0, 200.0, nodes)
    return arrays | {
        "basis/base_mm": np.column_stack([np.zeros((nodes, 2)), along]),
        "basis/modes": random.normal(size=(coefficients, nodes, 3)),
        "basis/radius_mm": np.full(nodes, 6.0),
        "basis/left_out_mm": np.zeros(nodes),
        "basis/arc_mm": along,
        "training/inputs": random.uniform(-8.0, 8.0, (60, 4)),
        "training/reach": np.array(0.4),
    }
