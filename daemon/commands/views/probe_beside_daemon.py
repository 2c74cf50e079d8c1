"""Probing a robot whose buses have a master already: not a frame is sent; the daemon is asked."""

import asyncio
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Final

import msgspec

from daemon.commands.outcome.result import tell
from daemon.commands.views.page import LivePage, Size
from daemon.commands.views.status_view import status_view
from daemon.host.stop_signals import StopSignals
from daemon.messages import Status
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.discovery import read_daemon
from daemon.robot.runtime_directory import default_runtime_directory
from drivers.bounded import end_tasks
from drivers.can.bus_lock import BusTakenError

_ENDS_WITHIN_S: Final = 2.0


def folder_of_master(taken: BusTakenError, robot: str, directory: Path) -> Path | None:
    """Where the master of the bus listens, if it is a daemon that can be found.

    directory: where to look first; then where daemons are by default.
    """
    for folder in (directory, default_runtime_directory(robot)):
        daemon = read_daemon(folder)
        if daemon is not None and taken.holder is not None and daemon.pid == taken.holder.pid:
            return folder
    return None


async def show_what_it_says(
    taken: BusTakenError,
    folder: Path,
    stop: StopSignals,
    duration_s: float | None,
    every_s: float,
    *,
    as_json: bool,
) -> bool:
    """Show the status of the daemon in `folder` again and again, until told to end.

    Returns whether all was well at the end. Raises ClientError.
    """
    print(f"{taken.reason}; what follows is what it says", file=sys.stderr, flush=True)
    reader = _Reader(as_json)
    with reader.shown:
        reading = asyncio.create_task(reader.read(folder, every_s))
        ending = asyncio.create_task(stop.wait(duration_s))
        await asyncio.wait((reading, ending), return_when=asyncio.FIRST_COMPLETED)
        if reading.done():
            reading.result()
        await end_tasks([reading, ending], _ENDS_WITHIN_S)
    return reader.last is not None and not reader.last.reasons


class _Reader:
    """Asks the daemon, and shows what it answers."""

    def __init__(self, as_json: bool) -> None:
        self.last: Status | None = None
        live = None if as_json else LivePage()
        self._live = live
        self.shown: AbstractContextManager[object] = nullcontext() if live is None else live

    async def read(self, folder: Path, every_s: float) -> None:
        """Until cancelled. Raises ClientError."""
        address = LocalAddress.in_folder(folder)
        async with await RobotClient.connect(address, own_stop=False) as client:
            while True:
                self.last = status = await client.status()
                if self._live is None:
                    tell("probe", {"kind": "status", **msgspec.to_builtins(status)})
                else:
                    self._live.show(status_view(status, Size.of_terminal()))
                await asyncio.sleep(every_s)
