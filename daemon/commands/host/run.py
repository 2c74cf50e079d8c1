"""`tentacled run ROBOT.yaml`: the daemon. It comes up with the power off, and waits for clients."""

import argparse
import asyncio
import resource
import sys
from collections.abc import Awaitable, Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Final

from config.robot import Robot
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.argument_types import seed_number
from daemon.commands.terminal.compiled import telling_progress
from daemon.commands.terminal.event_log import add_log_argument, event_line, style_of, warning_line
from daemon.controllers.make_controller import warm_up
from daemon.files import check_folder_can_be_made, models_directory
from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.logs import logging_to_stderr
from daemon.host.real_time import RealTime
from daemon.host.service_manager import ServiceManager
from daemon.host.stop_signals import StopSignals
from daemon.messages import Event, Status
from daemon.recording.flight_recorder import FlightRecorder
from daemon.recording.recovery import recover_unfinished
from daemon.recording.run_folder import describe_run, new_run
from daemon.remote.server.server import RemoteServer
from daemon.remote.surroundings import PreparedSurroundings, cut_surroundings
from daemon.risk.body_risk_source import files_of, make_risk_source, surroundings_stl
from daemon.risk.surroundings import RiskSurroundings
from daemon.robot.checked_robot import CheckedRobot, add_robot_argument, robot_with_warnings_told
from daemon.robot.connections import RealConnections
from daemon.robot.lab_connections import (
    LabListener,
    LabRefusedError,
    LabUnreachableError,
    ask,
    no_lab,
)
from daemon.robot.runtime_directory import default_runtime_directory, uses_lab, with_lab_ports
from daemon.service.dependencies import Dependencies
from daemon.service.motion_loader import in_a_thread
from daemon.service.operation.planning import plan_in_a_process
from daemon.service.operation.run_recording import MakeFolder
from daemon.service.operation.session import Session
from daemon.service.operation.surrounding import prepare_in_a_process
from daemon.service.telemetry.emulated_body import LabBody
from drivers.can.bus_lock import check_buses_are_free
from drivers.clock import WallClock
from safety.risk_source import RiskSource

_SWITCH_INTERVAL_S: Final = 0.0005
"""Python's own is ten times as long: so long the loop would wait for a thread that reads a file."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument(
        "--runtime-dir",
        type=Path,
        metavar="DIR",
        help="where clients find the daemon, and where the emulated lab has its ports",
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="where recordings go"
    )
    parser.add_argument("--seed", type=seed_number, default=1, metavar="N", help="of controllers")
    parser.add_argument(
        "--files",
        type=Path,
        metavar="DIR",
        help="whose files clients may name, models and waypoints (default: where models are kept)",
    )
    parser.add_argument(
        "--no-real-time",
        action="store_true",
        help="ask the operating system for no priority and no locked memory",
    )
    add_log_argument(parser)


def run(arguments: argparse.Namespace) -> Result:
    _spread_out()
    with logging_to_stderr("daemon", style=style_of(arguments)) as log:
        warn = warning_line(log, arguments)
        checked = robot_with_warnings_told(arguments.robot, warn)
        check_folder_can_be_made(arguments.runs)
        for recovered in recover_unfinished(arguments.runs):
            print(recovered)
        with nullcontext() if arguments.log == "json" else telling_progress():
            risk = make_risk_source(checked.file, MonotonicClock())
            for why_not in warm_up():
                warn(why_not)
        tell_event = None if arguments.log is None else event_line(log)
        run_in_real_time(_serve(checked, arguments, risk, warn, tell_event))
    return Result(None)


def _spread_out() -> None:
    """All the descriptors that there may be, and short turns for threads beside the loop's."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    sys.setswitchinterval(_SWITCH_INTERVAL_S)


