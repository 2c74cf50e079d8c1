"""Profile velocity."""

import pytest

from tests.sim_backends.drive.rig import Rig

REACHED, LIMITED, STANDS = 1 << 10, 1 << 11, 1 << 12


def standing() -> Rig:
    rig = Rig()
    rig.set(0x6083, 100_000)
    rig.set(0x6084, 50_000)
    rig.enable(3)
    rig.run(50)
    return rig


def shows(rig: Rig, *bits: int) -> list[bool]:
    return [bool(rig.statusword & bit) for bit in bits]


def test_a_velocity_is_reached_on_a_ramp_and_kept() -> None:
    rig = standing()
    assert shows(rig, REACHED, STANDS) == [True, True]
    rig.set(0x60FF, 10_000)
    rig.run(50)
    assert rig.get(0x606B) == pytest.approx(5000, rel=0.01)
    assert shows(rig, REACHED, STANDS) == [False, False]
    rig.run(100)
    assert rig.get(0x606C) == pytest.approx(10_000, rel=0.01)
    assert shows(rig, REACHED, STANDS) == [True, False]
    rig.run(5000)
    assert rig.get(0x606C) == pytest.approx(10_000, rel=0.01)


def test_it_reverses_through_zero() -> None:
    rig = standing()
    rig.set(0x60FF, 10_000)
    rig.run(200)
    rig.set(0x60FF, -10_000)
    rig.run(200)  # 0.2 s to stand still at 50000/s²
    assert rig.get(0x606B) == pytest.approx(0, abs=300)
    rig.run(200)
    assert rig.get(0x606C) == pytest.approx(-10_000, rel=0.01)


def test_it_stops_when_told() -> None:
    rig = standing()
    rig.set(0x60FF, 10_000)
    rig.run(200)
    rig.set(0x60FF, 0)
    rig.run(300)
    assert shows(rig, REACHED, STANDS) == [True, True]
    assert rig.get(0x606C) == 0


def test_it_comes_to_a_stop_at_a_position_limit_and_may_leave_it_again() -> None:
    rig = standing()
    rig.set(0x607D, -100, 1)
    rig.set(0x607D, 5000, 2)
    rig.set(0x60FF, 10_000)
    rig.run(2000)
    assert rig.position == 5000
    rig.set(0x60FF, 20_000)
    rig.run(500)
    assert rig.position == 5000
    assert shows(rig, LIMITED) == [True]
    rig.set(0x60FF, -10_000)
    rig.run(200)
    assert rig.position < 4500


def test_velocity_has_a_limit() -> None:
    rig = standing()
    rig.set(0x607F, 4000)
    rig.set(0x60FF, 10_000)
    rig.run(500)
    assert rig.get(0x606C) == pytest.approx(4000, rel=0.01)
    assert shows(rig, LIMITED) == [True]
