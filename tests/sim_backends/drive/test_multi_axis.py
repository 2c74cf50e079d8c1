"""A node with three axes: objects at +0x800, PDOs at +0x40."""

import pytest

from sim_backends.devices.drive.axis.mechanics import AxisMechanics
from tests.sim_backends.drive.rig import NODE, STEPPER3, Rig


def module() -> Rig:
    return Rig(
        eds=STEPPER3,
        mechanics=[AxisMechanics(rated_torque_nmm=torque) for torque in (100.0, 200.0, 300.0)],
    )


def enable(rig: Rig, axis: int) -> None:
    base = 0x800 * axis
    rig.set(0x6060 + base, 8)
    rig.set(0x60C2 + base, 10, 1)
    for word in (0x06, 0x07, 0x0F):
        rig.set(0x6040 + base, word)
    rig.run(60)


def test_each_axis_has_its_own_state_and_motor() -> None:
    rig = module()
    rig.operational()
    enable(rig, 1)
    words = [rig.get(0x6041 + 0x800 * axis) & 0x6F for axis in range(3)]
    assert words == [0x40, 0x27, 0x40]
    rig.set(0x607A + 0x800, 500)
    rig.run(100)
    assert [rig.get(0x6064 + 0x800 * axis) for axis in range(3)] == [0, 500, 0]
    assert [axis.position_counts for axis in rig.drive.axes] == [0.0, pytest.approx(500.0), 0.0]


def test_each_axis_has_its_own_mechanics() -> None:
    assert [module().get(0x6076 + 0x800 * axis) for axis in range(3)] == [100, 200, 300]


def test_one_description_is_for_all_axes() -> None:
    rig = Rig(eds=STEPPER3, mechanics=(AxisMechanics(rated_torque_nmm=150.0),))
    assert [rig.get(0x6076 + 0x800 * axis) for axis in range(3)] == [150, 150, 150]


def test_the_pdos_of_the_third_axis() -> None:
    rig = module()
    rig.set(0x1880, 0xC0000000 | 0x480 + NODE, 1)
    rig.set(0x1880, 1, 2)
    rig.set(0x1A80, 0, 0)
    rig.set(0x1A80, 0x70640020, 1)
    rig.set(0x1A80, 1, 0)
    rig.set(0x1880, 0x40000000 | 0x480 + NODE, 1)
    rig.drive.axes[2].drag_to(77.0)
    rig.operational()
    rig.sync()
    rig.run(1)
    assert rig.frames(0x480 + NODE) == [(77).to_bytes(4, "little")]


def test_an_axis_may_map_objects_of_another() -> None:
    rig = module()
    rig.map(False, 1, [0x68410010, 0x70410010], 1)
    rig.operational()
    rig.sync()
    rig.run(1)
    assert len(rig.frames(0x180 + NODE)) == 1


def test_faults_of_one_axis_say_which() -> None:
    rig = module()
    rig.operational()
    enable(rig, 0)
    enable(rig, 2)
    rig.drive.axes[2].fault(0x8611, rig.bus.now_ns)
    rig.run(1)
    (emergency,) = rig.frames(0x080 + NODE)
    assert emergency.hex() == "1186210200000000"
    assert rig.get(0x6041) & 0x6F == 0x27
    assert rig.get(0x7041) & 0x4F in (0x0F, 0x08)


def test_the_loss_of_the_master_stops_all_axes() -> None:
    rig = module()
    rig.set(0x1016, 127 << 16 | 100, 1)
    rig.operational()
    for axis in range(3):
        rig.set(0x6007 + 0x800 * axis, axis + 1)  # fault, disable voltage, quick stop
        rig.set(0x605A + 0x800 * axis, 6)
        enable(rig, axis)
    rig.send(0x77F, b"\x05")
    rig.run(200)
    words = [rig.get(0x6041 + 0x800 * axis) & 0x6F for axis in range(3)]
    assert words == [0x08, 0x40, 0x07]


def test_as_many_descriptions_as_axes() -> None:
    with pytest.raises(ValueError, match="3 axes, but 2"):
        Rig(eds=STEPPER3, mechanics=[AxisMechanics(), AxisMechanics()])
