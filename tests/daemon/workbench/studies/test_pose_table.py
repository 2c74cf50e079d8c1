"""Tables of position and direction by coordinate, and their aims; bodies matched to an error."""

from dataclasses import replace
from math import radians
from pathlib import Path

import msgspec
import pytest

from daemon.recording.result import PoseError
from daemon.workbench.studies.error_tables import aims_text
from daemon.workbench.studies.findings import Findings, findings
from daemon.workbench.studies.pose_table import pose_aims, pose_rms, pose_table
from daemon.workbench.studies.run import Outcome, PlanError, plan
from daemon.workbench.studies.study_file import StudyFile, load_study
from daemon.workbench.studies.write_up import reproduction_tables
from tests import SHIPPED_ROBOTS
from tests.daemon.workbench.studies.made_up import STUDY, outcome, write_study

SHIPPED = SHIPPED_ROBOTS.parent / "studies" / "lwpr_ctr.yaml"
POSES = STUDY.replace(
    "        published: {mean_mm: [4.56, 5.5], std_mm: [1.99, 1.12], max_mm: [9.02, null]}\n",
    "        published_pose: {broyden: {x_mm: 3.0, y_mm: 4.0, z_mm: 12.0, angle_deg: 2.0}}\n"
    "        aim_pose: {broyden: {x_mm: 0.5, y_mm: 0.5, z_mm: 0.5}}\n",
)


def rows(x_mm: float, angle_rad: float | None = None) -> list[PoseError]:
    return [
        PoseError(cycle=0, samples=100, x_mm=x_mm, y_mm=0.2, z_mm=0.1, angle_rad=angle_rad),
        PoseError(cycle=1, samples=300, x_mm=0.0, y_mm=0.2, z_mm=0.1, angle_rad=angle_rad),
    ]


def posed(seed: int, x_mm: float) -> Outcome:
    made = outcome([1.0, 1.0], seed)
    assert made.result is not None
    result = msgspec.structs.replace(
        made.result,
        tip_pose=rows(x_mm, radians(0.5)),
        true_pose=rows(2.0 * x_mm, radians(1.5)),
        sensor_angle_rad=[radians(3.0), radians(4.0)],
    )
    return msgspec.structs.replace(made, result=result)


def found_of(tmp_path: Path, outcomes: list[Outcome]) -> tuple[StudyFile, Findings]:
    file = load_study(write_study(tmp_path / "study", POSES))
    return file, findings(file, outcomes, 8)


def test_a_run_s_errors_are_root_mean_squares_over_all_of_its_cycles() -> None:
    found = pose_rms(posed(1, 0.8), "tip_pose")
    assert found.x == pytest.approx(0.4)  # √(100 · 0.8² / 400)
    assert (found.y, found.z) == pytest.approx((0.2, 0.1))
    assert found.norm == pytest.approx((0.4**2 + 0.2**2 + 0.1**2) ** 0.5)
    assert found.degrees == pytest.approx(0.5)
    lost = msgspec.structs.replace(posed(1, 0.8), failure="it fell over")
    assert pose_rms(lost, "tip_pose").x == float("inf")


def test_the_table_has_the_paper_s_figures_ours_and_how_far_they_spread(tmp_path: Path) -> None:
    file, found = found_of(tmp_path, [posed(1, 0.4), posed(2, 0.8), posed(3, 2.0)])
    made = pose_table(file, file.study.tables[0], found)
    section = next(one for one in made.sections if one.heading == "a load")
    published, ours = section.rows
    assert published[:6] == [
        "Somebody 2018: measured Jacobian",
        "3.00",
        "4.00",
        "12.00",
        "13.00",
        "2.00",
    ]
    assert ours[1] == "0.40 [0.20–1.00]"
    assert ours[5] == "0.50 [0.50–0.50]"
    assert ours[6:10] == ["0.80", "0.20", "0.10", "1.50"]
    assert float(ours[10]) == pytest.approx(3.54)  # √((3² + 4²) / 2)
    assert ours[11] == "3"
    assert all(len(row) == len(made.head) for row in section.rows)


def test_a_study_with_poses_shows_them_instead_of_distances(tmp_path: Path) -> None:
    file, found = found_of(tmp_path, [posed(1, 0.4)])
    assert "true x" in reproduction_tables(file, found)[0].head
    plain = load_study(write_study(tmp_path / "plain"))
    assert "true x" not in reproduction_tables(plain, findings(plain, [], 8))[0].head


def test_an_aim_is_reached_where_every_coordinate_s_median_is_below_it(tmp_path: Path) -> None:
    file, found = found_of(tmp_path, [posed(1, 0.4), posed(2, 0.8), posed(3, 9.0)])
    assert [aim.reached for aim in pose_aims(file, found)] == [True]
    assert any("at most 0.50/0.50/0.50 mm" in line for line in aims_text(file, found))
    file, found = found_of(tmp_path, [posed(1, 0.4), posed(2, 4.0), posed(3, 9.0)])
    assert [aim.reached for aim in pose_aims(file, found)] == [False]


def test_the_shipped_study_plans_bodies_that_are_off_by_what_it_says() -> None:
    study = load_study(SHIPPED)
    runs = plan(study, seeds=1, plants=2, only=["ctr_circle", "model_on", "broyden"])
    assert len(runs) == 4
    bodies = {run.plant: run.file.robot.emulation.plant for run in runs}  # type: ignore[union-attr]
    assert bodies[1] != bodies[2]
    own = study.experiments["ctr_circle"].robot.emulation
    assert own is not None
    from sim_backends.plants.concentric.body_error import body_error

    for body in bodies.values():
        error = body_error(own.plant, body, study.experiments["ctr_circle"].robot.axes)  # type: ignore[arg-type]
        assert error.mean_mm == pytest.approx(study.study.body_error_mm, rel=0.02)


def test_other_robots_have_no_bodies_that_are_matched(tmp_path: Path) -> None:
    file = load_study(write_study(tmp_path / "study", STUDY + "body_error_mm: 3.0\n"))
    with pytest.raises(PlanError, match="nothing tells how far another soft_arm is off"):
        plan(file, 1, 1)
    assert plan(replace(file), 1, 0)
