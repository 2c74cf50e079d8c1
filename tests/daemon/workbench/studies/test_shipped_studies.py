"""The shipped studies are sound, and ask for what the papers did."""

from importlib.resources import files
from pathlib import Path

import pytest

from config.tasks.controllers import RewardWeighted
from config.tasks.trajectory import Pointed, Rectangle, Waypoints
from daemon.commands.terminal.study_command import shipped_study
from daemon.reference.trajectories import make_trajectory
from daemon.workbench.studies.findings import cycles_of
from daemon.workbench.studies.run import plan
from daemon.workbench.studies.study_file import StudyFile, load_study
from daemon.workbench.studies.worker import as_asked

SHIPPED = sorted(Path(str(files("config") / "studies")).glob("*.yaml"))


@pytest.fixture(scope="module")
def ho2018() -> StudyFile:
    return load_study(shipped_study("ho2018"))


def paths(study: StudyFile, part: str) -> list[Pointed]:
    """Of the experiments that have this in their name; there are some."""
    found = [file.experiment.trajectory for name, file in study.experiments.items() if part in name]
    assert found
    return found


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_study_is_sound_and_goes_by_its_name(path: Path) -> None:
    file = load_study(path)
    assert file.study.study == path.stem
    assert shipped_study(path.stem) == path
    assert plan(file, 1, 1)
    for name, row in file.rows.items():
        told = row.published
        figures = [] if told is None else [told.mean_mm, told.std_mm, told.max_mm]
        figures += [] if row.aim_mm is None else [row.aim_mm]
        assert {len(one) for one in figures} <= {cycles_of(file.experiments[name])}


def test_another_path_is_meant_itself() -> None:
    assert shipped_study("my/own.yaml") == Path("my/own.yaml")


def test_whether_a_path_can_be_followed_is_asked_alike_for_all_variants() -> None:
    asked: dict[str, set[str]] = {}
    for run in plan(load_study(shipped_study("bench")), 1, 0):
        asked.setdefault(run.experiment, set()).add(repr(as_asked(run).experiment))
    assert {len(one) for one in asked.values()} == {1}


def test_both_rectangles_are_gone_round_at_the_papers_speed(ho2018: StudyFile) -> None:
    for path in paths(ho2018, "table"):
        assert isinstance(path, Rectangle)
        speed_mm_s = 2.0 * (path.width_mm + path.height_mm) / path.cycle_s
        assert speed_mm_s == pytest.approx(1.875, rel=1e-3)


def test_what_is_left_before_the_start_is_asked_of_the_first_rectangles_first_point(
    ho2018: StudyFile,
) -> None:
    rectangle = ho2018.experiments["ho2018_table1_offline"]
    first_mm = make_trajectory(rectangle.experiment.trajectory, rectangle.path.parent).start_mm
    for path in paths(ho2018, "standing"):
        assert isinstance(path, Waypoints)
        assert [place for _, *place in path.points or []] == [first_mm.tolist()] * 2


@pytest.mark.parametrize("how", ["offline_filling", "online"])
def test_water_is_poured_in_from_the_third_and_the_fourth_cycle(
    ho2018: StudyFile, how: str
) -> None:
    experiment = ho2018.experiments[f"ho2018_table2_{how}"].experiment
    assert experiment.tip_load_g == 14.0
    poured = [(one.at_cycle, one.tip_load_g, one.fill_g_s) for one in experiment.happenings]
    assert poured == [(2, 24.0, 0.6), (3, 30.0, 0.6)]


def test_only_what_is_said_to_learn_learns_and_the_models_never_felt_a_load(
    ho2018: StudyFile,
) -> None:
    for name, file in ho2018.experiments.items():
        controller, pretraining = file.experiment.controller, file.experiment.pretraining
        assert isinstance(controller, RewardWeighted)
        assert controller.learning == ("online" in name)
        assert pretraining is not None
        expected = (320, 550) if "table2" in name else (80, 425)
        assert (pretraining.waypoints, controller.window) == expected
