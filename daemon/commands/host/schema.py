"""`tentacled schema`: the JSON Schema of robot files. Editors use it to complete and to check."""

import argparse
import json

from config.robot import Robot
from daemon.commands.outcome.result import Result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser


def run(arguments: argparse.Namespace) -> Result:
    del arguments
    return Result({"robot": Robot.model_json_schema()}, robot_schema())


def robot_schema() -> str:
    """The schema as JSON text."""
    return json.dumps(Robot.model_json_schema(), indent=2, ensure_ascii=False)
