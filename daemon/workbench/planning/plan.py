"""What is planned: how it is looked for, what is found, and how it is kept.

A plan is kept as figures for people, and as the path file that a daemon takes.
"""

from dataclasses import dataclass
from typing import Any, Final

from config.robot import Robot
from config.tasks.planned_path import PlannedPath
from daemon.risk.body_risk_source import RiskIdentity
from daemon.workbench.planning.path_risk import PathRisk
from safety.risk.model.mixture import FloatArray

_DIGITS: Final = 6


@dataclass(frozen=True, slots=True)
class Settings:
    """How a path is looked for. What is random comes from the seed alone."""

    places: int = 400
    """Of the roadmap."""
    neighbours: int = 10
    waypoints: int = 20
    """While a path is optimised, and for equation 10."""
    iterations: int = 20
    """Of the optimiser."""
    samples: int = 1000
    """Bodies that are led along the whole path in the end."""
    mm_per_nat: float = 300.0
    most_risk: float = 0.05
    """Upper limit of the whole path's contact risk."""
    tip_mm_s: float = 8.0
    seed: int = 1


@dataclass(frozen=True, eq=False)
class Plan:
    """A path."""

    u: FloatArray
    """(k, m) places of the axes, the body at most 2 mm further from one to the next."""
    t_s: FloatArray
    """(k,) from 0."""
    tip_mm: FloatArray
    """(k, 3) where the model has the tip."""
    direction: FloatArray
    """(k, 3) unit vectors along its axis."""
    risk: PathRisk
    printed: float
    """Equation 10 of Thompson et al., over `Settings.waypoints` places."""
    length_mm: float
    """How far the part of the body goes that goes farthest."""
    before: PathRisk
    """Of the roadmap's path, before it was optimised."""
    printed_before: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A path of the roadmap, as it is: one of several of which none is better in both."""

    mm_per_nat: float
    waypoints: FloatArray
    length_mm: float
    risk: PathRisk
    printed: float


def figures_of(
    plan: Plan, settings: Settings, preset: str, course: tuple[float, ...] = ()
) -> dict[str, Any]:
    """For JSON. course: equation 10 after each of the paper's iterations."""
    figures: dict[str, Any] = {
        "method": preset,
        "seed": settings.seed,
        "waypoints": settings.waypoints,
        "length_mm": plan.length_mm,
        "duration_s": float(plan.t_s[-1]),
        **plan.risk.summary(),
        "contact_risk_by_place": list(plan.risk.by_place),
        "body_point_risk_eq_10": plan.printed,
        "before": {**plan.before.summary(), "body_point_risk_eq_10": plan.printed_before},
    }
    if course:
        figures["body_point_risk_eq_10_course"] = list(course)
    return figures


def path_of(
    plan: Plan, figures: dict[str, Any], robot: Robot, identity: RiskIdentity, pointing: bool
) -> PlannedPath:
    """As its file has it. pointing: whether the tip shall point as the model has it."""
    return PlannedPath(
        tentacled_path=1,
        robot=robot.robot,
        axes=tuple(axis.name for axis in robot.axes),
        model_sha256=identity.model_sha256,
        surroundings_sha256=identity.surroundings_sha256,
        t_s=tuple(_rounded(plan.t_s.tolist())),
        u=tuple(tuple(_rounded(row)) for row in plan.u.tolist()),
        tip_mm=tuple(_three(row) for row in plan.tip_mm.tolist()),
        direction=tuple(_three(row) for row in plan.direction.tolist()) if pointing else None,
        figures=figures,
    )


def _rounded(row: list[float]) -> list[float]:
    return [round(value, _DIGITS) for value in row]


def _three(row: list[float]) -> tuple[float, float, float]:
    x, y, z = _rounded(row)
    return x, y, z
