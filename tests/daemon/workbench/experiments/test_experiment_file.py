"""What is wrong with an experiment is told when its file is read, not when it is carried out."""

from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from daemon.supervision.tracking_error import TrackingError
from daemon.workbench.experiments.experiment_file import load_experiment

EXPERIMENT = """experiment: little
robot: builtin:soft_arm
trajectory:
  kind: circle
  center_mm: [0, 0, 185]
  radius_mm: 20.0
  cycle_s: 30.0
controller:
  kind: broyden
"""
WAYPOINTS = """  kind: waypoints
  file: way.csv
"""


def problem(tmp_path: Path, text: str) -> str:
    path = tmp_path / "experiment.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_experiment(path)
    return str(caught.value)


def with_waypoints() -> str:
    head, _, tail = EXPERIMENT.partition("  kind: circle\n")
    return head + WAYPOINTS + "controller" + tail.partition("controller")[2]


def test_a_sound_one_is_read(tmp_path: Path) -> None:
    path = tmp_path / "experiment.yaml"
    path.write_text(EXPERIMENT)
    assert load_experiment(path).robot.robot == "soft_arm"


def test_a_tip_may_be_farther_off_than_the_robot_file_allows(tmp_path: Path) -> None:
    """A controller is to be seen going on: the same monitor, with another limit."""
    path = tmp_path / "experiment.yaml"
    for text, allowed_mm in ((EXPERIMENT, 7.0), (f"{EXPERIMENT}tracking_error_mm: 13.0\n", 13.0)):
        path.write_text(text)
        found_mm = TrackingError.of(load_experiment(path).robot).allowed_mm
        assert found_mm == pytest.approx(allowed_mm, abs=0.5)


def test_what_is_faster_than_the_tip_may_go_is_told_with_its_line(tmp_path: Path) -> None:
    told = problem(tmp_path, EXPERIMENT.replace("cycle_s: 30.0", "cycle_s: 1.0"))
    assert "experiment.yaml:4" in told
    assert "at 125.7 mm/s, and the tip may go 25 mm/s" in told


def test_what_is_outside_the_workspace_is_told(tmp_path: Path) -> None:
    told = problem(tmp_path, EXPERIMENT.replace("[0, 0, 185]", "[500, 0, 185]"))
    assert "beyond the workspace" in told


def test_a_waypoint_file_that_is_missing_or_a_pipe_is_told(tmp_path: Path) -> None:
    assert "way.csv: No such file" in problem(tmp_path, with_waypoints())
    (tmp_path / "way.csv").mkdir()
    assert "way.csv" in problem(tmp_path, with_waypoints())


def test_who_cannot_point_is_told_with_the_trajectory(tmp_path: Path) -> None:
    pointing = "  pointing: {kind: away_from, point_mm: [0, 0, 0]}\ncontroller:"
    text = EXPERIMENT.replace("controller:", pointing)
    told = problem(tmp_path, text.replace("broyden", "pid_constant_curvature"))
    assert "trajectory: pid_constant_curvature leads the tip by its position alone" in told
    (tmp_path / "experiment.yaml").write_text(text)
    assert load_experiment(tmp_path / "experiment.yaml").experiment.controller.kind == "broyden"


@pytest.mark.parametrize(
    ("when", "why"),
    [
        ("at_cycle: 1", "happenings[1].at_cycle: cycles count from 0, and the last one is 0"),
        ("at_s: 30", "happenings[1].at_s: the trajectory is over after 30 s"),
    ],
)
def test_what_would_happen_after_the_end_is_told_with_its_line(
    when: str, why: str, tmp_path: Path
) -> None:
    other = "happenings:\n  - {at_s: 29.9, tip_load_g: 10}\n"
    told = problem(tmp_path, f"{EXPERIMENT}{other}  - {{{when}, tip_load_g: 20}}\n")
    assert told.endswith(f"{why}: this never happens")
    assert "experiment.yaml:12:" in told
    assert "happenings[0]" not in told


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("plant: {mas_g: 3}", "plant.mas_g: unknown key (did you mean 'mass_g'?)"),
        (
            "plant: {segments: [{lenght_mm: 3, length_mm: 90}]}",
            "plant.segments[0].lenght_mm: unknown key (did you mean 'length_mm'?)",
        ),
        ("plant: {body: worm}", "plant.body: must be 'as_made', 'worn', 'slow', 'heavy' or "),
        ("pretraining: {plant: {mass_g: x}}", "pretraining.plant.mass_g: should be a valid "),
    ],
)
def test_what_is_wrong_with_another_body_is_told_as_of_a_robot_file(
    more: str, told: str, tmp_path: Path
) -> None:
    assert told in problem(tmp_path, f"{EXPERIMENT}{more}\n")
