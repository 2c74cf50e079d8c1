"""A running daemon, and a controller of an installed package that does everything wrong: each time
the reason has its name, and the robot holds."""

import os
from collections.abc import Iterator
from typing import Final

import pytest

from safety.states import OperatingState
from tests.daemon.plugins.defective import HELD, LATE, REFUSED, package
from tests.hil.daemon_rig import CIRCLE, PATIENT, Rig, robot_file, short_folder

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("ten_defects")]

S = OperatingState
ATTEMPTS: Final = 5
STOPS_IT: Final = "controller_failed"


@pytest.fixture(scope="module")
def one() -> Iterator[Rig]:
    """With the package on its path."""
    with short_folder() as folder, pytest.MonkeyPatch.context() as patch:
        paths = [str(package(folder / "site")), os.environ.get("PYTHONPATH", "")]
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
        made = Rig(folder, robot_file(folder, PATIENT))
        try:
            yield made
        finally:
            made.leave()


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused(one: Rig, name: str) -> None:
    defect = REFUSED[name]
    one.armed()
    refusal = one.user.refused(one.client.load(CIRCLE, defect.controller))
    assert refusal.name == "bad_controller"
    assert defect.whose in refusal.text
    assert defect.told in refusal.text
    assert one.state is S.ARMED


@pytest.mark.parametrize("name", [*HELD, *LATE])
def test_what_it_does_wrong_meanwhile_holds_the_robot(one: Rig, name: str) -> None:
    """On a busy machine something else may be late before: then once more."""
    defect = (HELD | LATE)[name]
    for _ in range(ATTEMPTS):
        one.armed()
        one.user.do(one.client.load(CIRCLE, defect.controller))
        one.from_now_on()
        one.user.do(one.client.start())
        one.until_it_was(S.HOLD, S.FAULT)
        if told := one.events("cause", STOPS_IT):
            break
    assert defect.whose in told[0].detail
    assert defect.told in told[0].detail
    assert one.state is S.HOLD
    assert one.energised
    before = one.actuators()
    assert one.actuators() == pytest.approx(before, abs=0.02)
