"""The mixture density network at run time: from the actuation vector to a mixture, without torch.

It is made of named arrays, as a weights file holds them. All are float32 or float64:

    trunk.0.weight (outputs, features), trunk.0.bias (outputs,), trunk.1.weight, …
    means.0.weight, means.0.bias, …      last: (K·d) means, component by component
    factors.0.weight, factors.0.bias, …  last: (K·d(d+1)/2) entries of Ū by rows, the diagonal's
                                         logarithms in their places
    weights.0.weight, weights.0.bias, …  last: (K) logits
    input_offset (m,), input_scale (m,)  the network sees (u − offset) / scale
    input_period (m,)  may be left out. Of an input that has one, not 0, the network sees the cosine
                       and the sine of how far it is in its period, one after the other, instead
    output_offset_mm (d,), output_scale_mm ()  a mean is offset + scale · output; Ū is over scale
    log_diagonal_limits (2,)             the logarithms are kept between these

After each layer but the last of a head comes the activation: relu, tanh or silu.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.model.mixture import MOST_COMPONENTS, FloatArray, Mixture
from safety.risk.model.mixture_network_kernels import (
    RELU,
    SILU,
    TANH,
    backward,
    feature_count,
    forward,
)

ACTIVATIONS: Final = {"relu": RELU, "tanh": TANH, "silu": SILU}
_STACKS: Final = ("trunk", "means", "factors", "weights")
_SCALING: Final = (
    *("input_offset", "input_scale", "output_offset_mm", "output_scale_mm"),
    "log_diagonal_limits",
)
_PERIOD: Final = "input_period"


class NetworkError(ValueError):
    """Arrays that are no mixture density network. Names the array and what is wrong with it."""


class MixtureNetwork:
    """One trained network. Raises NetworkError where the arrays do not make one."""

    def __init__(self, arrays: Mapping[str, NDArray[Any]], activation: str) -> None:
        if activation not in ACTIVATIONS:
            raise NetworkError(f"activation: {activation!r} is none of {', '.join(ACTIVATIONS)}")
        for name, array in arrays.items():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise NetworkError(f"{name}: must be finite numbers")
        stacks = [_stack(arrays, name) for name in _STACKS]
        known = {name for stack in stacks for pair in stack for name in pair}
        known |= {*_SCALING, _PERIOD}
        if strange := sorted(set(arrays) - known):
            raise NetworkError(f"{strange[0]}: belongs to no layer")
        self._scaling = _scaling(arrays)
        self.period = self._scaling[-arrays["input_offset"].size :]
        """(m,) of the inputs, 0: none."""
        self._parameters, self._plan = _layers(arrays, stacks, ACTIVATIONS[activation])
        self._inputs = arrays["input_offset"].size
        self._dimensions = arrays["output_offset_mm"].size
        self._components = int(self._plan[-1, 1])
        self._check_ends(stacks)

    @property
    def inputs(self) -> int:
        """m, the actuation vector's length."""
        return self._inputs

    @property
    def components(self) -> int:
        """K."""
        return self._components

    @property
    def dimensions(self) -> int:
        """d of the mixture."""
        return self._dimensions

    def mixture(self, u: Sequence[float] | FloatArray) -> Mixture | None:
        """Where the body is at (m,) u; None where that comes out as no finite numbers."""
        found = self.mixtures(np.asarray(u, np.float64)[np.newaxis])
        return None if found is None else found[0]

    def mixtures(self, several: FloatArray) -> list[Mixture] | None:
        """Where the body is at each of (n, m) u, which takes little more than at one of them; None
        where any comes out as no finite numbers."""
        rows = np.ascontiguousarray(several, np.float64)
        if rows.ndim != 2 or rows.shape[1] != self._inputs:
            raise ValueError(f"the network takes {self._inputs} numbers, not {rows.shape[1:]}")
        n, k, d = len(rows), self._components, self._dimensions
        weights, means, factors = np.empty((n, k)), np.empty((n, k, d)), np.zeros((n, k, d, d))
        network = (self._parameters, self._plan, self._scaling)
        if not forward(*network, rows, weights, means, factors):
            return None
        return [Mixture(weights[i], means[i], factors[i]) for i in range(n)]

    def gradient(
        self,
        u: Sequence[float] | FloatArray,
        by_weights: FloatArray,
        by_means: FloatArray,
        by_factors: FloatArray,
    ) -> FloatArray:
        """(m,) derivative by u of what has these derivatives by the mixture at u.

        by_weights (K,) as if each weight could move alone, by_means (K, d), by_factors (K, d, d),
        of which the upper half counts.
        """
        network = (self._parameters, self._plan, self._scaling)
        result: FloatArray = backward(*network, self._checked(u), by_weights, by_means, by_factors)
        return result

    def _checked(self, u: Sequence[float] | FloatArray) -> FloatArray:
        vector = np.ascontiguousarray(u, np.float64)
        if vector.shape != (self._inputs,):
            raise ValueError(f"the network takes {self._inputs} numbers, not {vector.shape}")
        return vector

    def _check_ends(self, stacks: list[list[tuple[str, str]]]) -> None:
        d, components = self._dimensions, self._components
        if not 1 <= components <= MOST_COMPONENTS:
            raise NetworkError(f"weights: {components} components; 1 to {MOST_COMPONENTS} can be")
        if self._plan[1, 0] != (features := feature_count(self.period)):
            raise NetworkError(
                f"trunk.0.weight: must take {features} inputs, as input_offset and input_period say"
            )
        wanted = (components * d, components * d * (d + 1) // 2)
        for stack, end, count in zip(stacks[1:3], self._plan[0, 2:], wanted, strict=True):
            outputs = self._plan[end, 1]
            if outputs != count:
                raise NetworkError(f"{stack[-1][0]}: {outputs} outputs; must be {count}")


def _stack(arrays: Mapping[str, NDArray[Any]], name: str) -> list[tuple[str, str]]:
    """The names of a stack's matrices and biases in order."""
    layers: list[tuple[str, str]] = []
    while (weight := f"{name}.{len(layers)}.weight") in arrays:
        bias = f"{name}.{len(layers)}.bias"
        if arrays[weight].ndim != 2 or 0 in arrays[weight].shape:
            raise NetworkError(f"{weight}: must be (outputs, inputs)")
        if bias not in arrays or arrays[bias].shape != arrays[weight].shape[:1]:
            raise NetworkError(f"{bias}: must be there, one number per output of {weight}")
        layers.append((weight, bias))
    if not layers:
        raise NetworkError(f"{name}.0.weight: is missing")
    return layers


def _scaling(arrays: Mapping[str, NDArray[Any]]) -> FloatArray:
    """See `mixture_network_kernels`."""
    for name in _SCALING:
        if name not in arrays:
            raise NetworkError(f"{name}: is missing")
    offset, scale, offset_mm, scale_mm, limits = (arrays[n].astype(np.float64) for n in _SCALING)
    if offset.ndim != 1 or scale.shape != offset.shape or not _sized(scale):
        raise NetworkError(
            "input_scale: must be positive and finite, one per input, as input_offset"
        )
    if offset_mm.ndim != 1 or offset_mm.size == 0:
        raise NetworkError("output_offset_mm: must be one number per dimension")
    if scale_mm.size != 1 or not _sized(scale_mm):
        raise NetworkError("output_scale_mm: must be one positive number")
    if limits.shape != (2,) or not limits[0] < limits[1]:
        raise NetworkError("log_diagonal_limits: must be two numbers, lowest first")
    period = arrays.get(_PERIOD, np.zeros_like(offset)).astype(np.float64)
    if period.shape != offset.shape or not (period >= 0.0).all():
        raise NetworkError(f"{_PERIOD}: must be one per input, as input_offset, and not below 0")
    return np.concatenate([offset, scale, offset_mm, scale_mm.ravel(), limits, period])


def _sized(scale: NDArray[Any]) -> bool:
    """Whether all of it is positive, and finite: what is divided by infinity is nowhere far."""
    return bool(((scale > 0.0) & (scale < np.inf)).all())


def _layers(
    arrays: Mapping[str, NDArray[Any]], stacks: list[list[tuple[str, str]]], activation: int
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Parameters and plan; see `mixture_network_kernels`."""
    rows: list[tuple[int, ...]] = []
    flat, ends, place, trunk = [], [], 0, 0
    dtype = arrays["trunk.0.weight"].dtype
    for stack in stacks:
        width = trunk
        for weight, bias in stack:
            outputs, inputs = arrays[weight].shape
            if width not in (0, inputs):
                raise NetworkError(f"{weight}: takes {inputs} inputs, but gets {width}")
            rows.append((inputs, outputs, place, place + inputs * outputs))
            flat += [arrays[weight].ravel().astype(dtype), arrays[bias].astype(dtype)]
            place += (inputs + 1) * outputs
            width = outputs
        trunk = trunk or width
        ends.append(len(rows))
    return np.concatenate(flat), np.array([(activation, *ends[:3]), *rows], dtype=np.int64)
