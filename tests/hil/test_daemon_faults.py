"""Every cause that can be brought about from outside: what is told, what the drives do, what helps.

Lab and daemon are processes of their own, and the client is on their remote API. The same causes in
virtual time are in tests/daemon/service.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Final

import pytest

from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import RefusedError
from daemon.robot.lab_connections import ask
from safety.causes import Cause, Severity, cause
from safety.states import OperatingState
from tests.hil.daemon_rig import (
    MODEL,
    PATIENT,
    Rig,
    farthest,
    rig,
)
from tests.hil.processes import PATIENCE_S

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("daemon_faults")]

S = OperatingState

TIMES: Final = {
    "loop_hold_after_s": 0.4,  # a machine that stands still is no news here
    "loop_fault_after_s": 0.7,
    "tracker_hold_after_s": 0.3,
    "tracker_fault_after_s": 2.0,
    "lease_s": 1.0,
    "lease_disarm_after_s": 3.0,
    "arm_within_s": 1.0,
}
STANDS_WITHIN_MM: Final = 0.1

NOT_FROM_OUTSIDE: Final = {
    "real_time_degraded": "what a machine permits is not ours to change",
    "drive_limit": "the gate keeps targets inside the drives' own limits",
    "recording_dropped": "8 MiB have to wait first; tests/hil/test_recording.py has it",
    "not_recorded": "tests/daemon/service/operation/test_run_recording.py kills each recorder",
    "disk_full": "nine tenths of what a robot asks for would have to be filled",
    "gate_refused": "trajectories out of reach are refused; a model asks for little beyond them",
    "body_failed": "no shipped plant does that: tests/hil/test_foreign_plant.py has one that does",
    "controller_failed": "no shipped controller fails on what can be asked of it from outside",
    "tip_jumped": "the soft arm does not snap: tests/hil/test_concentric_tubes.py has it",
    "tracking_diverges": "a controller that is wired wrongly: tests/daemon/service",
    "not_referenced": "the soft arm's encoders keep their zeros: see service/test_homing.py",
    "body_not_as_modelled": "the soft arm has no model of its body; "
    "tests/daemon/service/test_body_not_as_modelled.py has it",
    "minute_risk_too_high": "the soft arm has no model of its body; "
    "tests/daemon/service/test_risk_of_the_path.py has it",
    "giving_way": "the soft arm has no model of its body; "
    "tests/daemon/service/test_giving_way.py has it",
    "near_at_rest": "the soft arm has no model of its body; "
    "tests/daemon/service/test_giving_way.py has it",
    "kept_away": "the soft arm has no model of its body; "
    "tests/daemon/service/test_giving_way.py has it",
    "path_risk_too_high": "the soft arm has no model of its body; "
    "tests/daemon/service/test_risk_of_the_path.py has it",
    "obstacles_late": "the soft arm has no model of its body; "
    "tests/hil/test_changing_surroundings.py has it",
    "tendon_slack": "the soft arm has no tendons",
    "tendon_over_tension": "the soft arm has no tendons",
    "internal_error": "it would be a defect",
}

Act = Callable[[Rig], None]


@dataclass(frozen=True)
class Row:
    """While the robot goes round a circle, something happens to it."""

    cause: str
    act: Act
    name: str
    resumes: bool = True
    """A HOLD that ends with the robot going on. Where it does not, worse follows."""


def fault(cause: str, order: str, *, resumes: bool = True) -> Row:
    """At an emulated device."""

    def act(one: Rig) -> None:
        one.inject(order)

    return Row(cause, act, order, resumes)


def frozen(seconds: float) -> Act:
    """The daemon does nothing for so long."""

    def act(one: Rig) -> None:
        os.kill(one.daemon.pid, signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            os.kill(one.daemon.pid, signal.SIGCONT)

    return act


def stuttering(one: Rig) -> None:
    """The daemon gets its turn now and then."""
    deadline_s = time.monotonic() + 10.0
    while not one.events("cause", "loop_slow") and time.monotonic() < deadline_s:
        frozen(0.03)(one)
        time.sleep(0.03)


def heavy_tip(one: Rig) -> None:
    """Somebody hangs far too much on the tip, and takes it away again."""
    ask(one.folder, {"do": "load", "tip_load_g": 100.0})
    try:
        one.until_told("out_of_workspace")
    finally:
        ask(one.folder, {"do": "load", "tip_load_g": 0.0})


def unplugged_and_plugged(one: Rig) -> None:
    one.inject("tracker.unplug_tool")
    time.sleep(1.0)
    one.inject("tracker.plug_tool")


def lease_not_renewed(one: Rig) -> None:
    one.user.stop_renewing()


def operator_holds(one: Rig) -> None:
    one.user.do(one.client.hold())


WHILE_RUNNING: Final = (
    fault("tracker_warning", "tracker.partially_out_of_volume=1.5s"),
    fault("tracker_late", "tracker.missing=0.8s"),
    fault("tracker_quality", "tracker.missing=1.2s"),
    fault("tracker_late", "tracker.hang_up=1s", resumes=False),
    fault("tracker_late", "tracker.frozen=1s"),
    fault("tracker_late", "tracker.reset", resumes=False),
    Row("tracker_late", unplugged_and_plugged, "tool unplugged and plugged", resumes=False),
    fault("tracker_gone", "tracker.missing=3s"),
    fault("bus_degraded", "bus.can0.passive=1s"),
    fault("foreign_master", "bus.can0.foreign_master=1s"),
    fault("foreign_master", "bus.can0.foreign_master=1s,nmt"),
    fault("bus_queue_full", "bus.can0.full=3s", resumes=False),
    fault("bus_gone", "bus.can0.unplug=0.5s"),
    fault("bus_off", "bus.can0.down=0.5s"),
    fault("bus_off", "bus.can0.off"),
    fault("drive_warning", "drive.can0/3.warning=1s"),
    fault("drive_emergency", "drive.can0/2.short_emergency=0x7121"),
    fault("drive_fault", "drive.can0/2.emergency=0x7121"),
    fault("drive_fault", "drive.can0/1.over_temperature=1s"),
    fault("drive_following_error", "drive.can0/2.blocked=6s"),
    fault("drive_not_enabled", "drive.can0/5.power_cycle=0.5s"),
    fault("drive_no_voltage", "drive.can0/3.sto=1s"),
    fault("node_lost", "drive.can0/1.dead=1s"),
    fault("node_lost", "drive.can0/1.tpdo_stop=1s"),
    fault("node_lost", "drive.can0/3.heartbeat_stop=1s"),
    fault("node_reset", "drive.can0/6.reset"),
    Row("loop_slow", stuttering, "frozen again and again"),
    Row("out_of_workspace", heavy_tip, "a weight pulls the tip away"),
    Row("loop_stalled", frozen(0.9), "frozen for 0.9 s"),
    Row("lease_lost", lease_not_renewed, "the lease is not renewed"),
    Row("operator_hold", operator_holds, "the operator holds"),
)
"""What is not in this table has a test of its own below."""

ALONE: Final = {
    "tracker_not_ready",
    "node_not_ready",
    "drive_settings_changed",
    "bus_not_open",
    "arming_failed",
    "recorder_failed",
    "disk_low",
    "lease_abandoned",
    "setpoint_late",
    "loop_late",
    "risk_too_high",
    "risk_unavailable",
}


class Place:
    """One rig for many rows, made anew where a row has broken it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._rig: Rig | None = None

    def rig(self) -> Rig:
        if self._rig is None or not self._rig.works:
            self.close()
            self._rig = self._stack.enter_context(rig(PATIENT, TIMES))
        return self._rig.without_faults()

    def close(self) -> None:
        self._rig = None
        self._stack.close()


