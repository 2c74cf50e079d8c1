"""The nearest of many vectors, compiled."""

from math import sqrt

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", nogil=True)
def nearest_distance(known, place):  # type: ignore[no-untyped-def]
    """From (m,) place to the nearest of (n, m) known vectors; not finite where the place is not."""
    nearest = np.inf
    for i in range(known.shape[0]):
        square = 0.0
        for j in range(known.shape[1]):
            way = known[i, j] - place[j]
            square += way * way
        if not square >= nearest:
            nearest = square
    return sqrt(nearest)
