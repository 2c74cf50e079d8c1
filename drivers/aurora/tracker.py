"""The tracker as the daemon has it: run it, and frames come; whatever happens to the hardware, it
comes back by itself and says meanwhile what is wrong."""

import asyncio
import errno
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum

from config.tracker import Tracker
from drivers.aurora.bring_up import (
    DeviceInformation,
    NobodyThereError,
    RateRefusedError,
    WrongFamilyError,
    components,
    identify,
    set_rate,
    wake,
)
from drivers.aurora.codec.commands import LineSettings, encode_line_settings
from drivers.aurora.codec.errors import warning_meaning
from drivers.aurora.codec.status_bits import SystemStatus
from drivers.aurora.conditions import (
    BAD_REPLIES,
    CONFIGURATION_CHANGED,
    DEVICE_ERROR,
    DEVICE_RESET,
    DEVICE_WARNING,
    LINK_LOST,
    NO_ANSWER,
    PORT_BUSY,
    PORT_DENIED,
    PORT_MISSING,
    PORT_UNUSABLE,
    RATE_REFUSED,
    SILENT,
    WRONG_FAMILY,
)
from drivers.aurora.frame import TrackerFrame
from drivers.aurora.health import Counters, Health
from drivers.aurora.link import (
    POWER_UP_BAUD_RATE,
    AuroraError,
    DamagedReplyError,
    DeviceRefusedError,
    DeviceRestartedError,
    Link,
    LinkLostError,
    NoReplyError,
    TrafficListener,
)
from drivers.aurora.polling import Polling, Rates, tracking_rates
from drivers.aurora.tools import Tools, set_up_tools
from drivers.aurora.watch import StatusWatch, Watch, fetch_alerts
from drivers.byte_stream import StreamError, StreamOpener
from drivers.clock import Clock
from drivers.conditions import ActiveCondition, Condition, ConditionChange

_REOPEN_S = 0.2
_PAUSE_S = 0.5
_NORMAL, _FAST = "80", "C0"
"""Both let the frame counter start at zero."""
_FAREWELL_S = 1.0
_FAREWELL_TIMEOUT_S = 0.3

_PORT_CONDITIONS = {
    errno.ENOENT: PORT_MISSING,
    errno.EACCES: PORT_DENIED,
    errno.EBUSY: PORT_BUSY,
}
_FAILURES: dict[type[AuroraError], Condition] = {
    NobodyThereError: NO_ANSWER,
    NoReplyError: SILENT,
    DamagedReplyError: BAD_REPLIES,
    DeviceRefusedError: DEVICE_ERROR,
    WrongFamilyError: WRONG_FAMILY,
    RateRefusedError: RATE_REFUSED,
}
_OVER_ONCE_OPEN = (PORT_MISSING, PORT_DENIED, PORT_BUSY, PORT_UNUSABLE)
_OVER_ONCE_TRACKING = (LINK_LOST, *(c for c in _FAILURES.values() if c is not SILENT))
"""A silent tracker is over with its first reply."""


