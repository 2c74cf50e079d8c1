"""A planned path is followed to its end; one that was planned with something else is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.commands.outcome.exit_codes import EXIT_OK
from daemon.commands.terminal.command_line import main
from daemon.reference.planned_path import misfit, read_path
from daemon.workbench.experiments.carry_out import STEPS_FILE
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.step_statistics import StepSeries
from daemon.workbench.experiments.trial import TrialError
from tests import SHIPPED_ROBOTS

pytestmark = pytest.mark.xdist_group("planned_path")  # whose path is planned once for all tests

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


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"model_sha256": "0" * 64}, "another model of the body"),
        ({"surroundings_sha256": "0" * 64}, "other surroundings"),
        ({"robot": "soft_arm"}, "of the robot soft_arm, and this is tendon_arm"),
    ],
)
def test_a_path_that_was_planned_with_something_else_is_refused(
    change: dict[str, Any], told: str, folder: Path, tmp_path: Path
) -> None:
    content = json.loads((folder / "path.json").read_text())
    (tmp_path / "path.json").write_text(json.dumps({**content, **change}))
    (tmp_path / "experiment.yaml").write_text(EXPERIMENT)
    with pytest.raises(TrialError, match=told):
        carried_out(tmp_path, tmp_path / "run")


def test_every_reason_has_a_name(folder: Path) -> None:
    path = read_path(folder / "path.json")
    robot = load_experiment(folder / "experiment.yaml").robot
    model, around = path.model_sha256, path.surroundings_sha256
    assert misfit(path, robot, model, around) is None
    found = [
        misfit(path, robot, None, None),
        misfit(path, robot, "0" * 64, around),
        misfit(path, robot, model, "0" * 64),
        misfit(path.model_copy(update={"axes": ("a",)}), robot, model, around),
    ]
    names = [one[0] for one in found if one is not None]
    assert names == ["other_model", "other_model", "other_surroundings", "wrong_robot"]


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
