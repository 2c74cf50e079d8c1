"""Drives that keep to the standards, and do otherwise than the emulated one: what they send is
changed on its way out."""

import asyncio
from collections.abc import Callable
from struct import Struct

import pytest

from config.axis import Axis
from config.emulation.lab import EmulatedDrives
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import Emergency
from drivers.canopen.codec.nmt import NmtCommand, NmtState
from drivers.canopen.codec.sdo import ExpeditedUpload, decode_response
from drivers.cia402 import objects
from drivers.cia402.homing import HomingError
from drivers.cia402.pdo_plan import TPDO_LAYOUT
from drivers.cia402.power_state import PowerGoal, PowerState, StatuswordBit, power_state
from sim_backends.devices.drive.node.object_dictionary import Entry, SdoAbortError
from tests.drivers.cia402.rig import Rig, axes, on_a_rig

SDO_RESPONSE, STATE, EMCY = 0x581, 0x181, 0x81
FRAME = Struct("<BHB4s")
NOT_SIZED, NO_REMOTE = 0x42, 1 << 30

Change = Callable[[bytes], list[bytes]]


def says(rig: Rig, changed_id: int, change: Change) -> None:
    """Of the frames with this identifier, drive 1 sends what `change` makes of each."""
    port = rig.drives[0].port
    send = port.send

    def send_changed(can_id: int, data: bytes, t_ns: int) -> bool:
        frames = change(data) if can_id == changed_id else [data]
        return all(send(can_id, frame, t_ns) for frame in frames)

    port.send = send_changed  # type: ignore[method-assign]


def resets(rig: Rig, node: int) -> int:
    """How often a drive's communication was reset."""
    return rig.frames.count((cob_ids.NMT, bytes([NmtCommand.RESET_COMMUNICATION.value, node])))


def unsized(data: bytes) -> list[bytes]:
    """An answer of up to four bytes that does not say how many of its four count."""
    match decode_response(data):
        case ExpeditedUpload(index, subindex, value):
            return [FRAME.pack(NOT_SIZED, index, subindex, value)]
    return [data]


def voltage_told_in(*told: PowerState) -> Change:
    """Statuswords whose bit 4 is the power stage's, which is on in these states."""

    def change(data: bytes) -> list[bytes]:
        statusword, position, torque = TPDO_LAYOUT.unpack(data)
        if power_state(statusword) not in told:
            statusword &= ~StatuswordBit.VOLTAGE_ENABLED
        return [TPDO_LAYOUT.pack(statusword, position, torque)]

    return change


def homed_where_it_stands(method: int = 35) -> list[Axis]:
    axis = axes(1)[0]
    homing = axis.homing.model_copy(update={"method": method})
    return [axis.model_copy(update={"homing": homing})]


def test_answers_that_do_not_say_how_many_of_their_bytes_count_are_understood() -> None:
    async def test(rig: Rig) -> None:
        says(rig, SDO_RESPONSE, unsized)
        await rig.operational()
        await rig.master.home(rig.homing(0))
        assert rig.names() == set()

    on_a_rig(test, robot_axes=homed_where_it_stands())


def test_two_drives_of_one_number_are_named_and_neither_is_used() -> None:
    async def test(rig: Rig) -> None:
        says(rig, SDO_RESPONSE, lambda data: [data, data])
        await rig.until(lambda: ("node_number_twice", "can0/1") in rig.holding())
        assert not rig.master.operational

    on_a_rig(test, robot_axes=axes(1))


@pytest.mark.parametrize(
    "told",
    [
        (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE),
        (PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE),
    ],
)
def test_a_power_stage_that_is_switched_off_is_no_lost_motor_voltage(
    told: tuple[PowerState, ...],
) -> None:
    async def test(rig: Rig) -> None:
        says(rig, STATE, voltage_told_in(*told))
        await rig.enabled()
        rig.master.set_goal(PowerGoal.OFF)
        await rig.until(lambda: rig.master.goal_reached)
        await asyncio.sleep(0.1)
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1))


