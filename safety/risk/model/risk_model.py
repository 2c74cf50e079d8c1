"""All that was learned of one body, as one file holds it: two networks, a basis, what they know.

The arrays of a file have these names:

    points/…          the network over places of the body: see `mixture_network`
    shapes/…          the network over coefficients of its shape
    basis/base_mm, basis/modes, basis/radius_mm, basis/left_out_mm, basis/arc_mm: see `shape_basis`
    training/inputs   (n, m) actuation vectors that it was trained at
    training/reach    () how far from the nearest of them it may be asked; see `distance`
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray
from safety.risk.model.mixture_network import MixtureNetwork, NetworkError
from safety.risk.model.mixture_network_kernels import feature_count, is_near, write_features
from safety.risk.model.shape_basis import ShapeBasis, ShapeBasisError

# The nearest of many vectors, compiled.


@njit(cache=True, error_model="numpy", nogil=True)
def nearest_distance(known, place):  # type: ignore[no-untyped-def]
    """From (f,) place to the nearest of (n, f) known vectors; not finite where the place is not."""
    nearest = np.inf
    for i in range(known.shape[0]):
        square = 0.0
        for j in range(known.shape[1]):
            way = known[i, j] - place[j]
            square += way * way
        if not square >= nearest:
            nearest = square
    return sqrt(nearest)


_POINTS, _SHAPES, _BASIS, _TRAINING = "points/", "shapes/", "basis/", "training/"
_BASIS_ARRAYS: Final = ("base_mm", "modes", "radius_mm", "left_out_mm", "arc_mm")


class RiskModelError(ValueError):
    """Arrays that make no model. Names the array and what is wrong with it."""


@dataclass(frozen=True, slots=True, eq=False)
class RiskModel:
    """Made by `risk_model`."""

    points: MixtureNetwork
    """Where a random point of the body is: for body_point_risk."""
    shapes: MixtureNetwork
    """Which coefficients the body's shape has: for contact_risk."""
    basis: ShapeBasis
    known: FloatArray
    """(n, m) the actuation vectors of the training."""
    known_features: FloatArray
    """(n, f) the same as `features` of them."""
    scale: FloatArray
    """(m,) how far one unit of an input leads in the features: one over the input scale; of an
    input with a period, the angle."""
    reach: float

    @property
    def inputs(self) -> int:
        """m, the actuation vector's length."""
        return self.points.inputs

    def distance(self, u: Sequence[float] | FloatArray) -> float:
        """From (m,) u to the nearest vector of the training, in the networks' own inputs."""
        return float(nearest_distance(self.known_features, self.features(u)))

    def features(self, u: Sequence[float] | FloatArray) -> FloatArray:
        """(f,) what the networks see of (m,) u, but for an offset that is the same everywhere."""
        place: FloatArray = features_of(
            np.asarray(u, np.float64)[None], self.scale, self.points.period
        )[0]
        return place

    def knows(self, u: Sequence[float] | FloatArray) -> bool:
        """Whether it may be asked there; never where u is not finite."""
        place = np.ascontiguousarray(u, np.float64)
        if place.shape != self.scale.shape:
            raise ValueError(f"the networks take {self.scale.size} numbers, not {place.shape}")
        period = self.points.period
        return bool(is_near(self.known_features, place, self.scale, period, self.reach))


def risk_model(
    arrays: Mapping[str, NDArray[Any]], points_activation: str, shapes_activation: str
) -> RiskModel:
    """A model of named arrays. Raises RiskModelError."""
    parts = {
        prefix: {
            name.removeprefix(prefix): array
            for name, array in arrays.items()
            if name.startswith(prefix)
        }
        for prefix in (_POINTS, _SHAPES, _BASIS, _TRAINING)
    }
    if strange := sorted(set(arrays) - {p + name for p, part in parts.items() for name in part}):
        raise RiskModelError(f"{strange[0]}: belongs to nothing")
    points = _network(_POINTS, parts[_POINTS], points_activation)
    shapes = _network(_SHAPES, parts[_SHAPES], shapes_activation)
    basis = _basis(parts[_BASIS])
    if points.dimensions != 3:
        raise RiskModelError(f"points/: places have 3 coordinates, not {points.dimensions}")
    if shapes.dimensions != basis.coefficients:
        raise RiskModelError(
            f"shapes/: over {shapes.dimensions} coefficients, and basis/modes has "
            f"{basis.coefficients}"
        )
    if shapes.inputs != points.inputs:
        raise RiskModelError(f"shapes/: takes {shapes.inputs} inputs, points/ {points.inputs}")
    if not np.array_equal(shapes.period, points.period):
        raise RiskModelError("shapes/: other inputs come round than in points/, or after more")
    inputs, reach = _training(parts[_TRAINING], points.inputs)
    scale = 1.0 / arrays["points/input_scale"].astype(np.float64)
    period = points.period
    scale[period > 0.0] = 2.0 * pi / period[period > 0.0]
    features = features_of(inputs, scale, period)
    return RiskModel(points, shapes, basis, inputs, features, scale, reach)


def features_of(u: FloatArray, scale: FloatArray, period: FloatArray) -> FloatArray:
    """(n, f) what networks of this (m,) scale and (m,) period see of (n, m) u, but for an offset.

    Raises ValueError where u has not m columns.
    """
    if u.shape[1:] != scale.shape:
        raise ValueError(f"the networks take {scale.size} numbers, not {u.shape[1:]}")
    found, nowhere, wide = np.empty((len(u), feature_count(period))), 0.0 * scale, 1.0 / scale
    for place, row in zip(u, found, strict=True):
        write_features(place, nowhere, wide, period, row)
    return found


def _network(prefix: str, arrays: Mapping[str, NDArray[Any]], activation: str) -> MixtureNetwork:
    try:
        return MixtureNetwork(arrays, activation)
    except NetworkError as error:
        raise RiskModelError(f"{prefix}{error}") from None


def _basis(arrays: Mapping[str, NDArray[Any]]) -> ShapeBasis:
    _check_names(_BASIS, arrays, _BASIS_ARRAYS)
    try:
        return ShapeBasis.checked(*(arrays[name] for name in _BASIS_ARRAYS))
    except ShapeBasisError as error:
        raise RiskModelError(f"{_BASIS}{error}") from None


def _training(arrays: Mapping[str, NDArray[Any]], inputs: int) -> tuple[FloatArray, float]:
    _check_names(_TRAINING, arrays, ("inputs", "reach"))
    known, reach = arrays["inputs"].astype(np.float64), arrays["reach"].astype(np.float64)
    if (
        known.ndim != 2
        or not len(known)
        or known.shape[1] != inputs
        or not np.isfinite(known).all()
    ):
        raise RiskModelError(f"{_TRAINING}inputs: must be finite numbers (n, {inputs})")
    if reach.size != 1 or not 0.0 < float(reach) < np.inf:
        raise RiskModelError(f"{_TRAINING}reach: must be one positive number")
    return known, float(reach)


def _check_names(prefix: str, arrays: Mapping[str, object], names: Sequence[str]) -> None:
    for name in names:
        if name not in arrays:
            raise RiskModelError(f"{prefix}{name}: is missing")
    if strange := sorted(set(arrays) - set(names)):
        raise RiskModelError(f"{prefix}{strange[0]}: belongs to nothing")
