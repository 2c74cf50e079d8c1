"""NMT: states, commands, boot-up and reset."""

import pytest

from tests.sim_backends.drive.rig import MS, NODE, Rig

PRE_OPERATIONAL, OPERATIONAL, STOPPED, BOOT_UP = 0x7F, 0x05, 0x04, 0x00


def test_a_drive_boots_says_so_once_and_is_pre_operational() -> None:
    rig = Rig(boots=False, boot_time_s=0.3)
    rig.drive.power_on(0)
    rig.run(299)
    assert rig.heard == []
    rig.run(2)
    assert [(can_id, data) for can_id, data, _ in rig.heard] == [(0x700 + NODE, b"\x00")]
    assert rig.drive.nmt.state == PRE_OPERATIONAL


def test_a_booting_drive_hears_nothing() -> None:
    rig = Rig(boots=False)
    rig.drive.power_on(0)
    rig.run(100)
    rig.operational()
    assert rig.ask(bytes((0x40, 0x00, 0x10, 0, 0, 0, 0, 0)), 50) is None
    rig.run(300)
    assert rig.drive.nmt.state == PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("command", "state"), [(0x01, OPERATIONAL), (0x02, STOPPED), (0x80, PRE_OPERATIONAL)]
)
@pytest.mark.parametrize("node", [0, NODE])
def test_commands_lead_from_every_state_to_theirs(command: int, state: int, node: int) -> None:
    rig = Rig()
    for before in (0x01, 0x02, 0x80):
        rig.nmt(before)
        rig.nmt(command, node)
        assert rig.drive.nmt.state == state


@pytest.mark.parametrize("data", [b"\x01\x06", b"\x01", b"", b"\x03\x05", b"\x01\x05\x00"])
def test_what_is_not_for_it_changes_nothing(data: bytes) -> None:
    rig = Rig()
    rig.send(0x000, data)
    assert rig.drive.nmt.state == PRE_OPERATIONAL


def test_what_is_heard_in_which_state() -> None:
    """CiA 301, table 37."""
    rig = Rig()
    sync_tpdo = rig.map(False, 1, [0x60410010], 1)
    for command, sdo, pdo in ((0x80, True, False), (0x01, True, True), (0x02, False, False)):
        rig.nmt(command)
        rig.frames(sync_tpdo)
        answer = rig.ask(bytes((0x40, 0x00, 0x10, 0, 0, 0, 0, 0)))
        assert (answer is not None) == sdo
        rig.sync()
        assert bool(rig.frames(sync_tpdo)) == pdo
    rig.nmt(0x80)
    assert rig.drive.nmt.state == PRE_OPERATIONAL


def test_reset_node_forgets_everything_and_takes_the_whole_boot_time() -> None:
    rig = Rig(boot_time_s=0.3)
    rig.set(0x6083, 777)
    rig.set(0x1017, 50)
    rig.enable(8)
    start_ns = rig.bus.now_ns
    rig.heard.clear()
    rig.nmt(0x81)
    assert rig.axis.power.state.name == "NOT_READY"
    assert not rig.axis.shaft.energised
    rig.run(400)
    boot_ups = [t_ns for can_id, data, t_ns in rig.heard if data == b"\x00"]
    assert len(boot_ups) == 1
    assert (boot_ups[0] - start_ns) / MS == pytest.approx(300, abs=1)
    assert rig.read(0x6083) == 100_000
    assert rig.read(0x1017) == 0
    assert rig.state == "switch on disabled"


def test_reset_communication_keeps_what_the_application_has() -> None:
    rig = Rig()
    rig.set(0x6083, 777)
    rig.set(0x1017, 50)
    rig.nmt(0x82)
    rig.heard.clear()
    rig.run(200)
    assert rig.states() == [BOOT_UP]
    assert rig.read(0x6083) == 777
    assert rig.read(0x1017) == 0


@pytest.mark.parametrize("command", [0x81, 0x82])
def test_an_answer_that_was_due_is_lost_with_a_reset(command: int) -> None:
    rig = Rig(sdo_delay_s=0.02)
    rig.send(0x600 + NODE, bytes.fromhex("4000100000000000"))
    rig.nmt(command)
    rig.run(400)
    assert rig.frames(0x580 + NODE) == []


def test_an_error_while_it_boots_changes_nothing() -> None:
    rig = Rig()
    rig.set(0x1029, 2, 1)
    rig.nmt(0x82)
    rig.drive.port.count_errors(transmit=256)
    rig.run(400)
    assert rig.drive.nmt.state == PRE_OPERATIONAL


def test_no_heartbeat_while_it_boots() -> None:
    rig = Rig(boot_time_s=0.3)
    rig.set(0x1017, 20)
    rig.nmt(0x81)
    rig.heard.clear()
    rig.run(290)
    assert rig.states() == []


def test_power_can_go_and_come() -> None:
    rig = Rig()
    rig.set(0x1017, 20)
    rig.operational()
    rig.drive.power_off(rig.bus.now_ns)
    rig.heard.clear()
    rig.run(500)
    assert rig.heard == []
    rig.drive.power_on(rig.bus.now_ns)
    rig.drive.power_on(rig.bus.now_ns)
    rig.run(310)
    assert rig.states() == [BOOT_UP]
