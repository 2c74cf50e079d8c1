"""What the robot tells, as ROS messages in CDR. Metres, radians, newtons, as REP 103 wants them."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from rosbags.typesys import Stores, get_typestore

from daemon.bridges.poses import is_place, quaternion_along, unit_quaternion
from daemon.bridges.ros2.graph import Topic
from daemon.messages import Axes, AxisStatus, Body, Message, Status, Surroundings, Tip, WhoAmI

DISTROS: Final = {
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
}
"""Those whose rmw_zenoh has type hashes and is told apart by nothing else here."""

_M_PER_MM: Final = 1e-3
_NS_PER_S: Final = 1_000_000_000
_TYPES: Final = {
    "tf": "tf2_msgs/msg/TFMessage",
    "tip": "geometry_msgs/msg/PoseStamped",
    "reference": "geometry_msgs/msg/PoseStamped",
    "body": "nav_msgs/msg/Path",
    "joint_states": "sensor_msgs/msg/JointState",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
_OK, _WARN, _ERROR, _STALE = range(4)
_LEVELS: Final = {"warning": _WARN, "not_ready": _WARN}
_TO_SI: Final = {"mm": 1e-3, "rad": 1.0}
_FORCE_TO_SI: Final = {"N": 1.0, "N mm": 1e-3}

Told = tuple[str, bytes, int]
"""Name of TOPICS, CDR, date in ns since 1970."""


class RosTranslation:
    """Makes messages of what is heard; remembers what axes are called."""

    def __init__(self, robot: str, distro: str = "jazzy") -> None:
        """robot: topics and frames begin with it."""
        self._store = get_typestore(DISTROS[distro])
        self._robot = robot
        self._axes: list[AxisStatus] = []

    def topics(self) -> dict[str, Topic]:
        """By short name."""
        absolute = {"tf": "/tf", "diagnostics": "/diagnostics"}
        return {
            name: Topic(
                absolute.get(name, f"/{self._robot}/{name}"), kind, self._store.hash_rihs01(kind)
            )
            for name, kind in _TYPES.items()
        }

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:  # noqa: ARG002
        self._axes = []

    def told(self, message: Message, date_ns: int) -> Iterator[Told]:
        """What becomes of one message; nothing of what is not known."""
        match message:
            case Tip():
                yield from self._tip(message, date_ns)
            case Body():
                yield from self._body(message, date_ns)
            case Status():
                self._axes = message.axes
                yield "diagnostics", self._diagnostics(message, date_ns), date_ns
            case Axes():
                yield from self._joints(message, date_ns)
            case _:
                pass

    def lost(self, why: str, date_ns: int) -> Iterator[Told]:
        """That nothing is known any more."""
        status = self._state(_STALE, "daemon", f"not connected: {why}", {})
        yield "diagnostics", self._array([status], date_ns), date_ns

    def _tip(self, tip: Tip, date_ns: int) -> Iterator[Told]:
        moved = []
        whole = unit_quaternion(tip.quaternion) or (1.0, 0.0, 0.0, 0.0)
        for name, place_mm, turn in (
            ("tip", tip.tip_mm, whole),
            ("reference", tip.reference_mm, quaternion_along(tip.reference_direction)),
        ):
            if place_mm is None or not is_place(place_mm):
                continue
            pose = self._pose(place_mm, turn)
            stamped = self._make(
                "geometry_msgs/msg/PoseStamped", header=self._header(date_ns), pose=pose
            )
            yield name, self._cdr("geometry_msgs/msg/PoseStamped", stamped), date_ns
            moved.append(self._moved(name, pose, date_ns))
        if moved:
            message = self._make("tf2_msgs/msg/TFMessage", transforms=moved)
            yield "tf", self._cdr("tf2_msgs/msg/TFMessage", message), date_ns

    def _moved(self, name: str, pose: Any, date_ns: int) -> Any:
        place = pose.position
        translation = self._make("geometry_msgs/msg/Vector3", x=place.x, y=place.y, z=place.z)
        transform = self._make(
            "geometry_msgs/msg/Transform", translation=translation, rotation=pose.orientation
        )
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(date_ns),
            child_frame_id=f"{self._robot}/{name}",
            transform=transform,
        )

    def _body(self, body: Body, date_ns: int) -> Iterator[Told]:
        points = body.centreline_mm
        if not points or not all(map(is_place, points)):
            return
        places = np.asarray(points, np.float64)
        along = np.gradient(places, axis=0) if len(places) > 1 else np.zeros_like(places)
        header = self._header(date_ns)
        poses = [
            self._make(
                "geometry_msgs/msg/PoseStamped",
                header=header,
                pose=self._pose(place, quaternion_along(way)),
            )
            for place, way in zip(places.tolist(), along.tolist(), strict=True)
        ]
        path = self._make("nav_msgs/msg/Path", header=header, poses=poses)
        yield "body", self._cdr("nav_msgs/msg/Path", path), date_ns

    def _joints(self, axes: Axes, date_ns: int) -> Iterator[Told]:
        """Axes have their names from the status: before the first one, nothing is told."""
        known = self._axes
        if len(known) != len(axes.actual):
            return
        scales = [_TO_SI.get(axis.unit, 1.0) for axis in known]
        position = np.array(axes.actual, np.float64) * scales
        effort = np.zeros(0)
        if len(axes.force) == len(known):
            effort = np.array(axes.force, np.float64)
            effort = effort * [_FORCE_TO_SI.get(axis.force_unit, 1.0) for axis in known]
        state = self._make(
            "sensor_msgs/msg/JointState",
            header=self._header(date_ns),
            name=[axis.name for axis in known],
            position=position,
            velocity=np.zeros(0),
            effort=effort,
        )
        yield "joint_states", self._cdr("sensor_msgs/msg/JointState", state), date_ns

    def _diagnostics(self, status: Status, date_ns: int) -> bytes:
        """One entry for the robot, and one for each reason."""
        stopped = status.state in ("fault", "estop")
        values = {
            "simulated": str(status.simulated).lower(),
            "tracker": status.tracker.state,
            "control steps per second": f"{status.loop.rate_hz:.1f}",
            "lease": status.lease.holder or "",
            "recording": status.recording or "",
        }
        told = [self._state(_ERROR if stopped else _OK, "state", status.state, values)]
        for reason in status.reasons:
            level = _LEVELS.get(reason.severity, _ERROR)
            name = f"{reason.subject}: {reason.name}"
            more = {"severity": reason.severity, "remedy": reason.remedy, "detail": reason.detail}
            told.append(self._state(level, name, reason.text, more))
        return self._array(told, date_ns)

    def _state(self, level: int, name: str, text: str, values: dict[str, str]) -> Any:
        pairs = [
            self._make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in values.items()
        ]
        return self._make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=level,
            name=f"{self._robot}: {name}",
            message=text,
            hardware_id=self._robot,
            values=pairs,
        )

    def _array(self, statuses: list[Any], date_ns: int) -> bytes:
        kind = "diagnostic_msgs/msg/DiagnosticArray"
        return self._cdr(kind, self._make(kind, header=self._header(date_ns), status=statuses))

    def _pose(self, place_mm: list[float], turn: tuple[float, float, float, float]) -> Any:
        x, y, z = (part * _M_PER_MM for part in place_mm)
        w, i, j, k = turn
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._make("geometry_msgs/msg/Quaternion", x=i, y=j, z=k, w=w),
        )

    def _header(self, date_ns: int) -> Any:
        sec, nanosec = divmod(date_ns, _NS_PER_S)
        stamp = self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=f"{self._robot}/base")

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _cdr(self, kind: str, message: Any) -> bytes:
        return bytes(self._store.serialize_cdr(message, kind))
