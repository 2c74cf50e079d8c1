"""An experiment on a named body, and what its controller knows of it."""

from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from config.emulation.plants import SoftArmPlant
from daemon.workbench.experiments.experiment_file import ExperimentFile, load_experiment, on_body
from daemon.workbench.studies.grid import _one_for_each_model
from daemon.workbench.studies.run import plan
from daemon.workbench.studies.study_file import load_study
from tests.daemon.workbench.studies.made_up import STUDY, write_study

EXPERIMENT = """experiment: little
robot: builtin:soft_arm
trajectory:
  kind: circle
  center_mm: [0, 0, 185]
  radius_mm: 20.0
  cycle_s: 30.0
controller:
  kind: forward_jacobian
plant: {body: slow, dead_time_s: 0.1}
pretraining: {plant: {body: as_made}}
"""


def loaded(tmp_path: Path, text: str = EXPERIMENT) -> ExperimentFile:
    path = tmp_path / "experiment.yaml"
    path.write_text(text)
    return load_experiment(path)


def plant_of(file: ExperimentFile) -> SoftArmPlant:
    assert file.robot.emulation is not None
    plant = file.robot.emulation.plant
    assert isinstance(plant, SoftArmPlant)
    return plant


def test_a_body_is_taken_by_its_name_and_what_stands_beside_it_on_top(tmp_path: Path) -> None:
    plant = plant_of(loaded(tmp_path))
    assert (plant.body, plant.pneumatic_lag_s, plant.dead_time_s) == ("slow", 0.5, 0.1)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("body: slow", "body: slwo"), "plant.body"),
        (("plant: {body: as_made}", "plant: {body: new}"), "plant.body"),
    ],
)
def test_a_body_that_there_is_none_of_is_told(
    tmp_path: Path, change: tuple[str, str], problem: str
) -> None:
    with pytest.raises(ConfigError, match=problem):
        loaded(tmp_path, EXPERIMENT.replace(*change))


def test_another_body_replaces_the_first_one_s_figures(tmp_path: Path) -> None:
    other = on_body(loaded(tmp_path), "worn")
    plant = plant_of(other)
    assert other.experiment.experiment == "little_worn"
    assert (plant.pneumatic_lag_s, plant.leak_per_hour) == (0.1, 0.1)
    assert plant.dead_time_s == 0.1  # the experiment's own figure stays on top


def test_what_is_known_of_another_body_is_the_body_of_before(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("{plant: {body: as_made}}", "{waypoints: 5}")
    known = on_body(loaded(tmp_path, text), "worn").experiment.pretraining
    assert known is not None
    assert known.plant == {"body": "slow", "dead_time_s": 0.1}


def test_a_study_s_rows_take_the_same_experiment_on_several_bodies(tmp_path: Path) -> None:
    row = "      - experiment: calm.yaml\n        label: no load\n"
    more = row + row.replace("label: no load", "label: worn\n        body: worn")
    file = load_study(write_study(tmp_path, STUDY.replace(row, more)))
    assert list(file.experiments) == ["calm", "calm_worn", "loaded"]
    assert plant_of(file.experiments["calm_worn"]).leak_per_hour == 0.1
    assert {run.experiment for run in plan(file, 1, 0)} == {"calm", "calm_worn", "loaded"}


def test_models_of_one_known_body_are_made_once_for_all_bodies_that_are_met(
    tmp_path: Path,
) -> None:
    path = write_study(tmp_path)
    row = "      - experiment: calm.yaml\n        label: no load\n"
    rows = "".join(
        row.replace("label: no load", f"label: {body}\n        body: {body}")
        for body in ("worn", "slow")
    )
    path.write_text(
        STUDY.replace(row, rows)
        .replace("[calm, loaded]", "[calm_slow, loaded]")
        .replace("        first_no_worse_than: calm\n", "")
        .replace("controller: {kind: constant_curvature}", "controller: {kind: forward_jacobian}")
    )
    calm = tmp_path / "calm.yaml"
    calm.write_text(calm.read_text() + "pretraining: {waypoints: 5}\n")
    models = _one_for_each_model(plan(load_study(path), 1, 0))
    assert len(models) == 1
