"""Receptive fields as the kernels want them: coordinate by coordinate, all fields side by side."""

import numpy as np

from daemon.learning.inverse.local_controller_kernels import Geometry, log_weights
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector


def geometry_of(fields: ReceptiveFields, middle: Vector, part: slice = slice(None)) -> Geometry:
    """Of some of the fields; centres count from (d,) `middle`."""
    centres, roots = fields.centres[part], fields.roots[part]
    used = np.abs(roots).max(axis=0, initial=0.0) > 0.0
    reach = np.array([1 + np.flatnonzero(row).max(initial=a) for a, row in enumerate(used)])
    return Geometry(
        np.ascontiguousarray((centres - middle).T),
        np.ascontiguousarray(roots.transpose(1, 2, 0)),
        reach.astype(np.int64),
    )


def log_weights_of(geometry: Geometry, places: Vector) -> Vector:
    """(f, n) ln w of (n, d) places, counted from the geometry's middle."""
    weights = np.empty((len(places), geometry.centres.shape[1]))
    log_weights(geometry, places, weights)
    return np.ascontiguousarray(weights.T)
