"""What goes wrong on a CAN bus: fault confinement as ISO 11898-1 has it."""

import pytest

from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.frame_length import frame_bits
from sim_backends.devices.can.port import ControllerState
from tests.sim_backends.can.rig import MS, Node


def test_a_node_alone_is_not_acknowledged_and_becomes_passive_but_never_bus_off() -> None:
    bus = CanBus(1_000_000)
    lonely = Node.on(bus)
    lonely.port.send(0x181, b"", 0)
    bus.advance(1000 * MS)
    assert lonely.states == [ControllerState.WARNING, ControllerState.PASSIVE]
    assert lonely.port.transmit_errors == 128
    assert lonely.port.sent == 0


def test_not_being_acknowledged_fills_the_bus_but_does_not_keep_the_machine_busy() -> None:
    bus = CanBus(1_000_000)
    lonely = Node.on(bus)
    lonely.port.send(0x181, b"", 0)
    bus.advance(10 * MS)
    before = bus.statistics()
    assert bus.advance(20 * MS) is None
    assert bus.statistics().load_since(before) == pytest.approx(1.0)


def test_the_frame_gets_through_as_soon_as_somebody_is_there() -> None:
    bus = CanBus(1_000_000)
    lonely = Node.on(bus)
    lonely.port.send(0x181, b"\x05", 0)
    bus.advance(50 * MS)
    late = Node.on(bus)
    bus.advance(60 * MS)
    assert late.ids == [0x181]
    assert late.heard[0][2] == 50 * MS + frame_bits(0x181, b"\x05") * 1000


def test_successes_make_a_node_active_again() -> None:
    bus = CanBus(1_000_000)
    lonely = Node.on(bus, capacity=200)
    lonely.port.send(0x181, b"", 0)
    bus.advance(50 * MS)
    Node.on(bus)
    for _ in range(130):
        lonely.port.send(0x181, b"", bus.now_ns)
    bus.advance(100 * MS)
    assert lonely.states[-2:] == [ControllerState.WARNING, ControllerState.ACTIVE]
    assert lonely.port.transmit_errors == 0


def test_a_destroyed_frame_is_sent_again_until_it_gets_through() -> None:
    bus = CanBus(1_000_000, seed=3)
    sender, hearer = Node.on(bus, 64), Node.on(bus)
    bus.corrupt_probability = 0.4
    bus.rebuild()
    for number in range(20):
        sender.port.send(0x200 + number, b"\x01", 0)
    bus.advance(100 * MS)
    assert hearer.ids == [0x200 + number for number in range(20)]
    assert bus.statistics().error_frames > 0
    assert hearer.port.receive_errors >= 0


def test_errors_are_counted_by_eight_for_the_sender_and_one_for_the_others() -> None:
    bus = CanBus(1_000_000)
    sender, hearer = Node.on(bus), Node.on(bus)
    bus.corrupt_probability = 1.0
    bus.rebuild()
    sender.port.send(0x181, bytes(8), 0)
    while bus.statistics().error_frames < 5:
        bus.advance(bus.now_ns + 10_000)
    assert sender.port.transmit_errors == 40
    assert hearer.port.receive_errors == 5
    bus.corrupt_probability = 0.0
    bus.rebuild()
    bus.advance(bus.now_ns + MS)  # the sixth attempt was under way, the seventh gets through
    assert sender.port.transmit_errors == 6 * 8 - 1
    assert hearer.port.receive_errors == 6 - 1


def test_too_many_errors_take_a_node_off_the_bus_and_it_comes_back_after_its_time() -> None:
    bus = CanBus(1_000_000)
    sender, hearer = Node.on(bus), Node.on(bus)
    sender.port.restart_after_ns = 100 * MS
    bus.corrupt_probability = 1.0
    bus.rebuild()
    sender.port.send(0x181, b"", 0)
    sender.port.send(0x182, b"", 0)
    bus.advance(50 * MS)
    assert sender.states[-1:] == [ControllerState.OFF]
    assert not sender.port.send(0x183, b"", 50 * MS)
    bus.corrupt_probability = 0.0
    bus.rebuild()
    bus.advance(200 * MS)
    assert sender.states[-1:] == [ControllerState.ACTIVE]
    assert sender.port.transmit_errors == 0
    # What had waited is gone: it was old.
    assert hearer.ids == []
    sender.port.send(0x184, b"", 200 * MS)
    bus.advance(201 * MS)
    assert hearer.ids == [0x184]


def test_without_a_restart_time_a_node_stays_off_until_told() -> None:
    bus = CanBus(1_000_000)
    sender, _ = Node.on(bus), Node.on(bus)
    sender.port.count_errors(transmit=256)
    bus.advance(10_000 * MS)
    assert sender.states == [ControllerState.OFF]
    sender.port.restart()
    assert sender.states == [ControllerState.OFF, ControllerState.ACTIVE]
    assert sender.port.on_bus


def test_a_node_with_the_wrong_bit_rate_hears_nothing_and_goes_off_the_bus() -> None:
    bus = CanBus(1_000_000)
    wrong, one, other = Node.on(bus), Node.on(bus), Node.on(bus)
    wrong.port.wrong_bit_rate = True
    bus.rebuild()
    one.port.send(0x181, b"", 0)
    wrong.port.send(0x080, b"", 0)
    bus.advance(100 * MS)
    assert wrong.states[-1] is ControllerState.OFF
    assert wrong.ids == []
    assert other.ids == [0x181]


def test_one_that_only_listens_does_not_acknowledge() -> None:
    bus = CanBus(1_000_000)
    sender, listener = Node.on(bus), Node.on(bus)
    listener.port.listens_only = True
    bus.rebuild()
    sender.port.send(0x181, b"", 0)
    bus.advance(10 * MS)
    assert sender.port.sent == 0


def test_a_dropped_frame_is_lost_for_some_and_counted() -> None:
    bus = CanBus(1_000_000, seed=5)
    sender, hearers = Node.on(bus, 200), [Node.on(bus), Node.on(bus)]
    bus.drop_probability = 0.5
    for _ in range(100):
        sender.port.send(0x181, b"", 0)
    bus.advance(100 * MS)
    for hearer in hearers:
        assert len(hearer.heard) + hearer.port.received_lost == 100
        assert 25 < len(hearer.heard) < 75
    assert hearers[0].heard != hearers[1].heard


def test_leaving_the_bus_cuts_off_what_is_being_sent() -> None:
    bus = CanBus(1_000_000)
    leaver, stayer, hearer = Node.on(bus), Node.on(bus), Node.on(bus)
    leaver.port.send(0x100, bytes(8), 0)
    bus.advance(20_000)
    leaver.port.connect(False)
    stayer.port.send(0x200, b"", 20_000)
    bus.advance(MS)
    assert hearer.ids == [0x200]
    assert leaver.port.pending == 0
