"""Opens a bus by its configuration: python-can opens, the quickest link reads and writes."""

import asyncio
import errno
import logging
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

import can
from can.interfaces.slcan import slcanBus
from serial import SerialException

from config.bus import Bus
from drivers.bounded import in_own_thread
from drivers.can.bus_lock import take_bus
from drivers.can.conditions import QUEUE_SHORT
from drivers.can.fd_link import FdLink
from drivers.can.link import CanLink, FrameReceiver, LinkError
from drivers.can.preflight import check_interface
from drivers.can.python_can_link import PythonCanLink
from drivers.can.slcan_link import SlcanLink, abandon
from drivers.clock import Clock
from drivers.exclusive_name import ExclusiveName

logging.getLogger("can").setLevel(logging.CRITICAL)
"""What it logs it raises too; while it tries again that may be ten thousand lines a second."""

_SOCKETCAN: Final = "socketcan"
_SLCAN: Final = "slcan"
_UDP_MULTICAST: Final = "udp_multicast"
_SLCAN_SETTLES_S: Final = 0.1
_OPENS_WITHIN_S: Final = 10.0
"""Slow vendors' libraries take about two; an adapter that hangs would take for ever."""

_REMEDIES: Final = {
    errno.ENOENT: "check the channel in the robot file; is the adapter plugged in?",
    errno.ENODEV: "check the channel in the robot file; is the adapter plugged in?",
    errno.EACCES: "join the group dialout (sudo usermod -aG dialout $USER) and log in again",
    errno.EPERM: "run as a user who may use this interface",
    errno.EBUSY: "another program has it: close that first",
    errno.ECONNREFUSED: "nobody listens there: start `tentacled emulate`",
}
_CHECK_ALL: Final = (
    "check interface, channel and options of the bus in the robot file, and that the adapter's own "
    "library is installed"
)


async def open_link(bus: Bus, receiver: FrameReceiver, clock: Clock) -> CanLink:
    """Open the interface of `bus`, as its one master on this machine, until the link is closed.

    Raises LinkError; where the bus has a master already BusTakenError, and nothing is opened.
    """
    if bus.interface == _SOCKETCAN:
        queue = check_interface(bus.channel).tx_queue_frames
        if queue < bus.tx_queue_frames:
            receiver.condition_seen(QUEUE_SHORT, True, f"it takes {queue} frames")
    elif bus.interface == _SLCAN:
        _check_serial_port(bus.channel)
    try:
        async with asyncio.timeout(_OPENS_WITHIN_S):
            opened, lock = await in_own_thread(_open_locked, bus, unwanted=_let_go)
    except TimeoutError:
        raise LinkError(
            f"{bus.channel} does not open within {_OPENS_WITHIN_S:g} s",
            "unplug the adapter and plug it in again",
        ) from None
    if isinstance(opened, slcanBus):
        return SlcanLink(opened, receiver, clock, lock.release)
    if bus.interface == _SOCKETCAN or getattr(opened, "carries_can_frames", False):
        # The link keeps the bus: python-can closes the socket of one that nobody keeps.
        return FdLink(opened.socket, partial(_let_go, (opened, lock)), receiver, clock)  # type: ignore[attr-defined]
    echoes = bus.interface == _UDP_MULTICAST
    return PythonCanLink(opened, receiver, clock, lock.release, echoes=echoes)


def _open_locked(bus: Bus) -> tuple[can.BusABC, ExclusiveName]:
    """Whatever opening sends to an adapter, it must not be sent to another master's."""
    lock = take_bus(bus)
    try:
        opened = _open(bus)
        if isinstance(opened, slcanBus):
            _keep_others_out(opened, bus.channel)
    except BaseException:
        lock.release()
        raise
    return opened, lock


def _let_go(opened_and_lock: tuple[can.BusABC, ExclusiveName]) -> None:
    opened, lock = opened_and_lock
    try:
        if isinstance(opened, slcanBus):
            abandon(opened)
        else:
            opened.shutdown()
    finally:
        lock.release()


def _keep_others_out(opened: slcanBus, channel: str) -> None:
    """Programs that are not ours."""
    try:
        opened.serialPortOrig.exclusive = True
    except (OSError, SerialException) as error:
        abandon(opened)
        raise LinkError(f"{channel} is in use", _REMEDIES[errno.EBUSY]) from error


def _open(bus: Bus) -> can.BusABC:
    options: dict[str, Any] = dict(bus.options)
    if bus.interface == _SLCAN:
        options.setdefault("sleep_after_open", _SLCAN_SETTLES_S)
    try:
        return can.Bus(
            interface=bus.interface,
            channel=bus.channel,
            bitrate=bus.bitrate_bit_s,
            ignore_config=True,
            **options,
        )
    except Exception as error:  # makers' libraries raise what they like
        code = getattr(error, "error_code", None) or getattr(error, "errno", None)
        remedy = _REMEDIES.get(cast(int, code), _CHECK_ALL)
        raise LinkError(f"{bus.interface} {bus.channel}: {error}", remedy) from error


def _check_serial_port(channel: str) -> None:
    path = Path(channel.split("@")[0])
    if not path.exists():
        raise LinkError(f"there is no {path}", _REMEDIES[errno.ENOENT])