class TrackerState(Enum):
    """How far the tracker is."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    SETTING_UP = "setting up"
    """The tools."""
    TRACKING = "tracking"


@dataclass(frozen=True)
class TrackerSnapshot:
    """The tracker at one moment."""

    state: TrackerState
    baud_rate: int
    device: DeviceInformation | None
    tools: Tools
    conditions: tuple[ActiveCondition, ...]
    counters: Counters


class AuroraTracker:
    """An NDI Aurora.

    on_frame: called with every new frame. on_condition: with everything that goes wrong or gets
    well again. on_traffic: with all bytes, for a recorder.
    """

    def __init__(
        self,
        config: Tracker,
        open_stream: StreamOpener,
        clock: Clock,
        on_frame: Callable[[TrackerFrame], None],
        on_condition: Callable[[ConditionChange], None] | None = None,
        on_traffic: TrafficListener | None = None,
    ) -> None:
        self._config = config
        self._open_stream = open_stream
        self._clock = clock
        self._on_frame = on_frame
        self._on_traffic = on_traffic
        self._health = Health(clock, on_condition)
        self._status_watch = StatusWatch(self._health)
        self._watch = Watch(config.silent_after_s, clock, self._health)
        self._state = TrackerState.CLOSED
        self._was_lost = False
        self._link: Link | None = None
        self._device: DeviceInformation | None = None
        self._tools = Tools((), {})

    @property
    def status(self) -> TrackerSnapshot:
        """How things are now; does not change any more once you have it."""
        return TrackerSnapshot(
            self._state,
            POWER_UP_BAUD_RATE if self._link is None else self._link.baud_rate,
            self._device,
            self._tools,
            self._health.active(),
            self._health.counted(),
        )

    @property
    def state(self) -> TrackerState:
        """The same as in `status`."""
        return self._state

    @property
    def tracking(self) -> bool:
        """Whether it is set up and measures. The same as in `status`, for every bus cycle."""
        return self._state is TrackerState.TRACKING

    async def run(self) -> None:
        """Track for ever. Cancelled, it leaves the device as it was at power-up, within 1 s."""
        while True:
            await self._use_port()
            await asyncio.sleep(_REOPEN_S)

    async def _use_port(self) -> None:
        """From opening the port to losing it."""
        counters = self._health.counters
        link = Link(self._clock, counters, self._lost, self._on_traffic, self._warned)
        try:
            await link.open(self._open_stream)
        except StreamError as error:
            condition = _PORT_CONDITIONS.get(error.errno or 0, PORT_UNUSABLE)
            self._health.set(condition, detail=str(error))
            return
        self._link = link
        self._health.clear(*_OVER_ONCE_OPEN)
        counters.reconnects += self._was_lost
        self._was_lost = False
        try:
            await self._use_link(link)
        except LinkLostError:
            pass  # reported when it happened
        finally:
            await _take_leave(link)
            self._link = None
            self._state = TrackerState.CLOSED

    async def _use_link(self, link: Link) -> None:
        """Bring up and track again and again, until the line is lost."""
        while True:
            try:
                self._device = await self._bring_up(link)
                await self._track(link, self._device)
            except LinkLostError:
                raise
            except DeviceRestartedError:
                self._restarted("it said so")
            except AuroraError as error:
                self._health.set(_FAILURES[type(error)], detail=str(error))
                if not isinstance(error, NoReplyError):
                    await asyncio.sleep(_PAUSE_S)
            finally:
                self._watch.stop()

    async def _bring_up(self, link: Link) -> DeviceInformation:
        self._state = TrackerState.CONNECTING
        expected_baud_rate = link.baud_rate
        found = await wake(link, self._config.baud_rate)
        if found.by_break:
            self._restarted("by a break, because it did not answer")
        elif found.baud_rate < expected_baud_rate:
            self._restarted(f"it answers at {found.baud_rate} baud again")
        await set_rate(link, self._config)
        device = await identify(link)
        await fetch_alerts(link, device.components, self._health)
        return device

    async def _track(self, link: Link, device: DeviceInformation) -> None:
        fast = self._config.frame_rate == "fast"
        while True:
            self._state = TrackerState.SETTING_UP
            self._status_watch.forget_tools()
            self._tools = await set_up_tools(link, self._config.tools, self._health)
            await link.command("TSTART", _FAST if fast else _NORMAL, attempts=1)
            polling = self._polling(link, await tracking_rates(link, fast))
            self._state = TrackerState.TRACKING
            self._health.clear(*_OVER_ONCE_TRACKING)
            status = await polling.run(device.components)
            self._watch.stop()
            await link.command("TSTOP", attempts=1)
            if SystemStatus.CONFIGURATION_CHANGED in status:
                self._health.note(CONFIGURATION_CHANGED)
                self._device = device = replace(device, components=await components(link))

    def _polling(self, link: Link, rates: Rates) -> Polling:
        return Polling(
            link,
            self._config,
            rates,
            self._tools.roles,
            self._watch,
            self._status_watch,
            self._health,
            self._clock,
            self._on_frame,
        )

    def _lost(self, error: OSError) -> None:
        self._was_lost = True
        self._health.set(LINK_LOST, detail=str(error))

    def _restarted(self, detail: str) -> None:
        self._health.counters.resets += 1
        self._health.note(DEVICE_RESET, detail=detail)

    def _warned(self, word: str, code: int) -> None:
        meaning = warning_meaning(code)
        detail = f"{word}: warning {code:02X}, {meaning.text}; {meaning.remedy}"
        self._health.note(DEVICE_WARNING, detail=detail)


async def _take_leave(link: Link) -> None:
    """Leave the device as the next program expects it: at rest, at 9600 baud."""
    try:
        async with asyncio.timeout(_FAREWELL_S):
            with suppress(DeviceRefusedError):  # it is not tracking
                await link.command("TSTOP", attempts=1, timeout_s=_FAREWELL_TIMEOUT_S)
            power_up = encode_line_settings(LineSettings(POWER_UP_BAUD_RATE))
            await link.command("COMM", power_up, attempts=1, timeout_s=_FAREWELL_TIMEOUT_S)
    except (AuroraError, TimeoutError):
        pass  # the next one who opens the port finds the device with a break
    finally:
        link.close()
