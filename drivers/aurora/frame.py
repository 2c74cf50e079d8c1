"""What the tracker measured at one moment, as everybody else sees it."""

import math
from collections.abc import Mapping, Sequence
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
from drivers.pose import PlainPose, Pose, Quaternion, product

_OUTSIDE = PortStatus.OUT_OF_VOLUME | PortStatus.PARTIALLY_OUT_OF_VOLUME
_UNIT_LENGTH_TOLERANCE = 0.02
"""Four digits of each component leave 1e-4 in text; more is no rotation. Chosen."""
_FARTHEST_MM = 10_000.0
"""A field of six digits holds 9999.99 mm; the volume is half a metre wide."""
_LEAP_MM, _LEAP_RAD = 2.0, 0.03
"""A base sensor that is so far from its mean has been moved, or was misread: some ten times what it
jitters by (0.1 to 0.2 mm, 1 to 3 mrad). Chosen."""
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


class SteadyBase:
    """The pose of a base that stands still, averaged over some time.

    Its jitter would move a tip that is far from it: 1.3 mrad at 180 mm are 0.23 mm, more than the
    tip's own sensor is uncertain by. A base that moves is followed the later, the longer the
    average; one that leaps is believed at once, and averaged anew if it is still there in the next
    frame. A single reading far off is left out.
    """

    def __init__(self, averaged_s: float) -> None:
        """averaged_s: time constant of the average."""
        self._averaged_s = averaged_s
        self._mean: PlainPose | None = None
        self._elsewhere: PlainPose | None = None
        """Where the newest reading was, if that is far from the mean."""
        self._readings = 0
        self._t_ns = 0

    def seen(self, pose: PlainPose, t_ns: int) -> PlainPose:
        """The pose to believe, of the newest reading and those before it."""
        mean, elsewhere = self._mean, self._elsewhere
        if mean is not None and not _leapt(mean, pose):
            self._elsewhere = None
            self._readings += 1
            passed_s = max(t_ns - self._t_ns, 0) * 1e-9
            gain = max(1.0 - math.exp(-passed_s / self._averaged_s), 1.0 / self._readings)
            self._mean = _between(mean, pose, gain)
        elif mean is None or (elsewhere is not None and not _leapt(elsewhere, pose)):
            self._mean, self._elsewhere, self._readings = pose, None, 1
        else:
            self._elsewhere = pose
            return pose
        self._t_ns = t_ns
        return self._mean


def _leapt(one: PlainPose, other: PlainPose) -> bool:
    """Whether two readings of a sensor are too far apart for one that stands still."""
    near = math.dist(one.position_mm, other.position_mm) <= _LEAP_MM
    cosine, *sine = _turn(one, other)
    return not (near and 2.0 * math.atan2(math.hypot(*sine), abs(cosine)) <= _LEAP_RAD)


def _between(one: PlainPose, other: PlainPose, share: float) -> PlainPose:
    """So far on the way from one to the other, which is near."""
    x, y, z = _mixed(one.position_mm, other.position_mm, share)
    sign = math.copysign(1.0, _turn(one, other)[0])
    mixed = _mixed(one.quaternion, [sign * value for value in other.quaternion], share)
    length = math.hypot(*mixed)
    q0, qx, qy, qz = (value / length for value in mixed)
    return PlainPose((x, y, z), (q0, qx, qy, qz))


def _turn(one: PlainPose, other: PlainPose) -> Quaternion:
    """From one to the other, in the frame of the first."""
    w, x, y, z = one.quaternion
    return product((w, -x, -y, -z), other.quaternion)


def _mixed(one: Sequence[float], other: Sequence[float], share: float) -> list[float]:
    return [a + share * (b - a) for a, b in zip(one, other, strict=True)]


class FrameAssembler:
    """Makes frames of replies."""

    def __init__(
        self,
        roles: Mapping[int, str],
        has_base: bool,
        tip_from_sensor: PlainPose | None = None,
        base_averaged_s: float | None = None,
    ) -> None:
        """tip_from_sensor: placement of the tip's frame in its sensor's; None: they are one.
        base_averaged_s: None: the base is where each frame has it."""
        self._roles = roles
        self._has_base = has_base
        self._tip_from_sensor = tip_from_sensor
        self._steady = None if base_averaged_s is None else SteadyBase(base_averaged_s)

    def frame_number(self, data: TrackingData) -> int | None:
        """The number of the frame in a reply; None: no tool is followed that could tell it. A tip
        with a pose has the first word: where only the others go on, it is an old one."""
        first = None
        for reading in data.readings:
            role = self._roles.get(reading.handle)
            if role is None or reading.frame_number is None:
                continue
            if role == "tip" and reading.state is _VALID:
                return reading.frame_number
            first = reading.frame_number if first is None else first
        return first

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
        return TrackerFrame(frame_number, t_ns, received_ns, tools, status, self._tip(tools, t_ns))

    def _tip(self, tools: Mapping[str, ToolSample], t_ns: int) -> Pose | None:
        base = self._base(tools, t_ns)
        tip = tools.get("tip")
        if tip is None or tip.plain_pose is None:
            return None
        sensor, mount = tip.plain_pose, self._tip_from_sensor
        tip_pose = sensor if mount is None else sensor @ mount
        if not self._has_base:
            return tip_pose.vectors()
        return None if base is None else tip_pose.seen_from(base).vectors()

    def _base(self, tools: Mapping[str, ToolSample], t_ns: int) -> PlainPose | None:
        base = tools.get("base")
        if base is None or base.plain_pose is None or self._steady is None:
            return None if base is None else base.plain_pose
        return self._steady.seen(base.plain_pose, t_ns)


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
