"""A matrix says a bench's cells compactly, and what is wrong with it is told with its place."""

from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from config.tasks.controllers import Broyden
from daemon.reference.trajectories import make_trajectory
from daemon.workbench.studies.run import Run, plan
from daemon.workbench.studies.study_file import StudyFile, load_study
from daemon.workbench.studies.study_matrix import length_mm
from daemon.workbench.studies.worker import as_asked
from tests.daemon.workbench.studies.made_up import write_study

STUDY = """
study: small
matrix:
  - robot: arm
    experiment: calm.yaml
    bodies: [as_made, slow]
    paths:
      - path: circle
        trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 10, cycles: 2}
        speeds_mm_s: [5, 7.5]
      - path: still
        trajectory: {kind: hold, position_mm: [0, 0, 185], duration_s: 4}
    loads:
      - {load: empty}
      - {load: pushed, tip_load_g: 14.2, happenings: [{at_s: 2.0, tip_load_g: 30.0}]}
    gains: [1.0, 2.0]
variants:
  - {variant: broyden, label: measured Jacobian}
  - {variant: slowly, label: slowly, controller: {gain_per_s: 1.0}}
judged: {ours: broyden, without_learning: slowly}
seeds: 1
plants: 0
"""


@pytest.fixture
def bench(tmp_path: Path) -> StudyFile:
    return load_study(write_study(tmp_path, STUDY))


def test_everything_is_done_with_everything(bench: StudyFile) -> None:
    assert len(bench.experiments) == len(bench.cells) == 2 * (2 + 1) * 2 * 2
    assert "arm_slow_circle_7p5_pushed_gain_2" in bench.experiments
    assert bench.rows["arm_as_made_still_empty"].label == "arm, as made: still"
    assert all(file.experiment.experiment == name for name, file in bench.experiments.items())


def test_a_cell_has_its_body_its_load_and_its_speed(bench: StudyFile) -> None:
    file = bench.experiments["arm_slow_circle_5_pushed"]
    assert file.robot.emulation is not None
    assert file.robot.emulation.plant.model_dump()["pneumatic_lag_s"] == 0.5
    assert (file.experiment.tip_load_g, file.robot.emulation.tip_load_g) == (14.2, 14.2)
    assert [one.tip_load_g for one in file.experiment.happenings] == [30.0]
    circle = make_trajectory(file.experiment.trajectory, file.path.parent)
    assert length_mm(circle) / circle.cycle_s == pytest.approx(5.0, rel=1e-4)
    assert circle.cycles == 2


def test_a_gain_is_a_share_of_each_controllers_own(bench: StudyFile) -> None:
    runs = {(run.experiment, run.variant): run for run in plan(bench, 1, 0)}
    gains = []
    for name in ("arm_slow_still_empty", "arm_slow_still_empty_gain_2"):
        for variant in ("broyden", "slowly"):
            controller = runs[name, variant].file.experiment.controller
            assert isinstance(controller, Broyden)
            gains.append(controller.gain_per_s)
    assert gains == [2.5, 1.0, 5.0, 2.0]
    assert all(run.foreseen for run in runs.values())


def test_who_is_asked_whether_a_path_can_be_followed_is_part_of_a_run(tmp_path: Path) -> None:
    """Its damping is the experiment's own, whatever that of the variant is; and it goes with the
    run to machines on which there are none of these files."""
    text = STUDY.replace("{gain_per_s: 1.0}", "{gain_per_s: 1.0, damping_mm: 3.0}")
    path, experiment = write_study(tmp_path, text), tmp_path / "calm.yaml"

    def planned() -> Run:
        return plan(load_study(path), 1, 0, ["arm_slow_still_empty", "slowly"])[0]

    before = planned().fingerprint
    stated = experiment.read_text().replace("gain_per_s", "damping_mm: 17.0, gain_per_s")
    experiment.write_text(stated)
    run = planned()
    assert run.fingerprint != before
    experiment.unlink()
    asked = as_asked(run).experiment.controller
    assert (asked.kind, getattr(asked, "damping_mm", None)) == ("forward_jacobian", 17.0)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("calm.yaml", "quiet.yaml"), ":5:17: matrix[0].experiment: there is no file"),
        (("radius_mm: 10", "radios_mm: 10"), ":9:21: matrix[0].paths[0].trajectory: trajectory.ra"),
        (("radius_mm: 10", "radius_mm: 100"), ":9:21: matrix[0].paths[0].trajectory: at "),
        (("radius_mm: 10,", "radius_mm: 10, cycle_s: 5,"), "leave out cycle_s"),
        (("path: still", "path: circle_5"), "there is twice"),
        (("bodies: [as_made, slow]", "bodies: [as_made, quick]"), "matrix[0].bodies[1]"),
        (("ours: broyden", "ours: bryden"), "judged: there is no variant bryden"),
        (("seeds: 1", "tuned: lost.yaml"), "tuned: there is no file"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, change: tuple[str, str], problem: str) -> None:
    text = STUDY.replace(*change)
    if problem == "there is twice":
        text = text.replace("bodies: [as_made, slow]", "bodies: [as_made, as_made]")
        problem = "another one is called arm_as_made_circle_5_empty too"
    with pytest.raises(ConfigError) as raised:
        load_study(write_study(tmp_path, text))
    assert problem in str(raised.value)


def test_what_a_search_found_goes_on_top_of_its_variants(tmp_path: Path) -> None:
    path = write_study(tmp_path, STUDY.replace("seeds: 1", "tuned: found.yaml"))
    found = "tuned: small\nsearch: By eye.\nvariants: {slowly: {gain_per_s: 1.25}}\n"
    (tmp_path / "found.yaml").write_text(found)
    file = load_study(path)
    assert file.searched == "By eye."
    given = {variant.variant: variant.controller for variant in file.study.variants}
    assert given == {"broyden": {}, "slowly": {"gain_per_s": 1.25}}
