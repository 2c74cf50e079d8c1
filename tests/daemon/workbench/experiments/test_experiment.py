"""Experiments in virtual time: figures, recording, and the same bytes for the same seed."""

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.documents.problems import ConfigError
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION
from daemon.commands.terminal.command_line import main
from daemon.control.controller import Proposal
from daemon.controllers.constant_curvature import ConstantCurvatureController
from daemon.messages import TELEMETRY
from daemon.recording.format.channels import TIP_POSE, TOPICS
from daemon.recording.result import Result
from daemon.recording.run_reader import RunReader
from daemon.testing.labs import TestLab, TrackingFailed
from daemon.workbench.experiments import in_virtual_time, trial
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.step_statistics import StepSeries
from daemon.workbench.experiments.trial import Trial
from safety.risk_source import RiskReading
from tests.daemon.recording.schemas import recording_contradictions

pytestmark = pytest.mark.xdist_group("experiment")  # whose circle is followed once for all tests

SHIPPED = sorted((Path(__file__).parents[4] / "config" / "experiments").glob("*.yaml"))

CIRCLE = """
experiment: circle
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 6, cycle_s: 3, cycles: 2}
controller: {kind: constant_curvature}
"""


def carry_out(folder: Path, text: str = CIRCLE, seed: int = 1) -> Result:
    folder.mkdir()
    path = folder / "experiment.yaml"
    path.write_text(text)
    run = folder / "run"
    run.mkdir()
    return carry_out_in_virtual_time(load_experiment(path), seed, run, lambda _: None)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The circle's."""
    path = tmp_path / "circle.yaml"
    path.write_text(CIRCLE)
    return path


@pytest.fixture(scope="module")
def circle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Result, Path]]:
    folder = tmp_path_factory.mktemp("experiment") / "circle"
    yield carry_out(folder), folder / "run"


def test_the_table_has_each_cycle_and_the_errors_are_small(circle: tuple[Result, Path]) -> None:
    result, _ = circle
    assert [row.cycle for row in result.cycles] == [0, 1]
    assert all(row.samples == pytest.approx(120, abs=3) for row in result.cycles)
    assert all(0.0 < row.mean_mm < 2.0 for row in result.cycles)
    assert (result.holds, result.refusals, result.faults) == (0, 0, [])
    assert result.simulated


def test_the_result_has_the_truth_and_what_the_controller_cost(
    circle: tuple[Result, Path],
) -> None:
    result, folder = circle
    assert [row.cycle for row in result.true_cycles] == [0, 1]
    assert len(result.drifts) == 2
    assert all(0.0 <= drift < 0.2 for drift in result.drifts)
    assert result.limits is not None
    assert result.limits.distortion_mm is not None
    assert 0.0 < result.limits.noise_mm < result.limits.reading_noise_mm < 1.0
    assert result.computing is not None
    assert result.computing.steps == pytest.approx(result.steps, abs=2)
    assert 0.0 < result.computing.median_ms <= result.computing.p99_ms <= result.computing.max_ms
    steps = StepSeries.load(folder / "steps.npz")
    of_cycles = [row.samples for row in result.cycles]
    assert [int((steps.cycle == number).sum()) for number in steps.cycles] == of_cycles
    # What the controller saw, and where the tip was, are not the same and not far apart.
    apart = np.linalg.norm(steps.tip_mm - steps.true_mm, axis=1)
    assert 0.1 < np.median(apart) < 2.5


def test_the_run_folder_tells_all(circle: tuple[Result, Path]) -> None:
    _, folder = circle
    names = {path.name for path in folder.iterdir()}
    assert names == {"run.mcap", "robot.yaml", "provenance.json", "result.json", "steps.npz"}
    reader = RunReader(folder / "run.mcap")
    topics = {message.topic for message in reader.messages()}
    assert {"/tip", "/axes", "/risk", "/state", "/event", "/raw/tracker", "/raw/can/can0"} <= topics
    assert reader.whole
    assert json.loads((folder / "result.json").read_text())["robot"] == "soft_arm"


def test_every_recorded_message_is_as_its_channel_says(circle: tuple[Result, Path]) -> None:
    _, folder = circle
    counts, found = recording_contradictions(folder / "run.mcap")
    assert found == []
    expected = {*(TOPICS[kind] for kind in TELEMETRY), TIP_POSE, "/raw/tracker", "/raw/can/can0"}
    assert set(counts) == expected, "and nothing of ours went wrong"


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not(
    circle: tuple[Result, Path], tmp_path: Path
) -> None:
    result, _ = circle
    assert carry_out(tmp_path / "again").control_sha256 == result.control_sha256
    other = carry_out(tmp_path / "other", seed=2).control_sha256
    assert len(other) == 64
    assert other != result.control_sha256


