"""Explores an emulated robot, and takes what can be learnt from out of the recording of a run.

It moves through the same loop, gate and limits as in every other motion.
"""

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from config.loader import RobotFile
from config.robot import Robot
from config.tasks.experiment import Experiment
from config.tasks.exploration import DesignedExploration, WaypointExploration
from config.tasks.trajectory import Hold
from daemon.host.progress import Progress
from daemon.learning.samples.dataset import Dataset, DatasetError, Frames
from daemon.messages import Axes, Status, Tip
from daemon.recording.format.channels import TOPICS
from daemon.recording.run_folder import robot_yaml
from daemon.recording.run_parts import RunParts
from daemon.recording.run_reader import UnreadableRunError
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.in_real_time import carry_out_in_real_time
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.trial import Tell
from safety.states import OperatingState

Exploring = WaypointExploration | DesignedExploration
"""What makes motions to learn from."""

_RUNNING = OperatingState.RUNNING.value
_STRETCH_NS = 5_000_000_000
"""Where nobody says which line it is, so much motion counts as one: about as long as a line of an
exploration, and a hundred times a body's lag."""


class _Seen(NamedTuple):
    t_ns: int
    tip_mm: list[float]
    u: list[float]
    line: int


def frames_of_run(path: Path) -> Frames:
    """Every believed frame of a run (its folder, or one recording) during which it was running.

    The tip is the loop's, and not that of `recorded_path`: its place is not late, only its velocity
    is, which nothing is learnt from. On the emulated soft arm both give the same lag, within 1 ms
    of that of the true tip, and models that predict true motions equally well (rms of four
    explorations 0.271 mm filtered, 0.278 smoothed, 0.273 true).

    A line is a part of an exploration; in another run, five seconds. Raises DatasetError for a
    recording that holds none, OSError.
    """
    try:
        seen = _seen(path)
    except UnreadableRunError as error:
        raise DatasetError(str(error)) from None
    except msgspec.MsgspecError as error:
        raise DatasetError(f"{path}: {error}") from None
    if not seen:
        raise DatasetError(f"{path}: the robot did not move in it")
    return Frames(
        np.array([frame.t_ns for frame in seen], dtype=np.int64),
        np.array([frame.tip_mm for frame in seen]),
        np.array([frame.u for frame in seen]),
        np.array([frame.line for frame in seen], dtype=np.int64),
    )


def _seen(run: Path) -> list[_Seen]:
    tip_of, axes_of = msgspec.json.Decoder(Tip), msgspec.json.Decoder(Axes)
    status_of = msgspec.json.Decoder(Status)
    lines, seen, tip = _Lines(), list[_Seen](), None
    for message in RunParts(run).messages([TOPICS[kind] for kind in (Tip, Axes, Status)]):
        if message.topic == TOPICS[Status]:
            lines.hear(status_of.decode(message.data))
        elif message.topic == TOPICS[Tip]:
            tip = tip_of.decode(message.data)
        elif tip is not None and tip.tip_mm is not None:
            axes = axes_of.decode(message.data)
            sound = tip.believed and tip.state == _RUNNING and tip.sequence == axes.sequence
            if sound and (not seen or axes.t_ns > seen[-1].t_ns):
                seen.append(_Seen(axes.t_ns, tip.tip_mm, axes.actual, lines.at(axes.t_ns)))
    return seen


class _Lines:
    """Numbers lines, by the parts of what the controller does."""

    def __init__(self) -> None:
        self._part: int | None = None
        self._line = 0
        self._began_ns: int | None = None

    def hear(self, status: Status) -> None:
        part = None if status.reference is None else status.reference.part
        if part != self._part:
            self._part = part
            self._line += 1
            self._began_ns = None

    def at(self, t_ns: int) -> int:
        if self._began_ns is None:
            self._began_ns = t_ns
        if self._part is None and t_ns - self._began_ns > _STRETCH_NS:
            self._line += 1
            self._began_ns = t_ns
        return self._line


_STAYS_S = 0.1
_AT_ONCE_MM_S = 1000.0
"""An exploration follows nothing: its reference need not be led anywhere gently."""
_LINE_AT_MOST = 3.0
"""A line with its dither takes less than this times the travel at full speed."""
_PAUSES_AT_MOST = 3.0
"""Seconds that pass for each that it moves: it may be held, and resumed, on its way."""
_BEGINS_WITHIN_S = 120.0


def explore(
    file: RobotFile,
    options: Exploring,
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
    file: RobotFile, options: Exploring, seed: int, tip_load_g: float
) -> ExperimentFile:
    experiment = Experiment(
        experiment="exploration",
        robot=str(file.path),
        trajectory=Hold(kind="hold", position_mm=_middle(file.robot), duration_s=_STAYS_S),
        controller=options,
        tip_load_g=tip_load_g,
        blend_speed_mm_s=_AT_ONCE_MM_S,
        seed=seed,
        longest_s=_BEGINS_WITHIN_S + _longest_s(file.robot, options),
    )
    return ExperimentFile(
        file.path, experiment, file, _loaded(file.robot, tip_load_g), file.document
    )


def _longest_s(robot: Robot, options: Exploring) -> float:
    if isinstance(options, DesignedExploration):
        return _PAUSES_AT_MOST * options.lasts_s(len(robot.axes))
    axes = AxisRanges.of(robot)
    through_s = float(np.max(axes.travel / (options.speed_share * axes.max_velocity)))
    return _LINE_AT_MOST * through_s * options.waypoints


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