async def _serve(
    checked: CheckedRobot,
    arguments: argparse.Namespace,
    risk: RiskSource,
    warn: Callable[[str], None],
    tell_event: Callable[[Event], None] | None = None,
) -> None:
    robot = checked.file.robot
    directory = arguments.runtime_dir or default_runtime_directory(robot.robot)
    stop, manager, truth = StopSignals(), ServiceManager(), LabBody(directory)
    surroundings = _surroundings(robot, risk)
    dependencies = _dependencies(robot, arguments, risk, manager, truth)
    session = Session(
        checked.file,
        with_lab_ports(robot, directory),
        dependencies,
        _folder_maker(checked, arguments, dependencies.clock, lambda: server.surroundings_stl),
        arguments.seed,
        inject=_injector(directory) if dependencies.simulated else None,
        files=arguments.files or models_directory(),
        off_the_loop=in_a_thread,
        plan_path=plan_in_a_process,
    )
    service = session.service
    server = RemoteServer(
        robot.robot,
        robot.remote,
        directory,
        session.operator,
        simulated=dependencies.simulated,
        version=service.version,
        robot_file_dir=checked.file.path.parent,
        surroundings=surroundings,
    )
    session.operator.surrounding.listeners.append(
        lambda around, stl: server.show(_shown(robot, around, stl))
    )
    lab = LabListener(
        directory, lambda what: service.events.tell("note", "happening", what, subject="lab")
    )
    await server.open()
    dependencies.subscribers.add(server.publish)
    if tell_event is not None:
        dependencies.subscribers.add_for(Event, tell_event)
    dependencies.subscribers.add_for(Status, lambda status: manager.status(_in_a_line(status)))
    manager.ready()
    try:
        check_buses_are_free(with_lab_ports(robot, directory).buses.values())
        if dependencies.simulated:
            lab.start()
            service.body.emulated = truth.newest
            truth.start()
            if not_there := no_lab(directory, checked.file.path):
                warn(not_there)
        ready = {"robot": robot.robot, "runtime_dir": directory, "state": "ready"}
        tell("run", ready, f"{robot.robot} in {directory}: Ctrl-C ends it")
        await session.serve(stop)
    finally:
        manager.stopping()
        lab.end()
        truth.end()
        await server.close()


def _dependencies(
    robot: Robot,
    arguments: argparse.Namespace,
    risk: RiskSource,
    manager: ServiceManager,
    truth: LabBody,
) -> Dependencies:
    """Of a daemon with drivers and a clock that are real."""
    clock = MonotonicClock()
    real_time = None if arguments.no_real_time else RealTime()
    if real_time is not None:
        real_time.prepare()
    return Dependencies(
        RealConnections(clock),
        clock,
        FlightRecorder(),
        risk,
        uses_lab(robot),
        real_time,
        runs=arguments.runs,
        body_failing=truth.failing,
        prepare_surroundings=prepare_in_a_process,
        good_cycle=manager.good_cycle,
    )


def _in_a_line(status: Status) -> str:
    """State and worst cause."""
    worst = f": {status.reasons[0].name}: {status.reasons[0].text}" if status.reasons else ""
    return f"{status.robot} is {status.state}{worst}"


def _surroundings(robot: Robot, risk: RiskSource) -> PreparedSurroundings:
    """What the risk is asked with, for whoever wants to see it."""
    files = files_of(risk)
    return _shown(robot, None if files is None else files.surroundings, surroundings_stl(risk))


def _shown(robot: Robot, around: RiskSurroundings | None, stl: bytes) -> PreparedSurroundings:
    box = robot.workspace
    workspace = None if box is None else [list(box.x_mm), list(box.y_mm), list(box.z_mm)]
    if around is None:
        return cut_surroundings("", b"", workspace)
    regions = [region.model_dump(mode="json") for region in around.surface.regions]
    port = around.surface.port
    hole = None if port is None else port.model_dump(mode="json")
    return cut_surroundings(around.name, stl, workspace, around.sha256, regions, hole)


def _folder_maker(
    checked: CheckedRobot,
    arguments: argparse.Namespace,
    clock: WallClock,
    surroundings: Callable[[], bytes],
) -> MakeFolder:
    """Makes folders in a thread of its own: neither disk nor git may hold the loop.

    surroundings: the meshes as they are when a run begins, as a binary STL file.
    """

    def make() -> Path:
        robot, wall_ns = checked.file.robot, clock.wall_time_ns()
        folder = new_run(arguments.runs, robot.robot, wall_ns)
        path, seed = checked.file.path, arguments.seed
        describe_run(folder, robot, path, wall_ns, seed, surroundings=surroundings())
        return folder

    async def make_folder() -> Path:
        return await asyncio.to_thread(make)

    return make_folder


def _injector(directory: Path) -> Callable[[str], Awaitable[None]]:
    async def inject(fault: str) -> None:
        try:
            await asyncio.to_thread(ask, directory, {"do": "inject", "faults": [fault]})
        except (LabRefusedError, LabUnreachableError) as error:
            raise ValueError(str(error)) from None

    return inject
