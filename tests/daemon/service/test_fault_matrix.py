"""Every cause in the table: what brings it about, what the robot then does, and how it recovers.

In virtual time, with the real drivers and the devices' real bytes. The same rows with separate
processes, real ports and sockets are in tests/hil.
"""

import asyncio
from dataclasses import dataclass
from io import StringIO
from typing import NoReturn, cast

import pytest
from _pytest.mark import ParameterSet
from rich.console import Console

from daemon.commands.views.status_view import status_view
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.messages import Acquire, Arm, Clear, Disarm, Hold, Inject, Resume, Status
from drivers.cia402.power_state import PowerState
from safety.causes import Severity, cause
from safety.states import OperatingState
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig

S = OperatingState


@dataclass(frozen=True)
class Row:
    """While the robot follows a trajectory, `fault` is injected."""

    cause: str
    fault: str
    within_s: float = 8.0
    recovers_within_s: float = 4.0


WHILE_RUNNING = (
    Row("tracker_late", "tracker.missing=0.6s"),
    Row("tracker_late", "tracker.hang_up=1s"),
    Row("tracker_late", "tracker.frozen=1s"),
    Row("tracker_late", "tracker.reset"),
    Row("tracker_gone", "tracker.missing=5s", recovers_within_s=8.0),
    Row("tracker_warning", "tracker.partially_out_of_volume=2s"),
    Row("foreign_master", "bus.can0.foreign_master=2s"),
    Row("foreign_master", "bus.can0.foreign_master=2s,heartbeat"),
    Row("foreign_master", "bus.can0.foreign_master=2s,nmt"),
    Row("foreign_master", "bus.can0.foreign_master=2s,sdo"),
    Row("foreign_master", "bus.can0.foreign_master=2s,setpoint"),
    Row("drive_settings_changed", "bus.can0.foreign_write=3,0x605A,0,5"),
    Row("bus_gone", "bus.can0.unplug=1s"),
    Row("bus_off", "bus.can0.down=1s"),
    Row("bus_off", "bus.can0.off"),
    Row("bus_degraded", "bus.can0.passive=1s"),
    Row("drive_fault", "drive.can0/2.emergency=0x7121"),
    Row("drive_fault", "drive.can0/1.over_temperature=1s"),
    Row("drive_emergency", "drive.can0/2.short_emergency=0x7121"),
    Row("drive_following_error", "drive.can0/2.blocked=15s", 15.0, 15.0),
    Row("drive_not_enabled", "drive.can0/5.power_cycle=1s"),
    Row("node_lost", "drive.can0/1.dead=2s"),
    Row("node_lost", "drive.can0/1.tpdo_stop=1s"),
    Row("node_lost", "drive.can0/3.heartbeat_stop=1s"),
    Row("node_reset", "drive.can0/6.reset"),
    Row("drive_no_voltage", "drive.can0/3.sto=2s"),
    Row("drive_warning", "drive.can0/3.warning=2s"),
)


async def look_at_outcome(rig: Rig, name: str) -> None:
    """State and drives are as the cause's severity demands."""
    severity = cause(name).severity
    if severity is Severity.WARNING:
        await asyncio.sleep(1.0)
        assert rig.in_state(S.RUNNING)
        return
    if severity is Severity.HOLD:
        await rig.until(lambda: bool(rig.events("state", S.HOLD.value)))
        return
    if name == "drive_settings_changed":  # whoever changes them is what stops the robot
        name, severity = "foreign_master", cause("foreign_master").severity
        assert rig.events("cause", name)
    wanted = {Severity.DISARM: S.STANDBY, Severity.FAULT: S.FAULT, Severity.ESTOP: S.ESTOP}
    states = {wanted[severity], S.FAULT} if severity is Severity.ESTOP else {wanted[severity]}
    await rig.until_state(*states, within_s=5.0)
    await rig.until(
        lambda: not any(axis.state.energised for axis in rig.service.loop.channels), within_s=5.0
    )


async def again_and_again(
    rig: Rig, command: type[Resume | Clear], leads_to: S, within_s: float
) -> None:
    """As an operator does who does not know when the fault is over."""
    async with asyncio.timeout(within_s):
        while not rig.in_state(leads_to):
            await rig.ask(command(token=rig.token))
            await asyncio.sleep(0.25)


