"""A plan as it is kept: figures for people, and the path file that a daemon takes."""

from typing import Any

from config.robot import Robot
from config.tasks.planned_path import PlannedPath
from daemon.risk.body_risk_source import RiskIdentity
from daemon.workbench.planning.planner import Plan, Settings

_DIGITS = 6


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
