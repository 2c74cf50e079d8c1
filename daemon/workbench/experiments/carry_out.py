"""An experiment from connecting the devices to the figures, in whatever time it takes place."""

from array import array
from collections.abc import Callable
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Final, Protocol

import msgspec
import numpy as np

from config.robot import Robot
from daemon.control.task import tip_axis
from daemon.host.progress import Progress
from daemon.messages import Axes, Tip
from daemon.recording.result import PoseError, read_result, write_result
from daemon.reference.trajectories import make_trajectory
from daemon.robot.axes import AxisRanges
from daemon.service.dependencies import Dependencies
from daemon.service.operation.run_recording import MakeFolder
from daemon.service.operation.session import Session
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.scripted_events import LabControl
from daemon.workbench.experiments.step_statistics import (
    Array,
    StepSeries,
    converged_s,
    drifts,
    errors_by_cycle,
    pose_errors,
    tracker_limits,
)
from daemon.workbench.experiments.stopwatch import Stopwatch
from daemon.workbench.experiments.trial import Tell, Trial
from drivers.pose import rotate
from safety.states import OperatingState

# Sees every step of an experiment, and the truth beside it where somebody knows it.


_RUNNING: Final = OperatingState.RUNNING.value
_UNKNOWN: Final = (nan,) * 3


class Truth(Protocol):
    """Knows what no device can measure."""

    def tip_mm(self) -> Array:
        """(3,) where the tip is now, in the base's frame."""
        ...

    def direction(self) -> Array:
        """(3,) unit vector along the tip's axis now."""
        ...

    def failures(self) -> int:
        """How often the emulated body found no equilibrium, and stayed as it was."""
        ...


class Witness:
    """Listens to telemetry. A step comes as a Tip, and then as Axes of the same number."""

    def __init__(
        self,
        axes: AxisRanges,
        truth: Truth | None,
        elapsed_s: Callable[[], float],
        sensor_axis: Array | None = None,
    ) -> None:
        """truth: None where nobody knows it. elapsed_s: along the trajectory, now. sensor_axis:
        (3,) the axis of the tip's sensor in the tip's frame; None: the tip's own."""
        self._sensor_axis = np.array([0.0, 0.0, 1.0]) if sensor_axis is None else sensor_axis
        self._aim, self._seen, self._directed = array("d"), array("d"), array("d")
        self._sensed, self._turned = array("d"), array("d")
        self._elapsed_s = elapsed_s
        self._axes = axes
        self._truth = truth
        self._tip: Tip | None = None
        self._times, self._cycles = array("d"), array("d")
        self._clock_ns = array("q")
        self._reference, self._believed = array("d"), array("d")
        self._reading, self._true = array("d"), array("d")
        self._u = array("d")
        self._expected = array("d")

    def hear_tip(self, tip: Tip) -> None:
        """Only what belongs to a step within a cycle counts."""
        counts = tip.cycle >= 0 and tip.error_mm is not None and tip.state == _RUNNING
        self._tip = tip if counts else None

    def hear_axes(self, axes: Axes) -> None:
        """Completes the step."""
        tip, self._tip = self._tip, None
        if tip is not None and tip.sequence == axes.sequence:
            self._take(tip, axes)

    def series(self) -> StepSeries:
        """All steps so far."""
        travel, clock_ns = self._axes.travel, np.array(self._clock_ns)
        return StepSeries(
            t_s=np.array(self._times),
            clock_s=1e-9 * (clock_ns - clock_ns[:1]),
            cycle=np.array(self._cycles),
            reference_mm=_points(self._reference),
            tip_mm=_points(self._believed),
            reading_mm=_points(self._reading),
            true_mm=_points(self._true),
            u=(np.array(self._u).reshape(-1, len(travel)) - self._axes.lowest) / travel,
            expected_mm=np.array(self._expected),
            **self._directions(),
        )

    def _directions(self) -> dict[str, Array]:
        """Of the tip; none where no step said where to point."""
        if not np.isfinite(self._aim).any():
            return {}
        return {
            "reference_direction": _points(self._aim),
            "tip_direction": _points(self._directed),
            "reading_direction": _points(self._seen),
            "sensor_direction": _points(self._sensed),
            "true_direction": _points(self._turned),
        }

    def _take(self, tip: Tip, axes: Axes) -> None:
        self._times.append(self._elapsed_s())
        self._clock_ns.append(tip.t_ns)
        self._cycles.append(tip.cycle)
        self._reference.extend(tip.reference_mm or _UNKNOWN)
        self._believed.extend(tip.tip_mm or _UNKNOWN)
        self._reading.extend(tip.measured_mm or _UNKNOWN)
        self._true.extend(_UNKNOWN if self._truth is None else self._truth.tip_mm().tolist())
        self._u.extend(axes.actual)
        self._expected.append(nan if tip.expected_mm is None else tip.expected_mm)
        measured = tip.measured_quaternion
        pointing = tip.reference_direction is not None
        self._aim.extend(tip.reference_direction or _UNKNOWN)
        self._directed.extend(tip.direction or _UNKNOWN)
        turn = None if measured is None else np.array(measured)
        self._seen.extend(_UNKNOWN if turn is None else tip_axis(turn).tolist())
        sensed = _UNKNOWN if turn is None else rotate(turn, self._sensor_axis).tolist()
        self._sensed.extend(sensed)
        truth = self._truth if pointing else None
        self._turned.extend(_UNKNOWN if truth is None else truth.direction().tolist())