def test_a_power_stage_that_loses_its_voltage_while_it_is_on_is_told() -> None:
    async def test(rig: Rig) -> None:
        on = [PowerState.OPERATION_ENABLED]
        says(rig, STATE, lambda data: voltage_told_in(*on)(data))
        await rig.enabled()
        on.clear()
        await rig.until(lambda: ("drive_no_voltage", "axis_0") in rig.holding(), 0.1)

    on_a_rig(test, robot_axes=axes(1))


OVERRUN, OVER_CURRENT = Emergency(0x8110), Emergency(0x2310)


def fault_explained(rig: Rig, *before_s: tuple[float, Emergency]) -> None:
    """Drive 1 has faulted now, and has told, or tells, of these errors so long before."""
    now_ns = rig.clock.now_ns()
    fault = TPDO_LAYOUT.pack(0x0218, 0, 0)
    frames = [(now_ns - round(s * 1e9), EMCY, error.encode()) for s, error in before_s]
    for t_ns, can_id, data in sorted([*frames, (now_ns, STATE, fault)]):
        rig.master.frame_received(can_id, data, t_ns)
    assert ("drive_fault", "axis_0") in rig.holding()


@pytest.mark.parametrize(
    ("told", "explanation"),
    [
        ([(0.02, OVER_CURRENT)], str(OVER_CURRENT)),
        ([(60.0, OVERRUN), (-0.03, OVER_CURRENT)], str(OVER_CURRENT)),
        ([(60.0, OVERRUN)], ""),
        ([(0.5, OVERRUN), (0.4, Emergency(0))], ""),
    ],
)
def test_a_fault_is_explained_by_the_error_that_comes_with_it_and_by_no_older_one(
    told: list[tuple[float, Emergency]], explanation: str
) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        fault_explained(rig, *told)
        assert rig.detail_of("drive_fault") == explanation

    on_a_rig(test, robot_axes=axes(1))


def stored(rig: Rig, index: int, value: int) -> Entry:
    """Drive 1 comes up with an object as somebody has stored it who was here before."""
    entry = rig.drives[0].objects.look_up(index, 0)
    entry.deliver(value)
    rig.drives[0].restart(rig.clock.now_ns())
    return entry


@pytest.mark.parametrize("value", [0xF5, 0x80000081])
def test_a_drive_that_tells_its_errors_elsewhere_is_told_to_tell_them_here(value: int) -> None:
    async def test(rig: Rig) -> None:
        stored(rig, objects.EMERGENCY_COB_ID, value)
        await rig.operational()
        assert rig.holding() == set()
        rig.inject("drive.can0/1.emergency=0x2310")
        await rig.until(lambda: ("drive_emergency", "can0/1") in rig.holding())

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_whose_errors_cannot_be_heard_is_used_and_its_fault_is_explained_all_the_same() -> (
    None
):
    def read_only(_value: int) -> None:
        raise SdoAbortError(AbortCode.READ_ONLY)

    async def test(rig: Rig) -> None:
        stored(rig, objects.EMERGENCY_COB_ID, 0xF5).check = read_only
        await rig.operational()
        assert "reads 0xF5, not 0x81; it refused" in rig.detail_of("node_emergencies_unheard")
        rig.inject("drive.can0/1.emergency=0x7305")
        await asyncio.sleep(0.5)
        assert "0x7305" in rig.detail_of("drive_fault")
        assert rig.master.channels[0].zero_lost
        assert "drive_emergency" not in rig.names()

    on_a_rig(test, robot_axes=axes(1))


def test_a_fault_that_came_while_nobody_listened_is_explained_by_what_the_drive_says_of_it() -> (
    None
):
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("drive.can0/2.dead=2s")
        await asyncio.sleep(1.0)
        rig.inject("drive.can0/2.emergency=0x2310")
        await asyncio.sleep(1.5)
        await rig.operational()
        await asyncio.sleep(0.5)
        assert "drive_emergency" not in rig.names()
        assert "0x2310" in rig.detail_of("drive_fault")
        assert ("drive_fault", "axis_1") in rig.holding()

    on_a_rig(test)


