"""What `check` builds of the experiments of a study, and what it need not build again."""

from typing import Any

import pytest

from config.robot import Robot
from daemon.workbench.experiments.construction import SoundRobots, experiment_problems
from daemon.workbench.experiments.experiment_file import ExperimentFile, load_experiment
from sim_backends.lab.lab import Lab
from tests import SHIPPED_ROBOTS

STIFFER: dict[str, Any] = {"plant": {"bending_stiffness_n_mm2": 3000.0}}


def experiment(**changed: Any) -> ExperimentFile:
    return load_experiment(SHIPPED_ROBOTS.parent / "experiments/rectangle.yaml", changed)


def test_a_robot_is_built_once_however_many_paths_it_follows_and_an_unsound_one_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built: list[Robot] = []

    def lab(robot: Robot, *more: Any) -> Lab:
        built.append(robot)
        if robot.emulation == experiment(**STIFFER).robot.emulation:
            raise ValueError("no such arm")
        return Lab(robot, *more)

    monkeypatch.setattr("daemon.workbench.experiments.construction.Lab", lab)
    sound = SoundRobots()
    for cycle_s in (80.0, 90.0):
        assert experiment_problems(experiment(trajectory={"cycle_s": cycle_s}), sound) == []
    assert len(built) == 1
    for _ in range(2):
        (problem,) = experiment_problems(experiment(**STIFFER), sound)
        assert "no such arm" in str(problem)