async def recover(rig: Rig, row: Row) -> None:
    """When the fault is over, what the table says leads back to a moving robot, or to READY."""
    if cause(row.cause).severity is Severity.WARNING:
        return
    if cause(row.cause).severity is Severity.HOLD and rig.in_state(S.HOLD, S.ARMED):
        await again_and_again(rig, Resume, S.RUNNING, row.recovers_within_s)
        return
    if rig.in_state(S.FAULT, S.ESTOP):
        assert (await rig.ask(Arm(token=rig.token))).state == rig.state.value  # latched: refused
        await again_and_again(rig, Clear, S.READY, 2.0 * row.recovers_within_s)
    await rig.until_state(S.READY, within_s=row.recovers_within_s)
    await rig.do(Arm)
    assert rig.power == {PowerState.OPERATION_ENABLED}


SAME_WAY = {
    "tracker.hang_up=1s",
    "tracker.reset",
    "bus.can0.foreign_master=2s,heartbeat",
    "bus.can0.foreign_master=2s,nmt",
    "bus.can0.foreign_master=2s,sdo",
    "bus.can0.down=1s",
    "drive.can0/3.heartbeat_stop=1s",
}
"""Told apart by drivers, which have tests of their own for it: another row of the same cause goes
down the same way here."""


def rows() -> list[ParameterSet]:
    marks = (pytest.mark.long,)
    return [
        pytest.param(
            row, id=f"{row.cause}-{row.fault}", marks=marks if row.fault in SAME_WAY else ()
        )
        for row in WHILE_RUNNING
    ]


@pytest.mark.parametrize("row", rows())
def test_a_fault_while_running(row: Row) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE | {"radius_mm": 25.0})
        await asyncio.sleep(0.5)
        await rig.do(Inject, fault=row.fault)
        await rig.until(lambda: bool(rig.events("cause", row.cause)), row.within_s)
        told = rig.events("cause", row.cause)[0]
        assert told.text == cause(row.cause).text
        await look_at_outcome(rig, row.cause)
        await recover(rig, row)

    on_a_rig(scene)


def test_arming_reads_the_drives_safety_objects_back_and_names_what_differs() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Disarm)
        await rig.do(Inject, fault="drive.can0/3.setting=0x6085,0,1")
        await asyncio.sleep(1.0)
        assert rig.in_state(S.READY), "nothing on the bus tells of it"
        began_ns = rig.service.clock.now_ns()
        refused = await rig.refused(Arm)
        assert rig.service.clock.now_ns() - began_ns < 3_500_000_000
        assert refused.name == "settings_differ"
        assert refused.text.startswith("can0/3 0x6085:00 (quick stop ramp) reads 1, not ")
        await rig.until(lambda: "drive_settings_changed" in rig.causes)
        assert rig.power <= {PowerState.SWITCH_ON_DISABLED, PowerState.UNKNOWN}
        await rig.until_state(S.READY)
        await rig.do(Arm)

    on_a_rig(scene)


def test_arming_is_refused_in_bounded_time_where_a_drive_does_not_show_its_settings() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Inject, fault="drive.can0/2.sdo_silent=10s")
        began_ns = rig.service.clock.now_ns()
        refused = await rig.refused(Arm)
        assert rig.service.clock.now_ns() - began_ns < 3_500_000_000
        assert refused.name == "settings_differ"
        assert refused.text.startswith("can0/2 does not show its settings: ")
        await asyncio.sleep(10.0)
        await rig.do(Arm)

    on_a_rig(scene)


def test_a_lost_lease_holds_and_an_abandoned_robot_is_switched_off() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        rig.renewing = False
        await rig.until_state(S.HOLD, within_s=4.0)
        assert "lease_lost" in rig.causes
        await rig.until(lambda: bool(rig.events("cause", "lease_abandoned")))
        await rig.until(lambda: rig.power == {PowerState.SWITCH_ON_DISABLED})
        rig.token = ""
        await rig.do(Acquire)
        await rig.until_state(S.READY)
        await rig.do(Arm)

    on_a_rig(scene)


def test_an_operators_hold_stays_until_the_operator_resumes() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await rig.do(Hold)
        await asyncio.sleep(2.0)
        assert rig.in_state(S.HOLD)
        assert "operator_hold" in rig.causes
        await rig.do(Resume)
        assert rig.in_state(S.RUNNING)

    on_a_rig(scene)


