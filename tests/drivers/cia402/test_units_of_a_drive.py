"""Drives that somebody has given another direction: they count as the robot file says."""

import asyncio

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


def refused(_value: int) -> None:
    raise SdoAbortError(AbortCode.READ_ONLY)