@pytest.mark.parametrize("index", [objects.SYNC_COB_ID, objects.SYNC_COUNTER])
def test_a_drive_that_was_left_with_another_sync_takes_ours(index: int) -> None:
    async def test(rig: Rig) -> None:
        stored(rig, objects.COMMUNICATION_CYCLE_PERIOD, 5000)
        entry = stored(rig, index, {objects.SYNC_COB_ID: 0x90, objects.SYNC_COUNTER: 10}[index])
        await rig.enabled()
        assert entry.number == {objects.SYNC_COB_ID: 0x80, objects.SYNC_COUNTER: 0}[index]
        assert rig.holding() == set()

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_that_knows_no_remote_requests_is_not_told_to_allow_them() -> None:
    async def test(rig: Rig) -> None:
        cob_id = rig.drives[0].objects.own(0x1800, 1, DataType.UNSIGNED32)
        cob_id.deliver(cob_id.number | NO_REMOTE)
        check = cob_id.check
        assert check is not None

        def refuse(value: int) -> None:
            if not value & NO_REMOTE:
                raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
            check(value)

        cob_id.check = refuse
        await rig.operational()

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_that_takes_a_mode_up_late_has_it() -> None:
    async def test(rig: Rig) -> None:
        def late(data: bytes) -> list[bytes]:
            response = decode_response(data)
            if getattr(response, "index", None) == objects.MODE_DISPLAY and rig_is_young():
                return [FRAME.pack(0x4F, objects.MODE_DISPLAY, 0, b"\0")]
            return [data]

        def rig_is_young() -> bool:
            return rig.clock.now_ns() < 800_000_000

        says(rig, SDO_RESPONSE, late)
        await rig.operational()
        assert rig.clock.now_ns() > 800_000_000
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_that_does_not_tell_its_name_is_used_without() -> None:
    async def test(rig: Rig) -> None:
        def nameless(data: bytes) -> list[bytes]:
            if getattr(decode_response(data), "index", None) == objects.DEVICE_NAME:
                abort = AbortCode.HARDWARE_ERROR.to_bytes(4, "little")
                return [FRAME.pack(0x80, objects.DEVICE_NAME, 0, abort)]
            return [data]

        says(rig, SDO_RESPONSE, nameless)
        await rig.operational()

    on_a_rig(test, robot_axes=axes(1))


def test_a_homing_method_that_fits_no_object_is_an_error_of_homing_that_names_it() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        with pytest.raises(HomingError, match=r"axis_0: 0x6098:00: 200 does not fit INTEGER8"):
            await rig.master.home(rig.homing(0))

    on_a_rig(test, robot_axes=homed_where_it_stands(method=200))


@pytest.mark.parametrize("boot_time_s", [1.4, 2.0, 2.05, 2.4, 4.2, 8.0, 9.3])
def test_a_drive_that_takes_long_to_boot_is_not_reset_again_meanwhile(boot_time_s: float) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert resets(rig, 1) == 1

    on_a_rig(test, robot_axes=axes(1), options=EmulatedDrives(boot_time_s=boot_time_s))


def test_a_drive_that_comes_late_and_says_nothing_of_it_is_reset_then() -> None:
    async def test(rig: Rig) -> None:
        rig.inject("drive.can0/1.dead=4s")
        await rig.operational()
        assert resets(rig, 1) == 2
        assert resets(rig, 2) == 1

    on_a_rig(test, robot_axes=axes(2))  # a lone drive's frames would wait for it on the bus


def test_a_drive_that_beats_and_answers_nothing_is_reset_again_and_again() -> None:
    """It stands in 'stopped', and the reset may not have reached it."""

    async def test(rig: Rig) -> None:
        rig.inject("drive.can0/1.dead")
        for _ in range(60):
            stopped = bytes([NmtState.STOPPED.value])
            rig.master.frame_received(cob_ids.heartbeat(1), stopped, rig.clock.now_ns())
            await asyncio.sleep(0.1)
        assert resets(rig, 1) == 3

    on_a_rig(test, robot_axes=axes(2))


def test_a_drive_that_tells_at_once_that_it_is_let_go_has_not_left_by_itself() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        closing = asyncio.create_task(rig.master.close())
        await asyncio.sleep(0.005)
        pre_operational = bytes([NmtState.PRE_OPERATIONAL.value])
        rig.master.frame_received(cob_ids.heartbeat(1), pre_operational, rig.clock.now_ns())
        await closing
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1))
