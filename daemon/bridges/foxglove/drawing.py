"""What the robot tells, as shapes of Foxglove's scenes. Metres, in the frame `base`."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Duration,
    FrameTransform,
    LinePrimitive,
    LinePrimitiveLineType,
    Log,
    LogLevel,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SpherePrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from numpy.typing import NDArray

from daemon.bridges.foxglove.solids import Solid
from daemon.bridges.poses import is_place, quaternion_along, unit_quaternion
from daemon.messages import Body, Component, Event, Risk, Tip

BASE: Final = "base"
_M_PER_MM: Final = 1e-3
_NS_PER_S: Final = 1_000_000_000
_DEVIATIONS: Final = 2.0
"""An ellipsoid reaches so many standard deviations to each side: 95 % along each axis."""
_LINE_M: Final = 0.0008

_BODY: Final = Color(r=0.35, g=0.65, b=0.95, a=0.9)
_TRAIL: Final = Color(r=0.35, g=0.65, b=0.95, a=0.6)
_REFERENCE: Final = Color(r=1.0, g=0.65, b=0.15, a=1.0)
_CLEARANCE: Final = Color(r=0.95, g=0.25, b=0.25, a=1.0)
_SURROUNDINGS: Final = Color(r=0.75, g=0.7, b=0.65, a=0.35)
_SEVERITY: Final = {
    "warning": LogLevel.Warning,
    "not_ready": LogLevel.Warning,
    "hold": LogLevel.Error,
    "disarm": LogLevel.Error,
    "fault": LogLevel.Fatal,
    "estop": LogLevel.Fatal,
}
_FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_STL_HEAD: Final = 84


def frames(tip: Tip, date_ns: int) -> list[FrameTransform]:
    """Of tip and reference, as far as they are known."""
    found = []
    for child, place_mm, turn in (
        ("tip", tip.tip_mm, unit_quaternion(tip.quaternion) or (1.0, 0.0, 0.0, 0.0)),
        ("reference", tip.reference_mm, quaternion_along(tip.reference_direction)),
    ):
        if place_mm is not None and is_place(place_mm):
            w, x, y, z = turn
            found.append(
                FrameTransform(
                    timestamp=_stamp(date_ns),
                    parent_frame_id=BASE,
                    child_frame_id=child,
                    translation=_vector(np.array(place_mm) * _M_PER_MM),
                    rotation=Quaternion(x=x, y=y, z=z, w=w),
                )
            )
    return found


def body_entity(body: Body, date_ns: int) -> SceneEntity | None:
    """The centreline, as thick as the body is, and the model's ellipsoids."""
    points = body.centreline_mm
    if not points or not all(map(is_place, points)):
        return None
    radius_mm = float(np.median(body.radius_mm)) if body.radius_mm else 0.5
    line = LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        thickness=2.0 * radius_mm * _M_PER_MM,
        points=_points(points),
        color=_BODY,
    )
    spheres = [sphere for one in body.components or [] if (sphere := _ellipsoid(one)) is not None]
    return _entity("body", date_ns, lines=[line], spheres=spheres)


def trail_entity(name: str, places_mm: Sequence[Sequence[float]], date_ns: int) -> SceneEntity:
    """Where something has been: `tip trail`, `reference trail`."""
    colour = _REFERENCE if name.startswith("reference") else _TRAIL
    line = LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        thickness=_LINE_M,
        points=_points(places_mm),
        color=colour,
    )
    return _entity(name, date_ns, lines=[line])


def clearance_entity(risk: Risk, date_ns: int) -> SceneEntity | None:
    """From where the body is nearest to something, to what that is."""
    if risk.place_mm is None or risk.obstacle_mm is None:
        return None
    ends = [risk.place_mm, risk.obstacle_mm]
    if not all(map(is_place, ends)):
        return None
    line = LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        thickness=_LINE_M,
        points=_points(ends),
        color=_CLEARANCE,
    )
    return _entity("clearance", date_ns, lines=[line])


