"""An experiment with the devices in a process of their own, over their real ports, as on a rig."""

import asyncio
import tempfile
from pathlib import Path

from daemon.controllers.make_controller import warm_up
from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.processes import OwnProcesses, ProcessError
from daemon.host.progress import Progress
from daemon.host.real_time import RealTime
from daemon.recording.flight_recorder import FlightRecorder
from daemon.recording.result import Result, read_result
from daemon.recording.run_folder import robot_yaml
from daemon.risk.body_risk_source import surroundings_stl
from daemon.robot.connections import RealConnections
from daemon.robot.lab_connections import LabRefusedError, LabUnreachableError, ask
from daemon.robot.runtime_directory import with_lab_ports
from daemon.service.dependencies import Dependencies
from daemon.service.telemetry.emulated_body import LabBody
from daemon.workbench.experiments.carry_out import carry_out
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.risk import risk_source_of
from daemon.workbench.experiments.trial import Tell, TrialError
from drivers.can.bus_lock import check_buses_are_free


def carry_out_in_real_time(
    file: ExperimentFile,
    seed: int,
    folder: Path,
    tell: Tell,
    progress: Progress | None = None,
) -> Result:
    """Takes as long as the trajectory. Raises TrialError, OSError.

    progress: hears how far it is, in the control loop's thread: it must never wait.

    folder: an empty one, for the run. What was recorded before an error is there too.
    """
    with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
        directory = Path(name)
        (directory / "robot.yaml").write_text(robot_yaml(file.robot, file.file.path))
        run_in_real_time(_with_lab(file, seed, folder, directory, tell, progress))
    result = read_result(folder)
    if result is None:
        raise TrialError(f"{folder}: the run left no result")
    return result


class _RunningLab:
    """The lab behind its control socket. Asked by threads: its answer must not hold the loop."""

    def __init__(self, directory: Path, tell: Tell) -> None:
        self._directory = directory
        self._tell = tell
        self._asking: set[asyncio.Task[None]] = set()

    def set_tip_load(self, mass_g: float) -> None:
        self._ask({"do": "load", "tip_load_g": mass_g})

    def inject(self, fault: str) -> None:
        self._ask({"do": "inject", "faults": [fault]})

    def _ask(self, request: dict[str, object]) -> None:
        task = asyncio.get_running_loop().create_task(self._request(request))
        self._asking.add(task)
        task.add_done_callback(self._asking.discard)

    async def _request(self, request: dict[str, object]) -> None:
        try:
            await asyncio.to_thread(ask, self._directory, request)
        except (LabRefusedError, LabUnreachableError) as error:
            self._tell(str(error))


async def _with_lab(
    file: ExperimentFile,
    seed: int,
    folder: Path,
    directory: Path,
    tell: Tell,
    progress: Progress | None,
) -> None:
    where = ["--runtime-dir", str(directory), "--seed", str(seed)]
    lab = OwnProcesses(["emulate", str(directory / "robot.yaml"), *where])
    try:
        await lab.start()
        await _carry_out(file, seed, folder, directory, tell, progress)
    except ProcessError as error:
        raise TrialError(f"the emulated lab did not start: {error}") from None
    finally:
        await lab.end()


async def _carry_out(
    file: ExperimentFile,
    seed: int,
    folder: Path,
    directory: Path,
    tell: Tell,
    progress: Progress | None,
) -> None:
    clock, real_time = MonotonicClock(), RealTime()
    warm_up()
    real_time.prepare()
    risk = risk_source_of(file, clock)
    truth = LabBody(directory)
    dependencies = Dependencies(
        RealConnections(clock),
        clock,
        FlightRecorder(),
        risk,
        True,
        real_time,
        body_failing=truth.failing,
    )

    def describe() -> Path:
        file.describe(folder, clock.wall_time_ns(), seed, surroundings_stl(risk))
        return folder

    async def make_folder() -> Path:
        return await asyncio.to_thread(describe)

    robot, lab = with_lab_ports(file.robot, directory), _RunningLab(directory, tell)
    check_buses_are_free(robot.buses.values())
    truth.start()
    try:
        await carry_out(file, robot, dependencies, make_folder, lab, None, seed, tell, progress)
    finally:
        truth.end()
