"""`tentacled emulate ROBOT.yaml`: the robot's hardware, emulated, in a process of its own."""

import argparse
import asyncio
from pathlib import Path
from typing import Final

from config.patience import patient
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.argument_types import seconds, seed_number
from daemon.commands.terminal.compiled import telling_progress
from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.logs import logging_to_stderr
from daemon.host.resident_memory import give_back_compiler
from daemon.host.stop_signals import StopSignals
from daemon.robot.checked_robot import CheckedRobot, add_robot_argument, robot_with_warnings_told
from daemon.robot.runtime_directory import default_runtime_directory
from daemon.robot.shipped_files import file_argument
from sim_backends.lab.lab import Lab
from sim_backends.lab.lab_ports import LabPorts
from sim_backends.lab.play import PLAYS
from sim_backends.lab.scenario import load_scenario, play_scenario

_COMPILED_WITHIN_S: Final = 2.0
"""By then a lab has run everything that it compiles."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="where the lab leaves its ports"
    )
    parser.add_argument("--duration", type=seconds, metavar="S", help="end after S seconds")
    parser.add_argument("--play", choices=PLAYS, help="turn the unpowered screws by a script")
    parser.add_argument(
        "--scenario",
        type=file_argument("scenarios"),
        metavar="FILE",
        help="faults and loads over time; builtin:lost_and_found is one that is shipped",
    )
    parser.add_argument("--seed", type=seed_number, metavar="N", help="instead of the robot file's")


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    with logging_to_stderr("lab"):
        run_in_real_time(_emulate(checked, arguments))
    return Result(None)


async def _emulate(checked: CheckedRobot, arguments: argparse.Namespace) -> None:
    stop = StopSignals()
    robot, clock = patient(checked.file.robot), MonotonicClock()
    directory = arguments.runtime_dir or default_runtime_directory(robot.robot)
    with telling_progress():
        lab = Lab(robot, checked.file.path, clock, arguments.seed)
    scenario = load_scenario(arguments.scenario, lab) if arguments.scenario else None
    ports = LabPorts(lab, directory, clock)
    lab.start()
    try:
        await ports.open()
        if arguments.play:
            lab.play(arguments.play)
        if scenario is not None:
            play_scenario(scenario, lab, lambda line: print(line, flush=True))
        _tell(robot.robot, directory, list(robot.buses))
        asyncio.get_running_loop().call_later(_COMPILED_WITHIN_S, give_back_compiler)
        await stop.wait(arguments.duration)
    finally:
        await ports.close()
        lab.stop()


def _tell(robot: str, directory: Path, buses: list[str]) -> None:
    lines = [
        f"{robot}, emulated, in {directory}",
        "  aurora      the tracker's serial port",
        *(
            f"  {bus:<12}a serial CAN adapter (slcan); {bus}.sock: python-can's 'tentacled'"
            for bus in buses
        ),
        "Ctrl-C ends it",
    ]
    ready = {"robot": robot, "runtime_dir": directory, "buses": buses, "state": "ready"}
    tell("emulate", ready, "\n".join(lines))
