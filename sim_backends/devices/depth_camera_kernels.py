"""The depth cameras' numerics, compiled: which surface each pixel sees first.

All in the camera's frame: x to the right, y down, z ahead. The ray of a pixel at (column, row) is
((column − cx) / f, (row − cy) / f, 1), so that how far one goes along it is the depth.
"""

import numpy as np
from numba import njit

_NEAREST_MM = 1.0
"""Nothing is seen that is not ahead."""

_kernel = njit(cache=True, error_model="numpy")


@_kernel
def draw(depth_mm, focal_px, balls_mm, radius_mm, disks_mm, axes, disk_mm, half_mm):  # type: ignore[no-untyped-def]
    """Fill the (rows, columns) image with depths; inf: nothing is there.

    balls_mm (b, 3) of radius_mm; disks_mm (k, 3) with unit axes (k, 3), of radius disk_mm and
    half the thickness half_mm.
    """
    depth_mm[:] = np.inf
    for b in range(len(balls_mm)):
        _ball(depth_mm, focal_px, balls_mm[b], radius_mm)
    for k in range(len(disks_mm)):
        _disk(depth_mm, focal_px, disks_mm[k], axes[k], disk_mm, half_mm)


@_kernel
def _box(depth_mm, focal_px, centre, radius):  # type: ignore[no-untyped-def]
    """First and last row and column that a ball can be in; empty where it is not ahead."""
    rows, columns = depth_mm.shape
    near = centre[2] - radius
    if not near > _NEAREST_MM:
        return 0, 0, 0, 0
    reach = focal_px * radius / near * 1.5 + 1.0  # seen from aside it is longer than wide
    x = focal_px * centre[0] / centre[2] + 0.5 * (columns - 1)
    y = focal_px * centre[1] / centre[2] + 0.5 * (rows - 1)
    first_row, last_row = max(0.0, np.floor(y - reach)), min(rows - 1.0, np.ceil(y + reach))
    first, last = max(0.0, np.floor(x - reach)), min(columns - 1.0, np.ceil(x + reach))
    return int(first_row), int(last_row) + 1, int(first), int(last) + 1


@_kernel
def _ball(depth_mm, focal_px, centre, radius):  # type: ignore[no-untyped-def]
    rows, columns = depth_mm.shape
    top, bottom, left, right = _box(depth_mm, focal_px, centre, radius)
    beyond = centre[0] ** 2 + centre[1] ** 2 + centre[2] ** 2 - radius**2
    for row in range(top, bottom):
        y = (row - 0.5 * (rows - 1)) / focal_px
        for column in range(left, right):
            x = (column - 0.5 * (columns - 1)) / focal_px
            square = x * x + y * y + 1.0
            along = x * centre[0] + y * centre[1] + centre[2]
            inside = along * along - square * beyond
            if inside > 0.0:
                depth = (along - np.sqrt(inside)) / square
                if depth < depth_mm[row, column]:
                    depth_mm[row, column] = depth


@_kernel
def _disk(depth_mm, focal_px, centre, axis, radius, half):  # type: ignore[no-untyped-def]
    rows, columns = depth_mm.shape
    top, bottom, left, right = _box(depth_mm, focal_px, centre, np.sqrt(radius**2 + half**2))
    for row in range(top, bottom):
        y = (row - 0.5 * (rows - 1)) / focal_px
        for column in range(left, right):
            x = (column - 0.5 * (columns - 1)) / focal_px
            depth = _into_cylinder(x, y, centre, axis, radius, half)
            if depth < depth_mm[row, column]:
                depth_mm[row, column] = depth


@_kernel
def _into_cylinder(x, y, centre, axis, radius, half):  # type: ignore[no-untyped-def]
    """Where the ray enters: after both the slab between the faces and the round side."""
    steep = x * axis[0] + y * axis[1] + axis[2]
    ahead = centre[0] * axis[0] + centre[1] * axis[1] + centre[2] * axis[2]
    square = x * x + y * y + 1.0 - steep * steep
    along = x * centre[0] + y * centre[1] + centre[2] - steep * ahead
    beyond = centre[0] ** 2 + centre[1] ** 2 + centre[2] ** 2 - ahead * ahead - radius * radius
    enter, leave = -np.inf, np.inf
    if abs(steep) > 1e-12:
        one, other = (ahead - half) / steep, (ahead + half) / steep
        enter, leave = min(one, other), max(one, other)
    elif abs(ahead) > half:
        return np.inf
    if square > 1e-12:
        inside = along * along - square * beyond
        if inside <= 0.0:
            return np.inf
        root = np.sqrt(inside)
        enter, leave = max(enter, (along - root) / square), min(leave, (along + root) / square)
    elif beyond > 0.0:
        return np.inf
    return enter if _NEAREST_MM < enter < leave else np.inf
