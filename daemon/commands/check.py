"""`tentacled check ROBOT.yaml`: every problem of a robot file at once, or what it describes."""

import argparse

from daemon.cli import EXIT_FAILED, EXIT_OK
from daemon.robot_argument import add_robot_argument, robot_or_explain


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    checked = robot_or_explain(arguments.robot)
    if checked is None:
        return EXIT_FAILED
    robot = checked.file.robot
    tracker = robot.tracker
    print(f"{arguments.robot}: {robot.robot} is sound")
    print(f"  tracker   {tracker.kind} on {tracker.port} at {tracker.baud_rate} baud")
    for name, bus in robot.buses.items():
        nodes = {axis.drive.node for axis in robot.axes if axis.drive.bus == name}
        print(
            f"  bus       {name}: {bus.interface} {bus.channel}, {1 / bus.cycle_period_s:g} Hz, "
            f"{len(nodes)} drives, {checked.budgets[name]}"
        )
    for axis in robot.axes:
        drive = axis.drive
        print(f"  axis      {axis.name}: {axis.kind}, {drive.bus}/{drive.node} axis {drive.axis}")
    return EXIT_OK
