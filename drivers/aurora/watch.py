"""Notices what does not happen: replies that stay away, frames that stay the same or get lost."""

import asyncio
from collections.abc import Callable, Mapping

from drivers.aurora.bring_up import CONTROL_UNIT
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import ALERTS, NEW_ALERTS, decode_parameters
from drivers.aurora.codec.status_bits import PortStatus, SystemStatus
from drivers.aurora.conditions import (
    ALERT,
    CRC_ERRORS,
    FIELD_GENERATOR_UNPLUGGED,
    FRAMES_MISSED,
    FROZEN,
    IMPLAUSIBLE_POSE,
    OUT_OF_VOLUME,
    PARTIALLY_OUT_OF_VOLUME,
    SENSOR_FAULT,
    SILENT,
    TOOL_DISABLED,
    TOOL_MISSING,
)
from drivers.aurora.frame import Absence, ToolSample
from drivers.aurora.health import Health
from drivers.aurora.link import DamagedReplyError, DeviceRefusedError, Link
from drivers.clock import Clock
from drivers.conditions import Condition

# Alerts: what a component of the tracker says is wrong with it.


_TEXTS: Mapping[str, Mapping[int, str]] = {
    "SCU": {
        0x01: "processor fault",
        0x02: "fault of a peripheral",
        0x04: "fault of the field generator's driver",
        0x08: "a supply voltage is out of range",
    },
    "FG": {
        0x01: "communication fault",
        0x02: "coil fault",
        0x04: "no volume that fits this control unit",
    },
    "SIU": {
        0x01: "processor fault",
        0x02: "communication fault",
        0x04: "fault of the analogue part",
        0x08: "hardware and firmware do not fit together",
    },
}
_OVERFLOW = 0x80000000


def alert_texts(component: str, bits: int) -> str:
    """The alerts of a component like `SIU-1` in words; bits without a meaning as a number."""
    known = {**_TEXTS.get(component.partition("-")[0], {}), _OVERFLOW: "too many alerts to tell"}
    texts = [text for bit, text in known.items() if bits & bit]
    rest = bits & ~sum(known)
    return ", ".join([*texts, *([f"alert {rest:08X}"] if rest else [])])


async def fetch_alerts(link: Link, components: tuple[str, ...], health: Health) -> None:
    """Ask every component, which also clears the alert bit of the system status."""
    alerts: dict[str, str] = {}
    for component in components:
        prefix = "" if component == CONTROL_UNIT else f"{component}."
        new = await _value(link, prefix + NEW_ALERTS)
        bits = await _value(link, prefix + ALERTS)
        if bits:
            alerts[component] = alert_texts(component, bits)
        elif new and not health.holds(ALERT, component):
            health.note(ALERT, component, alert_texts(component, new))
    health.keep_only(ALERT, alerts)


async def _value(link: Link, name: str) -> int:
    """A number; 0 where the component does not have it, or was unplugged meanwhile."""
    try:
        return await link.query("GET", name, _number)
    except (DeviceRefusedError, DamagedReplyError):
        return 0


def _number(text: str) -> int:
    value, *others = decode_parameters(text).values()
    if others:
        raise CodecError(f"GET: '{text}' is more than one parameter")
    try:
        return int(value, 10) & 0xFFFFFFFF
    except ValueError:
        raise CodecError(f"GET: '{text}' is not a number") from None


# From status bits to conditions: what the device itself says is wrong with it or with a tool.


_SENSOR_FAULTS: Mapping[PortStatus, str] = {
    PortStatus.SENSOR_BROKEN: "its lead is broken",
    PortStatus.SENSOR_SHORTED: "its lead is shorted",
    PortStatus.SIGNAL_TOO_LARGE: "it is too close to the field generator",
    PortStatus.PROCESSING_EXCEPTION: "its signal cannot be processed",
}


def _sensor_faults(sample: ToolSample) -> str:
    return ", ".join(text for bit, text in _SENSOR_FAULTS.items() if bit & sample.port_status)


_TOOL_CONDITIONS: Mapping[Condition, Callable[[ToolSample], object]] = {
    OUT_OF_VOLUME: lambda s: s.port_status & PortStatus.OUT_OF_VOLUME,
    PARTIALLY_OUT_OF_VOLUME: lambda s: s.port_status & PortStatus.PARTIALLY_OUT_OF_VOLUME,
    SENSOR_FAULT: _sensor_faults,
    TOOL_MISSING: lambda s: s.absence is Absence.MISSING and s.in_volume,
    TOOL_DISABLED: lambda s: s.absence is Absence.DISABLED,
    IMPLAUSIBLE_POSE: lambda s: s.absence is Absence.IMPLAUSIBLE,
}
"""When each of them holds for a sensor."""


