"""The tools: freed, initialised, identified, given their roles, enabled."""

import asyncio
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from config.tracker import ToolSelector
from drivers.aurora.codec.status_bits import PortStatus
from drivers.aurora.codec.tool_information import (
    NO_SERIAL,
    Fields,
    HandleList,
    PortHandle,
    ToolInformation,
    decode_port_handles,
    decode_tool_information,
)
from drivers.aurora.conditions import (
    TOOL_ABSENT,
    TOOL_NOT_PROGRAMMED,
    TOOL_REFUSED,
    TOOL_UNIDENTIFIED,
)
from drivers.aurora.health import Health
from drivers.aurora.link import DeviceRefusedError, Link

_FIELDS = Fields.IDENTITY | Fields.PART_NUMBER | Fields.SENSORS
_OLDER_FIELDS = Fields.IDENTITY | Fields.PART_NUMBER | Fields.PORT
_MAX_ROUNDS = 16
"""Initialising one half of a dual sensor brings up the other half, so the list is read again."""
_SERIAL_ATTEMPTS = 4
_SERIAL_WAIT_S = 0.5
_BLANK_MEMORY = 0x13
_REFERENCE, _BUTTON_BOX = 0x01, 0x03


@dataclass(frozen=True)
class Tool:
    """A tool that is plugged in and initialised."""

    handle: int
    information: ToolInformation

    @property
    def serial(self) -> str:
        """Eight hex digits; none where the device reported none."""
        identity = self.information.identity
        return "" if identity is None or identity.serial == NO_SERIAL else identity.serial

    @property
    def port(self) -> tuple[int, int]:
        """Port and channel; (0, 0) where the device does not say."""
        if self.information.sensors is not None and self.information.sensors.locations:
            sensor = self.information.sensors.locations[0]
            return sensor.port, sensor.channel
        if self.information.port is not None:
            return self.information.port.port, self.information.port.channel
        return 0, 0

    def __str__(self) -> str:
        port, channel = self.port
        return f"port {port} channel {channel} serial {self.serial or 'unknown'}"


@dataclass(frozen=True)
class Tools:
    """All tools, and the roles of those that are followed, by handle."""

    plugged: tuple[Tool, ...]
    roles: Mapping[int, str]


async def set_up_tools(link: Link, selectors: Mapping[str, ToolSelector], health: Health) -> Tools:
    """Make every described tool ready for tracking. The device must not be tracking.

    One tool that fails does not stop the others: it becomes a condition.
    """
    health.counters.tool_setups += 1
    for handle, _ in await _handles(link, HandleList.TO_FREE):
        await _refusal_of(link, "PHF", f"{handle:02X}")
    failures = await _initialise(link)
    plugged = await _identify(link, failures)
    chosen = _choose(plugged, selectors)
    for tool in chosen.values():
        refusal = await _refusal_of(link, "PENA", f"{tool.handle:02X}{_priority(tool)}")
        if refusal is not None:
            failures[tool.handle] = refusal
    roles = {tool.handle: role for role, tool in chosen.items() if tool.handle not in failures}
    broken = {handle: await _where(link, handle) for handle in failures}
    _report(health, selectors, failures, broken, plugged, roles)
    return Tools(tuple(plugged), roles)


async def _handles(link: Link, which: HandleList) -> tuple[PortHandle, ...]:
    return await link.query("PHSR", f"{which:02X}", decode_port_handles)


async def _refusal_of(link: Link, word: str, arguments: str) -> DeviceRefusedError | None:
    try:
        await link.command(word, arguments)
    except DeviceRefusedError as error:
        return error
    return None


async def _initialise(link: Link) -> dict[int, DeviceRefusedError]:
    """Initialise all; returns those that cannot be."""
    failures: dict[int, DeviceRefusedError] = {}
    done: set[int] = set()
    for _ in range(_MAX_ROUNDS):
        handles = await _handles(link, HandleList.TO_INITIALISE)
        fresh = [(handle, status) for handle, status in handles if handle not in done]
        if not fresh:
            break
        for handle, status in fresh:
            done.add(handle)
            if PortStatus.INITIALISED not in status:
                refusal = await _refusal_of(link, "PINIT", f"{handle:02X}")
                if refusal is not None:
                    failures[handle] = refusal
    return failures


