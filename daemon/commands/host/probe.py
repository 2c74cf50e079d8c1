"""`tentacled probe ROBOT.yaml`: tracker and drives through the real drivers, live.

Drives are set up and read, never energised. Where the buses have a master already, as beside a
running daemon, nothing is sent: what is shown is what the daemon says.
"""

import argparse
import asyncio
import sys
from collections import deque
from pathlib import Path
from typing import Final

from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.argument_types import seconds
from daemon.commands.views.page import LivePage, Size
from daemon.commands.views.probe_beside_daemon import folder_of_master, show_what_it_says
from daemon.commands.views.probe_snapshot import Json, ProbeSession
from daemon.commands.views.probe_view import event_line, view
from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.stop_signals import StopSignals
from daemon.robot.capture import CanCapture
from daemon.robot.checked_robot import CheckedRobot, add_robot_argument, robot_with_warnings_told
from daemon.robot.lab_connections import no_lab
from daemon.robot.runtime_directory import default_runtime_directory, uses_lab, with_lab_ports
from drivers.bounded import end_tasks
from drivers.can.bus_lock import BusTakenError, check_buses_are_free

_SHOW_EVERY_S: Final = 0.25
_EVENTS_SHOWN: Final = 6
_ENDS_WITHIN_S: Final = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument("--duration", type=seconds, metavar="S", help="end after S seconds")
    parser.add_argument(
        "--json",
        action="store_true",
        help="one JSON object a line: events at once, and a snapshot now and then",
    )
    parser.add_argument(
        "--every", type=seconds, default=1.0, metavar="S", help="with --json: snapshots every S s"
    )
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="where the emulated lab has its ports"
    )
    parser.add_argument(
        "--capture", type=Path, metavar="FILE", help="write the first bus' frames as a pcap file"
    )


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    healthy = run_in_real_time(_probe(checked, arguments))
    return Result(None, code=EXIT_OK if healthy else EXIT_FAILED)


async def _probe(checked: CheckedRobot, arguments: argparse.Namespace) -> bool:
    """Probe until told to end. Returns whether everything was there and well at the end."""
    stop, clock = StopSignals(), MonotonicClock()
    lab = arguments.runtime_dir or default_runtime_directory(checked.file.robot.robot)
    try:
        check_buses_are_free(with_lab_ports(checked.file.robot, lab).buses.values())
    except BusTakenError as taken:
        return await _ask_the_master(taken, lab, checked.file.robot.robot, arguments)
    robot = checked.file.robot
    if uses_lab(robot) and (not_there := no_lab(lab, checked.file.path)):
        print(not_there, file=sys.stderr, flush=True)
    capture = CanCapture(arguments.capture, clock) if arguments.capture else None
    output = _JsonLines(arguments.every) if arguments.json else _LiveTable()
    session = ProbeSession(checked, lab, clock, output.event, capture)
    try:
        async with session.running():
            showing = asyncio.create_task(output.show(session))
            await stop.wait(arguments.duration)
            await end_tasks([showing], _ENDS_WITHIN_S)
            return session.healthy
    finally:
        if capture is not None:
            capture.close()


async def _ask_the_master(
    taken: BusTakenError, directory: Path, robot: str, arguments: argparse.Namespace
) -> bool:
    """Raises BusTakenError where the master is none that can be asked, or where frames are wanted,
    ClientError where it does not answer."""
    folder = folder_of_master(taken, robot, directory)
    if folder is None or arguments.capture is not None:
        raise taken
    every_s = arguments.every if arguments.json else _SHOW_EVERY_S
    return await show_what_it_says(
        taken, folder, StopSignals(), arguments.duration, every_s, as_json=arguments.json
    )


class _JsonLines:
    """For scripts."""

    def __init__(self, every_s: float) -> None:
        self._every_s = every_s

    def event(self, event_message: Json) -> None:
        self._print("event", event_message)

    async def show(self, session: ProbeSession) -> None:
        try:
            while True:
                await asyncio.sleep(self._every_s)
                self._print("snapshot", session.snapshot())
        finally:
            self._print("end", session.snapshot())

    def _print(self, kind: str, content: Json) -> None:
        tell("probe", {"kind": kind, **content})


class _LiveTable:
    """For people."""

    def __init__(self) -> None:
        self._events: deque[Json] = deque(maxlen=_EVENTS_SHOWN)
        self._page = LivePage(last_alone=True)

    def event(self, event_message: Json) -> None:
        self._events.append(event_message)
        if not self._page.in_place:
            print(event_line(event_message), flush=True)

    async def show(self, session: ProbeSession) -> None:
        with self._page as page:
            while True:
                await asyncio.sleep(_SHOW_EVERY_S)
                page.show(view(session.snapshot(), self._events, Size.of_terminal()))
