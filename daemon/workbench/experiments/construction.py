"""Builds everything that a file describes, and lets it go again: what `check` passes can be built.

Nothing is opened, nothing moves, and no time passes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from config.documents.problems import ConfigError, Problem
from config.documents.yaml_document import Location
from config.loader import RobotFile
from config.robot import Robot
from daemon.control.axis_speeds import HasForesight
from daemon.control.controller import Controller
from daemon.control.reachability import Bounds, too_fast
from daemon.controllers.make_controller import make_controller
from daemon.host.clock import MonotonicClock
from daemon.recording.flight_recorder import FlightRecorder
from daemon.reference.trajectories import make_trajectory
from daemon.risk.body_risk_source import RiskFilesError, make_risk_source
from daemon.robot.axes import AxisRanges
from daemon.robot.connections import RealConnections
from daemon.service.dependencies import Dependencies
from daemon.service.robot_service import RobotService
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.risk import risk_source_of, tip_loads_g
from safety.risk_source import NoModel, RiskSource
from sim_backends.faults import understand
from sim_backends.lab.lab import Lab

_At = Callable[[Location, str], Problem]


def robot_problems(file: RobotFile) -> list[Problem]:
    """Why a robot that is sound by itself can still not be emulated or run."""
    problems: list[Problem] = []
    _lab(file.robot, file, file.problem, problems)
    risk: list[RiskSource] = []
    problems += _why_not(
        ("risk",), file.problem, lambda: risk.append(make_risk_source(file, MonotonicClock()))
    )
    asked = risk[0] if risk else NoModel()
    problems += _why_not(("axes",), file.problem, lambda: _service(file, asked))
    return problems


def lab_of(file: RobotFile) -> Lab:
    """Its emulated lab. Raises ConfigError."""
    problems: list[Problem] = []
    lab = _lab(file.robot, file, file.problem, problems)
    if lab is None:
        missing = file.problem((), "there is no 'emulation' in this robot file")
        raise ConfigError(problems or [missing])
    return lab


class SoundRobots:
    """Those of experiments that could be built: in a study one of them follows many paths."""

    def __init__(self) -> None:
        self._known: list[tuple[tuple[object, ...], Lab | None]] = []

    def lab(self, file: ExperimentFile, problems: list[Problem]) -> Lab | None:
        """The experiment's emulated lab. Why robot or lab cannot be built comes to `problems`."""
        asked = (file.robot, file.file.path, file.experiment.risk, tip_loads_g(file))
        for known, lab in self._known:
            if known == asked:
                return lab
        robot_file = replace(file.file, robot=file.robot)
        why: list[Problem] = []
        lab = _lab(file.robot, robot_file, file.problem, why)
        clock = MonotonicClock()
        why += _why_not(
            ("robot",), file.problem, lambda: _service(robot_file, risk_source_of(file, clock))
        )
        if not why:
            self._known.append((asked, lab))
        problems += why
        return lab


def experiment_problems(file: ExperimentFile, sound: SoundRobots | None = None) -> list[Problem]:
    """Why an experiment that is sound by itself can still not be carried out."""
    problems: list[Problem] = []
    lab = (sound or SoundRobots()).lab(file, problems)
    experiment = file.experiment
    lasts_s = make_trajectory(experiment.trajectory, file.path.parent).duration_s
    if lasts_s > experiment.longest_s:
        text = (
            f"the trajectory takes {lasts_s:g} s, and the experiment is given up after "
            f"{experiment.longest_s:g} s: raise longest_s, or make the trajectory shorter"
        )
        problems.append(file.problem(("longest_s",), text))
    if experiment.pretraining is None:
        made: list[Controller] = []
        problems += _why_not(
            ("controller",),
            file.problem,
            lambda: made.append(
                make_controller(experiment.controller, file.robot, experiment.seed)
            ),
        )
        for why in filter(None, (why_too_fast(file, controller) for controller in made)):
            problems.append(file.problem(("trajectory",), why))
    return problems + ([] if lab is None else _misunderstood(file, lab))


def check_happenings(file: ExperimentFile) -> None:
    """All of them are understood before the first one happens. Raises ConfigError."""
    if any(happening.inject is not None for happening in file.experiment.happenings):
        robot_file = replace(file.file, robot=file.robot)
        if problems := _misunderstood(file, lab_of(robot_file)):
            raise ConfigError(problems)


def _misunderstood(file: ExperimentFile, lab: Lab) -> list[Problem]:
    """Faults that the lab's devices do not have."""
    problems: list[Problem] = []
    for index, happening in enumerate(file.experiment.happenings):
        if happening.inject is not None:
            where = ("happenings", index, "inject")
            ask = partial(understand, lab.devices, happening.inject)
            problems += _why_not(where, file.problem, ask)
    return problems


def why_too_fast(file: ExperimentFile, controller: Controller) -> str | None:
    """Why the axes are too slow for the trajectory, as far as the controller knows the robot."""
    foresight = controller.foresight if isinstance(controller, HasForesight) else None
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    bounds = Bounds(axes=AxisRanges.of(file.robot), foresight=foresight)
    return next(filter(None, too_fast(trajectory, bounds)), None)


def _lab(robot: Robot, file: RobotFile, at: _At, problems: list[Problem]) -> Lab | None:
    if robot.emulation is None:
        return None
    built: list[Lab] = []
    problems += _why_not(
        ("emulation",), at, lambda: built.append(Lab(robot, file.path, MonotonicClock()))
    )
    return built[0] if built else None


def _service(file: RobotFile, risk: RiskSource) -> None:
    clock = MonotonicClock()
    dependencies = Dependencies(RealConnections(clock), clock, FlightRecorder(), risk, True, None)
    RobotService(file, file.robot, dependencies)


def _why_not(where: Location, at: _At, build: Callable[[], object]) -> list[Problem]:
    """Whatever keeps it from being built is a problem of the file: nothing else is there yet."""
    try:
        build()
    except RiskFilesError as error:
        return [at((*where, *error.keys), str(error))]
    except Exception as error:
        return [at(where, str(error) or type(error).__name__)]
    return []
