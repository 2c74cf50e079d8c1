"""The plan of a study: which runs there are, and what makes one another."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from config.emulation.plants import SoftArmPlant
from config.tasks.controllers import ConstantCurvature
from config.tasks.experiment import Pretraining
from daemon.recording import run_folder
from daemon.workbench.experiments.experiment_file import changed
from daemon.workbench.studies import worker
from daemon.workbench.studies.run import plan
from daemon.workbench.studies.study_file import StudyFile, load_study
from tests.daemon.workbench.studies.made_up import STUDY, write_study


@pytest.fixture
def study(tmp_path: Path) -> StudyFile:
    return load_study(write_study(tmp_path))


def test_every_experiment_with_every_controller_on_every_body_seed_by_seed(
    study: StudyFile,
) -> None:
    runs = plan(study, seeds=3, plants=2)
    assert len(runs) == len(set(map(str, runs))) == 2 * 2 * 2 * 3
    assert [run.seed for run in runs] == sorted(run.seed for run in runs)
    assert {run.plant for run in runs} == {1, 2}
    assert {run.plant for run in plan(study, seeds=1, plants=0)} == {0}


@pytest.mark.parametrize(
    ("only", "experiments", "variants"),
    [
        (["calm"], {"calm"}, {"broyden", "arcs"}),
        (["arcs"], {"calm", "loaded"}, {"arcs"}),
        (["loaded", "arcs"], {"loaded"}, {"arcs"}),
    ],
)
def test_only_some_of_it(
    study: StudyFile, only: list[str], experiments: set[str], variants: set[str]
) -> None:
    runs = plan(study, 1, 1, only)
    assert {run.experiment for run in runs} == experiments
    assert {run.variant for run in runs} == variants


def test_runs_differ_in_what_they_depend_on_and_in_where_they_leave_it(study: StudyFile) -> None:
    runs = plan(study, 2, 2)
    assert len({run.fingerprint for run in runs}) == len(runs)
    assert len({run.folder(Path("out")) for run in runs}) == len(runs)
    assert [run.fingerprint for run in plan(study, 2, 2)] == [run.fingerprint for run in runs]


def test_what_is_in_the_files_that_a_run_names_makes_it_another_one(tmp_path: Path) -> None:
    """And where they lie does not: shares of a study come from several machines."""

    def fingerprint(folder: str, way_mm: float) -> str:
        path = write_study(tmp_path / folder)
        experiment = tmp_path / folder / "calm.yaml"
        head, _, rest = experiment.read_text().partition("trajectory:")
        tail = rest[rest.index("controller:") :]
        experiment.write_text(f"{head}trajectory: {{kind: waypoints, file: way.csv}}\n{tail}")
        rows = f"t,x,y,z\n0,0,0,185\n5,{way_mm},0,185\n"
        (tmp_path / folder / "way.csv").write_text(rows)
        (run,) = plan(load_study(path), 1, 0, ["calm", "arcs"])
        return run.fingerprint

    first = fingerprint("here", 5.0)
    assert fingerprint("there", 5.0) == first
    assert fingerprint("here", -9.0) != first


def test_the_body_that_a_model_is_learnt_on_is_part_of_a_run(study: StudyFile) -> None:
    """Also where the experiment is on another one, and says only in what the known one differs."""
    (run,) = plan(study, 1, 0, ["calm", "arcs"])
    experiment = changed(run.file, {"pretraining": Pretraining(plant={})})
    emulation = experiment.file.robot.emulation
    assert emulation is not None
    stiffer = emulation.plant.model_copy(update={"pneumatic_lag_s": 0.3})
    robot = experiment.file.robot.model_copy(
        update={"emulation": emulation.model_copy(update={"plant": stiffer})}
    )
    elsewhere = replace(experiment, file=replace(experiment.file, robot=robot))
    fingerprints = [replace(run, file=one).fingerprint for one in (experiment, elsewhere)]
    assert experiment.robot == elsewhere.robot
    assert fingerprints[0] != fingerprints[1]


def test_a_plant_has_another_body_and_the_same_tracker_and_load(study: StudyFile) -> None:
    runs = [*plan(study, 1, 0, ["loaded", "arcs"]), *plan(study, 1, 2, ["loaded", "arcs"])]
    emulations = [run.file.robot.emulation for run in runs]
    assert len({str(one and one.plant) for one in emulations}) == 3
    assert len({str(one and one.tracker) for one in emulations}) == 1
    assert {one and one.tip_load_g for one in emulations} == {14.2}


def test_the_variants_controller_is_in_the_experiment(study: StudyFile) -> None:
    (run,) = plan(study, 1, 0, ["calm", "arcs"])
    controller = run.file.experiment.controller
    assert isinstance(controller, ConstantCurvature)
    assert controller.gain_per_s == 2.5


POOR = """
  - variant: poor
    label: poor samples
    pretraining: {waypoints: 80, dither_share: 0, sample_tip_mm: 2.0, lag_s: 0, test_share: 0.2}
