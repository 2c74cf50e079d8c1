"""The robot file on the command line: read, checked against the bus budget, or explained."""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import acos, degrees, dist, hypot, sqrt
from pathlib import Path
from typing import Final

from config.documents.problems import ConfigError, Problem
from config.emulation.lab import Emulation
from config.loader import RobotFile, load_robot
from config.robot import Robot
from daemon.robot.shipped_files import add_list_option, file_argument
from drivers.can.budget import BusBudget, bus_budget
from drivers.cia402.pdo_plan import bus_traffic

_FAST_TIMES: Final = 2.0
"""The noise at 66 Hz against that at 40 Hz."""
_BORNE: Final = 2.0
"""Times the noise that the filter was told of. The shipped robots have up to 1.6 times as much."""
_SAME_PLACE_MM: Final = 0.01
_SAME_DIRECTION_DEG: Final = 0.1
"""Both far below what a tracker tells; files are written with so many digits."""


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
    return CheckedRobot(file, budgets, [*warned, *tracker_warnings(file)])


def tracker_warnings(file: RobotFile) -> list[Problem]:
    """Where the filter is told of less noise than the tracker has, and where the tip is followed in
    another place than where its emulated sensor has it."""
    noise, elsewhere = _untold_noise(file.robot), _sensor_elsewhere(file.robot)
    found = []
    if noise is not None:
        found.append(file.problem(("pose_filter", "position_noise_mm"), noise))
    if elsewhere is not None:
        found.append(file.problem(("tracker", "tools", "tip"), elsewhere))
    return found


def _on_stderr(text: str) -> None:
    print(text, file=sys.stderr)


def robot_with_warnings_told(path: Path, tell: Callable[[str], None] = _on_stderr) -> CheckedRobot:
    """The robot, with its warnings told. Raises ConfigError."""
    robot = check_robot(path)
    for warning in robot.warnings:
        tell(f"{warning} (warning)")
    return robot


def _untold_noise(robot: Robot) -> str | None:
    """What to tell the filter, as a sentence, which does not believe more noise than it is told of;
    None: it knows, or nobody can say."""
    told_mm, fast = robot.pose_filter.position_noise_mm, robot.tracker.frame_rate == "fast"
    noise_mm = _emulated_noise_mm(robot)
    if noise_mm is None:
        if fast and "position_noise_mm" not in robot.pose_filter.model_fields_set:
            return (
                f"at 66 Hz the tracker has twice the noise, of which the filter is not told: say "
                f"`pose_filter: {{position_noise_mm: {_FAST_TIMES * told_mm:g}}}`"
            )
        return None
    if noise_mm <= _BORNE * told_mm:
        return None
    averaged = "base" in robot.tracker.tools and robot.tracker.base_averaged_s is None
    also = (
        ", or with a base that stands still `tracker: {base_averaged_s: 1.0}`" if averaged else ""
    )
    return (
        f"the emulated tracker's noise is about {noise_mm:.2g} mm at the tip, and the filter is "
        f"told of {told_mm:g} mm, so it will not believe many frames: say "
        f"`pose_filter: {{position_noise_mm: {0.75 * noise_mm:.1g}}}`{also}"
    )


def _sensor_elsewhere(robot: Robot) -> str | None:
    """How far the tip that is followed is from the emulated one, as a sentence; None: it is the
    same, or nobody can say."""
    emulation, told = _emulation(robot), robot.tracker.tools["tip"]
    if emulation is None:
        return None
    for there in emulation.tracker.tools:
        same_port = (there.port, there.channel) == (told.port, told.channel)
        if there.attached_to != "tip" or not (same_port or there.serial == told.serial):
            continue
        apart_mm = dist(there.position_mm, told.position_mm)
        turned = _degrees_between(there.quaternion, told.quaternion)
        if apart_mm < _SAME_PLACE_MM and turned < _SAME_DIRECTION_DEG:
            return None
        return (
            f"the emulated sensor sits {apart_mm:.3g} mm from where this says that it does, and is "
            f"turned by {turned:.3g}° from it, so what is followed is not the tip: say the same "
            "position_mm and quaternion here and in emulation.tracker.tools"
        )
    return None


def _degrees_between(one: Sequence[float], other: Sequence[float]) -> float:
    """Of two rotations, as quaternions of any length."""
    product = sum(a * b for a, b in zip(one, other, strict=True))
    return degrees(2.0 * acos(min(1.0, abs(product) / (hypot(*one) * hypot(*other)))))


def _emulation(robot: Robot) -> Emulation | None:
    """None: on a rig it is not read."""
    return robot.emulation if robot.tracker.port.startswith("lab:") else None


def _emulated_noise_mm(robot: Robot) -> float | None:
    """Of one coordinate of the tip in the base's frame. None: on a rig nobody knows."""
    emulation, workspace = _emulation(robot), robot.workspace
    if emulation is None:
        return None
    tracker = emulation.tracker
    times = _FAST_TIMES if robot.tracker.frame_rate == "fast" else 1.0
    if "base" not in robot.tracker.tools or robot.tracker.base_averaged_s is not None:
        return times * tracker.jitter_mm
    far_mm = 0.0
    if workspace is not None:
        ranges = (workspace.x_mm, workspace.y_mm, workspace.z_mm)
        far_mm = hypot(*(0.5 * (low + high) for low, high in ranges))
    return times * hypot(sqrt(2.0) * tracker.jitter_mm, far_mm * tracker.jitter_rad)
