"""An experiment with the devices in a process of their own, over their real ports, as on a rig."""

import asyncio
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

from daemon.clock import MonotonicClock, run_in_real_time
from daemon.connections import RealConnections
from daemon.control.trajectories import make_trajectory
from daemon.experiment.experiment_file import ExperimentFile
from daemon.experiment.in_virtual_time import Tell
from daemon.experiment.trial import Trial, TrialError
from daemon.lab_client import LabRefusedError, LabUnreachableError, ask
from daemon.loop.real_time import RealTime
from daemon.recording.flight_recorder import FlightRecorder
from daemon.recording.result import Result
from daemon.recording.run_folder import describe_run, robot_yaml
from daemon.runtime_directory import LAB_FILE, with_lab_ports
from daemon.service.operator import Operator
from daemon.service.robot_service import RobotService
from daemon.service.run_recording import RunRecording
from daemon.service.surroundings import Surroundings
from safety.risk_source import NoModel

_LAB_ENDS_WITHIN_S: Final = 5.0


def carry_out_in_real_time(file: ExperimentFile, seed: int, folder: Path, tell: Tell) -> Result:
    """Takes as long as the trajectory. Raises TrialError, OSError.

    folder: an empty one, for the run.
    """
    with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
        directory = Path(name)
        robot_path = directory / "robot.yaml"
        robot_path.write_text(robot_yaml(file.robot, file.file.path))
        command = [sys.executable, "-m", "daemon.cli", "emulate", str(robot_path)]
        lab = subprocess.Popen(
            [*command, "--runtime-dir", name, "--seed", str(seed)], stdout=subprocess.PIPE
        )
        try:
            assert lab.stdout is not None
            lab.stdout.readline()  # it speaks when its ports are there
            if not (directory / LAB_FILE).exists():
                raise TrialError("the emulated lab did not start")
            return run_in_real_time(_carry_out(file, seed, folder, directory, tell))
        finally:
            lab.terminate()
            try:
                lab.wait(_LAB_ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                lab.kill()
                lab.wait()


class _RunningLab:
    """The lab behind its control socket. Asked by threads: its answer must not hold the loop."""

    def __init__(self, directory: Path, tell: Tell) -> None:
        self._directory = directory
        self._tell = tell
        self._asking: set[asyncio.Task[None]] = set()

    def set_tip_load(self, mass_g: float) -> None:
        self._ask({"do": "load", "tip_load_g": mass_g})

    def inject(self, fault: str) -> None:
        self._ask({"do": "inject", "fault": fault})

    def _ask(self, request: dict[str, object]) -> None:
        task = asyncio.get_running_loop().create_task(self._asked(request))
        self._asking.add(task)
        task.add_done_callback(self._asking.discard)

    async def _asked(self, request: dict[str, object]) -> None:
        try:
            await asyncio.to_thread(ask, self._directory, request)
        except (LabRefusedError, LabUnreachableError) as error:
            self._tell(str(error))


async def _carry_out(
    file: ExperimentFile, seed: int, folder: Path, directory: Path, tell: Tell
) -> Result:
    clock = MonotonicClock()
    robot = with_lab_ports(file.robot, directory)
    real_time = RealTime()
    surroundings = Surroundings(
        RealConnections(clock), clock, FlightRecorder(), NoModel(), True, real_time
    )
    service = RobotService(replace(file.file, robot=file.robot), robot, surroundings)

    def describe() -> Path:
        describe_run(folder, file.robot, file.file.path, clock.wall_time_ns(), seed)
        return folder

    async def make_folder() -> Path:
        return await asyncio.to_thread(describe)

    recording = RunRecording(service, make_folder, seed)
    operator = Operator(service, recording, seed, None)
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    lab = _RunningLab(directory, tell)
    real_time.prepare()
    trial = Trial(file.experiment, trajectory, service, operator, lab, tell)
    devices = asyncio.create_task(service.run())
    try:
        await trial.run()
    finally:
        await service.rest()
        devices.cancel()
        await asyncio.gather(devices, return_exceptions=True)
        await recording.end()
    return recording.result()
