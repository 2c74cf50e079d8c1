"""One master per bus and machine: whoever opens a bus holds its name until it is closed again.

The name is that of what is really opened, by whatever path it is called in the robot file. It has
nothing to do with the runtime folder, so that a second daemon elsewhere meets the first one too.
"""

import errno
import os
import socket
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from config.bus import Bus
from drivers.can.link import LinkError
from drivers.exclusive_name import (
    ExclusiveName,
    Holder,
    NameTakenError,
    OtherName,
    holder_of,
    is_taken,
)

_WITHIN_THE_PROCESS: Final = "virtual"
"""python-can's interface between threads of one process: two processes have two of them."""


class BusTakenError(LinkError):
    """Another master of this machine has the bus."""

    def __init__(self, bus: Bus, holder: Holder | None) -> None:
        if holder is not None and holder.pid == os.getpid():
            why = "this process has it open, or is still closing it"
        else:
            why = f"{holder or 'another process'} is the master of this bus"
        super().__init__(
            f"{bus.channel} is taken: {why}",
            "a bus has one master: end that one first; a running daemon is asked by "
            "`tentacled status`",
        )
        self.errno = errno.EBUSY
        self.holder = holder


def take_bus(bus: Bus) -> ExclusiveName:
    """Become the one master of `bus`, until the name is released. Raises BusTakenError."""
    try:
        return ExclusiveName(bus_name(bus))
    except NameTakenError as error:
        raise BusTakenError(bus, error.holder) from None


def check_buses_are_free(buses: Iterable[Bus]) -> None:
    """Before anything is opened: raises BusTakenError where one of them has a master already."""
    for bus in buses:
        name = bus_name(bus)
        if is_taken(name):
            raise BusTakenError(bus, holder_of(name))


def bus_name(bus: Bus) -> str:
    """What is really opened: the same name for the same bus, by whatever path."""
    if bus.interface == "socketcan":
        return f"bus socketcan {_interface_index(bus.channel)}"
    try:
        return _name_of_file(Path(bus.channel.split("@")[0]))
    except (OSError, ValueError):
        own = f" of process {os.getpid()}" if bus.interface == _WITHIN_THE_PROCESS else ""
        options = "".join(f" {name}={value}" for name, value in sorted(bus.options.items()))
        return f"bus {bus.interface} {bus.channel}{options}{own}"


def door_of(path: Path, bus: str) -> OtherName:
    """Say that what is opened at `path` is one of several ways to `bus`, a name for it that nobody
    else uses: then it has one master, whichever way that one comes. Raises OSError.
    """
    return OtherName(_name_of_file(path), bus)


def _name_of_file(path: Path) -> str:
    """Raises OSError, ValueError."""
    status = path.stat()
    if stat.S_ISCHR(status.st_mode):
        # Nodes of one port may stand in several folders. Pseudo-terminals are numbered anew in
        # each file system of them.
        where = status.st_dev if os.path.realpath(path).startswith("/dev/pts/") else 0
        return f"bus port {where} {os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"
    return f"bus file {status.st_dev} {status.st_ino}"


def _interface_index(channel: str) -> str:
    try:
        return str(socket.if_nametoindex(channel))
    except OSError:
        return channel
