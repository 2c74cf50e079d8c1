"""Faults of a drive, by the orders an operator would give."""

from typing import Any

import pytest

from sim_backends.devices.drive.faults import DRIVE_FAULTS
from sim_backends.faults import FaultError
from tests.sim_backends.drive.rig import MS, NODE, Rig

ARGUMENTS: dict[str, str] = {
    "emergency": "=0x8611",
    "sdo_abort": "=0x08000020",
    "setting": "=0x6085,0,1",
}


def enabled(**options: Any) -> Rig:
    rig = Rig(**options)
    rig.set(0x60C2, 10, 1)
    rig.enable(8)
    rig.run(1)
    rig.heard.clear()
    return rig


@pytest.mark.parametrize("fault", DRIVE_FAULTS, ids=lambda fault: fault.name)
def test_every_fault_can_be_ordered_and_overcome(fault: Any) -> None:
    rig = enabled()
    lasting = [parameter.name for parameter in fault.parameters] == ["duration"]
    rig.fault(fault.name + ("=50ms" if lasting else ARGUMENTS.get(fault.name, "")))
    rig.run(1500)
    rig.fault("power_cycle=10ms")
    rig.run(500)
    answers = [rig.ask(bytes.fromhex("4000100000000000"), 600) for _ in range(2)]
    assert answers[1] == bytes.fromhex("4300100092010400")
    rig.enable(8)


@pytest.mark.parametrize("fault", DRIVE_FAULTS, ids=lambda fault: fault.name)
def test_a_drive_that_is_off_can_do_nothing_wrong(fault: Any) -> None:
    rig = Rig(boots=False)
    with pytest.raises(FaultError, match="off"):
        rig.fault(fault.name + ARGUMENTS.get(fault.name, ""))


def test_power_cycle() -> None:
    rig = enabled()
    rig.set(0x1017, 20)
    rig.fault("power_cycle=0.5s")
    assert not rig.axis.shaft.energised
    rig.run(790)
    assert rig.heard == []
    rig.run(20)
    assert rig.states() == [0x00]
    assert rig.get(0x6060) == 1  # what was configured is gone


def test_reset_is_a_boot_up_out_of_nothing() -> None:
    rig = enabled()
    rig.fault("reset")
    rig.run(310)
    assert rig.states() == [0x00]
    assert rig.drive.nmt.state == 0x7F
    assert rig.state == "switch on disabled"


def test_boots_twice() -> None:
    rig = enabled()
    rig.fault("boots_twice")
    rig.run(310)
    assert rig.states() == [0x00, 0x00]


def test_wrong_identity() -> None:
    rig = Rig()
    product = rig.read(0x1018, 2)
    rig.fault("wrong_identity")
    rig.run(310)
    assert rig.read(0x1018, 2) == product + 1
    rig.fault("power_cycle=10ms")
    rig.run(400)
    assert rig.read(0x1018, 2) == product + 1


def test_dead_is_cut_off_and_notices_the_masters_silence() -> None:
    rig = enabled()
    rig.set(0x1017, 20)
    rig.set(0x1016, 127 << 16 | 100, 1)
    rig.send(0x77F, b"\x05")
    rig.heard.clear()
    rig.fault("dead=1s")
    rig.run(900)
    assert rig.heard == []
    assert rig.state == "fault"  # its own heartbeat watch
    rig.run(200)
    assert set(rig.states()) == {0x7F}


def test_heartbeat_stop() -> None:
    rig = enabled()
    rig.set(0x1017, 20)
    rig.fault("heartbeat_stop=100ms")
    rig.run(99)
    assert rig.states() == []
    assert rig.read(0x1000) == 0x00040192
    rig.run(100)
    assert rig.states() != []


def test_tpdo_stop() -> None:
    rig = enabled()
    tpdo = rig.map(False, 1, [0x60410010], 1)
    rig.fault("tpdo_stop=10ms")
    rig.sync()
    rig.run(1)
    assert rig.frames(tpdo) == []
    rig.run(20)
    rig.sync()
    rig.run(1)
    assert len(rig.frames(tpdo)) == 1


def test_sync_loss() -> None:
    rig = enabled()
    rig.set(0x1006, 10_000)
    for _ in range(5):
        rig.sync()
        rig.run(9.8)
    rig.fault("sync_loss=1s")
    for _ in range(12):
        rig.sync()
        rig.run(9.8)
    assert rig.state == "fault"
    assert rig.emergencies() == [0x8700]


def test_emergency_is_a_fault_with_that_code() -> None:
    rig = enabled()
    rig.fault("emergency=0x7121")
    rig.run(50)
    assert rig.emergencies() == [0x7121]
    assert rig.get(0x603F) == 0x7121
    assert rig.state == "fault"


@pytest.mark.parametrize("code", ["0", "0x10000"])
def test_no_emergency_code(code: str) -> None:
    with pytest.raises(FaultError, match="0x0001"):
        enabled().fault(f"emergency={code}")


def test_short_emergency_is_only_a_message() -> None:
    rig = enabled()
    rig.fault("short_emergency=0x8110")
    rig.run(1)
    assert rig.frames(0x080 + NODE) == [bytes.fromhex("108100")]
    assert rig.state == "enabled"


