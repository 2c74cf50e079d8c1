"""Drives that somebody has given another direction, or other units: what the robot file says of
their counts holds, or is told not to."""

import asyncio
from typing import Any

import pytest

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.cia402 import objects
from sim_backends.devices.drive.node.object_dictionary import SdoAbortError
from tests.drivers.cia402.rig import Rig, axes, on_a_rig
from tests.drivers.cia402.test_velocity_modes import gate_of, led

POSITIONS_TURNED, VELOCITIES_TURNED = 0x80, 0x40


def left_with(rig: Rig, index: int, value: int, subindex: int = 0) -> None:
    """Drive 1 comes up with what somebody has stored in it who was here before."""
    rig.drives[0].objects.look_up(index, subindex).deliver(value)
    rig.drives[0].restart(rig.clock.now_ns())


def shaft(rig: Rig) -> float:
    """Where drive 1's shaft really is, in increments of its encoder."""
    rig.bus.advance(rig.clock.now_ns())
    return rig.drives[0].axes[0].position_counts


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize(
    ("mode", "polarity"),
    [
        ("csp", POSITIONS_TURNED),
        ("csv", VELOCITIES_TURNED),
        ("pv", VELOCITIES_TURNED),
        ("csv", POSITIONS_TURNED | VELOCITIES_TURNED),
    ],
)
def test_an_axis_runs_the_way_the_robot_file_says_whatever_direction_was_left_in_its_drive(
    mode: str, polarity: int, inverted: bool
) -> None:
    async def test(rig: Rig) -> None:
        left_with(rig, objects.POLARITY, polarity)
        await rig.enabled()
        outwards = -2000.0 if inverted else 2000.0  # 1 mm
        await led(rig, gate_of(rig), [outwards], 1.5)
        assert shaft(rig) == pytest.approx(outwards, abs=3.0)
        assert rig.positions() == pytest.approx([outwards], abs=3.0)
        assert rig.names() <= {"drive_limit_active"}, "as fast as it may"

    on_a_rig(test, robot_axes=axes(1, mode=mode, inverted=inverted))


def test_a_direction_that_is_changed_after_the_drive_was_set_up_is_found_before_it_is_armed() -> (
    None
):
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert await rig.master.check_settings(1.0) == []
        rig.inject("drive.can0/1.setting=0x607E,0,128")
        (differs,) = await rig.master.check_settings(1.0)
        assert differs.startswith("can0/1 0x607E:00 (direction of counting) reads 128, not 0")
        await asyncio.sleep(0.1)
        await rig.operational()
        assert await rig.master.check_settings(1.0) == []

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_without_the_object_is_used() -> None:
    def without(_value: int) -> None:
        raise SdoAbortError(AbortCode.NO_OBJECT)

    async def test(rig: Rig) -> None:
        rig.drives[0].objects.look_up(objects.POLARITY, 0).check = without
        await rig.enabled()
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1))


def test_a_drive_that_keeps_its_direction_turned_is_not_used() -> None:
    async def test(rig: Rig) -> None:
        left_with(rig, objects.POLARITY, POSITIONS_TURNED)
        rig.drives[0].objects.look_up(objects.POLARITY, 0).check = refused
        await rig.until(lambda: ("node_setting_refused", "can0/1") in rig.holding())
        assert "direction of counting" in rig.detail_of("node_setting_refused")
        assert not rig.master.operational

    on_a_rig(test, robot_axes=axes(1))


GEAR, FEED, VELOCITY = 0x6091, 0x6092, 0x6096


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ({(GEAR, 1): 5}, "0x6092 is 4000:1 and 0x6091 5:1, which are 800 counts per turn of"),
        ({(FEED, 1): 1000}, "which are 1000 counts per turn of the motor, not 4000"),
        ({(FEED, 1): 1, (GEAR, 2): 3}, "axis_0: 0x6091 is 1:3, not 1:1"),
        ({(VELOCITY, 1): 60, (VELOCITY, 2): 4000}, "a velocity unit of 66.6667 counts/s, not 1"),
    ],
)
def test_a_drive_that_counts_in_other_units_is_used_and_the_operator_is_told(
    factors: dict[tuple[int, int], int], told: str
) -> None:
    async def test(rig: Rig) -> None:
        for (index, subindex), value in factors.items():
            left_with(rig, index, value, subindex)
        await rig.operational()
        assert rig.holding() == {("drive_counts_differ", "can0/1")}
        assert told in rig.detail_of("drive_counts_differ")

        for (index, subindex), value in AS_THE_ROBOT_FILE_SAYS.items():
            left_with(rig, index, value, subindex)
        await rig.until(lambda: not rig.master.operational)
        await rig.operational()
        assert ("drive_counts_differ", "can0/1") not in rig.holding(), "found anew at each set-up"

    on_a_rig(test, robot_axes=axes(1))


AS_THE_ROBOT_FILE_SAYS = {
    (GEAR, 1): 1,
    (GEAR, 2): 1,
    (FEED, 1): 4000,
    (VELOCITY, 1): 1,
    (VELOCITY, 2): 1,
}


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        ({(GEAR, 1): 5, (FEED, 1): 20_000}, {}),
        ({(FEED, 1): 1}, {}),
        ({(FEED, 1): 0xFFFFFFFF, (FEED, 2): 0}, {}),
        ({(VELOCITY, 1): 60, (VELOCITY, 2): 4000}, {"velocity_unit_counts_s": 4000 / 60}),
    ],
)
def test_factors_that_come_to_what_the_robot_file_says_or_say_nothing_are_no_news(
    factors: dict[tuple[int, int], int], says: dict[str, Any]
) -> None:
    async def test(rig: Rig) -> None:
        for (index, subindex), value in factors.items():
            left_with(rig, index, value, subindex)
        await rig.operational()
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1, **says))


def test_a_drive_that_does_not_show_its_factors_is_used_without_a_word() -> None:
    async def test(rig: Rig) -> None:
        for index in (GEAR, FEED, VELOCITY):
            rig.drives[0].objects.look_up(index, 1).on_read = not_there
        await rig.operational()
        assert rig.names() == set()

    on_a_rig(test, robot_axes=axes(1))


def not_there(_t_ns: int) -> int:
    raise SdoAbortError(AbortCode.NO_OBJECT)


def refused(_value: int) -> None:
    raise SdoAbortError(AbortCode.READ_ONLY)
