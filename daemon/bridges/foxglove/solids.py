"""Regions and obstacles that move, as shapes of Foxglove's scenes. Metres, in the frame `base`."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Pose,
    Quaternion,
    SpherePrimitive,
    Vector3,
)

from config.control import BallRegion, BoxRegion, CapsuleRegion, CylinderRegion, Region
from daemon.bridges.poses import quaternion_along, unit_quaternion

Solid = Any
"""A CubePrimitive, CylinderPrimitive or SpherePrimitive, whose library tells no types."""

_M_PER_MM: Final = 1e-3
_ENDLESS_MM: Final = 400.0
"""So far the plane of a half-space is drawn, ..."""
_THIN_MM: Final = 0.2
"""... and so thick."""
_FORBIDDEN: Final = Color(r=0.9, g=0.35, b=0.35, a=0.3)
_TO_STAY_IN: Final = Color(r=0.15, g=0.65, b=0.4, a=0.2)
_MOVING: Final = Color(r=0.9, g=0.65, b=0.15, a=0.5)
_UPRIGHT: Final = (1.0, 0.0, 0.0, 0.0)


def region_solids(region: Region) -> list[Solid]:
    """Red is what the body must not get into, green what it must not get out of."""
    color = _TO_STAY_IN if region.keep == "in" else _FORBIDDEN
    match region:
        case BallRegion():
            return [_ball(region.centre_mm, region.radius_mm, color)]
        case BoxRegion():
            return [_box(region.centre_mm, region.turned, region.size_mm, color)]
        case CapsuleRegion():
            return _capsule(region.from_mm, region.to_mm, region.radius_mm, color)
        case CylinderRegion():
            return [_cylinder(region.from_mm, region.to_mm, region.radius_mm, color)]
        case _:
            size_mm = (_ENDLESS_MM, _ENDLESS_MM, _THIN_MM)
            return [_box(region.point_mm, quaternion_along(region.normal), size_mm, color)]


def moving_solids(moving_mm: Sequence[Sequence[float]]) -> list[Solid]:
    """Capsules: from where, on what way, how thick, each as `risk.moving_mm` of a status has it."""
    solids: list[Solid] = []
    for one in moving_mm:
        if len(one) == 7 and np.isfinite(one).all():
            end = [begins + way for begins, way in zip(one[:3], one[3:6], strict=True)]
            solids += _capsule(one[:3], end, one[6], _MOVING)
    return solids


def _ball(centre_mm: Sequence[float], radius_mm: float, color: Color) -> Solid:
    pose = _pose(centre_mm, _UPRIGHT)
    return SpherePrimitive(pose=pose, size=_size([2.0 * radius_mm] * 3), color=color)


def _box(
    centre_mm: Sequence[float], turned: Sequence[float], size_mm: Sequence[float], color: Color
) -> Solid:
    turn = unit_quaternion(turned) or _UPRIGHT
    return CubePrimitive(pose=_pose(centre_mm, turn), size=_size(size_mm), color=color)


def _cylinder(
    from_mm: Sequence[float], to_mm: Sequence[float], radius_mm: float, color: Color
) -> Solid:
    way = np.subtract(to_mm, from_mm)
    size_mm = [2.0 * radius_mm, 2.0 * radius_mm, float(np.linalg.norm(way))]
    return CylinderPrimitive(
        pose=_pose(np.add(from_mm, 0.5 * way).tolist(), quaternion_along(way.tolist())),
        size=_size(size_mm),
        bottom_scale=1.0,
        top_scale=1.0,
        color=color,
    )


def _capsule(
    from_mm: Sequence[float], to_mm: Sequence[float], radius_mm: float, color: Color
) -> list[Solid]:
    ends = [_ball(from_mm, radius_mm, color)]
    if list(from_mm) == list(to_mm):
        return ends
    return [
        *ends,
        _ball(to_mm, radius_mm, color),
        _cylinder(from_mm, to_mm, radius_mm, color),
    ]


def _pose(place_mm: Sequence[float], turn: tuple[float, float, float, float]) -> Pose:
    x, y, z = (float(part) * _M_PER_MM for part in place_mm)
    w, i, j, k = turn
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=i, y=j, z=k, w=w))


def _size(size_mm: Sequence[float]) -> Vector3:
    x, y, z = (float(part) * _M_PER_MM for part in size_mm)
    return Vector3(x=x, y=y, z=z)
