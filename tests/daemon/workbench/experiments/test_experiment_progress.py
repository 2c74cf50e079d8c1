"""An experiment and an exploration say how far they are: each part for itself, to its end."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from config.tasks.exploration import WaypointExploration
from daemon.commands.terminal.progress_line import ProgressLine
from daemon.commands.terminal.study_command import _Told
from daemon.learning.forward.pretraining import EpochErrors, PretrainingSettings
from daemon.robot.checked_robot import check_robot
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.pretraining.explore import explore
from daemon.workbench.pretraining.model_cache import epochs_told
from daemon.workbench.studies.run import Run
from tests import SOFT_ARM

CIRCLE = """
experiment: circle
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 8, cycle_s: 3, cycles: 2}
controller: {kind: constant_curvature}
"""


@dataclass
class Part:
    what: str
    total: float
    reached: list[float] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


class Ear:
    """A `Progress` that remembers."""

    def __init__(self) -> None:
        self.parts: list[Part] = []

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        self.parts.append(Part(what, total, [done]))

    def advance(self, by: float = 1.0) -> None:
        self.reach(self.parts[-1].reached[-1] + by)

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        part = self.parts[-1]
        part.total = total or part.total
        part.reached.append(done)
        part.said.append(what)


def test_an_experiment_says_what_it_does_and_how_far_along_the_trajectory_it_is(
    tmp_path: Path,
) -> None:
    (tmp_path / "circle.yaml").write_text(CIRCLE)
    run, ear = tmp_path / "run", Ear()
    run.mkdir()
    file = load_experiment(tmp_path / "circle.yaml")
    carry_out_in_virtual_time(file, 1, run, lambda _: None, progress=ear)
    assert [(part.what, part.total) for part in ear.parts] == [
        ("getting ready", 0.0),
        ("circle: on the way to its start", 0.0),
        ("circle: following", 6.0),
    ]
    followed = ear.parts[-1].reached
    assert followed == sorted(followed)
    assert followed[0] < 0.2
    assert followed[-1] == pytest.approx(6.0, abs=0.1)


def test_an_exploration_counts_its_lines(tmp_path: Path) -> None:
    options = WaypointExploration(kind="waypoint_exploration", waypoints=3, travel_share=0.2)
    ear = Ear()
    explore(check_robot(SOFT_ARM).file, options, 1, tmp_path, lambda _: None, progress=ear)
    lines = next(part for part in ear.parts if part.total == 3.0)
    assert [what for what in dict.fromkeys(lines.said) if what] == [
        f"exploration: line {number} of 3" for number in (1, 2, 3)
    ]
    assert lines.reached[-1] == 3.0


def test_a_pretraining_tells_its_epochs() -> None:
    ear = Ear()
    told = epochs_told(PretrainingSettings(epochs=4), ear)
    for epoch in (1, 2, 3, 4):
        told(EpochErrors(epoch, 1.0, 1.0, 1.0))
    assert (ear.parts[0].what, ear.parts[0].total) == ("learning", 4.0)
    assert ear.parts[0].reached == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_study_tells_models_first_and_then_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Line(ProgressLine, Ear):
        """Remembers, and tells what is to stay."""

        def __init__(self) -> None:
            ProgressLine.__init__(self)
            Ear.__init__(self)

        begin, advance, reach = Ear.begin, Ear.advance, Ear.reach

    (tmp_path / "circle.yaml").write_text(CIRCLE)
    file = load_experiment(tmp_path / "circle.yaml")
    run = Run("circle", "constant_curvature", 0, 1, file)
    line = Line()
    told = _Told(line)
    told.begin(3, 2, 4)
    told.model(run, "")
    told.model(run, "no motion")
    for number in range(4):
        told.run(run, None, "" if number else "it broke")
    models, runs = line.parts
    assert (models.what, models.total, models.reached) == ("models to begin with", 2.0, [0, 1, 2])
    assert (runs.what, runs.total) == ("runs: 3 of 7 done", 7.0)
    assert runs.said[-1] == "runs: 7 of 7 done"
    assert runs.reached == [3, 4, 5, 6, 7]
    assert told.errors == 2
    shown = capsys.readouterr()
    assert len(shown.out.splitlines()) == 7
    assert shown.err == ""
