"""`tentacled bridge`: the robot told to other programs, in their own language. One way: out."""

import argparse
from importlib import import_module
from typing import Final, cast

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.command_line import CommandModule

_WORDS: Final = {
    "openigtlink": "to 3D Slicer, PLUS and others that read OpenIGTLink",
    "ros2": "to ROS 2 with rmw_zenoh, without any ROS here",
    "foxglove": "to Foxglove and Lichtblick, live",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = parser.add_subparsers(dest="word", metavar="TO", required=True)
    for word, purpose in _WORDS.items():
        _command(word).add_arguments(words.add_parser(word, help=purpose, description=purpose))


def run(arguments: argparse.Namespace) -> Result:
    return _command(arguments.word).run(arguments)


def _command(word: str) -> CommandModule:
    return cast(CommandModule, import_module(f"daemon.commands.bridge.{word}"))
