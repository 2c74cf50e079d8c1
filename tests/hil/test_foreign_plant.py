"""A body of a package that fails while a running daemon moves it: HOLD, and the reason names it.

The same in virtual time is in tests/daemon/plugins/test_foreign_plant.py.
"""

import os
from pathlib import Path

import pytest
import yaml

from safety.states import OperatingState
from tests.daemon.plugins.test_foreign_plant import DEFECTS, STILL, WHOSE, robot_and_package
from tests.hil.daemon_rig import MODEL, Rig, short_folder

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("foreign_plant")]

S = OperatingState
ATTEMPTS = 5


def test_the_robot_holds_with_the_name_of_whose_body_it_is() -> None:
    does, told = DEFECTS["raises"]
    with short_folder() as folder, pytest.MonkeyPatch.context() as patch:
        path, site, broken = robot_and_package(folder, does)
        paths = [str(site), os.environ.get("PYTHONPATH", "")]
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
        one = Rig(folder, patient(path))
        try:
            held(one, broken)
            detail = one.events("cause", "body_failed")[0].detail
            assert f"{WHOSE} failed: {told}" in detail
            assert one.state is S.HOLD
            assert one.energised
        finally:
            one.leave()


def held(one: Rig, broken: Path) -> None:
    """By its body. On a busy machine something else may be late before: then once more."""
    for _ in range(ATTEMPTS):
        broken.unlink(missing_ok=True)
        one.armed()
        one.user.do(one.client.load(STILL, MODEL))
        one.user.do(one.client.start())
        one.until_state(S.RUNNING)
        one.from_now_on()
        broken.touch()
        one.until(lambda: one.state is not S.RUNNING)
        one.until(lambda: bool(one.events("cause", "body_failed")))
        if one.state is S.HOLD:
            return


def patient(path: Path) -> Path:
    """The same robot for a machine that gives nobody a turn for a moment."""
    robot = yaml.safe_load(path.read_text())
    robot["buses"]["can0"] |= {"cycle_period_s": 0.02, "master_heartbeat_timeout_s": 2.0}
    robot["supervision"] |= {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
    path.write_text(yaml.safe_dump(robot))
    return path
