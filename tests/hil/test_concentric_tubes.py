"""The tubes as they are shipped, from homing to the report and through what goes wrong, as
processes.

The same in virtual time is in tests/daemon/service/test_concentric_tubes.py.
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import yaml

from daemon.messages import Event
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from daemon.remote.client.client_errors import RefusedError
from daemon.robot.lab_connections import ask
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.steering.scripted import DEAD_MAN, LET_GO
from tests.hil.daemon_rig import Rig, short_folder
from tests.hil.processes import run
from tests.hil.test_steering import LED_MM, by_hand, tip, until_held, until_led_on

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("concentric_tubes")]

S = OperatingState
TUBES: Final = SOFT_ARM.with_name("concentric_tubes.yaml")
CIRCLE: Final = {
    "kind": "circle",
    "center_mm": [45.0, 0.0, 180.0],
    "radius_mm": 12.0,
    "cycle_s": 10.0,
}
BY_HAND: Final = {
    "kind": "learned_kinematics",
    "model": "builtin:concentric_tubes_pose.npz",
    "damping_mm": 2.0,
}
BROYDEN: Final = {"kind": "broyden", "settle_s": 0.3}
ROUND_WITHIN_S: Final = 120.0
SNAPS_BEYOND_RAD: Final = 3.22
"""With 3.5 mm of the inner tube out: where its curve stands against that of the pair."""

Robot = dict[str, Any]


def patient(folder: Path, change: Callable[[Robot], None]) -> Path:
    """The shipped file, changed, for a machine that gives nobody a turn for a moment."""
    robot = yaml.safe_load(TUBES.read_text())
    robot["buses"]["can0"] |= {"cycle_period_s": 0.02, "master_heartbeat_timeout_s": 2.0}
    robot["supervision"] |= {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
    robot["emulation"]["patience_s"] = 1.5
    for axis in robot["axes"]:
        if axis["kind"] == "tube_rotation":
            axis["following_error_rad"] = 0.12
    change(robot)
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path


@contextmanager
def tubes(change: Callable[[Robot], None] = lambda robot: None) -> Iterator[Rig]:
    with short_folder() as folder:
        one = Rig(folder, patient(folder, change))
        try:
            yield one
        finally:
            one.leave()


def without_zeros(robot: Robot) -> None:
    """Encoders lose their zeros with their power."""
    for axis in robot["axes"]:
        axis["homing"] = axis.get("homing", {}) | {"referenced": "home_at_start"}


def homed(one: Rig) -> None:
    """All that do not know their zeros look for them."""
    with suppress(RefusedError):
        one._acquire()
        if one.state in (S.FAULT, S.ESTOP):
            one.user.do(one.client.clear())
        one.user.do(one.client.home([], 60.0))


def goes_round(one: Rig) -> None:
    """Until the first motions are over, and the tip follows the circle."""
    deadline_s = time.monotonic() + ROUND_WITHIN_S
    while (reference := one.status().reference) is None or reference.cycle < 0 or reference.note:
        assert time.monotonic() < deadline_s, f"{one.state}, {one.status().reasons}"
        if "not_referenced" in one.causes():  # a drive that was missed for a moment
            homed(one)
        if one.state in (S.READY, S.ARMED, S.FAULT, S.STANDBY):
            one.armed()
            with suppress(RefusedError):
                one.user.do(one.client.load(CIRCLE | {"cycles": 20}, BROYDEN))
                one.user.do(one.client.start())
        elif one.state is S.HOLD:  # of a machine that was busy for a moment
            one.resumed()
        time.sleep(0.1)
    one.from_now_on()


def stands(one: Rig) -> None:
    """No tube goes on, and none unwinds."""
    time.sleep(0.5)
    before = one.actuators()
    time.sleep(1.5)
    assert one.actuators() == pytest.approx(before, abs=2e-3)


def seen(recorded: Path, topic: str) -> list[dict[str, Any]]:
    """What was told of it."""
    reader = RunReader(recorded / RUN_FILE)
    return [json.loads(message.data) for message in reader.messages([topic])]


def test_a_day_from_homing_to_the_report() -> None:
    with tubes(without_zeros) as one:
        one.until(lambda: one.causes() == {"not_referenced"})
        one._acquire()
        answer = one.user.do(one.client.home([], 60.0))
        names = [axis.name for axis in one.status().axes]
        assert sorted(answer.text.removeprefix("homed: ").split(", ")) == sorted(names)
        one.until_state(S.READY)
        goes_round(one)
        one.user.do(one.client.hold())
        one.until_state(S.HOLD)
        stands(one)
        assert one.energised
        one.resumed()
        before = one.actuators()
        one.until(lambda: max(np.abs(np.subtract(one.actuators(), before))) > 0.2)
        one.until(lambda: (r := one.status().reference) is not None and r.cycle >= 1, 60.0)
        one.user.do(one.client.stop())
        one.until_without_torque()
        stands(one)
        status = one.status()
        assert [axis.unit for axis in status.axes] == ["rad"] * 3 + ["mm"] * 2
        one.until(lambda: one.status().recording is None, 30.0)
        recorded = max((one.folder / "runs").iterdir())
        errors = [t["error_mm"] for t in seen(recorded, "/tip") if t.get("cycle", -1) >= 0]
        assert float(np.median(errors)) < 2.0
        report = run("report", str(recorded))
        assert report.returncode == 0, report.stderr
        assert "rotation_1" in (recorded / "report.html").read_text()


@pytest.mark.parametrize(
    ("fault", "cause", "subject"),
    [
        ("drive.can0/2.dead=6s", "node_lost", "can0/2"),
        ("drive.can0/5.blocked=8s", "drive_following_error", "carriage_inner"),
    ],
)
def test_one_that_is_dead_or_blocked_is_named_all_are_held_and_it_goes_on(
    fault: str, cause: str, subject: str
) -> None:
    with tubes() as one:
        goes_round(one)
        one.inject(fault)
        told = one.until_told(cause)
        assert subject in told.subject
        one.until_it_was(S.FAULT)
        stands(one)
        time.sleep(8.0)
        goes_round(one)
        assert one.works, "nothing was started again"


def test_a_hand_leads_the_tubes_and_turns_their_tip_and_stop_ends_it() -> None:
    with (
        tubes() as one,
        by_hand(one, "--pointing", controller=json.dumps(BY_HAND)) as (_, puck),
    ):
        until_held(one)
        begin = tip(one)
        puck.key(DEAD_MAN)
        puck.push(0, 0, 0, 0, 350)
        until_led_on(one)
        before = list(one.actuators())
        one.until(lambda: max(np.abs(np.subtract(one.actuators(), before))) > 0.1)
        puck.push(0, 350)
        one.until(lambda: abs(tip(one)[1] - begin[1]) > LED_MM)
        assert one.works
        one.from_now_on()
        puck.key(LET_GO)
        until_held(one)
        stands(one)
        puck.key(DEAD_MAN)
        until_led_on(one)
        one.user.do(one.client.stop())
        one.until_without_torque()
        stands(one)


def nearly_snapping(robot: Robot) -> None:
    """The inner tube is drawn in, and by hand (`sway`) only it is turned, to where the tubes are
    about to snap; nobody guards what they may do together."""
    travels = {
        "rotation_1": [-0.02, 0.02],
        "rotation_2": [-0.02, 0.02],
        "rotation_3": [-6.2832, 2.5 * SNAPS_BEYOND_RAD],
        "carriage_pair": [-0.04, 0.04],
        "carriage_inner": [-53.0, -50.0],
    }
    for axis in robot["axes"]:
        axis[f"travel_{'rad' if 'rotation' in axis['name'] else 'mm'}"] = travels[axis["name"]]
    robot.pop("coupled_limits", None)


def turned_by_hand(one: Rig) -> None:
    """To where the play turns round, which is where it is slow."""
    ask(one.folder, {"do": "play", "name": "sway"})
    one.until(lambda: one.actuators()[2] > SNAPS_BEYOND_RAD - 0.02)
    ask(one.folder, {"do": "play", "name": None})
    assert ask(one.folder, {"do": "state"})["snaps"] == 0


def test_tubes_that_snap_are_named_and_held_and_nothing_is_started_again() -> None:
    with tubes(nearly_snapping) as one:
        turned_by_hand(one)
        where = list(one.status().tip_mm or [])
        one.armed()
        one.from_now_on()
        wait = {"kind": "hold", "position_mm": where, "duration_s": 60.0}
        one.user.do(one.client.load(wait, BROYDEN | {"explore_share": 0.25}))
        one.user.do(one.client.start())
        one.until(lambda: ask(one.folder, {"do": "state"})["snaps"] > 0, 60.0)
        told = one.until_told("tip_jumped")
        assert 5.0 < float(told.detail.split()[0]) < 20.0
        one.until_it_was(S.HOLD)
        one.until(lambda: bool(one.events("note", "snapped")))
        stands(one)
        assert one.energised, "held, and not let go"
        one.user.do(one.client.stop())
        one.until_without_torque()
        one.armed()
        assert one.works
        events = [told for told in one.user.told if isinstance(told, Event)]
        assert not [e for e in events if e.name == "internal_error"]
