"""The tracking loop: ask for a frame, hand it on, and see what the device says beside it."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot
from typing import Final

from config.tracker import Tracker
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import FRAME_FREQUENCY, TRACK_FREQUENCY, decode_parameters
from drivers.aurora.codec.replies import (
    BINARY_FRAMING_BYTES,
    TEXT_FRAMING_BYTES,
    BinaryReply,
    Reply,
    TextReply,
)
from drivers.aurora.codec.status_bits import SystemStatus
from drivers.aurora.codec.tracking_data import (
    FRAME_MODULUS,
    OUT_OF_VOLUME_TOO,
    TRANSFORMS,
    TrackingData,
    decode_bx,
    decode_tx,
)
from drivers.aurora.frame import FrameAssembler, TrackerFrame
from drivers.aurora.frame_clock import FrameClock
from drivers.aurora.health import Health
from drivers.aurora.link import DamagedReplyError, DeviceRefusedError, Link, NoReplyError
from drivers.aurora.watch import StatusWatch, Watch, fetch_alerts
from drivers.clock import Clock
from drivers.pose import PlainPose

# The device's rhythm: how often it measures, and how fast its frame counter runs.


_NORMAL_FRAMES_PER_S = 40.0
_FAST_FRAMES_PER_S = 1000.0 / 15.0
_TICKS_PER_S = 320.0


@dataclass(frozen=True)
class Rates:
    """Frames per second, and steps of the frame counter per second."""

    frames_per_s: float
    ticks_per_s: float


async def tracking_rates(link: Link, fast: bool) -> Rates:
    """What the device says while it tracks; older ones do not say it, but keep to the book."""
    usual = Rates(_FAST_FRAMES_PER_S if fast else _NORMAL_FRAMES_PER_S, _TICKS_PER_S)
    try:
        return await link.query("GET", "Param.Tracking.*", _rates)
    except (DeviceRefusedError, DamagedReplyError):
        return usual


def _rates(text: str) -> Rates:
    parameters = decode_parameters(text)
    try:
        rates = Rates(float(parameters[TRACK_FREQUENCY]), float(parameters[FRAME_FREQUENCY]))
    except (KeyError, ValueError):
        raise CodecError("GET: no track and frame frequency") from None
    if not (1.0 <= rates.frames_per_s <= 1000.0 and rates.ticks_per_s >= rates.frames_per_s):
        raise CodecError(f"GET: implausible {rates}")
    return rates


# When to ask for the next frame: just after it is there, so that its reply is young.
#
# Nobody says when a frame is ready; asking shows it. A reply that repeats the last frame was
# asked for too early, a new one late enough. So requests keep the device's rhythm and creep
# earlier a little every frame; a repeated frame shows the edge, and the rhythm steps back behind
# it.


_SLOWEST_CREEP_NS = 5_000
"""Per frame. Twice what 100 ppm between the clocks makes of 25 ms: the edge cannot run away."""
_GUARD_NS = 500_000
"""Smallest step back, so that in any jitter at most one frame in a hundred is asked for twice."""


class PollTiming:
    """Decides when requests go out. Where the rhythm is not known, they go back to back.

    That is the case at first, and stays so where the line is too slow for repeated frames, or
    where the device holds a reply until it has a new frame: there is nothing to gain then.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._planned_ns: int | None = None
        self._creep_ns = 0
        self._repeat_sent_ns: int | None = None

    def next_request_ns(self, now_ns: int) -> int:
        """When the next request is to go out; not before now."""
        if self._planned_ns is None or self._repeat_sent_ns is not None:
            return now_ns
        return max(self._planned_ns, now_ns)

    def repeated(self, sent_ns: int) -> None:
        """The request sent then brought the last frame once more."""
        if self._planned_ns is not None and self._repeat_sent_ns is None:
            self._planned_ns += max(2 * self._creep_ns, _GUARD_NS)
            self._creep_ns = max(self._creep_ns // 2, _SLOWEST_CREEP_NS)
        self._repeat_sent_ns = sent_ns

    def fresh(self, sent_ns: int, frames: int) -> None:
        """The request sent then brought a new frame, `frames` after the last one."""
        repeat_sent_ns, self._repeat_sent_ns = self._repeat_sent_ns, None
        if repeat_sent_ns is None:
            if self._planned_ns is not None:
                self._planned_ns += frames * self._period_ns - self._creep_ns
            return
        planned_ns = self._planned_ns
        if planned_ns is not None and planned_ns > repeat_sent_ns:
            self._planned_ns = planned_ns + frames * self._period_ns
            return
        # The frame became ready between these two requests: start from the later one.
        too_late_ns = sent_ns - (repeat_sent_ns if planned_ns is None else planned_ns)
        self._creep_ns = min(max(too_late_ns // 8, _SLOWEST_CREEP_NS), self._period_ns // 8)
        self._planned_ns = sent_ns + self._period_ns


_OPTIONS = f"{TRANSFORMS | OUT_OF_VOLUME_TOO:04X}"
_TIMEOUT_S = 0.2
_LONGEST_REPLY_BYTES = 1024
_BYTES_PER_POLL, _BYTES_PER_TOOL = 30, 70
"""Command and reply, in text; in binary they are fewer."""
_DAMAGED_IN_A_ROW = 10
_SETTLED_NS = 1_000_000_000
"""A plug that is pushed in bounces, and not every device clears its bits at once."""

_TOOLS_CHANGED = (
    SystemStatus.TOOL_PLUGGED | SystemStatus.TOOL_UNPLUGGED | SystemStatus.CONFIGURATION_CHANGED
)


def _tip_from_sensor(config: Tracker) -> PlainPose | None:
    """Placement of the tip's frame in its sensor's. None where the file has them as one."""
    tool = config.tools.get("tip")
    if tool is None or (tool.position_mm, tool.quaternion) == _AS_ONE:
        return None
    length = hypot(*tool.quaternion)
    q0, qx, qy, qz = (value / length for value in tool.quaternion)
    sensor = PlainPose(tool.position_mm, (q0, qx, qy, qz))
    return PlainPose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)).seen_from(sensor)


_AS_ONE: Final = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


class Polling:
    """One stretch of tracking, from TSTART to the next change of the tools."""

    def __init__(
        self,
        link: Link,
        config: Tracker,
        rates: Rates,
        roles: Mapping[int, str],
        watch: Watch,
        status_watch: StatusWatch,
        health: Health,
        clock: Clock,
        on_frame: Callable[[TrackerFrame], None],
    ) -> None:
        self._link = link
        self._binary = config.reply_format == "binary"
        self._latency_ns = round(config.acquisition_latency_s * 1e9)
        self._tools = len(roles)
        self._assembler = FrameAssembler(
            roles, "base" in config.tools, _tip_from_sensor(config), config.base_averaged_s
        )
        self._watch = watch
        self._status_watch = status_watch
        self._health = health
        self._clock = clock
        self._on_frame = on_frame
        self._period_ns = round(1e9 / rates.frames_per_s)
        self._ticks_per_frame = rates.ticks_per_s / rates.frames_per_s
        self._frame_clock = FrameClock(rates.ticks_per_s)
        self._timing = PollTiming(self._period_ns)
        self._last_number: int | None = None
        self._alerts_due_ns = 0
        self._damaged_in_a_row = 0

    async def run(self, components: tuple[str, ...]) -> SystemStatus:
        """Track until the tools change; returns the system status that says so.

        Raises NoReplyError, DamagedReplyError, DeviceRefusedError, DeviceRestartedError,
        LinkLostError.
        """
        started_ns = self._clock.now_ns()
        self._watch.start(self._link.wire_ns(_BYTES_PER_POLL + _BYTES_PER_TOOL * self._tools))
        while True:
            await self._until_next_request()
            status = await self._poll()
            if not status:
                continue
            now_ns = self._clock.now_ns()
            if status & _TOOLS_CHANGED and now_ns - started_ns > _SETTLED_NS:
                return SystemStatus(status)
            if status & SystemStatus.ALERT_PENDING and now_ns >= self._alerts_due_ns:
                self._alerts_due_ns = now_ns + _SETTLED_NS
                await fetch_alerts(self._link, components, self._health)

    async def _until_next_request(self) -> None:
        now_ns = self._clock.now_ns()
        wait_ns = self._timing.next_request_ns(now_ns) - now_ns
        if wait_ns > 0:
            await asyncio.sleep(wait_ns * 1e-9)

    async def _poll(self) -> int:
        """One request; returns the system status, 0 where there was no reply to believe."""
        word, wanted = ("BX", BinaryReply) if self._binary else ("TX", TextReply)
        timeout_s = _TIMEOUT_S + self._link.wire_ns(_LONGEST_REPLY_BYTES) * 1e-9
        sent_ns = self._clock.now_ns()
        try:
            reply, received_ns = await self._link.exchange(word, _OPTIONS, wanted, timeout_s)
            data, size = _decode(reply)
        except (DamagedReplyError, CodecError) as error:
            self._health.counters.retries += 1
            self._watch.damaged(str(error))
            self._damaged_in_a_row += 1
            if self._damaged_in_a_row % _DAMAGED_IN_A_ROW == 0:
                await self._link.resynchronise()
            return 0
        except NoReplyError:
            await self._link.resynchronise()
            return 0
        self._damaged_in_a_row = 0
        self._watch.replied(received_ns)
        self._status_watch.system(data.system_status)
        if not self._take(data, sent_ns, received_ns, self._link.wire_ns(size)):
            await asyncio.sleep(self._period_ns * 1e-9)
        return data.system_status

    def _take(self, data: TrackingData, sent_ns: int, received_ns: int, wire_ns: int) -> bool:
        """What a reply says about the tools. False: none is followed, so none has a frame."""
        number = self._assembler.frame_number(data)
        if number is None:
            self._watch.idle(received_ns)
            self._status_watch.tools(self._assembler.samples(data))
            return False
        if number == self._last_number:
            self._health.counters.duplicates += 1
            self._timing.repeated(sent_ns)
        else:
            t_ns, missed = self._place_in_time(number, received_ns - wire_ns)
            self._timing.fresh(sent_ns, missed + 1)
            self._watch.fresh(received_ns, missed)
            self._health.counters.frames += 1
            frame = self._assembler.frame(data, number, t_ns - self._latency_ns, received_ns)
            self._status_watch.tools(frame.tools)
            self._on_frame(frame)
        return True

    def _place_in_time(self, number: int, arrived_ns: int) -> tuple[int, int]:
        """When the frame was measured, and how many were missed before it."""
        last, self._last_number = self._last_number, number
        jumps = self._frame_clock.jumps
        t_ns = self._frame_clock.observe(number, arrived_ns)
        if self._frame_clock.jumps != jumps:
            self._health.counters.counter_jumps += 1
            return t_ns, 0
        ticks = 0 if last is None else (number - last) % FRAME_MODULUS
        missed = max(round(ticks / self._ticks_per_frame) - 1, 0)
        self._health.counters.missed += missed
        return t_ns, missed


def _decode(reply: Reply) -> tuple[TrackingData, int]:
    """The content of a tracking reply, and its length on the line. Raises CodecError."""
    if isinstance(reply, BinaryReply):
        return decode_bx(reply.body), len(reply.body) + BINARY_FRAMING_BYTES
    assert isinstance(reply, TextReply)
    return decode_tx(reply.text), len(reply.text) + TEXT_FRAMING_BYTES
