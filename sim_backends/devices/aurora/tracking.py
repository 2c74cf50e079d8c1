"""The measuring side of the emulated tracker: a frame at a time, from the body's true poses."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from config.emulation.lab import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.status_bits import HandleState, PortStatus
from drivers.aurora.codec.tracking_data import FRAME_MODULUS, ToolReading
from drivers.pose import PlainPose, Pose, Vector
from sim_backends.devices.aurora.faults import Pending
from sim_backends.devices.aurora.measurement import Measured, Sensing
from sim_backends.devices.aurora.port import Agenda
from sim_backends.devices.aurora.rack import Handle, Rack
from sim_backends.devices.device import DeviceClock

# The emulated tracker's rhythm: when it measures, and how it numbers what it measured.


TICKS_PER_S = 320
NORMAL_PERIOD_NS = 25_000_000
FAST_PERIOD_NS = 15_000_000


class FrameGrid:
    """Frames since tracking was started, on the device's own clock. The counter runs from
    power-up, or from a start that sets it to zero."""

    def __init__(self, clock: DeviceClock) -> None:
        self._clock = clock
        self._zero_ns = self._start_ns = 0
        self._offset_ticks = 0
        self.period_ns = NORMAL_PERIOD_NS

    @property
    def is_fast(self) -> bool:
        """66 Hz instead of 40 Hz."""
        return self.period_ns == FAST_PERIOD_NS

    def power_up(self, t_ns: int) -> None:
        """The counter starts anew. t_ns: host time."""
        self._zero_ns = self._clock.device_ns(t_ns)
        self._offset_ticks = 0

    def start(self, t_ns: int, fast: bool, from_zero: bool) -> None:
        """Tracking starts; the first frame comes a period later. t_ns: host time."""
        self._start_ns = self._clock.device_ns(t_ns)
        self.period_ns = FAST_PERIOD_NS if fast else NORMAL_PERIOD_NS
        if from_zero:
            self.power_up(t_ns)

    def jump(self, ticks: int) -> None:
        """The counter jumps."""
        self._offset_ticks += ticks

    def host_ns(self, index: int) -> int:
        """Host time of frame `index` since the start, from 1."""
        return self._clock.host_ns(self._start_ns + index * self.period_ns)

    def number(self, index: int) -> int:
        """Its number."""
        since_zero_ns = self._start_ns + index * self.period_ns - self._zero_ns
        return (since_zero_ns * TICKS_PER_S // 10**9 + self._offset_ticks) % FRAME_MODULUS


BodyPoses = Callable[[int], Mapping[str, Pose]]
"""Poses of `tip` and `base` in the robot's base frame at a host time in ns."""

_BESIDE_THE_GENERATOR = PlainPose((400.0, 0.0, 50.0), (1.0, 0.0, 0.0, 0.0))
_NO_ROTATION = (0.0, 0.0, 0.0, 0.0)
_SENSOR_BROKEN = PortStatus.SENSOR_BROKEN.value
_OUT_OF_VOLUME = PortStatus.OUT_OF_VOLUME.value
_PARTIALLY_OUT_OF_VOLUME = PortStatus.PARTIALLY_OUT_OF_VOLUME.value
_OUTSIDE = _OUT_OF_VOLUME | _PARTIALLY_OUT_OF_VOLUME
_VALID, _MISSING, _DISABLED = HandleState.VALID, HandleState.MISSING, HandleState.DISABLED


class MeasuredFrame(NamedTuple):
    """One frame: its number, its host time, and what was measured, by handle."""

    number: int
    t_ns: int
    measured: Mapping[int, Measured]


