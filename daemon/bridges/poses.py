"""Places and directions of the daemon's messages, as rotations and quaternions. Base's frame."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.pose import rotate

Matrix = NDArray[np.float64]

_NEARLY_AGAINST = -1.0 + 1e-9


def is_place(place: Sequence[float] | None) -> bool:
    """Whether it is three finite numbers: others' programs are told no place that is none."""
    return place is not None and len(place) == 3 and bool(np.isfinite(place).all())


def unit_quaternion(quaternion: Sequence[float] | None) -> tuple[float, float, float, float] | None:
    """(w, x, y, z) of length one; None where it is none."""
    if quaternion is None or len(quaternion) != 4 or not np.isfinite(quaternion).all():
        return None
    norm = float(np.linalg.norm(quaternion))
    if norm < 0.5:
        return None
    w, x, y, z = (float(part) / norm for part in quaternion)
    return w, x, y, z


def rotation(quaternion: tuple[float, float, float, float]) -> Matrix:
    """(3, 3) of a unit quaternion, scalar first."""
    return np.column_stack([rotate(np.array(quaternion), axis) for axis in np.eye(3)])


def quaternion_along(direction: Sequence[float] | None) -> tuple[float, float, float, float]:
    """The least turn that leads z, the tip's axis, along a direction; none where there is none."""
    if not is_place(direction) or direction is None or not np.linalg.norm(direction) > 0.0:
        return 1.0, 0.0, 0.0, 0.0
    x, y, z = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    if z < _NEARLY_AGAINST:
        return 0.0, 1.0, 0.0, 0.0
    w = float(np.sqrt((1.0 + z) / 2.0))
    return w, float(-y / (2.0 * w)), float(x / (2.0 * w)), 0.0
