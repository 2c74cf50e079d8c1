"""Homing: every method, its status bits, and how it fails."""

from typing import Any

import pytest

from sim_backends.devices.drive.axis.mechanics import AxisMechanics
from tests.sim_backends.drive.rig import Rig

ENABLE, START, HALT = 0x0F, 0x10, 0x100
REACHED, ATTAINED, ERROR = 1 << 10, 1 << 12, 1 << 13

# Stops at -9000 and 9000, switches at -7000 and 6000, index at 150 and every 4000.
STAGE = AxisMechanics(
    start_counts=1000.0,
    low_stop_counts=-9000.0,
    high_stop_counts=9000.0,
    low_switch_counts=-7000.0,
    high_switch_counts=6000.0,
    index_counts=150.0,
)


def ready(method: int, mechanics: AxisMechanics = STAGE, **options: Any) -> Rig:
    rig = Rig(mechanics=(mechanics,), **options)
    rig.set(0x6098, method)
    rig.set(0x6099, 20_000, 1)
    rig.set(0x6099, 4_000, 2)
    rig.set(0x609A, 400_000)
    rig.enable(6)
    return rig


def bits(rig: Rig) -> tuple[bool, bool, bool]:
    """Statusword bits 13, 12, 10."""
    word = rig.statusword
    return bool(word & ERROR), bool(word & ATTAINED), bool(word & REACHED)


NOT_STARTED = INTERRUPTED = (False, False, True)
IN_PROGRESS = (False, False, False)
DONE = (False, True, True)
FAILED_STANDING = (True, False, True)


def run_until_over(rig: Rig, limit_ms: int = 20_000) -> None:
    rig.control(ENABLE | START)
    for _ in range(limit_ms // 10):
        if bits(rig) != IN_PROGRESS and not rig.get(0x606B):
            break
        rig.run(10)
    rig.run(50)


@pytest.mark.parametrize(
    ("method", "home"),
    [
        (17, -7000.0),
        (18, 6000.0),
        (1, -3850.0),  # first index above the switch
        (2, 4150.0),  # first index below the switch
        (33, 150.0),
        (34, 4150.0),
        (35, 1000.0),
        (37, 1000.0),
        (-17, -9000.0),
        (-18, 9000.0),
    ],
)
def test_methods(method: int, home: float) -> None:
    rig = ready(method)
    assert bits(rig) == NOT_STARTED
    run_until_over(rig)
    assert bits(rig) == DONE
    assert rig.axis.homed
    # Zero is where home is.
    assert rig.position == pytest.approx(rig.axis.position_counts - home, abs=1)
    assert rig.axis.position_counts == pytest.approx(home, abs=200)


@pytest.mark.parametrize(("method", "start"), [(17, -8000.0), (1, -8000.0), (18, 7000.0)])
def test_starting_on_the_switch(method: int, start: float) -> None:
    stage = AxisMechanics(
        start_counts=start,
        low_stop_counts=-9000.0,
        high_stop_counts=9000.0,
        low_switch_counts=-7000.0,
        high_switch_counts=6000.0,
        index_counts=150.0,
    )
    rig = ready(method, stage)
    run_until_over(rig)
    assert bits(rig) == DONE


@pytest.mark.parametrize("method", [17, 33, 37])
def test_the_home_offset_moves_the_zero(method: int) -> None:
    rig = ready(method)
    rig.set(0x607C, 250)
    run_until_over(rig)
    without = ready(method)
    run_until_over(without)
    assert rig.position == pytest.approx(without.position - 250, abs=1)


def test_status_while_it_runs() -> None:
    rig = ready(17)
    rig.control(ENABLE | START)
    rig.run(50)
    assert bits(rig) == IN_PROGRESS
    assert rig.get(0x606C) < -10_000
    attained_and_moving = False
    for _ in range(20_000):
        rig.run(1)
        attained_and_moving |= bits(rig) == (False, True, False)
        if bits(rig) == DONE:
            break
    assert attained_and_moving
    assert bits(rig) == DONE


def test_taking_the_start_bit_back_interrupts() -> None:
    rig = ready(17)
    rig.control(ENABLE | START)
    rig.run(100)
    rig.control(ENABLE)
    rig.run(300)
    assert bits(rig) == INTERRUPTED
    assert rig.get(0x606C) == 0
    assert not rig.axis.homed
    run_until_over(rig)
    assert bits(rig) == DONE


def test_halt_ends_a_run() -> None:
    rig = ready(17)
    rig.control(ENABLE | START)
    rig.run(100)
    rig.control(ENABLE | START | HALT)
    rig.run(300)
    assert rig.get(0x606C) == 0
    rig.control(ENABLE | START)
    rig.run(300)
    assert bits(rig) == INTERRUPTED


def test_without_speed_it_fails() -> None:
    rig = ready(17)
    rig.set(0x6099, 0, 1)
    run_until_over(rig)
    assert bits(rig) == FAILED_STANDING
    assert not rig.axis.homed


def test_an_index_that_never_comes_before_the_switch_fails() -> None:
    stage = AxisMechanics(
        start_counts=5000.0, high_switch_counts=6000.0, index_counts=0.0, counts_per_turn=4000
    )
    rig = ready(34, stage)
    run_until_over(rig)
    assert bits(rig) == FAILED_STANDING


def test_a_missing_switch_ends_in_a_following_error() -> None:
    stage = AxisMechanics(start_counts=0.0, low_stop_counts=-3000.0)
    rig = ready(17, stage)
    run_until_over(rig)
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x8611


@pytest.mark.parametrize("method", [0, 3, 24, -1, 36])
def test_methods_it_does_not_have(method: int) -> None:
    assert Rig().refused(0x6098, 0, method) == 0x06090030


def test_the_methods_it_has_are_listed() -> None:
    rig = Rig()
    listed = [rig.read(0x60E3, place, signed=True) for place in range(1, rig.read(0x60E3) + 1)]
    assert all(rig.refused(0x6098, 0, method) == 0 for method in listed)


def test_after_a_loss_of_power_the_zero_is_lost() -> None:
    rig = ready(17)
    run_until_over(rig)
    rig.fault("power_cycle=10ms")
    rig.run(500)
    assert not rig.axis.homed
    assert rig.position == 0


def test_software_limits_count_from_home() -> None:
    rig = ready(37)
    rig.set(0x607D, -300, 1)
    rig.set(0x607D, 300, 2)
    rig.set(0x607C, 100)  # zero lies 100 above home, so that home is -100
    run_until_over(rig)
    rig.set(0x6060, 8)
    rig.set(0x60C2, 10, 1)
    for _ in range(5):
        rig.set(0x607A, 1000)
        rig.run(10)
    rig.run(100)
    assert rig.position == 200
    assert rig.axis.position_counts == pytest.approx(1000.0 + 300.0)


def test_the_limit_switches_show_and_stop_ordinary_motion() -> None:
    rig = Rig(mechanics=(STAGE,))
    assert rig.get(0x60FD) == 0
    rig.enable(3)
    rig.set(0x60FF, 20_000)
    rig.run(3000)
    assert rig.axis.position_counts == pytest.approx(6000.0, abs=25)
    assert rig.get(0x60FD) == 2
    rig.set(0x60FF, -20_000)
    rig.run(3000)
    assert rig.axis.position_counts == pytest.approx(-7000.0, abs=25)
    assert rig.get(0x60FD) == 1
