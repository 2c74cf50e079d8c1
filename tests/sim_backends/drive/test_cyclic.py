"""Cyclic synchronous position and velocity."""

import struct
from typing import Any

import pytest

from tests.sim_backends.drive.rig import Rig

CSP, CSV = 8, 9
LIMITED, FOLLOWS, FOLLOWING_ERROR = 1 << 11, 1 << 12, 1 << 13


def cyclic(mode: int, **options: Any) -> Rig:
    rig = Rig(**options)
    rig.set(0x60C2, 10, 1)
    rig.enable(mode)
    return rig


def cycles(rig: Rig, targets: list[int], index: int = 0x607A) -> None:
    for target in targets:
        rig.set(index, target)
        rig.run(10)


def test_targets_are_reached_within_one_period_in_a_straight_line() -> None:
    rig = cyclic(CSP)
    rig.set(0x607A, 100)
    rig.run(5)
    assert rig.get(0x6062) == pytest.approx(50, abs=1)
    rig.run(5)
    assert rig.get(0x6062) == 100


def test_the_shaft_lags_by_its_response_time() -> None:
    rig = cyclic(CSP, response_time_s=0.004)
    cycles(rig, list(range(100, 2100, 100)))
    # 10000 counts/s times 4 ms
    assert rig.get(0x60F4) == pytest.approx(40, abs=1)
    assert rig.get(0x606C) == pytest.approx(10_000, rel=0.01)


def test_without_new_targets_it_waits_at_the_last() -> None:
    rig = cyclic(CSP)
    cycles(rig, [100, 200])
    rig.run(1000)
    assert rig.position == 200
    assert rig.statusword & FOLLOWS


def test_a_jump_is_limited_to_the_greatest_velocity_and_says_so() -> None:
    rig = cyclic(CSP)
    rig.set(0x607F, 20_000)  # 200 in 10 ms
    cycles(rig, [1000])
    assert rig.get(0x6062) == 200
    assert rig.statusword & LIMITED
    cycles(rig, [300])
    assert rig.get(0x6062) == 300
    assert not rig.statusword & LIMITED


def test_position_limits_hold() -> None:
    rig = cyclic(CSP)
    rig.set(0x607D, -50, 1)
    rig.set(0x607D, 150, 2)
    cycles(rig, [100, 200, 300])
    rig.run(50)
    assert rig.position == 150
    assert rig.statusword & LIMITED
    cycles(rig, [100, 0, -100, -200])
    rig.run(50)
    assert rig.position == -50


def test_beyond_a_limit_it_stays_and_may_only_come_back() -> None:
    rig = cyclic(CSP)
    cycles(rig, [100])
    rig.set(0x607D, -10, 1)
    rig.set(0x607D, 50, 2)
    cycles(rig, [200])
    assert rig.get(0x6062) == 100
    cycles(rig, [70])
    assert rig.get(0x6062) == 70


def test_limits_are_off_when_the_lower_is_not_lower() -> None:
    rig = cyclic(CSP)
    rig.set(0x607D, 0, 1)
    rig.set(0x607D, 0, 2)
    cycles(rig, [100, 200])
    assert rig.get(0x6062) == 200


def test_with_synchronous_pdos_all_of_it_goes_by_sync() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [0x60400010, 0x607A0020], 1)
    tpdo = rig.map(False, 1, [0x60410010, 0x60640020], 1)
    rig.set(0x60C2, 10, 1)
    rig.set(0x6060, CSP)
    rig.operational()
    positions = []
    for cycle in range(60):
        word = (0x06, 0x07, 0x0F)[min(cycle // 2, 2)]
        target = max(0, cycle - 20) * 50
        rig.send(rpdo, struct.pack("<Hi", word, target))
        rig.sync()
        rig.run(9.6)
        ((_, position),) = [struct.unpack("<Hi", data) for data in rig.frames(tpdo)]
        positions.append(position)
    assert rig.state == "enabled"
    # The target of a cycle is reached at the end of it, one lag late.
    assert positions[-1] == pytest.approx(38 * 50 - 5000 * 0.004, abs=2)


def test_velocities_are_reached_within_one_period_and_kept() -> None:
    rig = cyclic(CSV)
    cycles(rig, [10_000], 0x60FF)
    assert rig.get(0x606B) == 10_000
    rig.run(500)
    assert rig.get(0x606B) == 10_000
    cycles(rig, [-5000], 0x60FF)
    assert rig.get(0x606B) == -5000
    cycles(rig, [0], 0x60FF)
    assert rig.get(0x606B) == 0


@pytest.mark.parametrize(("velocity", "limit"), [(10_000, 3000), (-10_000, -2000)])
def test_a_velocity_ends_at_a_position_limit_and_leaves_it_only_inwards(
    velocity: int, limit: int
) -> None:
    rig = cyclic(CSV)
    rig.set(0x607D, -2000, 1)
    rig.set(0x607D, 3000, 2)
    cycles(rig, [velocity] * 60, 0x60FF)
    assert rig.position == limit
    assert rig.statusword & LIMITED
    cycles(rig, [-velocity // 10] * 10, 0x60FF)
    assert abs(rig.position) < abs(limit) - 50


def test_a_velocity_limit() -> None:
    rig = cyclic(CSV)
    rig.set(0x607F, 4000)
    cycles(rig, [10_000], 0x60FF)
    assert rig.get(0x606B) == 4000
    assert rig.statusword & LIMITED


def test_jammed_it_has_a_following_error_and_after_its_time_a_fault() -> None:
    rig = cyclic(CSP)
    rig.set(0x6065, 300)
    rig.set(0x6066, 50)
    rig.set(0x605E, 0)
    rig.fault("blocked")
    cycles(rig, [100, 200, 300])
    assert rig.state == "enabled"
    cycles(rig, [400, 500])
    assert rig.state == "enabled"
    rig.run(50)
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x8611
    assert rig.statusword & FOLLOWING_ERROR
    assert rig.emergencies() == [0x8611]
    assert rig.get(0x6077) == 0
    rig.control(0x00, 0x80)
    assert not rig.statusword & FOLLOWING_ERROR


def test_a_following_error_that_passes_is_none() -> None:
    rig = cyclic(CSP)
    rig.set(0x6065, 300)
    rig.set(0x6066, 50)
    rig.fault("blocked=60ms")
    cycles(rig, [100, 200, 300, 400])
    rig.run(500)
    assert rig.state == "enabled"
    assert rig.position == 400


def test_the_window_can_be_switched_off() -> None:
    rig = cyclic(CSP)
    rig.set(0x6065, 0xFFFFFFFF)
    rig.fault("blocked")
    cycles(rig, list(range(0, 20_000, 1000)))
    rig.run(1000)
    assert rig.state == "enabled"


def test_too_much_load_stalls_it() -> None:
    rig = cyclic(CSP)
    rig.set(0x6072, 500)
    rig.axis.set_load(150.0)
    cycles(rig, [100])
    assert rig.get(0x6077) == 375
    rig.axis.set_load(250.0)
    cycles(rig, list(range(200, 3000, 100)))
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x8611


def test_a_stalled_motor_gives_all_its_torque() -> None:
    rig = cyclic(CSP)
    rig.set(0x6072, 500)
    rig.axis.set_load(250.0)
    cycles(rig, [100])
    assert rig.get(0x6077) == 500
    assert rig.position == 0
