"""Things to learn, made from a seed: inputs (count, n) and outputs (count, k)."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BENDING_RAD = 1.2
_LENGTH_MM = 70.0
_STRETCH_MM = 12.0
_AROUND_RAD = np.radians([90.0, 210.0, 330.0])


def cross_of(x: FloatArray) -> FloatArray:
    """Two ridges and a bump on (-1, 1)², the test function of the LWPR papers. (count, 1)."""
    ridges = [np.exp(-10.0 * x[:, 0] ** 2), np.exp(-50.0 * x[:, 1] ** 2)]
    bump = 1.25 * np.exp(-5.0 * (x**2).sum(axis=1))
    return np.asarray(np.max([*ridges, bump], axis=0)[:, None], dtype=np.float64)


def cross(count: int, seed: int, noise: float = 0.1) -> tuple[FloatArray, FloatArray]:
    """Samples of it, anywhere."""
    random = np.random.default_rng(seed)
    x = random.uniform(-1.0, 1.0, (count, 2))
    return x, cross_of(x) + noise * random.normal(size=(count, 1))


def arm(count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """What small motions Δu from anywhere do to the tip of two arcs: [u, Δu] (12) to Δp (3), mm."""
    random = np.random.default_rng(seed)
    u, step = random.uniform(0.0, 1.0, (count, 6)), random.uniform(-0.1, 0.1, (count, 6))
    return np.hstack([u, step]), _tips_mm(u + step) - _tips_mm(u)


def _tips_mm(u: FloatArray) -> FloatArray:
    """(count, 3) of (count, 6) actuations from 0 to 1."""
    lower, turn = _arc(u[:, :3])
    upper, _ = _arc(u[:, 3:])
    tips: FloatArray = lower + np.einsum("cij,cj->ci", turn, upper)
    return tips


def _arc(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """End (count, 3) and rotation (count, 3, 3) of arcs bent by three chambers each."""
    bend_x = _BENDING_RAD * u @ np.cos(_AROUND_RAD)
    bend_y = _BENDING_RAD * u @ np.sin(_AROUND_RAD)
    angle = np.hypot(bend_x, bend_y) + 1e-9
    x, y = bend_x / angle, bend_y / angle
    length = _LENGTH_MM + _STRETCH_MM * u.sum(axis=1)
    out, c, s = (1.0 - np.cos(angle)) / angle, np.cos(angle), np.sin(angle)
    end = length[:, None] * np.stack([out * x, out * y, s / angle], axis=1)
    rows = [
        [1.0 + (c - 1.0) * x * x, (c - 1.0) * x * y, s * x],
        [(c - 1.0) * x * y, 1.0 + (c - 1.0) * y * y, s * y],
        [-s * x, -s * y, c],
    ]
    return end, np.array(rows).transpose(2, 0, 1)