def test_warning() -> None:
    rig = enabled()
    rig.fault("warning=50ms")
    assert rig.statusword & 1 << 7
    assert rig.state == "enabled"
    rig.run(60)
    assert not rig.statusword & 1 << 7


def test_over_temperature() -> None:
    rig = enabled()
    cool = rig.read(0x2000, signed=True)
    rig.fault("over_temperature=1s")
    rig.run(50)
    assert rig.emergencies() == [0x4310]
    assert rig.read(0x2000, signed=True) > cool + 300
    assert rig.state == "fault"
    rig.run(1000)
    assert rig.read(0x2000, signed=True) == cool


def test_under_voltage_coasts_and_cannot_be_enabled() -> None:
    rig = enabled()
    rig.fault("under_voltage=1s")
    assert rig.state == "fault"
    assert not rig.axis.shaft.energised
    assert not rig.statusword & 1 << 4
    assert rig.read(0x6079) < 10_000
    rig.control(0x00, 0x80)
    assert rig.state == "fault"
    rig.run(1000)
    rig.control(0x00, 0x80, 0x06, 0x07, 0x0F)
    assert rig.state == "enabled"
    assert rig.statusword & 1 << 4
    assert rig.read(0x6079) > 40_000


def test_sto_takes_the_torque_and_is_no_fault() -> None:
    rig = enabled()
    rig.fault("sto=100ms")
    assert rig.state == "switch on disabled"
    assert not rig.axis.shaft.energised
    assert not rig.statusword & 1 << 4
    assert rig.get(0x60FD) & 1 << 31
    rig.control(0x06)
    assert rig.state == "switch on disabled"
    assert rig.emergencies() == []
    rig.run(150)
    rig.control(0x06, 0x07, 0x0F)
    assert rig.state == "enabled"


def test_encoder_loses_the_zero() -> None:
    rig = Rig()
    rig.axis.drag_to(500.0)
    rig.set(0x6098, 37)
    rig.enable(6)
    rig.control(0x1F)
    rig.run(10)
    assert rig.axis.homed
    rig.fault("encoder=100ms")
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x7305
    assert not rig.axis.homed


def test_blocked() -> None:
    rig = enabled()
    rig.set(0x6065, 100)
    rig.fault("blocked=10s")
    for target in range(100, 1000, 100):
        rig.set(0x607A, target)
        rig.run(10)
    rig.run(100)
    assert rig.axis.position_counts == 0.0
    assert rig.get(0x603F) == 0x8611


def test_sdo_silent() -> None:
    rig = Rig()
    rig.fault("sdo_silent=100ms")
    assert rig.ask(bytes.fromhex("4000100000000000"), 90) is None
    rig.run(20)
    assert rig.read(0x1000) == 0x00040192


def test_sdo_late() -> None:
    rig = Rig()
    rig.fault("sdo_late=300ms,10ms")
    start_ns = rig.bus.now_ns
    rig.master.send(0x600 + NODE, bytes.fromhex("4000100000000000"), start_ns)
    rig.run(500)
    ((_, _, end_ns),) = rig.heard
    assert 300 * MS < end_ns - start_ns < 310 * MS
    rig.heard.clear()
    assert rig.read(0x1000) == 0x00040192


def test_sdo_abort() -> None:
    rig = Rig()
    rig.fault("sdo_abort=0x06060000,2")
    assert [rig.refused(0x1017, 0, 5) for _ in range(3)] == [0x06060000, 0x06060000, 0]


def test_sdo_toggle() -> None:
    rig = Rig()
    rig.fault("sdo_toggle=1")
    rig.ask(bytes.fromhex("4008100000000000"))
    answer = rig.ask(bytes.fromhex("6000000000000000"))
    assert answer is not None
    assert answer[0] & 0x10


def test_stuck_statusword() -> None:
    rig = enabled()
    rig.fault("stuck_statusword=100ms")
    rig.control(0x00)
    assert rig.state == "enabled"
    rig.run(110)
    assert rig.state == "switch on disabled"


def test_refuses_enable() -> None:
    rig = Rig()
    rig.operational()
    rig.fault("refuses_enable=100ms")
    rig.control(0x06, 0x07, 0x0F)
    assert rig.state == "switched on"
    rig.run(110)
    rig.control(0x0F)  # the same word once more
    assert rig.state == "enabled"


def test_injecting_again_prolongs() -> None:
    rig = Rig()
    rig.fault("warning=100ms")
    rig.run(80)
    rig.fault("warning=100ms")
    rig.run(80)
    assert rig.statusword & 1 << 7
    rig.run(30)
    assert not rig.statusword & 1 << 7


def test_the_drives_own_controller_can_go_off_the_bus_and_comes_back() -> None:
    rig = enabled()
    rig.drive.port.count_errors(transmit=256)
    rig.run(5)
    assert 0x8140 in rig.emergencies()
    assert rig.state == "fault"


def test_an_error_passive_controller_is_told() -> None:
    rig = enabled()
    rig.drive.port.count_errors(transmit=130)
    rig.run(1)
    assert rig.emergencies() == [0x8120]
    rig.drive.port.count_errors(transmit=-130)
    rig.run(1)
    assert rig.emergencies() == [0x0000]
