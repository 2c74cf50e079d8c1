"""`tentacled inject tracker.missing=0.5s`: make an emulated device misbehave."""

import argparse
import shutil
import textwrap
from pathlib import Path
from typing import Final

from daemon.commands.outcome.result import Result
from daemon.robot.lab_connections import LabUnreachableError, ask, the_running_lab

_USAGE_WIDTH: Final = 34
"""What is longer pushes its text to the right."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("faults", nargs="*", metavar="DEVICE.FAULT[=VALUE,...]")
    parser.add_argument("--list", action="store_true", help="show all faults there are")
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="the lab's folder, if several are running"
    )


def run(arguments: argparse.Namespace) -> Result:
    try:
        directory = arguments.runtime_dir or the_running_lab()
    except LabUnreachableError:
        if arguments.faults or not arguments.list:
            raise
        known = _of_any_lab()
        return Result({"injected": [], "faults": known}, lambda: _list(known))
    known = {}
    if arguments.list or not arguments.faults:
        known = ask(directory, {"do": "faults"})["faults"]
    if arguments.faults:
        ask(directory, {"do": "inject", "faults": arguments.faults})
    return Result({"injected": arguments.faults, "faults": known}, lambda: _list(known))


def _of_any_lab() -> dict[str, dict[str, str]]:
    """As a lab lists them, with words in capitals where it has names and numbers."""
    from sim_backends.devices.aurora.faults import FAULTS
    from sim_backends.devices.can.faults import BUS_FAULTS
    from sim_backends.devices.drive.faults import DRIVE_FAULTS

    devices = {"tracker": FAULTS, "drive.BUS/NODE": DRIVE_FAULTS, "bus.BUS": BUS_FAULTS}
    return {
        device: {fault.usage(): fault.text for fault in faults}
        for device, faults in devices.items()
    }


def _list(known: dict[str, dict[str, str]]) -> None:
    width = shutil.get_terminal_size().columns
    for device, faults in known.items():
        print(device)
        for usage, text in faults.items():
            word = f"  .{usage}"
            first = word.ljust(_USAGE_WIDTH) if len(word) < _USAGE_WIDTH else f"{word}  "
            indent = " " * _USAGE_WIDTH
            print(textwrap.fill(text, width, initial_indent=first, subsequent_indent=indent))
