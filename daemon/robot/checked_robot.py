"""The robot file on the command line: read, checked against the bus budget, or explained."""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

from config.documents.problems import ConfigError, Problem
from config.loader import RobotFile, load_robot
from daemon.robot.shipped_files import add_list_option, file_argument
from daemon.robot.tracker_noise import untold_noise
from drivers.can.budget import BusBudget, bus_budget
from drivers.cia402.pdo_plan import bus_traffic


@dataclass(frozen=True)
class CheckedRobot:
    """A robot that may be run, with what the operator should know about it."""

    file: RobotFile
    budgets: dict[str, BusBudget]
    warnings: list[Problem]


def add_robot_argument(parser: argparse.ArgumentParser) -> None:
    """The positional ROBOT."""
    parser.add_argument(
        "robot",
        type=file_argument("robots"),
        metavar="ROBOT.yaml",
        help="the robot file; builtin:soft_arm is one that is shipped",
    )
    add_list_option(parser, "robots")


def check_robot(path: Path) -> CheckedRobot:
    """Everything that can be known of a robot file without its hardware. Raises ConfigError."""
    file = load_robot(path)
    budgets = {
        name: bus_budget(bus_traffic(name, bus, file.robot.axes))
        for name, bus in file.robot.buses.items()
    }
    refused, warned = [], []
    for name, budget in budgets.items():
        where = ("buses", name, "cycle_period_s")
        if budget.refused:
            message = f"the bus cannot carry this: {budget}; lengthen it, or use two buses"
            refused.append(file.problem(where, message))
        elif budget.warned:
            warned.append(file.problem(where, f"the bus will be busy: {budget}"))
    if refused:
        raise ConfigError(refused)
    if noise := untold_noise(file.robot):
        warned.append(file.problem(("pose_filter", "position_noise_mm"), noise))
    return CheckedRobot(file, budgets, warned)


def robot_with_warnings_told(path: Path) -> CheckedRobot:
    """The robot, with its warnings told on stderr. Raises ConfigError."""
    robot = check_robot(path)
    for warning in robot.warnings:
        print(f"{warning} (warning)", file=sys.stderr)
    return robot