class Tracking:
    """Frames while tracking."""

    def __init__(
        self,
        config: EmulatedTracker,
        body_poses: BodyPoses,
        agenda: Agenda,
        grid: FrameGrid,
        rack: Rack,
        pending: Pending,
        seed: np.random.SeedSequence,
    ) -> None:
        self._body_poses = body_poses
        self._agenda = agenda
        self._grid = grid
        self._rack = rack
        self._pending = pending
        self._sensing = Sensing(config, seed)
        turn = np.array(config.base_quaternion)
        self._base = Pose(np.array(config.base_position_mm), turn / np.linalg.norm(turn)).plain()
        self._mounts = {(tool.port, tool.channel): _mount(tool) for tool in config.tools}
        self._true_poses: dict[tuple[int, int], tuple[Pose, PlainPose]] = {}
        """By port and channel, the last pose of what a sensor sits on, and where it was itself in
        the field generator's frame."""
        self._outliers: dict[str, Vector] = {}
        self._run = 0
        self._measure_next: Callable[[], None] = partial(self._measure, self._run)
        self._index = 0
        self._reported = -1
        self.latest: MeasuredFrame | None = None

    def start(self) -> None:
        """Measure from now on, in the grid's rhythm."""
        self.stop()
        self._index = 0
        self._reported = -1
        self._measure_next = partial(self._measure, self._run)
        self._schedule()

    def stop(self) -> None:
        """Measure no longer."""
        self._run += 1
        self.latest = None

    def next_news_ns(self, hold: bool) -> int | None:
        """When there will be something to report; None: now."""
        waits = self.latest is None or (hold and self.latest.number == self._reported)
        return self._grid.host_ns(self._index + 1) if waits else None

    def readings(self, out_of_volume_too: bool) -> tuple[ToolReading, ...]:
        """The latest frame, as a reply lists it."""
        assert self.latest is not None
        self._reported = self.latest.number
        return tuple(
            _reading(number, handle, self.latest, out_of_volume_too)
            for number, handle in self._rack.handles.items()
        )

    def displace_once(self, who: str, offset_mm: Vector) -> None:
        """The next reading of this tool is off by so much. offset_mm: (3,)."""
        self._outliers[who] = offset_mm

    def _schedule(self) -> None:
        self._agenda.at(self._grid.host_ns(self._index + 1), self._measure_next)

    def _measure(self, run: int) -> None:
        if run != self._run:
            return
        self._index += 1
        t_ns = self._agenda.now_ns
        if self.latest is None or not self._pending.holds("frozen", t_ns):
            self.latest = MeasuredFrame(self._grid.number(self._index), t_ns, self._measured(t_ns))
        self._schedule()

    def _measured(self, t_ns: int) -> Mapping[int, Measured]:
        """All enabled tools, by handle."""
        poses = self._body_poses(t_ns)
        period_s, fast = self._grid.period_ns * 1e-9, self._grid.is_fast
        disturbed = self._outliers or self._pending.any_lasts
        found = {}
        for number, handle in self._rack.handles.items():
            if handle.enabled:
                tool = handle.socket.tool
                true = self._seen(tool, poses)
                measured = self._sensing.measure(tool, true, period_s, fast)
                if disturbed:
                    measured = self._with_faults(measured, handle.socket.name, t_ns)
                found[number] = measured
        return found

    def _seen(self, tool: EmulatedTool, poses: Mapping[str, Pose]) -> PlainPose:
        """In the field generator's frame; what does not move is not worked out again."""
        pose = poses.get(tool.attached_to)
        if pose is None:
            return _BESIDE_THE_GENERATOR
        plug = tool.port, tool.channel
        last = self._true_poses.get(plug)
        if last is None or last[0] is not pose:
            true = self._base @ pose.plain()
            mount = self._mounts[plug]
            last = self._true_poses[plug] = (pose, true if mount is None else true @ mount)
        return last[1]

    def _with_faults(self, measured: Measured, who: str, t_ns: int) -> Measured:
        holds = self._pending.holds
        offset_mm = self._outliers.pop(who, None)
        if holds("missing", t_ns, who) or holds("unplug_field_generator", t_ns):
            return Measured(None)
        if holds("broken_sensor", t_ns, who):
            return Measured(None, _SENSOR_BROKEN)
        if measured.pose is not None and offset_mm is not None:
            measured = measured._replace(pose=_displaced(measured.pose, offset_mm))
        if measured.pose is not None and holds("implausible_pose", t_ns, who):
            measured = measured._replace(pose=measured.pose._replace(quaternion=_NO_ROTATION))
        if holds("out_of_volume", t_ns, who):
            return measured._replace(flags=_OUT_OF_VOLUME)
        if holds("partially_out_of_volume", t_ns, who):
            return measured._replace(flags=_PARTIALLY_OUT_OF_VOLUME)
        return measured


def _displaced(pose: PlainPose, offset_mm: Vector) -> PlainPose:
    (x, y, z), (u, v, w) = pose.position_mm, offset_mm.tolist()
    return PlainPose((x + u, y + v, z + w), pose.quaternion)


def _reading(
    number: int, handle: Handle, frame: MeasuredFrame, out_of_volume_too: bool
) -> ToolReading:
    measured = frame.measured.get(number)
    if not handle.enabled or measured is None:
        return ToolReading(number, _DISABLED)
    pose, flags, indicator = measured
    status = handle.bits | flags
    if pose is None or (flags & _OUTSIDE and not out_of_volume_too):
        return ToolReading(number, _MISSING, None, None, 0.0, status, frame.number)
    position_mm, quaternion = pose
    return ToolReading(number, _VALID, quaternion, position_mm, indicator, status, frame.number)


def _mount(tool: EmulatedTool) -> PlainPose | None:
    """Where a sensor sits on what it is attached to; None: at its very frame."""
    turn = np.array(tool.quaternion)
    turn /= np.linalg.norm(turn)
    if not any(tool.position_mm) and turn[0] == 1.0:
        return None
    return Pose(np.array(tool.position_mm), turn).plain()
