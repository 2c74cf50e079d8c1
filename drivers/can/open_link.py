"""Opens a bus by its configuration: python-can opens, the quickest link reads and writes."""

import asyncio
import errno
from pathlib import Path
from typing import Any, Final, cast

import can
from can.interfaces.slcan import slcanBus
from serial import SerialException

from config.bus import Bus
from drivers.can.conditions import QUEUE_SHORT
from drivers.can.fd_link import FdLink
from drivers.can.link import CanLink, FrameReceiver, LinkError
from drivers.can.preflight import check_interface
from drivers.can.python_can_link import PythonCanLink
from drivers.can.slcan_link import SlcanLink, abandon
from drivers.clock import Clock

_SOCKETCAN: Final = "socketcan"
_SLCAN: Final = "slcan"
_SLCAN_SETTLES_S: Final = 0.1

_REMEDIES: Final = {
    errno.ENOENT: "check the channel in the robot file; is the adapter plugged in?",
    errno.ENODEV: "check the channel in the robot file; is the adapter plugged in?",
    errno.EACCES: "join the group dialout (sudo usermod -aG dialout $USER) and log in again",
    errno.EPERM: "run as a user who may use this interface",
    errno.EBUSY: "another program has it: close that first",
    errno.ECONNREFUSED: "nobody listens there: start `tentacled emulate`",
}


async def open_link(bus: Bus, receiver: FrameReceiver, clock: Clock) -> CanLink:
    """Open the interface of `bus`. Raises LinkError."""
    if bus.interface == _SOCKETCAN:
        queue = check_interface(bus.channel).tx_queue_frames
        if queue < bus.tx_queue_frames:
            receiver.condition_seen(QUEUE_SHORT, True, f"it takes {queue} frames")
    elif bus.interface == _SLCAN:
        _check_serial_port(bus.channel)
    opened = await asyncio.to_thread(_open, bus)  # adapters take their time
    if isinstance(opened, slcanBus):
        try:
            opened.serialPortOrig.exclusive = True
        except (OSError, SerialException) as error:
            abandon(opened)
            raise LinkError(f"{bus.channel} is in use", _REMEDIES[errno.EBUSY]) from error
        return SlcanLink(opened, receiver, clock)
    if bus.interface == _SOCKETCAN or getattr(opened, "carries_can_frames", False):
        # The link keeps the bus: python-can closes the socket of one that nobody keeps.
        return FdLink(opened.socket, opened.shutdown, receiver, clock)  # type: ignore[attr-defined]
    return PythonCanLink(opened, receiver, clock)


def _open(bus: Bus) -> can.BusABC:
    options: dict[str, Any] = (
        {"sleep_after_open": _SLCAN_SETTLES_S} if bus.interface == _SLCAN else {}
    )
    try:
        return can.Bus(
            interface=bus.interface,
            channel=bus.channel,
            bitrate=bus.bitrate_bit_s,
            ignore_config=True,
            **options,
        )
    except (can.CanError, OSError, ValueError, NotImplementedError, SerialException) as error:
        code = getattr(error, "error_code", None) or getattr(error, "errno", None)
        remedy = _REMEDIES.get(cast(int, code), "check interface and channel in the robot file")
        raise LinkError(f"{bus.interface} {bus.channel}: {error}", remedy) from error


def _check_serial_port(channel: str) -> None:
    path = Path(channel.split("@")[0])
    if not path.exists():
        raise LinkError(f"there is no {path}", _REMEDIES[errno.ENOENT])