def test_loads_and_faults_happen_and_the_motion_goes_on(lab: TestLab, file: Path) -> None:
    happenings: list[dict[str, Any]] = [
        {"at_s": 1.0, "tip_load_g": 20.0, "fill_g_s": 10.0},
        {"at_cycle": 1, "inject": "tracker.missing=0.5s"},
    ]
    run = lab.run(file, happenings=happenings)
    assert run.holds == 1
    assert run.faults[0] == "tracker_late"
    assert run.cycle(2).samples > 0
    events = RunReader(run.folder / "run.mcap").messages(["/event"])
    told = [json.loads(event.data)["text"] for event in events]
    assert "tip load filled up to 20 g at 10 g/s" in told
    assert "tracker.missing=0.5s" in told


def test_a_run_that_is_given_up_leaves_what_it_has_seen(lab: TestLab, file: Path) -> None:
    happenings = [{"at_s": 4.0, "inject": "drive.can0/2.power_cycle=1s"}]
    with pytest.raises(TrackingFailed, match="the robot is fault"):
        lab.run(file, happenings=happenings)
    (result,) = [run.result for run in lab.runs]
    assert [row.cycle for row in result.cycles] == [row.cycle for row in result.true_cycles]
    assert result.cycles[0].samples == pytest.approx(120, abs=3)
    assert result.faults[0] == "node_lost", result.faults


class Wall:
    """Whoever moves touches something."""

    name = "wall"

    def assess(self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int) -> RiskReading:
        moves = list(u_from) != list(u_to)
        return RiskReading(0.9 if moves else 0.0, None, 0.0, self.name, "there is a wall")

    def clearance(self, u: object, risk: float) -> None:
        return None


def test_nobody_arms_before_a_loop_that_waited_for_a_model_is_on_time_again(
    lab: TestLab, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = Trial._load

    async def keeps_the_loop_waiting(trial: Trial) -> None:
        await load(trial)
        service = trial._service
        service.supervisor.cycle(service.dependencies.clock.now_ns(), 0.3, "a model was read")

    monkeypatch.setattr(Trial, "_load", keeps_the_loop_waiting)
    assert lab.run(file).cycle(2).samples > 0


def test_who_is_held_again_and_again_gives_up_and_says_why(
    lab: TestLab, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(in_virtual_time, "risk_source_of", lambda file, clock: Wall())
    run = lab.run(file, may_end_early=True)
    assert re.search(r"held again and again, .*risk_too_high .*a wall", run.problem)
    assert run.holds > 10


def test_who_is_held_by_what_does_not_go_gives_up_and_says_why(
    lab: TestLab, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "_LONGEST_HELD_S", 1.0)
    missing = [{"at_s": 0.5, "inject": "tracker.missing=2.5s"}]
    run = lab.run(file, happenings=missing, may_end_early=True)
    assert re.search(r"held and cannot go on, .*tool_missing", run.problem)


def test_who_waits_for_a_controller_that_is_never_ready_gives_up_and_says_why(
    lab: TestLab, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "_LONGEST_UNREADY_S", 1.0)
    monkeypatch.setattr(ConstantCurvatureController, "ready", property(lambda _: False))
    monkeypatch.setattr(
        ConstantCurvatureController, "propose", lambda _, seen: Proposal(0.0 * seen.targets)
    )
    run = lab.run(file, may_end_early=True)
    assert "the controller constant_curvature has not been ready for 1 s" in run.problem


def test_a_fault_that_no_device_has_is_told_before_anything_begins(
    lab: TestLab, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = r"happenings\[0\]\.inject: .* no fault 'mising' \(did you mean 'missing'\?\)"
    with pytest.raises(ConfigError, match=told):
        lab.run(file, happenings=[{"at_s": 0.5, "inject": "tracker.mising=1s"}])
    file.write_text(CIRCLE + "happenings: [{at_s: 0.5, inject: tracker.mising=1s}]")
    assert main(["experiment", str(file), "--out", str(tmp_path / "out")]) == EXIT_CONFIGURATION
    assert re.search(told, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_another_plant_is_another_body(circle: tuple[Result, Path], tmp_path: Path) -> None:
    text = CIRCLE + "plant: {bending_stiffness_n_mm2: 12000.0}\n"
    assert carry_out(tmp_path / "stiff", text).control_sha256 != circle[0].control_sha256


def test_what_cannot_be_reached_ends_the_experiment_with_the_reason(
    lab: TestLab, file: Path
) -> None:
    with pytest.raises(ConfigError, match="beyond the workspace's x_mm"):
        lab.run(file, trajectory={"radius_mm": 95.0})


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (
            ("radius_mm", "radus_mm"),
            ":4:52: trajectory.radus_mm: unknown key (did you mean 'radius_mm'?)",
        ),
        (("kind: constant_curvature", "kind: magic"), ":5:"),
        (("builtin:soft_arm", "no_such.yaml"), ":3:8: robot: there is no file"),
    ],
)
def test_a_wrong_experiment_file_is_explained(
    tmp_path: Path, change: tuple[str, str], problem: str
) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(CIRCLE.replace(*change))
    with pytest.raises(ConfigError) as raised:
        load_experiment(path)
    assert problem in str(raised.value)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_experiments_are_sound(path: Path) -> None:
    assert load_experiment(path).experiment.experiment == path.stem
