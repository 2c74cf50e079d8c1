"""The shipped tendon arm among things, as a planner sees it."""

from functools import cache
from pathlib import Path

import numpy as np

from config.loader import RobotFile, load_robot
from daemon.risk.model_file import ModelFile, read_model
from daemon.workbench.body_model.evaluation import shapes
from daemon.workbench.planning.body_in_place import BodyInPlace
from daemon.workbench.planning.goals import TipGoal, places_for
from daemon.workbench.planning.plan import Settings
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import Free, InsertionPort, Mesh, environment
from tests import SHIPPED_ROBOTS

REST = np.zeros(4)
SMALL = Settings(places=160, waypoints=10, iterations=8, samples=400)
TENDONS = SHIPPED_ROBOTS / "tendon_arm.yaml"
MODEL = SHIPPED_ROBOTS.parent / "models" / "tendon_arm.npz"


@cache
def tendon_arm() -> RobotFile:
    return load_robot(TENDONS)


@cache
def model_file(path: Path = MODEL) -> ModelFile:
    return read_model(path)


def among(
    mesh: Mesh, free: Free | None = None, port: InsertionPort | None = None, grid_mm: float = 3.0
) -> BodyInPlace:
    """The arm, which comes from the origin along z."""
    model = model_file().model
    around = environment(*mesh, free=free, port=port)
    grid = distance_grid(around, grid_mm, model.basis.thickest_mm + 10.0)
    return BodyInPlace(tendon_arm().robot, model, around, grid, samples=100)


def beside_a_ball() -> BodyInPlace:
    """It is in the way from (55, −60) to (55, 60), but not from there to the straight arm."""
    return among(shapes.ball(14.0, (78.0, 0.0, 172.0), 200), "outside")


@cache
def before_a_wall() -> BodyInPlace:
    """Its face is at x = 74 mm: an arm bent to +x comes up to it."""
    return among(shapes.box((20.0, 160.0, 160.0), (84.0, 0.0, 170.0), 3), "outside")


def before_a_slot(gap_mm: float) -> BodyInPlace:
    """Two plates at +x, `gap_mm` apart in y: an arm that bends to +x has to go between them."""
    size, away = (30.0, 60.0, 200.0), 0.5 * gap_mm + 30.0
    plates = [shapes.box(size, (48.0, side * away, 100.0), 3) for side in (-1.0, 1.0)]
    return among(shapes.joined(plates), "outside")


@cache
def planner_beside_a_ball() -> Planner:
    return Planner(beside_a_ball(), SMALL)


def bent_to(x_mm: float, y_mm: float) -> FloatArray:
    """(3,) where the tip may be, out to one side."""
    aside = float(np.hypot(x_mm, y_mm))
    return np.array([x_mm, y_mm, 199.0 - 0.0041 * aside**2])


def posture_at(planner: Planner, place_mm: FloatArray) -> FloatArray:
    """(m,) with the tip as near to a place as it comes."""
    beginnings = [REST, *planner.roadmap.places[:40]]
    return places_for(planner.body, TipGoal(place_mm), beginnings, 1).nearest_u


def reachable(planner: Planner, x_mm: float, y_mm: float) -> FloatArray:
    """(3,) where the tip comes out there."""
    return planner.body.tip(posture_at(planner, bent_to(x_mm, y_mm)))[:3]
