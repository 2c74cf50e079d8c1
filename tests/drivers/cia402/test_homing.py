"""Homing: the drive finds its zero by itself, with leave, and comes back to its own mode."""

from typing import Any

import pytest

from config.axis import Axis
from drivers.cia402.homing import HomingError, HomingProgress, homing_progress
from drivers.cia402.power_state import PowerState
from tests.drivers.cia402.rig import Rig, axes, on_a_rig


def homing_axes(**homing: Any) -> list[Axis]:
    return [
        axis.model_copy(update={"homing": axis.homing.model_copy(update=homing)})
        for axis in axes(2)
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


def test_a_drive_that_faults_while_homing_ends_it() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("drive.can0/1.blocked")
        with pytest.raises(HomingError):
            await rig.master.home(rig.homing(0))

    on_a_rig(test, robot_axes=homing_axes(method=33, timeout_s=5.0))
