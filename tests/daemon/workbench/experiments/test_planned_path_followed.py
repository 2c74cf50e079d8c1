"""A planned path, from the command that plans it to a robot at its end, in virtual time."""

from pathlib import Path

import numpy as np
import pytest

from daemon.commands.terminal.command_line import EXIT_OK, main
from daemon.reference.planned_path import read_path
from daemon.workbench.experiments.carry_out import STEPS_FILE
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.step_statistics import StepSeries
from tests import SHIPPED_ROBOTS

TENDONS = SHIPPED_ROBOTS / "tendon_arm.yaml"
EXPERIMENT = """
experiment: along_a_path
robot: builtin:tendon_arm
trajectory: {kind: planned, file: path.json}
controller:
  kind: broyden
  explore_together: false
  explore_share: 0.03
  damping_mm: 200.0
  posture_gain_per_s: 1.0
longest_s: 120.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a path through the shipped chest, and an experiment that follows it."""
    found = tmp_path_factory.mktemp("planned")
    words = ["--to", "-30,5,194.5", "--waypoints", "8", "--out", str(found / "path.json")]
    assert main(["plan", str(TENDONS), *words]) == EXIT_OK
    (found / "experiment.yaml").write_text(EXPERIMENT)
    return found


def carried_out(folder: Path, out: Path) -> None:
    out.mkdir()
    file = load_experiment(folder / "experiment.yaml")
    carry_out_in_virtual_time(file, 1, out, lambda _: None)


@pytest.mark.long
def test_tip_and_axes_go_along_the_path(folder: Path, tmp_path: Path) -> None:
    carried_out(folder, tmp_path / "run")
    path, steps = read_path(folder / "path.json"), StepSeries.load(tmp_path / "run" / STEPS_FILE)
    off_mm = np.linalg.norm(steps.true_mm[-1] - np.array(path.tip_mm[-1]))
    assert off_mm < 3.0
    travel = [axis.travel for axis in load_experiment(folder / "experiment.yaml").robot.axes]
    low, high = np.array(travel).T
    ends = (np.array([path.u[0], path.u[-1]]) - low) / (high - low)
    assert np.abs(steps.u[-1] - ends[1]).max() < 0.5 * np.abs(ends[1] - ends[0]).max()
