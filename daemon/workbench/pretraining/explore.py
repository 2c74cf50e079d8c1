"""Explores an emulated robot: through the same loop, gate and limits as every other motion."""

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from config.loader import RobotFile
from config.robot import Robot
from config.tasks.experiment import Experiment
from config.tasks.exploration import WaypointExploration
from config.tasks.trajectory import Hold
from daemon.host.progress import Progress
from daemon.learning.samples.dataset import Dataset
from daemon.recording.run_folder import robot_yaml
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.in_real_time import carry_out_in_real_time
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.trial import Tell
from daemon.workbench.pretraining.recorded_frames import frames_of_run

_STAYS_S = 0.1
_AT_ONCE_MM_S = 1000.0
"""An exploration follows nothing: its reference need not be led anywhere gently."""
_LINE_AT_MOST = 3.0
"""A line with its dither takes less than this times the travel at full speed."""
_BEGINS_WITHIN_S = 120.0


def explore(
    file: RobotFile,
    options: WaypointExploration,
    seed: int,
    run: Path,
    tell: Tell,
    *,
    tip_load_g: float = 0.0,
    real_time: bool = False,
    progress: Progress | None = None,
) -> Dataset:
    """Leaves its recording in `run`, an empty folder. Raises TrialError, DatasetError, OSError.

    The same file, options and seed give the same data, unless in real time.
    """
    carry_out = carry_out_in_real_time if real_time else carry_out_in_virtual_time
    experiment = _experiment(file, options, seed, tip_load_g)
    carry_out(experiment, seed, run, tell, progress=progress)
    how = {
        "exploration": options.model_dump(mode="json"),
        "seed": seed,
        "tip_load_g": tip_load_g,
        "real_time": real_time,
    }
    return dataset_of_run(run, file, how)


def dataset_of_run(run: Path, file: RobotFile, more: dict[str, Any] | None = None) -> Dataset:
    """What a recorded run of this robot has seen, whatever it did. Raises DatasetError, OSError."""
    made = {"config_sha256": config_sha256(file), "version": version("tentacled"), **(more or {})}
    return Dataset.of(frames_of_run(run), file.robot, made)


def config_sha256(file: RobotFile) -> str:
    """Of the robot as it is understood, all defaults written out."""
    return hashlib.sha256(robot_yaml(file.robot, file.path).encode()).hexdigest()


def _experiment(
    file: RobotFile, options: WaypointExploration, seed: int, tip_load_g: float
) -> ExperimentFile:
    axes = AxisRanges.of(file.robot)
    through_s = float(np.max(axes.travel / (options.speed_share * axes.max_velocity)))
    experiment = Experiment(
        experiment="exploration",
        robot=str(file.path),
        trajectory=Hold(kind="hold", position_mm=_middle(file.robot), duration_s=_STAYS_S),
        controller=options,
        tip_load_g=tip_load_g,
        blend_speed_mm_s=_AT_ONCE_MM_S,
        seed=seed,
        longest_s=_BEGINS_WITHIN_S + _LINE_AT_MOST * through_s * options.waypoints,
    )
    return ExperimentFile(
        file.path, experiment, file, _loaded(file.robot, tip_load_g), file.document
    )


def _middle(robot: Robot) -> tuple[float, float, float]:
    """Of the workspace: a place that no reference is refused for."""
    box = robot.workspace
    if box is None:
        return 0.0, 0.0, 0.0
    x, y, z = (0.5 * (low + high) for low, high in (box.x_mm, box.y_mm, box.z_mm))
    return x, y, z


def _loaded(robot: Robot, tip_load_g: float) -> Robot:
    assert robot.emulation is not None
    emulation = robot.emulation.model_copy(update={"tip_load_g": tip_load_g})
    return robot.model_copy(update={"emulation": emulation})