class StatusWatch:
    """Keeps the conditions in step with the bits. Costs next to nothing while they stay."""

    def __init__(self, health: Health) -> None:
        self._health = health
        self._system_status = 0
        self._seen: dict[str, tuple[Absence | None, int]] = {}

    def system(self, status: int) -> None:
        """The system status of a reply."""
        if status == self._system_status:
            return
        self._system_status = status
        if status & SystemStatus.FIELD_GENERATOR_UNPLUGGED:
            self._health.set(FIELD_GENERATOR_UNPLUGGED)
        else:
            self._health.clear(FIELD_GENERATOR_UNPLUGGED)

    def tools(self, samples: Mapping[str, ToolSample]) -> None:
        """The sensors of a reply, by role."""
        for role, sample in samples.items():
            seen = (sample.absence, sample.port_status)
            if self._seen.get(role) != seen:
                self._seen[role] = seen
                self._update(role, sample)

    def forget_tools(self) -> None:
        """The tools are set up anew: what held for one of them may not hold for the next."""
        for role in self._seen:
            self._health.clear(*_TOOL_CONDITIONS, part=role)
        self._seen.clear()

    def _update(self, role: str, sample: ToolSample) -> None:
        for condition, holds in _TOOL_CONDITIONS.items():
            held = holds(sample)
            if held:
                self._health.set(condition, role, held if isinstance(held, str) else "")
            else:
                self._health.clear(condition, part=role)


_CLEAN_NS = 1_000_000_000
"""Without a damaged reply for so long, the line counts as good again."""
_WINDOW_FRAMES = 200
"""Five seconds of them."""
_TOLERATED_SHARE = 0.05
"""Ten frames in five seconds: a step without a frame is bridged, but a line that is too slow for
its tools misses every other one. Chosen."""


class Watch:
    """Watches over a running tracker, from `start` to `stop`."""

    def __init__(self, silent_after_s: float, clock: Clock, health: Health) -> None:
        self._configured_ns = self._limit_ns = round(silent_after_s * 1e9)
        self._clock = clock
        self._health = health
        self._reply_ns = self._fresh_ns = self._damaged_ns = 0
        self._alarmed = False
        self._window_got = self._window_missed = 0
        self._timer: asyncio.TimerHandle | None = None

    def start(self, exchange_ns: int) -> None:
        """Watch from now on. A request and its reply take `exchange_ns` on the line: on a slow one
        the limit has to be longer than configured."""
        self._limit_ns = max(self._configured_ns, 2 * exchange_ns)
        self._alarmed = True  # whatever was raised before: the first reply clears it
        self._reply_ns = self._fresh_ns = self._clock.now_ns()
        self._arm(self._limit_ns)

    def stop(self) -> None:
        """What holds now keeps holding; nothing new is noticed."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def replied(self, t_ns: int) -> None:
        """A sound reply came, whatever is in it."""
        self._reply_ns = t_ns
        if self._alarmed:
            self._health.clear(SILENT)

    def idle(self, t_ns: int) -> None:
        """Nothing is followed, so that there is no new frame to wait for."""
        self._fresh_ns = t_ns

    def fresh(self, t_ns: int, missed: int) -> None:
        """A new frame came, and `missed` others before it did not."""
        self._fresh_ns = t_ns
        if self._alarmed:
            self._alarmed = False
            self._health.clear(FROZEN)
        else:
            self._window_missed += missed  # what a silence has cost is no slow line
        self._window_got += 1
        if self._window_got + self._window_missed >= _WINDOW_FRAMES:
            self._close_window()

    def damaged(self, detail: str) -> None:
        """A reply came that must not be believed."""
        self._damaged_ns = self._clock.now_ns()
        self._health.set(CRC_ERRORS, detail=detail)

    def _close_window(self) -> None:
        got, missed = self._window_got, self._window_missed
        self._window_got = self._window_missed = 0
        if missed > _TOLERATED_SHARE * (got + missed):
            self._health.set(FRAMES_MISSED, detail=f"{missed} of {got + missed}")
        else:
            self._health.clear(FRAMES_MISSED)

    def _arm(self, wait_ns: int) -> None:
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(wait_ns * 1e-9, self._look)

    def _look(self) -> None:
        now_ns = self._clock.now_ns()
        stale_ns = now_ns - self._fresh_ns
        if stale_ns >= self._limit_ns:
            self._alarmed = True
            if now_ns - self._reply_ns >= self._limit_ns:
                self._health.clear(FROZEN)
                self._health.set(SILENT)
            else:
                self._health.set(FROZEN)
        if self._damaged_ns and now_ns - self._damaged_ns >= _CLEAN_NS:
            self._damaged_ns = 0
            self._health.clear(CRC_ERRORS)
        self._arm(max(self._limit_ns - stale_ns, self._limit_ns // 4))
