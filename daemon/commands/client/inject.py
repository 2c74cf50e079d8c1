"""`tentacled inject tracker.missing=0.5s`: make an emulated device misbehave."""

import argparse
import shutil
import textwrap
from pathlib import Path
from typing import Final

from daemon.commands.outcome.result import Result
from daemon.robot.lab_connections import ask, the_running_lab

_USAGE_WIDTH: Final = 34
"""What is longer pushes its text to the right."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("faults", nargs="*", metavar="DEVICE.FAULT[=VALUE,...]")
    parser.add_argument("--list", action="store_true", help="show all faults there are")
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="the lab's folder, if several are running"
    )


def run(arguments: argparse.Namespace) -> Result:
    directory = arguments.runtime_dir or the_running_lab()
    known = {}
    if arguments.list or not arguments.faults:
        known = ask(directory, {"do": "faults"})["faults"]
    for fault in arguments.faults:
        ask(directory, {"do": "inject", "fault": fault})
    return Result({"injected": arguments.faults, "faults": known}, lambda: _list(known))


def _list(known: dict[str, dict[str, str]]) -> None:
    width = shutil.get_terminal_size().columns
    for device, faults in known.items():
        print(device)
        for usage, text in faults.items():
            word = f"  .{usage}"
            first = word.ljust(_USAGE_WIDTH) if len(word) < _USAGE_WIDTH else f"{word}  "
            indent = " " * _USAGE_WIDTH
            print(textwrap.fill(text, width, initial_indent=first, subsequent_indent=indent))
