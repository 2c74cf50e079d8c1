"""Homing: the drive finds its zero by itself, with leave, and comes back to its own mode."""

from typing import Any

import pytest

from config.axis import Axis
from drivers.cia402.homing import HomingError, HomingProgress, homing_progress
from drivers.cia402.objects import MODE_DISPLAY
from drivers.cia402.power_state import PowerState
from tests.drivers.cia402.rig import Rig, axes, on_a_rig


def homing_axes(*, home_mm: float = 0.0, inverted: bool = False, **homing: Any) -> list[Axis]:
    return [
        axis.model_copy(
            update={
                "homing": axis.homing.model_copy(update=homing),
                "homing_position_mm": home_mm,
            }
        )
        for axis in axes(2, inverted=inverted)
    ]


@pytest.mark.parametrize(
    ("word", "progress"),
    [
        (0x0237, HomingProgress.IN_PROGRESS),
        (0x0637, HomingProgress.NOT_STARTED),
        (0x1237, HomingProgress.ATTAINED),
        (0x1637, HomingProgress.DONE),
        (0x2237, HomingProgress.ERROR),
        (0x2637, HomingProgress.ERROR),
    ],
)
def test_the_statusword_tells_how_far_homing_is(word: int, progress: HomingProgress) -> None:
    assert homing_progress(word) is progress


def test_where_it_stands_becomes_zero_and_the_axis_can_be_used_afterwards() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(4000, 0.5))
        await rig.until(lambda: rig.positions()[0] == 4000)
        rig.master.set_goal(None)
        await rig.master.home(rig.homing(0))
        await rig.until(lambda: rig.master.channels[0].state is PowerState.SWITCH_ON_DISABLED)
        assert rig.positions()[0] == 0
        assert rig.positions()[1] == 4000
        await rig.enabled()
        rig.master.write(rig.step(1000, 0.5))
        await rig.until(lambda: rig.positions() == [1000, 5000])

    on_a_rig(test)


def test_an_index_pulse_is_looked_for() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.drives[0].axes[0].drag_to(1500.0)
        await rig.master.home(rig.homing(0))
        zero = rig.drives[0].axes[0].position_counts - rig.positions()[0]
        assert (zero + 2000) % 4000 == pytest.approx(2000, abs=2)

    on_a_rig(test, robot_axes=homing_axes(method=33))


def test_a_zero_that_is_not_found_is_an_error() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        with pytest.raises(HomingError, match="axis_0: "):
            await rig.master.home(rig.homing(0))
        await rig.until(lambda: not rig.drives[0].axes[0].shaft.energised)

    on_a_rig(test, robot_axes=homing_axes(method=17, timeout_s=3.0))


def test_a_method_that_the_drive_does_not_have_is_an_error() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        with pytest.raises(HomingError):
            await rig.master.home(rig.homing(0))

    on_a_rig(test, robot_axes=homing_axes(method=99, timeout_s=3.0))


def test_what_took_too_long_is_said_and_not_that_all_of_it_did(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        says = "axis_0: told to enable, the drive is switched on after 3 s"
        rig.inject("drive.can0/1.refuses_enable=5s")
        with pytest.raises(HomingError, match=says):
            await rig.master.home(rig.homing(0))
        sdo = rig.master.nodes[1].sdo
        read = sdo.read

        async def shows_csp(index: int, subindex: int = 0, size: int | None = None) -> bytes:
            return b"\x08" if index == MODE_DISPLAY else await read(index, subindex, size)

        monkeypatch.setattr(sdo, "read", shows_csp)
        says = "axis_0: told mode 6, the drive does not show it within 1 s"
        with pytest.raises(HomingError, match=says):
            await rig.master.home(rig.homing(0))

    on_a_rig(test, robot_axes=homing_axes(method=33))


def test_a_drive_that_faults_while_homing_ends_it() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("drive.can0/1.blocked")
        with pytest.raises(HomingError):
            await rig.master.home(rig.homing(0))

    on_a_rig(test, robot_axes=homing_axes(method=33, timeout_s=5.0))


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("home_mm", [20.0, -7.5])
def test_what_is_found_may_be_anywhere_on_the_scale(home_mm: float, inverted: bool) -> None:
    """Travel and target count from zero, and not from what homing found."""

    async def test(rig: Rig) -> None:
        await rig.operational()
        shaft = rig.drives[0].axes[0]
        before = shaft.position_counts
        await rig.master.home(rig.homing(0))
        channel = rig.master.channels[0]
        assert channel.scale.position(channel.position_counts) == pytest.approx(home_mm)
        # The drive keeps the travel that the robot file names, from zero: 0 to 50 mm.
        assert await rig.master.check_settings(1.0) == []
        per_mm = channel.scale.counts_per_unit
        zero = before - home_mm * per_mm
        ends = sorted((zero, zero + 50.0 * per_mm))
        assert [shaft.limits.low, shaft.limits.high] == pytest.approx(ends)

    on_a_rig(test, robot_axes=homing_axes(home_mm=home_mm, inverted=inverted))


def test_a_drive_that_counts_its_home_offset_the_other_way_round_is_not_believed() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("drive.can0/1.setting=0x607C,0,40000")
        with pytest.raises(HomingError, match="it is at -20 mm, not at 20: it counts its home off"):
            await rig.master.home(rig.homing(0))
        assert not rig.master.channels[0].referenced or not rig.master.channels[0].zero_found

    on_a_rig(test, robot_axes=homing_axes(home_mm=20.0, referenced="home_at_start"))