async def _identify(link: Link, failures: Mapping[int, DeviceRefusedError]) -> list[Tool]:
    ready = PortStatus.OCCUPIED | PortStatus.INITIALISED
    tools = []
    for handle, status in await _handles(link, HandleList.ALL):
        if ready in status and handle not in failures:
            tool = await _tool(link, handle)
            if tool is not None:
                tools.append(tool)
    return tools


async def _tool(link: Link, handle: int) -> Tool | None:
    """What is at the handle. Some units need a moment until they know a tool's serial number."""
    tool = None
    for _ in range(_SERIAL_ATTEMPTS):
        information = await _information(link, handle, _FIELDS, _OLDER_FIELDS)
        tool = None if information is None else Tool(handle, information)
        if tool is None or tool.serial:
            break
        await asyncio.sleep(_SERIAL_WAIT_S)
    return tool


async def _information(link: Link, handle: int, *options: Fields) -> ToolInformation | None:
    """PHINF with the first of these options that the device knows."""
    for fields in options:
        decode = partial(decode_tool_information, fields=fields)
        with suppress(DeviceRefusedError):
            return await link.query("PHINF", f"{handle:02X}{fields:04X}", decode)
    return None


async def _where(link: Link, handle: int) -> Tool:
    """A broken tool: only its port can be known."""
    information = await _information(link, handle, Fields.PORT, Fields.SENSORS)
    return Tool(handle, information or ToolInformation())


def _fits(tool: Tool, selector: ToolSelector) -> bool:
    port, channel = tool.port
    if selector.serial is not None:
        return tool.serial == selector.serial and channel == selector.channel
    return (port, channel) == (selector.port, selector.channel)


def _choose(tools: Iterable[Tool], selectors: Mapping[str, ToolSelector]) -> dict[str, Tool]:
    """The tool of each role. No tool gets two."""
    chosen: dict[str, Tool] = {}
    for tool in tools:
        for role, selector in selectors.items():
            if role not in chosen and _fits(tool, selector):
                chosen[role] = tool
                break
    return chosen


def _priority(tool: Tool) -> str:
    identity = tool.information.identity
    kind = identity.main_type if identity is not None else 0
    return {_REFERENCE: "S", _BUTTON_BOX: "B"}.get(kind, "D")


def _report(
    health: Health,
    selectors: Mapping[str, ToolSelector],
    failures: Mapping[int, DeviceRefusedError],
    broken: Mapping[int, Tool],
    plugged: Iterable[Tool],
    roles: Mapping[int, str],
) -> None:
    blank: dict[str, str] = {}
    refused: dict[str, str] = {}
    for handle, tool in broken.items():
        part = next((role for role, s in selectors.items() if _fits(tool, s)), _part(tool))
        found = blank if failures[handle].code == _BLANK_MEMORY else refused
        found[part] = f"{tool}: {failures[handle]}"
    nameless = {_part(t): str(t) for t in plugged if not t.serial and t.handle not in roles}
    there = ", ".join(map(str, plugged)) or "no tool"
    absent = {
        role: f"wanted: {_wanted(selector)}; plugged in: {there}"
        for role, selector in selectors.items()
        if role not in roles.values() and role not in blank and role not in refused
    }
    health.keep_only(TOOL_NOT_PROGRAMMED, blank)
    health.keep_only(TOOL_REFUSED, refused)
    health.keep_only(TOOL_UNIDENTIFIED, nameless)
    health.keep_only(TOOL_ABSENT, absent)


def _part(tool: Tool) -> str:
    return "port {} channel {}".format(*tool.port)


def _wanted(selector: ToolSelector) -> str:
    which = f"serial {selector.serial}" if selector.serial else f"port {selector.port}"
    return f"{which} channel {selector.channel}"
