"""A body of a package that fails while the robot moves: HOLD, with its name in the reason."""

import asyncio
from pathlib import Path

import pytest
import yaml

from daemon.commands.terminal.command_line import main
from daemon.messages import Resume
from safety.causes import Cause
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.plugins.packages import OPTIONS
from tests.daemon.service.rig import Rig, on_a_rig
from tests.installed_package import installed, write_package

WHOSE = "the plant 'mine' of other_people 1.2"
PLANT = '''
import os

import numpy as np

from drivers.pose import Pose
from sim_backends.plants.plant import BodyState


class Plant:
    """A stick whose tip the first two pistons push aside, until a file says that it breaks."""

    actuator_count = 6

    def reset(self):
        pass

    def step(self, actuators, load, dt_s):
        tip = np.array([0.5 * actuators[0], 0.5 * actuators[1], 190.0])
        line = np.linspace(np.zeros(3), tip, 5)
        state = BodyState(line, Pose(tip, np.array([1.0, 0.0, 0.0, 0.0])), np.zeros(6), 5.0)
        if os.path.exists({broken!r}):
            {does}
        return state


def make(options, robot):
    return Plant()
'''
DEFECTS = {
    "raises": ("raise ZeroDivisionError('stiffness')", "ZeroDivisionError: stiffness"),
    "ends the process": ("raise SystemExit(3)", "SystemExit: 3"),
    "nothing": ("return None", "it gave no BodyState, but None"),
    "not a number": (
        "return state._replace(actuator_forces=np.full(6, np.nan))",
        "its force is not a number",
    ),
    "wrong shape": (
        "return state._replace(actuator_forces=np.zeros(5))",
        "its actuator_forces have the shape (5,)",
    ),
}
STILL = {"kind": "hold", "position_mm": [0.0, 0.0, 190.0], "duration_s": 60.0}


def robot_and_package(folder: Path, does: str) -> tuple[Path, Path, Path]:
    """The robot file, where the package is, and the file that breaks it."""
    broken = folder / "broken"
    source = PLANT.format(broken=str(broken), does=does)
    points = {"tentacled.plants": {"mine": "other_people.kinds:BODY"}}
    modules = {"kinds": OPTIONS, "maker": source}
    site = write_package(folder / "site", "other_people", modules, points)
    values = yaml.safe_load(SOFT_ARM.read_text())
    values["emulation"]["plant"] = {"kind": "mine"}
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(values))
    return path, site, broken


@pytest.mark.parametrize(("does", "told"), DEFECTS.values(), ids=list(DEFECTS))
def test_the_robot_holds_and_goes_on_when_it_is_repaired(
    does: str, told: str, tmp_path: Path
) -> None:
    path, site, broken = robot_and_package(tmp_path, does)

    async def story(rig: Rig) -> None:
        rig.service.dependencies.body_failing = lambda: rig.lab.body.failing
        await rig.running(STILL)
        broken.touch()
        await rig.until_state(OperatingState.HOLD, within_s=0.5)
        (reason,) = rig.service.supervisor.stopped_by
        assert reason.cause is Cause.BODY_FAILED
        assert reason.detail.startswith(f"{WHOSE} failed: ")
        assert told in reason.detail
        await asyncio.sleep(1.0)
        assert rig.state is OperatingState.HOLD
        await rig.refused(Resume)
        broken.unlink()
        await asyncio.sleep(1.0)
        await rig.do(Resume)
        assert rig.in_state(OperatingState.RUNNING)

    with installed(site):
        on_a_rig(story, path=path)


def test_a_failure_of_one_step_holds_it_too(tmp_path: Path) -> None:
    does = f"os.unlink({str(tmp_path / 'broken')!r}); raise ValueError('once')"
    path, site, broken = robot_and_package(tmp_path, does)

    async def story(rig: Rig) -> None:
        rig.service.dependencies.body_failing = lambda: rig.lab.body.failing
        await rig.running(STILL)
        broken.touch()
        await rig.until_state(OperatingState.HOLD, within_s=0.5)
        assert not broken.exists()
        await asyncio.sleep(2.0)
        assert rig.state is OperatingState.HOLD, "until somebody resumes"

    with installed(site):
        on_a_rig(story, path=path)


def test_an_experiment_says_whose_body_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    does = "self.n = getattr(self, 'n', 0) + 1; assert self.n < 250, 'tired'"
    path, site, broken = robot_and_package(tmp_path, does)
    experiment = tmp_path / "still.yaml"
    experiment.write_text(
        f"experiment: still\nrobot: {path}\nlongest_s: 20\n"
        "controller: {kind: constant_curvature}\n"
        "trajectory: {kind: hold, position_mm: [0, 0, 190], duration_s: 15}\n"
    )
    broken.touch()
    with installed(site):
        code = main(["experiment", str(experiment), "--out", str(tmp_path / "out")])
    assert code != 0
    told = capsys.readouterr().err
    assert f"body_failed (body): {WHOSE} failed: AssertionError: tired" in told