def _points(values: "array[float]") -> Array:
    return np.array(values).reshape(-1, 3)


STEPS_FILE: Final = "steps.npz"
"""In the run's folder: a `StepSeries`, with the truth that no recording has."""


async def carry_out(
    file: ExperimentFile,
    robot: Robot,
    dependencies: Dependencies,
    make_folder: MakeFolder,
    lab: LabControl,
    truth: Truth | None,
    seed: int,
    tell: Tell,
    progress: Progress | None = None,
) -> None:
    """Leaves recording, result and steps in the run's folder, also where it fails on the way.

    robot: the file's, with its ports as they are to be opened. truth: None where nobody knows it.
    Raises TrialError, OSError.
    """
    robot_file = replace(file.file, robot=file.robot)
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    session = Session(robot_file, robot, dependencies, make_folder, seed)
    following, recording = session.service.following, session.recording
    witness = Witness(AxisRanges.of(robot), truth, lambda: following.elapsed_s, _sensor_axis(robot))
    stopwatch = Stopwatch()
    try:
        async with session.running():
            trial = Trial(file.experiment, trajectory, session, lab, stopwatch, tell, progress)
            dependencies.subscribers.add_for(Tip, witness.hear_tip)
            dependencies.subscribers.add_for(Axes, witness.hear_axes)
            await trial.run()
    finally:
        if recording.folder is not None:
            steps, failures = witness.series(), 0 if truth is None else truth.failures()
            _complete(recording.folder, steps, stopwatch, trajectory.cycle_s, failures)


def _sensor_axis(robot: Robot) -> Array:
    """(3,) the axis of the tip's sensor, in the tip's frame."""
    turn = np.array(robot.tracker.tools["tip"].quaternion)
    return tip_axis(turn / np.linalg.norm(turn))


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
        tip_pose=pose_errors(steps, steps.tip_mm, steps.tip_direction),
        reading_pose=pose_errors(steps, steps.reading_mm, steps.reading_direction),
        true_pose=pose_errors(steps, steps.true_mm, steps.true_direction),
        sensor_angle_rad=_angles(pose_errors(steps, steps.reading_mm, steps.sensor_direction)),
        drifts=drifts(steps),
        converged_s=converged_s(steps, cycle_s),
        limits=tracker_limits(steps),
        computing=stopwatch.computing_time(),
        plant_failures=plant_failures,
    )
    write_result(folder, whole)


def _angles(rows: list[PoseError]) -> list[float]:
    return [row.angle_rad for row in rows if row.angle_rad is not None]
