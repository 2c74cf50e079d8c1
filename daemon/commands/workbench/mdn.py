"""`tentacled mdn`: the mixture density network of a body: its data, its training, its trial."""

import argparse
from importlib import import_module
from typing import Final, cast

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.command_line import CommandModule

_WORDS: Final = {
    "collect": "see an emulated body at many configurations; or take over clouds of a real one",
    "train": "learn where a body is from such data",
    "sweep": "learn with 1, 2, … components, and say how many it needs",
    "evaluate": "put a learned model beside the data that were kept back",
    "calibrate": "put the contacts that it predicts beside those of an emulated body",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = parser.add_subparsers(dest="word", metavar="WHAT", required=True)
    for word, purpose in _WORDS.items():
        _command(word).add_arguments(words.add_parser(word, help=purpose, description=purpose))


def run(arguments: argparse.Namespace) -> Result:
    return _command(arguments.word).run(arguments)


def _command(word: str) -> CommandModule:
    return cast(CommandModule, import_module(f"daemon.commands.body_model.{word}"))
