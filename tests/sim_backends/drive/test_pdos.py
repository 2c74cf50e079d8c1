"""When PDOs are sent and applied."""

import struct

import pytest

from drivers.can.frame import REMOTE_FLAG
from sim_backends.devices.can.frame_length import frame_bits
from tests.sim_backends.drive.rig import NODE, Rig

CONTROLWORD, TARGET, MODE = 0x60400010, 0x607A0020, 0x60600008
STATUSWORD, POSITION, TORQUE = 0x60410010, 0x60640020, 0x60770010
SYNC_EVERY, ACYCLIC, REMOTE_SYNC, REMOTE, VENDOR, PROFILE = 1, 0, 252, 253, 254, 255

RPDO1, TPDO1 = 0x200 + NODE, 0x180 + NODE


def sent_by_sync(rig: Rig, count: int) -> list[int]:
    """With which of `count` SYNCs, from 1, the TPDO came."""
    turns = []
    for turn in range(1, count + 1):
        rig.sync()
        rig.run(1)
        turns += [turn] * len(rig.frames(TPDO1))
    return turns


# Receive


def test_a_synchronous_rpdo_counts_from_the_next_sync() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [CONTROLWORD, TARGET], SYNC_EVERY)
    rig.operational()
    rig.send(rpdo, struct.pack("<Hi", 0x06, 1234))
    rig.run(10)
    assert rig.get(0x6040) == 0
    assert rig.state == "switch on disabled"
    rig.sync()
    assert (rig.get(0x6040), rig.get(0x607A)) == (0x06, 1234)
    assert rig.state == "ready"


def test_only_the_newest_synchronous_rpdo_counts() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [CONTROLWORD, TARGET], SYNC_EVERY)
    rig.operational()
    for target in (1, 2, 3):
        rig.send(rpdo, struct.pack("<Hi", 0, target))
    rig.sync()
    assert rig.get(0x607A) == 3
    rig.set(0x607A, 7)
    rig.sync()  # nothing new
    assert rig.get(0x607A) == 7


@pytest.mark.parametrize("kind", [VENDOR, PROFILE])
def test_an_asynchronous_rpdo_counts_at_once(kind: int) -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [CONTROLWORD, TARGET], kind)
    rig.operational()
    rig.send(rpdo, struct.pack("<Hi", 0x06, -1))
    assert rig.get(0x607A) == -1
    assert rig.state == "ready"


def test_outside_of_operational_rpdos_are_not_heard() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [TARGET], PROFILE)
    rig.send(rpdo, struct.pack("<i", 5))
    assert rig.get(0x607A) == 0


def test_dummies_are_skipped() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [0x00050008, TARGET, 0x00060010], PROFILE)
    rig.operational()
    rig.send(rpdo, struct.pack("<BiH", 9, 77, 9))
    assert rig.get(0x607A) == 77


def test_a_value_out_of_range_has_no_effect() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [MODE, CONTROLWORD], PROFILE)
    rig.operational()
    rig.send(rpdo, struct.pack("<bH", 99, 0x06))
    assert rig.get(0x6060) == 1
    assert rig.state == "ready"
    rig.send(rpdo, struct.pack("<bH", 8, 0x06))
    assert rig.get(0x6061) == 8


def test_one_that_is_too_short_is_told_once_and_not_used() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [TARGET], PROFILE)
    rig.operational()
    rig.send(rpdo, b"\x01")
    rig.send(rpdo, b"\x01")
    rig.run(1)
    assert rig.emergencies() == [0x8210]
    assert rig.get(0x607A) == 0
    rig.send(rpdo, struct.pack("<i", 5))
    assert rig.get(0x607A) == 5
    rig.send(rpdo, b"\x01")
    rig.run(1)
    assert rig.emergencies() == [0x8210]


def test_one_that_is_too_long_is_told_and_used() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [TARGET], PROFILE)
    rig.operational()
    rig.send(rpdo, struct.pack("<iH", 5, 0xFFFF))
    rig.run(1)
    assert rig.emergencies() == [0x8220]
    assert rig.get(0x607A) == 5


def test_a_deadline_is_watched_from_the_first_one_on() -> None:
    rig = Rig()
    rpdo = rig.map(True, 1, [TARGET], PROFILE)
    rig.set(0x1400, 50, 5)
    rig.operational()
    rig.run(200)
    assert rig.emergencies() == []
    rig.send(rpdo, bytes(4))
    rig.run(49)
    assert rig.emergencies() == []
    rig.run(2)
    assert rig.emergencies() == [0x8250]
    rig.send(rpdo, bytes(4))
    rig.run(1)
    assert rig.emergencies() == [0x0000]


# Transmit


def test_a_synchronous_tpdo_shows_the_moment_of_the_sync_and_comes_after_it() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD, POSITION, TORQUE], SYNC_EVERY)
    rig.enable(3)
    rig.set(0x60FF, 100_000)
    rig.run(2000)
    rig.frames(tpdo)
    start_ns = rig.bus.now_ns
    rig.master.send(0x080, b"", start_ns)
    sync_ns = start_ns + frame_bits(0x080, b"") * 1000
    rig.bus.advance(sync_ns)
    at_sync = rig.get(0x6064)
    rig.run(1)
    ((_, data, end_ns),) = [entry for entry in rig.heard if entry[0] == tpdo]
    word, position, torque = struct.unpack("<Hih", data)
    assert position == at_sync
    assert word & 0x6F == 0x27
    assert torque == 0
    begun_ns = end_ns - frame_bits(tpdo, data) * 1000
    assert 20_000 < begun_ns - sync_ns < 100_000