@pytest.fixture(scope="module")
def place() -> Iterator[Place]:
    one = Place()
    try:
        yield one
    finally:
        one.close()


@pytest.fixture
def robot(place: Place) -> Rig:
    return place.rig()


def test_every_cause_is_brought_about_or_it_is_said_why_not() -> None:
    names = {row.value for row in Cause}
    here = {row.cause for row in WHILE_RUNNING} | ALONE
    assert here | NOT_FROM_OUTSIDE.keys() == names
    assert not here & NOT_FROM_OUTSIDE.keys()


def assert_told(one: Rig, name: str) -> None:
    """Name, severity and text are those of the table."""
    told = one.until_told(name)
    assert told.text == cause(name).text
    assert told.severity == cause(name).severity.name.lower()


@pytest.mark.parametrize("row", WHILE_RUNNING, ids=lambda row: f"{row.cause}-{row.name}")
def test_while_running(robot: Rig, row: Row) -> None:
    robot.running()
    row.act(robot)
    assert_told(robot, row.cause)
    severity = cause(row.cause).severity
    if severity is Severity.WARNING:
        goes_on(robot)
    elif severity is Severity.HOLD and row.resumes:
        holds(robot)
        robot.resumed()
    elif severity is Severity.HOLD:
        robot.until_it_was(S.HOLD, S.STANDBY, S.FAULT)
        is_armed_again(robot, severity)
    else:
        switches_off(robot, severity)
        is_armed_again(robot, severity)


def test_a_setting_that_was_changed_behind_our_back_keeps_the_drives_off(robot: Rig) -> None:
    robot.armed()
    robot.user.do(robot.client.stop())
    robot.ready()
    robot.from_now_on()
    robot.inject("drive.can0/3.setting=0x6085,0,1")
    refused = robot.user.refused(robot.client.arm())
    assert refused.name == "settings_differ"
    assert refused.text.startswith("can0/3 0x6085:00 (quick stop ramp) reads 1, not ")
    assert_told(robot, "drive_settings_changed")
    robot.armed()


