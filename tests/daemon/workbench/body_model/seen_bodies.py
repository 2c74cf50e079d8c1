"""What cameras see of both emulated arms at a few configurations, and where they truly are."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from config.loader import load_robot
from config.robot import Robot
from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface
from daemon.workbench.body_model.clouds.cloud_import import surface_of
from daemon.workbench.body_model.clouds.collection import (
    Arrays,
    CollectionSettings,
    planned,
    possible_ones,
    seen_at,
)
from tests.daemon.workbench.body_model.small_clouds import ROBOTS


@dataclass(frozen=True, eq=False)
class Seen:
    """plan, clouds: see `collection`."""

    robot: Robot
    surface: VisibleSurface
    radius_mm: float
    plan: Arrays
    clouds: Arrays


@cache
def seen_bodies(name: str, configurations: int = 4, starts: int = 2, points: int = 256) -> Seen:
    """Of the robot file of that name."""
    robot = load_robot(ROBOTS / f"{name}.yaml").robot
    settings = CollectionSettings(configurations - 1, 1, starts, points)
    parameters = possible_ones(robot, settings.seed, 0, 6 * configurations)[:configurations]
    plan = planned(robot, settings, parameters)
    which = np.arange(configurations)
    clouds = seen_at(robot, settings, which, plan["configurations"], plan["starts"])
    known = surface_of(robot)
    assert known is not None
    return Seen(robot, *known, plan, clouds)