@pytest.mark.parametrize("every", [1, 2, 5, 240])
def test_every_so_manieth_sync(every: int) -> None:
    rig = Rig()
    rig.map(False, 1, [STATUSWORD], every)
    rig.operational()
    turns = sent_by_sync(rig, 480)
    assert turns == list(range(every, 481, every))


def test_acyclic_comes_with_the_sync_after_an_event() -> None:
    rig = Rig()
    rig.map(False, 1, [STATUSWORD], ACYCLIC)
    rig.operational()
    assert sent_by_sync(rig, 3) == [1]
    rig.control(0x06)
    assert rig.frames(TPDO1) == []
    assert sent_by_sync(rig, 3) == [1]


def test_counting_can_begin_with_a_certain_sync() -> None:
    rig = Rig()
    rig.set(0x1019, 10)
    rig.map(False, 1, [STATUSWORD], 4)
    rig.set(0x1800, TPDO1 | 0xC0000000, 1)
    rig.set(0x1800, 3, 6)
    rig.set(0x1800, TPDO1 | 0x40000000, 1)
    rig.operational()
    turns = []
    for turn in range(1, 21):
        rig.sync((turn - 1) % 10 + 1)
        rig.run(1)
        turns += [turn] * len(rig.frames(TPDO1))
    assert turns == [6, 10, 14, 18]


@pytest.mark.parametrize("kind", [VENDOR, PROFILE])
def test_event_driven_ones_come_at_first_and_with_every_change(kind: int) -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD], kind)
    rig.operational()
    assert len(rig.frames(tpdo)) == 1
    rig.run(1000)
    assert rig.frames(tpdo) == []
    rig.control(0x06)
    rig.run(1)
    assert [word[0] & 0x6F for word in rig.frames(tpdo)] == [0x21]


def test_the_inhibit_time_lets_the_last_state_through() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD], PROFILE)
    rig.set(0x1800, TPDO1 | 0xC0000000, 1)
    rig.set(0x1800, 1000, 3)  # 100 ms
    rig.set(0x1800, TPDO1 | 0x40000000, 1)
    rig.operational()
    rig.frames(tpdo)
    rig.control(0x06, 0x07)
    rig.run(90)
    assert rig.frames(tpdo) == []
    rig.run(20)
    assert [word[0] & 0x6F for word in rig.frames(tpdo)] == [0x23]


def test_the_event_timer_repeats() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [STATUSWORD], PROFILE)
    rig.set(0x1800, 20, 5)
    rig.operational()
    rig.frames(tpdo)
    rig.run(201)
    assert len(rig.frames(tpdo)) == 10


def remote(rig: Rig, kind: int) -> int:
    can_id = rig.map(False, 1, [POSITION], kind)
    rig.set(0x1800, can_id | 0x80000000, 1)
    rig.set(0x1800, can_id, 1)  # bit 30 clear: remote frames allowed
    return can_id


def test_one_asked_for_by_a_remote_frame() -> None:
    rig = Rig()
    tpdo = remote(rig, REMOTE)
    rig.operational()
    rig.sync()
    assert rig.frames(tpdo) == []
    rig.send(tpdo | REMOTE_FLAG, bytes(4))
    rig.run(1)
    assert len(rig.frames(tpdo)) == 1


def test_one_sampled_at_sync_and_asked_for_later() -> None:
    rig = Rig()
    tpdo = remote(rig, REMOTE_SYNC)
    rig.operational()
    rig.sync()
    rig.axis.drag_to(500.0)
    rig.send(tpdo | REMOTE_FLAG, bytes(4))
    rig.run(1)
    assert rig.frames(tpdo) == [bytes(4)]


def test_where_remote_frames_are_not_allowed_they_are_not_answered() -> None:
    rig = Rig()
    tpdo = rig.map(False, 1, [POSITION], SYNC_EVERY)
    rig.operational()
    rig.send(tpdo | REMOTE_FLAG, bytes(4))
    rig.run(1)
    assert rig.frames(tpdo) == []


def test_another_identifier_counts_at_once() -> None:
    rig = Rig()
    rig.map(False, 1, [STATUSWORD], SYNC_EVERY)
    rig.operational()
    rig.set(0x1800, 0xC0000000 | TPDO1, 1)
    rig.sync()
    rig.run(1)
    assert rig.frames(TPDO1) == []
    rig.set(0x1800, 0x400001F5, 1)
    rig.sync()
    rig.run(1)
    assert len(rig.frames(0x1F5)) == 1


def test_the_last_state_of_a_broken_drive_stays_whole() -> None:
    """A drive reset in the middle of a cycle leaves no half-configured PDO behind."""
    rig = Rig()
    rpdo = rig.map(True, 1, [CONTROLWORD, TARGET], SYNC_EVERY)
    rig.operational()
    rig.send(rpdo, struct.pack("<Hi", 0x06, 99))
    rig.nmt(0x81)
    rig.run(400)
    rig.operational()
    rig.sync()
    assert (rig.get(0x6040), rig.get(0x607A)) == (0, 0)


def test_the_same_seed_gives_the_same_frames() -> None:
    def play(seed: int) -> list[tuple[int, bytes, int]]:
        rig = Rig(seed=seed)
        rig.map(False, 1, [STATUSWORD, POSITION], SYNC_EVERY)
        rig.operational()
        rig.read(0x1000)
        for _ in range(5):
            rig.sync()
            rig.run(10)
        return rig.heard

    assert play(1) == play(1)
    assert play(1) != play(2)


def test_nothing_is_sent_that_was_not_asked_for() -> None:
    rig = Rig()
    rig.operational()
    rig.run(1)
    rig.heard.clear()
    rig.run(5000)
    assert rig.heard == []
