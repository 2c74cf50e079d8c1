"""An experiment with devices in the same process, on a clock that jumps: fast, and repeatable."""

import asyncio
import gc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random

import msgspec

from daemon.control.trajectories import make_trajectory
from daemon.experiment.experiment_file import ExperimentFile
from daemon.experiment.trial import Trial
from daemon.lab_connections import LabConnections
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.result import Result, write_result
from daemon.recording.run_files import RUN_FILE
from daemon.recording.run_folder import describe_run
from daemon.recording.run_reader import control_hash
from daemon.service.operator import Operator
from daemon.service.robot_service import RobotService
from daemon.service.run_recording import RunRecording
from daemon.service.surroundings import Surroundings
from drivers.clock import WallClock
from safety.risk_source import NoModel
from sim_backends.lab import Lab
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock

Tell = Callable[[str], None]


def carry_out_in_virtual_time(file: ExperimentFile, seed: int, folder: Path, tell: Tell) -> Result:
    """The same file and seed give the same recording, to the last bit. Raises TrialError, OSError.

    folder: an empty one, for the run.
    """
    gc.collect()
    gc.freeze()  # what is there by now stays: to look through it again and again costs a tenth
    try:
        run_in_virtual_time(_carry_out(file, seed, folder, tell))
    finally:
        gc.unfreeze()
    result = msgspec.json.decode((folder / "result.json").read_bytes(), type=Result)
    hashed = msgspec.structs.replace(result, control_sha256=control_hash(folder / RUN_FILE))
    write_result(folder, hashed)
    return hashed


async def _carry_out(file: ExperimentFile, seed: int, folder: Path, tell: Tell) -> None:
    clock = virtual_clock()
    lab = Lab(file.robot, file.file.path, clock, seed)
    lab.start()
    surroundings = _surroundings(lab, clock, seed)
    robot_file = replace(file.file, robot=file.robot)
    service = RobotService(robot_file, file.robot, surroundings)

    async def make_folder() -> Path:
        describe_run(folder, file.robot, file.file.path, clock.wall_time_ns(), seed)
        return folder

    recording = RunRecording(service, make_folder, seed)
    operator = Operator(service, recording, seed, None)
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    trial = Trial(file.experiment, trajectory, service, operator, lab, tell)
    devices = asyncio.create_task(service.run())
    try:
        await trial.run()
    finally:
        await service.rest()
        devices.cancel()
        await asyncio.gather(devices, return_exceptions=True)
        await recording.end()
        lab.stop()


def _surroundings(lab: Lab, clock: WallClock, seed: int) -> Surroundings:
    random = Random(seed)
    return Surroundings(
        LabConnections(lab, clock),
        clock,
        DirectRecorder(),
        NoModel(),
        simulated=True,
        new_token=lambda: f"{random.getrandbits(128):032x}",
    )
