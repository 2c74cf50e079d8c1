"""An experiment from connecting the devices to the figures, in whatever time it takes place."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec

from config.robot import Robot
from daemon.messages import Axes, Tip
from daemon.recording.result import read_result, write_result
from daemon.reference.trajectories import make_trajectory
from daemon.robot.axes import AxisRanges
from daemon.service.run_recording import MakeFolder, RunRecording
from daemon.service.surroundings import Surroundings
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.scripted_events import LabControl
from daemon.workbench.experiments.session import session
from daemon.workbench.experiments.step_series import StepSeries
from daemon.workbench.experiments.step_statistics import (
    converged_s,
    drifts,
    errors_by_cycle,
    tracker_limits,
)
from daemon.workbench.experiments.stopwatch import Stopwatch
from daemon.workbench.experiments.trial import Tell, Trial
from daemon.workbench.experiments.witness import Truth, Witness

STEPS_FILE: Final = "steps.npz"
"""In the run's folder: a `StepSeries`, with the truth that no recording has."""


async def carry_out(
    file: ExperimentFile,
    robot: Robot,
    surroundings: Surroundings,
    make_folder: MakeFolder,
    lab: LabControl,
    truth: Truth | None,
    seed: int,
    tell: Tell,
) -> None:
    """Leaves recording, result and steps in the run's folder, also where it fails on the way.

    robot: the file's, with its ports as they are to be opened. truth: None where nobody knows it.
    Raises TrialError, OSError.
    """
    robot_file = replace(file.file, robot=file.robot)
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    witness, stopwatch = Witness(AxisRanges.of(robot), truth), Stopwatch()
    recording: RunRecording | None = None
    try:
        async with session(robot_file, robot, surroundings, make_folder, seed) as at_work:
            recording, operator = at_work.recording, at_work.operator
            trial = Trial(file.experiment, trajectory, at_work, lab, stopwatch, tell)
            witness.elapsed_s = lambda: operator.elapsed_s
            surroundings.listeners.add_for(Tip, witness.hear_tip)
            surroundings.listeners.add_for(Axes, witness.hear_axes)
            await trial.run()
    finally:
        if recording is not None and recording.folder is not None:
            steps, failures = witness.series(), 0 if truth is None else truth.failures()
            _complete(recording.folder, steps, stopwatch, trajectory.cycle_s, failures)


def _complete(
    folder: Path, steps: StepSeries, stopwatch: Stopwatch, cycle_s: float, plant_failures: int
) -> None:
    """Add what only an experiment knows to what every recording has. Raises OSError."""
    result = read_result(folder)
    if result is None:
        return
    steps.save(folder / STEPS_FILE)
    whole = msgspec.structs.replace(
        result,
        reading_cycles=errors_by_cycle(steps, steps.reading_mm),
        true_cycles=errors_by_cycle(steps, steps.true_mm),
        drifts=drifts(steps),
        converged_s=converged_s(steps, cycle_s),
        limits=tracker_limits(steps),
        computing=stopwatch.computing_time(),
        plant_failures=plant_failures,
    )
    write_result(folder, whole)
