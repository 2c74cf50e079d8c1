"""A segment bent to a circular arc, and what its tip does when its shape changes.

A shape is (b_x, b_y, s): the bending as a vector in rad that points to where the segment leans, and
its length in mm. In these coordinates the straight segment is nothing special.
"""

from math import cos, sin

import numpy as np

from drivers.pose import Vector

_STRAIGHT_RAD = 1e-2
"""Below this the first terms of the series are exact to 1e-13."""


def arc(shape: Vector) -> tuple[Vector, Vector]:
    """(3,) end of the segment in mm and (3, 3) rotation of its end frame, from its base frame."""
    x, y, s = shape.tolist()
    c, f, g, _, _ = _terms(x * x + y * y)
    end = np.array([s * f * x, s * f * y, s * g])
    turn = np.array(
        [
            [1.0 - f * x * x, -f * x * y, g * x],
            [-f * x * y, 1.0 - f * y * y, g * y],
            [-g * x, -g * y, c],
        ]
    )
    return end, turn


def arc_end_by_shape(shape: Vector) -> Vector:
    """(3, 3) derivative of the end by b_x, b_y, s."""
    x, y, s = shape.tolist()
    _, f, g, df, dg = _terms(x * x + y * y)
    return np.array(
        [
            [s * (f + df * x * x), s * df * x * y, f * x],
            [s * df * x * y, s * (f + df * y * y), f * y],
            [s * dg * x, s * dg * y, g],
        ]
    )


def arc_carries_by_bending(shape: Vector, point: Vector) -> Vector:
    """(3, 2) derivative by b_x, b_y of `point`, (3,) fixed in the end frame, in the base frame."""
    x, y, _ = shape.tolist()
    u, v, w = point.tolist()
    _, f, g, df, dg = _terms(x * x + y * y)
    along = x * u + y * v
    return np.array(
        [
            [
                -f * (along + x * u) - df * x * x * along + (g + dg * x * x) * w,
                -f * x * v - df * x * y * along + dg * x * y * w,
            ],
            [
                -f * y * u - df * x * y * along + dg * x * y * w,
                -f * (along + y * v) - df * y * y * along + (g + dg * y * y) * w,
            ],
            [
                -g * u - dg * x * along - g * x * w,
                -g * v - dg * y * along - g * y * w,
            ],
        ]
    )


def _terms(squared: float) -> tuple[float, float, float, float, float]:
    """cos θ, f = (1 − cos θ)/θ², g = sin θ/θ, f'/θ and g'/θ for a bending of θ² = `squared`."""
    if squared < _STRAIGHT_RAD**2:
        return (
            1.0 - squared * (0.5 - squared / 24.0),
            0.5 - squared * (1.0 / 24.0 - squared / 720.0),
            1.0 - squared * (1.0 / 6.0 - squared / 120.0),
            -1.0 / 12.0 + squared * (1.0 / 180.0 - squared / 6720.0),
            -1.0 / 3.0 + squared * (1.0 / 30.0 - squared / 840.0),
        )
    angle = squared**0.5
    c, s = cos(angle), sin(angle)
    f, g = (1.0 - c) / squared, s / angle
    return c, f, g, (g - 2.0 * f) / squared, (c - g) / squared
