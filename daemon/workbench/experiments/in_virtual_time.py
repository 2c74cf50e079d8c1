"""An experiment with devices in the same process, on a clock that jumps: fast, and repeatable."""

from collections.abc import Callable
from pathlib import Path
from random import Random

import msgspec

from daemon.control.task import tip_axis
from daemon.host.progress import Progress
from daemon.host.real_time import collector_rarely
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.result import Result, read_result, write_result
from daemon.recording.run_parts import control_hash
from daemon.risk.body_risk_source import surroundings_stl
from daemon.robot.lab_connections import LabConnections
from daemon.service.dependencies import Dependencies
from daemon.workbench.experiments.carry_out import carry_out
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.risk import risk_source_of
from daemon.workbench.experiments.trial import Tell, TrialError
from drivers.clock import WallClock
from drivers.pose import Vector
from sim_backends.lab.lab import Lab
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock


def carry_out_in_virtual_time(
    file: ExperimentFile,
    seed: int,
    folder: Path,
    tell: Tell,
    hash_of_recording: Callable[[], str] | None = None,
    progress: Progress | None = None,
) -> Result:
    """The same file and seed give the same recording, to the last bit. Raises TrialError, OSError.

    folder: an empty one, for the run. What was recorded before an error is there too.
    hash_of_recording: from somebody who has read it already. progress: hears how far it is.
    """
    with collector_rarely():
        run_in_virtual_time(_carry_out(file, seed, folder, tell, progress))
    result = read_result(folder)
    if result is None:
        raise TrialError(f"{folder}: the run left no result")
    digest = control_hash(folder) if hash_of_recording is None else hash_of_recording()
    hashed = msgspec.structs.replace(result, control_sha256=digest)
    write_result(folder, hashed)
    return hashed


async def _carry_out(
    file: ExperimentFile, seed: int, folder: Path, tell: Tell, progress: Progress | None
) -> None:
    clock = virtual_clock()
    lab = Lab(file.robot, file.file.path, clock, seed)
    lab.start()

    async def make_folder() -> Path:
        file.describe(folder, None, seed, surroundings_stl(dependencies.risk))
        return folder

    dependencies, truth = _dependencies(file, lab, clock, seed), _TruthOf(lab)
    try:
        robot = file.robot
        await carry_out(file, robot, dependencies, make_folder, lab, truth, seed, tell, progress)
    finally:
        lab.stop()


class _TruthOf:
    """Of a lab in this process."""

    def __init__(self, lab: Lab) -> None:
        self._body = lab.body

    def tip_mm(self) -> Vector:
        return self._body.record.state.tip.position_mm

    def direction(self) -> Vector:
        return tip_axis(self._body.record.state.tip.quaternion)

    def failures(self) -> int:
        return self._body.record.plant_failures


def _dependencies(file: ExperimentFile, lab: Lab, clock: WallClock, seed: int) -> Dependencies:
    random = Random(seed)
    return Dependencies(
        LabConnections(lab, clock),
        clock,
        DirectRecorder(),
        risk_source_of(file, clock),
        simulated=True,
        new_token=lambda: f"{random.getrandbits(128):032x}",
        body_failing=lambda: lab.body.failing,
    )
