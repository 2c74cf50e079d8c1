"""Heartbeat producer and consumer, node guarding."""

import pytest

from drivers.can.frame import REMOTE_FLAG
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.device import DeviceClock
from sim_backends.devices.drive.drive import EmulatedDrive
from tests.sim_backends.drive.rig import NODE, STEPPER, Rig

MASTER_200_MS = 127 << 16 | 200


def test_the_drive_beats_with_its_state() -> None:
    rig = Rig()
    rig.write(0x1017, 0, 100)
    rig.heard.clear()
    rig.run(1000)
    assert rig.states() == [0x7F] * 10
    rig.operational()
    rig.run(400)
    assert set(rig.states()) == {0x05}
    rig.nmt(0x02)
    rig.run(400)
    assert set(rig.states()) == {0x04}


def test_another_period_counts_at_once_and_zero_ends_it() -> None:
    rig = Rig()
    rig.set(0x1017, 500)
    rig.set(0x1017, 20)
    rig.run(101)
    assert len(rig.states()) == 5
    rig.set(0x1017, 0)
    rig.run(1000)
    assert rig.states() == []


def test_its_clock_is_not_ours() -> None:
    bus = CanBus(1_000_000)
    drive = EmulatedDrive(bus, NODE, STEPPER, clock=DeviceClock(error_ppm=10_000))
    hearer = bus.attach("hearer", 1)
    times: list[int] = []
    hearer.listen({0x700 + NODE: lambda _id, _data, t_ns: times.append(t_ns)})
    drive.power_on(0)
    bus.advance(400_000_000)
    drive.objects.look_up(0x1017, 0).write(1000, bus.now_ns)
    bus.advance(5_000_000_000)
    assert (times[-1] - times[-2]) / 1e6 == pytest.approx(1000 / 1.01, abs=0.01)


def test_a_consumer_waits_for_the_first_heartbeat() -> None:
    rig = Rig()
    rig.write(0x1016, 1, MASTER_200_MS)
    rig.operational()
    rig.run(5000)
    assert rig.emergencies() == []
    assert rig.drive.nmt.state == 0x05


def test_heartbeats_keep_it_content_and_their_end_is_told_in_time() -> None:
    rig = Rig()
    rig.set(0x1016, MASTER_200_MS, 1)
    rig.operational()
    for _ in range(10):
        rig.send(0x77F, b"\x05")
        rig.run(150)
    assert rig.emergencies() == []
    rig.run(49)
    assert rig.emergencies() == []
    rig.run(2)
    assert rig.emergencies() == [0x8130]


def test_a_heartbeat_that_comes_back_ends_the_error() -> None:
    rig = Rig()
    rig.set(0x1016, MASTER_200_MS, 1)
    rig.send(0x77F, b"\x05")
    rig.run(250)
    assert rig.emergencies() == [0x8130]
    assert rig.read(0x1001) == 0x11
    rig.send(0x77F, b"\x05")
    rig.run(1)
    assert rig.emergencies() == [0x0000]
    assert rig.read(0x1001) == 0


def test_several_nodes_can_be_watched() -> None:
    rig = Rig()
    rig.set(0x1016, MASTER_200_MS, 1)
    rig.set(0x1016, 3 << 16 | 100, 2)
    rig.send(0x77F, b"\x05")
    rig.send(0x703, b"\x05")
    rig.run(110)
    assert rig.emergencies() == [0x8130]
    rig.run(200)
    rig.send(0x703, b"\x05")
    rig.run(1)
    assert rig.emergencies() == []  # the other one is still lost
    rig.send(0x77F, b"\x05")
    rig.run(1)
    assert rig.emergencies() == [0x0000]


def test_one_node_cannot_be_watched_twice() -> None:
    rig = Rig()
    rig.write(0x1016, 1, MASTER_200_MS)
    assert rig.refused(0x1016, 2, 127 << 16 | 500) == 0x06040043
    assert rig.refused(0x1016, 1, 127 << 16 | 500) == 0
    assert rig.refused(0x1016, 2, 128 << 16 | 500) == 0x06090031
    assert rig.refused(0x1016, 1, 0) == 0
    assert rig.refused(0x1016, 2, 127 << 16 | 500) == 0


def test_a_consumer_that_is_switched_off_forgets() -> None:
    rig = Rig()
    rig.set(0x1016, MASTER_200_MS, 1)
    rig.send(0x77F, b"\x05")
    rig.set(0x1016, 0, 1)
    rig.run(1000)
    assert rig.emergencies() == []


def test_node_guarding_answers_with_alternating_toggle() -> None:
    rig = Rig()
    for _ in range(3):
        rig.send(0x700 + NODE | REMOTE_FLAG, bytes(1))
        rig.run(1)
    assert rig.states() == [0x7F, 0xFF, 0x7F]


def test_life_guarding_notices_that_the_master_has_stopped_asking() -> None:
    rig = Rig()
    rig.write(0x100C, 0, 100)
    rig.write(0x100D, 0, 3)
    rig.run(1000)
    assert rig.emergencies() == []
    rig.send(0x700 + NODE | REMOTE_FLAG, bytes(1))
    rig.run(298)
    assert rig.emergencies() == []
    rig.run(5)
    assert rig.emergencies() == [0x8130]
    rig.send(0x700 + NODE | REMOTE_FLAG, bytes(1))
    rig.run(1)
    assert rig.emergencies() == [0x0000]