def goes_on(one: Rig) -> None:
    """It moves on, but for a machine that stood still."""
    time.sleep(0.3)
    if not one.events("cause", "loop_late") and not one.events("cause", "node_lost"):
        assert one.state is S.RUNNING
        assert not one.events("state", S.HOLD.value)


def holds(one: Rig) -> None:
    """It says so, and for as long as it does its drives are on and its shafts stand."""
    one.until_it_was(S.HOLD)
    time.sleep(0.2)  # for its ramp
    before = one.actuators()
    time.sleep(0.2)
    after = one.actuators()
    if one.state in (S.HOLD, S.ARMED):
        assert farthest(before, after) < STANDS_WITHIN_MM
        assert one.energised or one.state not in (S.HOLD, S.ARMED)


def switches_off(one: Rig, severity: Severity) -> None:
    """State and drives are as the severity demands; a fault stays until it is cleared."""
    # An open chain is seen by one drive, and the bus may be quicker to tell of a fault.
    wanted = {
        Severity.DISARM: (S.STANDBY,),
        Severity.FAULT: (S.FAULT,),
        Severity.ESTOP: (S.ESTOP, S.FAULT),
    }
    one.until_it_was(*wanted[severity])
    one.until_without_torque()
    if severity >= Severity.FAULT:
        refusal = one.user.refused(one.client.arm())
        assert refusal.name in ("not_ready", "wrong_state", "no_lease")
        assert one.state in (S.FAULT, S.ESTOP)


def is_armed_again(one: Rig, severity: Severity) -> None:
    """As the table promises: by arming, after a clear where it was a fault."""
    cleared = len(one.events("command", "clear"))
    one.armed()
    assert one.state is S.ARMED
    assert one.energised
    if severity >= Severity.FAULT:
        assert len(one.events("command", "clear")) > cleared


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("tracker_not_ready", "tracker.hang_up=1s"),
        ("node_not_ready", "drive.can0/4.dead=1s"),
        ("bus_not_open", "bus.can0.unplug=1s"),
    ],
)
def test_while_ready_what_goes_missing_forbids_arming_until_it_is_back(
    robot: Rig, name: str, order: str
) -> None:
    robot.running()
    robot.ready()
    robot.from_now_on()
    robot.inject(order)
    assert_told(robot, name)
    robot.until_it_was(S.STANDBY)
    refusal = robot.user.refused(robot.client.arm())
    assert refusal.name == "not_ready"
    assert all(reason.remedy for reason in refusal.reasons)
    assert robot.drive_states() <= {"switch on disabled", "unknown"}
    robot.until_state(S.READY)  # nobody has to clear anything
    robot.armed()


def test_a_drive_that_will_not_come_on_ends_the_arming(robot: Rig) -> None:
    robot.running()
    robot.ready()
    robot.from_now_on()
    robot.inject("drive.can0/4.refuses_enable=2.5s")
    refusal = robot.user.refused(robot.client.arm())
    assert refusal.name == "not_armed"
    assert_told(robot, "arming_failed")
    assert "distal_1" in robot.events("cause", "arming_failed")[0].detail
    robot.until_without_torque()
    robot.armed()
    assert robot.energised


def test_an_abandoned_robot_is_held_and_then_switched_off(robot: Rig) -> None:
    robot.running()
    robot.user.stop_renewing()
    assert_told(robot, "lease_lost")
    assert_told(robot, "lease_abandoned")
    switches_off(robot, Severity.DISARM)
    robot.running()


def test_set_points_that_stop_hold_and_new_ones_go_on(robot: Rig) -> None:
    teleoperated(robot)
    here = robot.status().tip_mm
    assert here is not None
    deadline_s = time.monotonic() + 1.0
    while time.monotonic() < deadline_s:
        send(robot, here)
    assert_told(robot, "setpoint_late")
    holds(robot)
    goes_on_with(robot, here)


def teleoperated(one: Rig) -> None:
    one.armed()
    one.user.do(one.client.teleoperate(MODEL))
    one.from_now_on()


def send(one: Rig, position_mm: Sequence[float]) -> None:
    one.user.do(_send(one.client, position_mm))
    time.sleep(0.04)


async def _send(client: RobotClient, position_mm: Sequence[float]) -> None:
    client.send_setpoint(position_mm, valid_s=0.3)


def goes_on_with(one: Rig, position_mm: Sequence[float]) -> None:
    """With fresh set-points, resuming leads on."""
    deadline_s = time.monotonic() + PATIENCE_S
    while one.state is not S.RUNNING:
        assert time.monotonic() < deadline_s, f"{one.state}, {one.causes()}"
        for _ in range(3):
            send(one, position_mm)
        with suppress(RefusedError):
            one.user.do(one.client.resume())
