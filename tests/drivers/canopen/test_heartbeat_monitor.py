"""A node is lost only after it has been heard."""

from drivers.canopen.codec.nmt import NmtState
from drivers.canopen.heartbeat_monitor import HeartbeatMonitor

MS = 1_000_000


def test_a_node_that_was_never_heard_is_not_lost() -> None:
    assert not HeartbeatMonitor(250 * MS).is_lost(10**12)


def test_a_node_is_lost_when_its_heartbeat_is_late() -> None:
    monitor = HeartbeatMonitor(250 * MS)
    assert monitor.receive(b"\x05", 1000 * MS) is NmtState.OPERATIONAL
    assert not monitor.is_lost(1250 * MS)
    assert monitor.is_lost(1251 * MS)


def test_boot_ups_are_counted() -> None:
    monitor = HeartbeatMonitor(250 * MS)
    monitor.receive(b"\x00", 0)
    monitor.receive(b"\x00", 1)
    assert (monitor.boot_ups, monitor.state) == (2, NmtState.BOOT_UP)


def test_nonsense_is_no_sign_of_life() -> None:
    monitor = HeartbeatMonitor(250 * MS)
    for data in (b"", b"\x05\x05", b"\x42"):
        assert monitor.receive(data, 0) is None
    assert monitor.state is None


def test_a_forgotten_node_has_to_be_heard_anew() -> None:
    monitor = HeartbeatMonitor(250 * MS)
    monitor.receive(b"\x05", 0)
    monitor.forget()
    assert not monitor.is_lost(10**12)