def surroundings_entity(
    mesh: bytes, transform: Sequence[float] | None, date_ns: int
) -> SceneEntity | None:
    """What is round the body; None where the bytes are no binary STL file.

    transform: (16,) row by row, from the mesh's places to the base's; None or empty: none.
    """
    count = (len(mesh) - _STL_HEAD) // _FACET.itemsize
    if count < 1 or len(mesh) != _STL_HEAD + count * _FACET.itemsize:
        return None
    facets = np.frombuffer(mesh, _FACET, count, _STL_HEAD)
    corners = facets["corners"].reshape(-1, 3).astype(np.float64)
    if transform:
        matrix = np.reshape(transform, (4, 4))
        corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    triangles = TriangleListPrimitive(points=_points(corners), color=_SURROUNDINGS)
    return _entity("surroundings", date_ns, triangles=[triangles])


def solids_entity(name: str, solids: Sequence[Solid], date_ns: int) -> SceneEntity | None:
    """`regions`, `moving obstacles`; None where there are none."""
    if not solids:
        return None
    return SceneEntity(
        timestamp=_stamp(date_ns),
        frame_id=BASE,
        id=name,
        lifetime=Duration(0, 0),
        frame_locked=True,
        cubes=[one for one in solids if isinstance(one, CubePrimitive)],
        cylinders=[one for one in solids if isinstance(one, CylinderPrimitive)],
        spheres=[one for one in solids if isinstance(one, SpherePrimitive)],
    )


def gone(name: str, date_ns: int) -> SceneEntityDeletion:
    """That one of the entities is not there any more."""
    by_name = SceneEntityDeletionType.MatchingId
    return SceneEntityDeletion(timestamp=_stamp(date_ns), type=by_name, id=name)


def log(event: Event, date_ns: int) -> Log:
    """An event as a line of a log."""
    gone = event.kind in ("cause", "condition") and not event.present
    level = LogLevel.Info if gone else _SEVERITY.get(event.severity, LogLevel.Info)
    detail = f" ({event.detail})" if event.detail else ""
    text = f"{'over: ' if gone else ''}{event.subject}: {event.text}{detail}"
    name = f"{event.kind}/{event.name}"
    return Log(timestamp=_stamp(date_ns), level=level, message=text, name=name)


def _entity(
    name: str,
    date_ns: int,
    lines: list[LinePrimitive] | None = None,
    spheres: list[SpherePrimitive] | None = None,
    triangles: list[TriangleListPrimitive] | None = None,
) -> SceneEntity:
    return SceneEntity(
        timestamp=_stamp(date_ns),
        frame_id=BASE,
        id=name,
        lifetime=Duration(0, 0),
        frame_locked=True,
        lines=lines,
        spheres=spheres,
        triangles=triangles,
    )


def _ellipsoid(one: Component) -> SpherePrimitive | None:
    """The size of a sphere in a scene is its diameter."""
    if not is_place(one.mean_mm) or len(one.covariance_mm2) != 6:
        return None
    xx, xy, xz, yy, yz, zz = one.covariance_mm2
    covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite(covariance).all():
        return None
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    size = 2.0 * _DEVIATIONS * np.sqrt(np.maximum(variances, 0.0)) * _M_PER_MM
    place = _vector(np.array(one.mean_mm) * _M_PER_MM)
    return SpherePrimitive(
        pose=Pose(position=place, orientation=_turn(axes)),
        size=_vector(size),
        color=Color(r=0.6, g=0.4, b=0.9, a=0.08 + 0.4 * min(1.0, max(0.0, one.weight))),
    )


def _turn(axes: NDArray[np.float64]) -> Quaternion:
    """Of a rotation: the eigenvector to the greatest eigenvalue of Davenport's matrix (Bar-Itzhack
    2000), which has no case that is nearly singular."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    matrix = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = (float(part) for part in np.linalg.eigh(matrix)[1][:, -1])
    return Quaternion(x=x, y=y, z=z, w=w)


def _points(
    places_mm: Sequence[Sequence[float]] | NDArray[np.float64],
) -> list[Point3]:
    scaled = np.asarray(places_mm, np.float64) * _M_PER_MM
    return [Point3(x=x, y=y, z=z) for x, y, z in scaled.tolist()]


def _vector(place: NDArray[np.float64]) -> Vector3:
    x, y, z = place.tolist()
    return Vector3(x=x, y=y, z=z)


def _stamp(date_ns: int) -> Timestamp:
    sec, nsec = divmod(date_ns, _NS_PER_S)
    return Timestamp(sec, nsec)
