"""What the loss of the master does: heartbeat, EMCY, NMT state, power state machine."""

from struct import pack

import pytest

from tests.sim_backends.drive.rig import MS, Rig

CSP = 8
PRE_OPERATIONAL, OPERATIONAL, STOPPED = 0x7F, 0x05, 0x04


def watched(**settings: int) -> Rig:
    """An enabled drive that watches its master."""
    rig = Rig()
    rig.set(0x1016, 127 << 16 | 200, 1)
    rig.set(0x1029, settings.get("behaviour", 0), 1)
    rig.set(0x6007, settings.get("abort_option", 3))
    rig.set(0x605A, settings.get("quick_stop_option", 6))
    rig.enable(settings.get("mode", CSP))
    rig.send(0x77F, b"\x05")
    rig.heard.clear()
    return rig


def test_the_whole_cascade_step_by_step() -> None:
    rig = watched(mode=3, abort_option=3, quick_stop_option=6)
    rig.set(0x6083, 1_000_000)
    rig.set(0x60FF, 20_000)
    rig.set(0x6085, 100_000)
    rig.set(0x1017, 10)
    rig.run(150)
    assert rig.get(0x606C) == pytest.approx(20_000, rel=0.01)
    lost_ns = rig.bus.now_ns
    rig.run(60)
    # 1. The EMCY says why.
    (emergency,) = [entry for entry in rig.heard if entry[0] == 0x085]
    assert emergency[1] == bytes.fromhex("3081110000000000")
    assert 0 < emergency[2] - lost_ns < 60 * MS
    # 2. Leaving operational, as 0x1029 says, shows in the heartbeat.
    assert rig.drive.nmt.state == PRE_OPERATIONAL
    assert rig.states()[-1] == PRE_OPERATIONAL
    # 3. 0x6007 makes that a quick stop, braking at 0x6085: 20000 in 0.2 s.
    assert rig.state == "quick stop"
    assert 0 < rig.get(0x606C) < 20_000
    rig.run(250)
    # 4. 0x605A = 6: it stands, holds, and stays.
    assert rig.state == "quick stop"
    assert rig.get(0x606C) == 0
    assert rig.axis.shaft.energised


@pytest.mark.parametrize(
    ("option", "state"),
    [(0, "enabled"), (1, "fault"), (2, "switch on disabled"), (3, "quick stop")],
)
def test_abort_connection_options(option: int, state: str) -> None:
    rig = watched(abort_option=option)
    rig.run(250)
    assert rig.drive.nmt.state == PRE_OPERATIONAL
    assert rig.state == state
    assert rig.get(0x603F) == (0x8130 if option == 1 else 0)


@pytest.mark.parametrize(
    ("behaviour", "nmt_state", "state"),
    [
        (0, PRE_OPERATIONAL, "quick stop"),
        (1, OPERATIONAL, "enabled"),
        (2, STOPPED, "quick stop"),
    ],
)
def test_error_behaviours(behaviour: int, nmt_state: int, state: str) -> None:
    rig = watched(behaviour=behaviour)
    rig.run(250)
    assert rig.drive.nmt.state == nmt_state
    assert rig.state == state
    assert rig.emergencies() == [0x8130]


def test_in_pre_operational_a_loss_is_told_and_changes_nothing_else() -> None:
    rig = Rig()
    rig.set(0x1016, 127 << 16 | 200, 1)
    rig.send(0x77F, b"\x7f")
    rig.run(250)
    assert rig.emergencies() == [0x8130]
    assert rig.drive.nmt.state == PRE_OPERATIONAL
    assert rig.state == "switch on disabled"


def test_a_fault_of_lost_connection_stays_until_the_master_is_back_and_resets_it() -> None:
    rig = watched(abort_option=1)
    rig.run(300)
    assert rig.state == "fault"
    rig.control(0x00, 0x80)
    assert rig.state == "fault"  # the master is still silent
    rig.send(0x77F, b"\x05")
    rig.control(0x00, 0x80)
    assert rig.state == "switch on disabled"
    assert rig.get(0x603F) == 0


@pytest.mark.parametrize("command", [0x80, 0x02])
def test_leaving_operational_by_command_is_an_end_of_connection_too(command: int) -> None:
    rig = watched(abort_option=1)
    rig.nmt(command)
    rig.run(100)
    assert rig.state == "fault"
    assert rig.get(0x603F) == 0x8100


def test_a_drive_that_is_not_switched_on_takes_no_offence() -> None:
    rig = Rig()
    rig.set(0x6007, 1)
    rig.operational()
    rig.nmt(0x80)
    assert rig.state == "switch on disabled"
    assert rig.emergencies() == []


@pytest.mark.parametrize(
    ("option", "state"),
    [(0, "enabled"), (1, "fault"), (2, "switch on disabled"), (3, "quick stop")],
)
@pytest.mark.parametrize("mode", [3, 9])
def test_set_points_that_do_not_come_do_what_a_lost_connection_does(
    mode: int, option: int, state: str
) -> None:
    rig = Rig()
    rig.set(0x6007, option)
    rig.set(0x605A, 6)
    rig.set(0x60C2, 10, 1)
    rpdo = rig.map(True, 1, [0x60400010, 0x60FF0020], 1)
    rig.set(0x1400, 100, 5)
    rig.enable(mode)
    rig.heard.clear()
    for _ in range(30):
        rig.send(rpdo, pack("<Hi", 0x0F, 20_000))
        rig.sync()
        rig.run(9.6)
    assert rig.get(0x606C) == pytest.approx(20_000, rel=0.05)
    rig.run(85)
    assert rig.get(0x606C) == pytest.approx(20_000, rel=0.05), "it goes on for so long"
    assert rig.emergencies() == []
    rig.run(400)
    assert rig.emergencies()[0] == 0x8250
    assert rig.state == state
    assert (rig.get(0x606C) == 0) is (option != 0)
    assert rig.drive.nmt.state == OPERATIONAL
