"""`--log`: a line on stderr for each thing that happens, of commands that go on for long."""

import argparse
import logging
import sys
from collections.abc import Callable
from functools import partial
from typing import Final

from daemon.host.log_styles import STYLES
from daemon.host.logs import Log
from daemon.messages import Event

_LEVELS: Final = {
    "": logging.INFO,
    "none": logging.INFO,
    "warning": logging.WARNING,
    "not_ready": logging.INFO,
    "hold": logging.WARNING,
    "disarm": logging.WARNING,
    "fault": logging.ERROR,
    "estop": logging.ERROR,
}
"""By what a cause does to the robot. That drives are not there yet is no reason to wake anybody."""


def add_log_argument(parser: argparse.ArgumentParser) -> None:
    """Declare `--log`."""
    parser.add_argument(
        "--log",
        choices=STYLES,
        help="a line on stderr for each thing that happens: text; json, an object a line; journal, "
        "with the priorities of systemd",
    )


def style_of(arguments: argparse.Namespace) -> str:
    """In which the log is written; errors are, whether happenings are wanted or not."""
    return arguments.log or STYLES[0]


def warning_line(log: Log, arguments: argparse.Namespace) -> Callable[[str], None]:
    """Tells what is no event: in the log where one is wanted, else as it is."""
    if arguments.log is not None:
        return partial(log.tell, logging.WARNING, "warning")
    return partial(print, file=sys.stderr, flush=True)


def event_line(log: Log, robot: str = "") -> Callable[[Event], None]:
    """Tells a robot's events. robot: its name, where there are several."""

    def tell(event: Event) -> None:
        level = _LEVELS.get(event.severity, logging.WARNING) if event.present else logging.INFO
        gone = "" if event.present else " is over"
        detail = f": {event.detail}" if event.detail else ""
        about = f"{robot} {event.subject}".strip()
        log.tell(
            level,
            event.kind,
            f"{about} {event.name}{gone}: {event.text}{detail}",
            **({"robot": robot} if robot else {}),
            name=event.name,
            subject=event.subject,
            present=event.present,
            severity=event.severity,
            detail=event.detail,
            sequence=event.sequence,
            t_ns=event.t_ns,
        )

    return tell
