"""The tracking loop: ask for a frame, hand it on, and see what the device says beside it."""

import asyncio
from collections.abc import Callable, Mapping

from config.tracker import Tracker
from drivers.aurora.alerts import fetch_alerts
from drivers.aurora.codec.errors import CodecError
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
from drivers.aurora.link import DamagedReplyError, Link, NoReplyError
from drivers.aurora.poll_timing import PollTiming
from drivers.aurora.rates import Rates
from drivers.aurora.status_watch import StatusWatch
from drivers.aurora.watch import Watch
from drivers.clock import Clock

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
        self._assembler = FrameAssembler(roles, "base" in config.tools)
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
