"""What the tracker measured at one moment, as everybody else sees it."""

import math
from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from drivers.aurora.codec.status_bits import (
    HandleState,
    PortStatus,
    SystemStatus,
    port_status,
    system_status,
)
from drivers.aurora.codec.tracking_data import ToolReading, TrackingData
from drivers.pose import PlainPose, Pose

_OUTSIDE = PortStatus.OUT_OF_VOLUME | PortStatus.PARTIALLY_OUT_OF_VOLUME
_UNIT_LENGTH_TOLERANCE = 0.02
"""Four digits of each component leave 1e-4 in text; more is no rotation. Chosen."""
_FARTHEST_MM = 10_000.0
"""A field of six digits holds 9999.99 mm; the volume is half a metre wide."""
_VALID = HandleState.VALID


class Absence(Enum):
    """Why a sample has no pose."""

    MISSING = "missing"
    DISABLED = "disabled"
    IMPLAUSIBLE = "implausible"
    """Numbers came, but they are not a pose."""


_ABSENCES: Mapping[HandleState, Absence] = {
    HandleState.VALID: Absence.IMPLAUSIBLE,
    HandleState.MISSING: Absence.MISSING,
    HandleState.DISABLED: Absence.DISABLED,
}
"""Why there is no pose, by what the reply says."""


class ToolSample(NamedTuple):
    """One sensor in one frame."""

    handle: int
    state: HandleState
    plain_pose: PlainPose | None
    """In the field generator's frame. Roll about the sensor's axis (z) means nothing at 5 degrees
    of freedom."""
    absence: Absence | None
    """Why there is no pose."""
    port_status: PortStatus
    indicator: float
    """0 to 9.9, larger is a worse fit; always 0 for a sensor with 5 degrees of freedom."""

    @property
    def pose(self) -> Pose | None:
        """In the field generator's frame."""
        return None if self.plain_pose is None else self.plain_pose.vectors()

    @property
    def in_volume(self) -> bool:
        """Whether the accuracy of the pose is specified at all."""
        return not self.port_status & _OUTSIDE


class TrackerFrame(NamedTuple):
    """One frame."""

    frame_number: int
    t_ns: int
    """Host time of the measurement."""
    received_ns: int
    """Host time at which the reply was complete."""
    tools: Mapping[str, ToolSample]
    """By role. A role whose tool is absent is not here."""
    system_status: SystemStatus
    tip: Pose | None
    """The tip in the frame of the base sensor; where no base is configured, in the field
    generator's. None where one of the two has no pose."""


class FrameAssembler:
    """Makes frames of replies."""

    def __init__(
        self, roles: Mapping[int, str], has_base: bool, tip_from_sensor: PlainPose | None = None
    ) -> None:
        """tip_from_sensor: placement of the tip's frame in its sensor's; None: they are one."""
        self._roles = roles
        self._has_base = has_base
        self._tip_from_sensor = tip_from_sensor

    def frame_number(self, data: TrackingData) -> int | None:
        """The number of the frame in a reply; None: no tool is followed that could tell it."""
        for reading in data.readings:
            if reading.handle in self._roles and reading.frame_number is not None:
                return reading.frame_number
        return None

    def samples(self, data: TrackingData) -> dict[str, ToolSample]:
        """The sensors in a reply, by role."""
        return {
            self._roles[reading.handle]: _sample(reading)
            for reading in data.readings
            if reading.handle in self._roles
        }

    def frame(
        self, data: TrackingData, frame_number: int, t_ns: int, received_ns: int
    ) -> TrackerFrame:
        """The frame in a reply."""
        tools = self.samples(data)
        status = system_status(data.system_status)
        return TrackerFrame(frame_number, t_ns, received_ns, tools, status, self._tip(tools))

    def _tip(self, tools: Mapping[str, ToolSample]) -> Pose | None:
        tip = tools.get("tip")
        if tip is None or tip.plain_pose is None:
            return None
        sensor, mount = tip.plain_pose, self._tip_from_sensor
        tip_pose = sensor if mount is None else sensor @ mount
        if not self._has_base:
            return tip_pose.vectors()
        base = tools.get("base")
        if base is None or base.plain_pose is None:
            return None
        return tip_pose.seen_from(base.plain_pose).vectors()


def _sample(reading: ToolReading) -> ToolSample:
    handle, state, _, _, indicator, status, _ = reading
    pose = _pose(reading) if state is _VALID else None
    absence = None if pose is not None else _ABSENCES[state]
    return ToolSample(handle, state, pose, absence, port_status(status), indicator)


def _pose(reading: ToolReading) -> PlainPose | None:
    """The pose of a valid reading, its quaternion brought to unit length."""
    quaternion, position_mm = reading.quaternion, reading.position_mm
    if quaternion is None or position_mm is None:
        return None
    length = math.hypot(*quaternion)
    # Written so that NaN fails both.
    if not abs(length - 1.0) <= _UNIT_LENGTH_TOLERANCE:
        return None
    if not math.hypot(*position_mm) <= _FARTHEST_MM:
        return None
    q0, qx, qy, qz = quaternion
    return PlainPose(position_mm, (q0 / length, qx / length, qy / length, qz / length))
