"""Whoever starts processes that are waited for has their kernels compiled before."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from config.loader import load_robot
from daemon.commands.outcome.exit_codes import EXIT_INTERNAL
from daemon.commands.terminal import compiled
from daemon.commands.terminal.command_line import main
from tests import SHIPPED_ROBOTS, SOFT_ARM

NOTHING_LEFT = """
import sys
from numba.core import event
from pathlib import Path
from config.loader import load_robot
from daemon.commands.terminal.compiled import compile_all
from daemon.controllers.make_controller import warm_up
from daemon.host import compilation
from daemon.host.clock import MonotonicClock
from sim_backends.lab.lab import Lab

file = load_robot(Path(sys.argv[1]))
compile_all(file)
told = []

class Ear:
    def begin(self, what, total, done=0.0): told.append(what)
    def reach(self, done, total=0.0, what=""): pass

with compilation.compilation_told(Ear()):
    warm_up()
    lab = Lab(file.robot, file.path, MonotonicClock())
    for step in range(1, 4):
        lab.body.advance(lab.body.advanced_ns + 25_000_000)
    lab.set_tip_load(14.2)
    lab.body.advance(lab.body.advanced_ns + 25_000_000)
print(told)
"""

EXPERIMENT = """
experiment: circle
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 8, cycle_s: 3}
controller: {kind: constant_curvature}
"""


@pytest.mark.parametrize("robot", ["soft_arm", "tendon_arm"])
def test_a_lab_and_a_daemon_find_everything_compiled(robot: str) -> None:
    found = subprocess.run(
        [sys.executable, "-c", NOTHING_LEFT, str(SHIPPED_ROBOTS / f"{robot}.yaml")],
        capture_output=True,
        text=True,
        check=True,
        env=dict(os.environ),
    )
    assert found.stdout.strip() == "[]"


def test_a_robot_whose_lab_cannot_be_is_left_to_who_starts_it() -> None:
    file = load_robot(SOFT_ARM)
    without = file.robot.model_copy(update={"emulation": None})
    compiled.compile_all(type(file)(file.path, without, file.document))


class BeganError(Exception):
    """The processes are started."""


@pytest.mark.parametrize("command", ["experiment", "explore"])
def test_in_real_time_it_is_done_before_the_lab_is_started(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    done: list[str] = []

    def begin(*_: object, **__: object) -> None:
        done.append("started")
        raise BeganError

    monkeypatch.setattr(compiled, "compile_all", lambda _: done.append("compiled"))
    monkeypatch.setattr("daemon.commands.workbench.experiment.compile_all", compiled.compile_all)
    where = "daemon.workbench.experiments.in_real_time.carry_out_in_real_time"
    monkeypatch.setattr(where, begin)
    monkeypatch.setattr("daemon.workbench.pretraining.explore.carry_out_in_real_time", begin)
    (tmp_path / "circle.yaml").write_text(EXPERIMENT)
    words = {
        "experiment": [str(tmp_path / "circle.yaml"), "--out", str(tmp_path / "run")],
        "explore": [str(SOFT_ARM), "--out", str(tmp_path / "data.npz"), "--waypoints", "1"],
    }[command]
    assert main([command, *words, "--real-time"]) == EXIT_INTERNAL
    assert "BeganError" in capsys.readouterr().err
    assert done == ["compiled", "started"]
