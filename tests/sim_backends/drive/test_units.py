"""The factor group: what the master counts in, and what the motor does."""

import pytest

from sim_backends.devices.drive.axis.mechanics import AxisMechanics, to_int32
from tests.sim_backends.drive.rig import Rig


def test_without_factors_a_unit_is_an_increment_of_whatever_encoder_there_is() -> None:
    rig = Rig(mechanics=(AxisMechanics(counts_per_turn=10_000),))
    assert rig.get(0x608F, 1) == 10_000
    assert rig.axis.drag_to(2500.0)
    assert rig.position == rig.get(0x6063) == 2500


def test_feed_constant_and_gear_set_the_position_unit() -> None:
    rig = Rig()  # 4000 increments per motor turn
    rig.write(0x6091, 1, 5)  # five turns of the motor per turn of the shaft
    rig.write(0x6092, 1, 2000)  # 2000 units per turn of the shaft
    rig.axis.drag_to(20_000.0)  # one turn of the shaft
    assert rig.position == 2000
    assert rig.get(0x6063) == 20_000


def test_targets_are_in_the_same_unit() -> None:
    rig = Rig()
    rig.set(0x6092, 1000, 1)  # a quarter of an increment's resolution
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.set(0x607A, 25)
    rig.run(100)
    assert rig.axis.position_counts == pytest.approx(100.0, abs=0.01)
    assert rig.position == 25


def test_velocities_have_a_factor_of_their_own() -> None:
    rig = Rig()
    rig.set(0x6096, 60, 1)  # 60/4000: revolutions per minute
    rig.set(0x6096, 4000, 2)
    rig.enable(3)
    rig.set(0x60FF, 150)
    rig.run(500)
    assert rig.get(0x606C) == 150
    assert rig.axis.shaft.velocity == pytest.approx(10_000.0)


def test_polarity_turns_positions_and_torques_round() -> None:
    rig = Rig()
    rig.set(0x607E, 1 << 7)
    rig.axis.drag_to(100.0)
    assert rig.position == -100
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.axis.set_load(40.0)
    rig.set(0x607A, -200)
    rig.run(100)
    assert rig.axis.position_counts == pytest.approx(200.0, abs=0.01)
    assert rig.get(0x6077) == -100


def test_polarity_turns_velocities_round() -> None:
    rig = Rig()
    rig.set(0x607E, 1 << 6)
    rig.enable(3)
    rig.set(0x60FF, 1000)
    rig.run(200)
    assert rig.axis.shaft.velocity == pytest.approx(-1000.0)
    assert rig.get(0x606C) == 1000


def test_limits_and_windows_follow_the_unit() -> None:
    rig = Rig()
    rig.set(0x607D, -50, 1)
    rig.set(0x607D, 50, 2)
    rig.set(0x6065, 10)
    rig.set(0x6066, 10)
    rig.set(0x6092, 400, 1)  # ten increments to the unit
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.set(0x607A, 100)
    rig.run(100)
    assert rig.axis.position_counts == pytest.approx(500.0, abs=0.1)
    rig.fault("blocked=1s")
    rig.set(0x607A, 41)
    rig.run(100)
    assert rig.state == "enabled"
    rig.set(0x607A, 39)
    rig.run(100)
    assert rig.state in ("fault", "fault reaction")


@pytest.mark.parametrize("index", [0x6091, 0x6092, 0x6096])
def test_a_factor_of_zero_is_refused(index: int) -> None:
    assert Rig().refused(index, 1, 0) == 0x06090032
    assert Rig().refused(index, 2, 0) == 0x06090032


@pytest.mark.parametrize(
    ("value", "wrapped"),
    [(0.4, 0), (-0.6, -1), (2.0**31, -(2**31)), (-(2.0**31) - 1, 2**31 - 1), (2.0**33 + 5, 5)],
)
def test_counters_wrap_round(value: float, wrapped: int) -> None:
    assert to_int32(value) == wrapped


def test_torque_is_in_per_mille_of_the_rated_torque() -> None:
    rig = Rig(mechanics=(AxisMechanics(rated_torque_nmm=200.0),), motor_torque_nmm=1000.0)
    assert rig.read(0x6076) == 200
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.axis.set_load(50.0)
    assert rig.get(0x6077) == rig.get(0x6078) == 250
    rig.axis.set_load(-50.0)
    assert rig.get(0x6077) == -250
