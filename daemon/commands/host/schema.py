"""`tentacled schema`: the JSON Schema of robot files. Editors use it to complete and to check."""

import argparse
import json

from config.robot import Robot
from daemon.commands.terminal.command_line import EXIT_OK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser


def run(arguments: argparse.Namespace) -> int:
    del arguments
    print(robot_schema())
    return EXIT_OK


def robot_schema() -> str:
    """The schema as JSON text."""
    return json.dumps(Robot.model_json_schema(), indent=2, ensure_ascii=False)
