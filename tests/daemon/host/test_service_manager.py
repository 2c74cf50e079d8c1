"""What systemd hears on its socket."""

import os
import socket
from pathlib import Path

import pytest

from daemon.host.service_manager import ServiceManager


@pytest.fixture
def listener(tmp_path: Path) -> socket.socket:
    """The service manager's end."""
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    end.bind(str(tmp_path / "notify"))
    return end


def heard(listener: socket.socket) -> list[str]:
    """All that has come."""
    found = []
    while True:
        try:
            found.append(listener.recv(1000).decode())
        except BlockingIOError:
            return found


def manager_of(tmp_path: Path, **more: str) -> ServiceManager:
    return ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "notify"), **more})


def test_it_is_told_when_we_are_up_how_we_are_and_when_we_go(
    listener: socket.socket, tmp_path: Path
) -> None:
    manager = manager_of(tmp_path)
    manager.ready()
    manager.status("arm is hold:\n tip_lost")
    manager.status("arm is hold:\n tip_lost")
    manager.stopping()
    assert heard(listener) == ["READY=1", "STATUS=arm is hold: tip_lost", "STOPPING=1"]
    manager.close()
    listener.close()


def test_the_watchdog_is_fed_five_times_per_timeout_by_good_cycles_alone(
    listener: socket.socket, tmp_path: Path
) -> None:
    manager = manager_of(tmp_path, WATCHDOG_USEC="2000000", WATCHDOG_PID=str(os.getpid()))
    fed = 0
    for cycle in range(200):  # two seconds
        manager.good_cycle(cycle * 10_000_000)
        fed += heard(listener).count("WATCHDOG=1")
    assert fed == 5
    manager.ready()
    manager.status("busy")
    assert "WATCHDOG=1" not in heard(listener)
    manager.close()
    listener.close()


def test_a_queue_that_is_full_holds_nobody(listener: socket.socket, tmp_path: Path) -> None:
    manager = manager_of(tmp_path, WATCHDOG_USEC="5")
    for cycle in range(1000):
        manager.good_cycle(cycle * 1_000_000)
    assert 0 < len(heard(listener)) < 1000
    listener.close()
    manager.ready()  # nobody is there any more
    manager.close()
    manager.ready()


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "vsock:2:1"},
        {"WATCHDOG_USEC": "2000000"},
        {"WATCHDOG_USEC": "often"},
        {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"},
    ],
    ids=str,
)
def test_where_nobody_listens_nothing_is_said(environment: dict[str, str]) -> None:
    manager = ServiceManager(environment)
    manager.ready()
    manager.good_cycle(10**12)
    manager.close()


def test_another_processs_watchdog_is_not_ours(listener: socket.socket, tmp_path: Path) -> None:
    manager = manager_of(tmp_path, WATCHDOG_USEC="2000000", WATCHDOG_PID="1")
    manager.good_cycle(10**12)
    assert heard(listener) == []
    manager.close()
    listener.close()


def test_a_name_of_the_abstract_kind_is_understood() -> None:
    name = f"tentacled-test-{os.getpid()}"
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    end.bind("\0" + name)
    manager = ServiceManager({"NOTIFY_SOCKET": f"@{name}"})
    manager.ready()
    assert heard(end) == ["READY=1"]
    manager.close()
    end.close()