@pytest.mark.parametrize(
    ("error", "name", "state"),
    [
        (ControllerError("it has lost its way"), "controller_failed", S.HOLD),
        (ZeroDivisionError("a defect of its own"), "internal_error", S.FAULT),
    ],
    ids=["gives up", "breaks"],
)
def test_a_controller_that_fails_does_not_take_the_loop_down(
    error: Exception, name: str, state: OperatingState
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        controller = rig.service.loop.controller
        assert controller is not None
        propose = controller.propose

        def failing(observation: object) -> NoReturn:
            raise error

        controller.propose = failing  # type: ignore[method-assign]
        await rig.until_state(state)
        await rig.until(lambda: bool(rig.events("cause", name)))
        assert rig.events("cause", name)[0].detail.endswith(str(error))
        controller.propose = propose  # type: ignore[method-assign]
        await asyncio.sleep(3.0)
        if state is S.HOLD:
            await rig.do(Resume)
            assert rig.in_state(S.RUNNING)
            return
        await rig.do(Clear)
        await rig.until_state(S.READY)

    on_a_rig(scene)


@pytest.mark.parametrize(
    ("factor", "says", "within_mm"),
    [(-1.0, "mm by now", 30.0), (0.0, "does not come nearer", 80.0)],
    ids=["the wrong way round", "not at all"],
)
def test_a_controller_that_leads_the_tip_wrongly_holds_the_robot(
    factor: float, says: str, within_mm: float
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await asyncio.sleep(4.0)
        controller = rig.service.loop.controller
        assert controller is not None
        propose = controller.propose

        def wrong(observation: Observation) -> Proposal:
            return Proposal(factor * propose(observation).delta_u)

        controller.propose = wrong  # type: ignore[method-assign]
        await rig.until_state(S.HOLD, within_s=12.0)
        await rig.until(lambda: bool(rig.events("cause", "tracking_diverges")), within_s=1.0)
        (told,) = rig.events("cause", "tracking_diverges")
        assert told.text == cause("tracking_diverges").text
        assert told.detail.endswith(f"{says}; the controller is constant_curvature")
        worst_mm = max(tip.error_mm for tip in rig.tips if tip.error_mm is not None)
        assert worst_mm < within_mm
        await asyncio.sleep(2.0)
        assert rig.in_state(S.HOLD)
        assert "tracking_diverges" in {why.name for why in rig.status.stopped_by}
        controller.propose = propose  # type: ignore[method-assign]
        await rig.do(Resume)
        await asyncio.sleep(3.0)
        assert rig.in_state(S.RUNNING)

    on_a_rig(scene)


def test_learning_that_breaks_stops_the_robot_and_is_told() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        controller = rig.service.loop.controller
        assert controller is not None
        asked: list[int] = []
        controller.learn = lambda: asked.append(1)  # type: ignore[method-assign]
        await asyncio.sleep(1.0)
        assert 95 <= len(asked) <= 105, "once in each bus cycle"

        def breaks() -> NoReturn:
            raise ZeroDivisionError

        controller.learn = breaks  # type: ignore[method-assign]
        await rig.until_state(S.FAULT)
        await rig.until(lambda: bool(rig.events("cause", "internal_error")))
        assert rig.events("cause", "internal_error")[0].detail.startswith("learning or looking")

    on_a_rig(scene)


async def gap(rig: Rig, seconds: float) -> None:
    """The loop was not run for this long, as its timer tells."""
    rig.service.timekeeping.last_gap_ns = round(seconds * 1e9)
    rig.service.supervisor.cycle(rig.service.clock.now_ns(), seconds, "a test")


def test_a_late_loop_holds_and_a_stalled_one_faults() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await gap(rig, 0.08)
        assert rig.events("state", S.HOLD.value)
        await rig.until_state(S.ARMED)
        await rig.do(Resume)
        await gap(rig, 0.2)
        assert rig.in_state(S.FAULT)
        await asyncio.sleep(3.0)
        await rig.do(Clear)
        await rig.until_state(S.READY)

    on_a_rig(scene)


def test_what_has_held_the_robot_is_told_until_motion_goes_on() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        assert rig.status.stopped_by == []
        await gap(rig, 0.08)
        await rig.until_state(S.ARMED)
        await asyncio.sleep(1.0)
        assert "loop_late" not in rig.causes, "it is over"
        told = rig.status.stopped_by
        assert [(why.name, why.detail) for why in told] == [("loop_late", "80 ms; a test")]
        view = shown(rig.status)
        assert "stopped by loop: the control loop came much too late (80 ms; a test)" in view
        await rig.do(Resume)
        assert rig.status.stopped_by == []
        assert "stopped by" not in shown(rig.status)

    on_a_rig(scene)


def test_what_has_switched_the_drives_off_is_told_while_they_are_off_and_after_arming() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await rig.do(Inject, fault="tracker.missing=4s")
        await rig.until_state(S.STANDBY)
        await rig.until_state(S.READY)
        assert "tracker_gone" in {why.name for why in rig.status.stopped_by}
        await rig.do(Arm)
        assert "tracker_gone" in {why.name for why in rig.status.stopped_by}

    on_a_rig(scene)


def shown(status: Status) -> str:
    """The status as people see it."""
    console = Console(width=200, file=StringIO())
    console.print(status_view(status))
    return cast(StringIO, console.file).getvalue()
