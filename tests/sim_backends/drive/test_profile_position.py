"""Profile position: set-points and their handshake."""

import pytest

from tests.sim_backends.drive.rig import Rig

ENABLE, NEW, AT_ONCE, RELATIVE, HALT = 0x0F, 0x10, 0x20, 0x40, 0x100
REACHED, LIMITED, ACKNOWLEDGED = 1 << 10, 1 << 11, 1 << 12


def standing(**settings: int) -> Rig:
    """Enabled in profile position; 1000 counts at 10000/s take 0.2 s."""
    rig = Rig()
    rig.set(0x6081, 10_000)
    rig.set(0x6083, 100_000)
    rig.set(0x6084, 100_000)
    rig.enable(1)
    return rig


def setpoint(rig: Rig, target: int, bits: int = 0) -> None:
    rig.set(0x607A, target)
    rig.control(ENABLE | NEW | bits)


def shows(rig: Rig, *bits: int) -> list[bool]:
    return [bool(rig.statusword & bit) for bit in bits]


def test_the_handshake_of_one_setpoint() -> None:
    rig = standing()
    assert shows(rig, REACHED, ACKNOWLEDGED) == [True, False]
    setpoint(rig, 1000)
    assert shows(rig, REACHED, ACKNOWLEDGED) == [False, True]
    rig.control(ENABLE)
    assert shows(rig, REACHED, ACKNOWLEDGED) == [False, False]
    rig.run(195)
    assert shows(rig, REACHED) == [False]
    rig.run(50)
    assert shows(rig, REACHED) == [True]
    assert rig.position == 1000


def test_a_target_alone_moves_nothing() -> None:
    rig = standing()
    rig.set(0x607A, 1000)
    rig.control(ENABLE)
    rig.run(100)
    assert rig.position == 0


def test_the_bit_must_rise_for_the_next_setpoint() -> None:
    rig = standing()
    setpoint(rig, 1000)
    setpoint(rig, 3000)  # still high: no edge
    rig.run(1000)
    assert rig.position == 1000


def test_a_setpoint_waits_for_the_one_under_way_and_a_third_for_room() -> None:
    rig = standing()
    setpoint(rig, 1000)
    rig.control(ENABLE)
    setpoint(rig, 2000)
    assert shows(rig, ACKNOWLEDGED) == [True]
    rig.control(ENABLE)
    assert shows(rig, ACKNOWLEDGED) == [True]  # no room: stays until the second begins
    setpoint(rig, 9000)
    rig.control(ENABLE)
    rig.run(215)
    assert shows(rig, ACKNOWLEDGED, REACHED) == [False, False]
    assert 1000 <= rig.position < 1500
    rig.run(400)
    assert rig.position == 2000


def test_change_immediately_replaces_the_one_under_way() -> None:
    rig = standing()
    setpoint(rig, 5000)
    rig.control(ENABLE)
    rig.run(200)
    setpoint(rig, -500, AT_ONCE)
    rig.run(2000)
    assert rig.position == -500


def test_relative_setpoints_add_up() -> None:
    rig = standing()
    setpoint(rig, 300, RELATIVE)
    rig.control(ENABLE)
    setpoint(rig, 200, RELATIVE)
    rig.control(ENABLE)
    rig.run(1000)
    assert rig.position == 500


def test_halt_interrupts_and_its_end_goes_on() -> None:
    rig = standing()
    setpoint(rig, 5000)
    rig.run(200)
    rig.control(ENABLE | NEW | HALT)
    rig.run(300)
    stopped = rig.position
    assert 1000 < stopped < 4000
    assert shows(rig, REACHED) == [True]
    rig.control(ENABLE | NEW)
    rig.run(1000)
    assert rig.position == 5000


def test_it_takes_the_time_that_its_profile_says() -> None:
    rig = standing()
    setpoint(rig, 1000)
    rig.run(100)
    # 0.1 s of acceleration to 10000/s, lagging by 4 ms.
    assert rig.get(0x6062) == pytest.approx(500, abs=2)
    assert rig.get(0x606B) == pytest.approx(10_000, rel=0.01)
    assert rig.get(0x60F4) == pytest.approx(40, abs=5)


def test_a_target_beyond_a_limit_ends_at_the_limit_and_says_so() -> None:
    rig = standing()
    rig.set(0x607D, -100, 1)
    rig.set(0x607D, 700, 2)
    setpoint(rig, 1000)
    rig.run(500)
    assert rig.position == 700
    assert shows(rig, LIMITED) == [True]
    rig.control(ENABLE)
    setpoint(rig, 100)
    rig.run(500)
    assert rig.position == 100
    assert shows(rig, LIMITED) == [False]


def test_velocity_is_limited_by_the_largest_profile_velocity_and_the_motor() -> None:
    rig = standing()
    rig.set(0x6081, 1_000_000)
    rig.set(0x6083, 10_000_000)
    rig.set(0x607F, 30_000)
    setpoint(rig, 100_000)
    rig.run(200)
    assert rig.get(0x606C) == pytest.approx(30_000, rel=0.01)
    rig.set(0x6080, 300)  # rpm: 20000 counts/s
    rig.control(ENABLE)
    setpoint(rig, 100_000, AT_ONCE)
    rig.run(200)
    assert rig.get(0x606C) == pytest.approx(20_000, rel=0.01)


def test_acceleration_is_limited() -> None:
    rig = standing()
    rig.set(0x60C5, 20_000)
    setpoint(rig, 10_000)
    rig.run(100)
    assert rig.get(0x606B) == pytest.approx(2000, rel=0.02)


def test_reached_needs_the_window_and_its_time() -> None:
    rig = standing()
    rig.set(0x6067, 100)
    rig.set(0x6068, 50)
    setpoint(rig, 1000)
    rig.run(200)
    assert abs(rig.position - 1000) < 100
    assert shows(rig, REACHED) == [False]
    rig.run(50)
    assert shows(rig, REACHED) == [True]


def test_a_setpoint_given_before_the_brake_is_open_is_not_lost() -> None:
    rig = Rig(brake_release_s=0.2)
    rig.operational()
    rig.control(0x06, 0x07, 0x0F)
    setpoint(rig, 400)
    rig.run(100)
    assert rig.position == 0
    rig.run(500)
    assert rig.position == 400
