"""Clouds of a body that anyone can calculate: a bent arc, thick as a finger."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from config.loader import RobotFile, load_robot
from daemon.array_files import whose
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset

ROBOTS = Path(__file__).parents[4] / "config" / "robots"
TENDON_ARM = ROBOTS / "tendon_arm.yaml"
SOFT_ARM = ROBOTS / "soft_arm.yaml"
RADIUS_MM = 8.0


def tendon_arm() -> RobotFile:
    return load_robot(TENDON_ARM)


def arrays(
    n: int = 60, starts: int = 3, points: int = 24, seed: int = 1
) -> dict[str, NDArray[Any]]:
    """Two straight tendons bend it; where it comes from moves it a little."""
    random = np.random.default_rng(seed)
    u = random.uniform(-8.0, 8.0, (n, 4))
    origins = u[random.integers(n, size=(n, starts))]
    bend = 0.05 * (u[:, None, :2] + 0.03 * origins[:, :, :2]) + 1e-3
    turn = np.linalg.norm(bend, axis=2)[..., None]
    angle = turn * np.linspace(0.0, 1.0, 11)
    out, way = 200.0 / turn * (1.0 - np.cos(angle)), bend / turn
    lines = np.stack([out * way[..., :1], out * way[..., 1:], 200.0 / turn * np.sin(angle)], axis=3)
    at = random.integers(11, size=(n, starts, points))
    clouds = np.take_along_axis(lines, at[..., None], axis=2)
    clouds = clouds + 0.5 * RADIUS_MM * random.standard_normal(clouds.shape)
    test = np.zeros(n, np.bool_)
    test[::6] = True
    return {
        "configurations": u,
        "starts": origins,
        "clouds_mm": clouds.astype(np.float32),
        "centrelines_mm": lines.astype(np.float32),
        "true_centrelines_mm": lines.astype(np.float32),
        "fit_error_mm": np.linspace(0.0, 0.3, 11),
        "forces": np.ones((n, starts, 4), np.float32),
        "test": test,
        "block": (u[:, 0] > 4.0) & (u[:, 1] > 0.0),
        "radius_mm": np.array(RADIUS_MM),
    }


def dataset(**more: int) -> CloudDataset:
    return CloudDataset.checked(arrays(**more), dict(whose(tendon_arm().robot)))