"""


def test_a_variant_may_have_learnt_otherwise_beforehand(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path, STUDY + POOR))
    (run,) = plan(study, 1, 0, ["calm", "poor"])
    pretraining = run.file.experiment.pretraining
    assert pretraining is not None
    assert (pretraining.waypoints, pretraining.dither_share, pretraining.lag_s) == (80, 0.0, 0.0)
    assert (pretraining.sample_tip_mm, pretraining.test_share) == (2.0, 0.2)
    (other,) = plan(study, 1, 0, ["calm", "broyden"])
    assert other.file.experiment.pretraining is None


def test_what_a_variant_does_not_say_of_pretraining_is_the_experiments(tmp_path: Path) -> None:
    path = write_study(tmp_path, STUDY + POOR)
    for name in ("calm", "loaded"):
        with (tmp_path / f"{name}.yaml").open("a") as file:
            file.write("pretraining: {waypoints: 40, fields: 7, seed: 5}\n")
    (run,) = plan(load_study(path), 1, 0, ["calm", "poor"])
    pretraining = run.file.experiment.pretraining
    assert pretraining is not None
    assert (pretraining.waypoints, pretraining.fields, pretraining.seed) == (80, 7, 5)


ON_ANOTHER_BODY = """
  - variant: worn
    label: on a worn body
    plant: {body: worn, creep: 0.2}
"""


@pytest.mark.parametrize("plants", [0, 1])
def test_a_variant_may_be_of_another_body(tmp_path: Path, plants: int) -> None:
    study = load_study(write_study(tmp_path, STUDY + ON_ANOTHER_BODY))
    worn, own = (plan(study, 1, plants, ["calm", one])[0] for one in ("worn", "broyden"))
    for run, creep in ((worn, 0.2), (own, 0.05)):
        emulation = run.file.robot.emulation
        assert emulation is not None and isinstance(emulation.plant, SoftArmPlant)
        assert emulation.plant.creep == pytest.approx(creep, rel=0.3)
        assert (emulation.plant.backlash_mm > 0.0) is (run is worn)
    assert worn.fingerprint != own.fingerprint


def test_a_variant_of_a_body_that_cannot_be_is_told_with_its_line(tmp_path: Path) -> None:
    path = write_study(tmp_path, STUDY + ON_ANOTHER_BODY.replace("creep: 0.2", "creeep: 0.2"))
    with pytest.raises(ConfigError, match=r"study\.yaml:\d+:\d+: .*did you mean 'creep'"):
        load_study(path)


def test_a_dither_needs_lines_to_waypoints(tmp_path: Path) -> None:
    path = write_study(tmp_path, STUDY + POOR.replace("waypoints: 80, ", ""))
    with pytest.raises(ConfigError, match=r"study\.yaml:\d+:\d+: .*say how many"):
        load_study(path)


def test_a_run_says_which_version_made_it_where_that_was_installed(
    study: StudyFile, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(run_folder, "_checkout", lambda: (None, None))
    (run, *_) = plan(study, 1, 0, ["calm", "arcs"])
    run.file.describe(tmp_path, None, 1)
    assert worker._commit(tmp_path) == version("tentacled")
    assert worker._commit(tmp_path / "nothing") is None
