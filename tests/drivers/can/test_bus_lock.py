"""A bus has one name, by whatever path it is opened, and different buses have different ones."""

import os
import pty
import socket
from pathlib import Path

import pytest

from config.bus import Bus
from drivers.can.bus_lock import BusTakenError, bus_name, check_buses_are_free, take_bus


def bus(interface: str, channel: Path | str) -> Bus:
    return Bus(interface=interface, channel=str(channel), cycle_period_s=0.01)


def test_a_serial_adapter_is_the_same_by_any_path_and_through_any_interface(
    tmp_path: Path,
) -> None:
    far, near = pty.openpty()
    other_far, other_near = pty.openpty()
    try:
        device, other = Path(os.ttyname(near)), Path(os.ttyname(other_near))
        by_id = tmp_path / "usb-adapter"
        by_id.symlink_to(device)
        name = bus_name(bus("slcan", device))
        assert bus_name(bus("slcan", by_id)) == name
        assert bus_name(bus("slcan", f"{by_id}@115200")) == name
        assert bus_name(bus("robotell", by_id)) == name
        assert bus_name(bus("slcan", other)) != name
    finally:
        for descriptor in (far, near, other_far, other_near):
            os.close(descriptor)


def test_a_port_is_the_same_through_a_device_node_in_another_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # /dev/null stands for a serial adapter whose node is seen in two file systems.
    status = os.stat("/dev/null")  # noqa: PTH116
    elsewhere = os.stat_result(
        (status.st_mode, 999, status.st_dev + 1, *status[3:]), {"st_rdev": status.st_rdev}
    )
    name = bus_name(bus("slcan", "/dev/null"))
    monkeypatch.setattr(Path, "stat", lambda _: elsewhere)
    assert bus_name(bus("slcan", "/dev/null")) == name


def test_the_emulated_bus_is_its_socket_and_a_new_one_is_another_bus(tmp_path: Path) -> None:
    path, moved = tmp_path / "can0.sock", tmp_path / "away.sock"
    with socket.socket(socket.AF_UNIX) as first, socket.socket(socket.AF_UNIX) as second:
        first.bind(str(path))
        name = bus_name(bus("tentacled", path))
        path.rename(moved)
        assert bus_name(bus("tentacled", moved)) == name
        second.bind(str(path))
        assert bus_name(bus("tentacled", path)) != name


def test_interfaces_without_a_file_are_told_apart_by_kind_and_channel() -> None:
    loopback = next(name for _, name in socket.if_nameindex())
    index = socket.if_nametoindex(loopback)
    names = [
        bus_name(bus(interface, channel))
        for interface, channel in (
            ("socketcan", loopback),
            ("socketcan", "can_that_is_not_there"),
            ("pcan", "PCAN_USBBUS1"),
            ("pcan", "PCAN_USBBUS2"),
            ("kvaser", "0"),
            ("ixxat", "0"),
        )
    ]
    assert len(set(names)) == len(names)
    assert names[0] == f"bus socketcan {index}"


def test_pythons_virtual_bus_is_another_one_in_each_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mine = bus_name(bus("virtual", "vcan"))
    monkeypatch.setattr(os, "getpid", lambda: 1)
    assert bus_name(bus("virtual", "vcan")) != mine


def test_a_bus_that_is_taken_is_told_before_anything_is_opened(tmp_path: Path) -> None:
    free, taken = bus("pcan", f"{tmp_path} A"), bus("pcan", f"{tmp_path} B")
    check_buses_are_free([free, taken])
    lock = take_bus(taken)
    with pytest.raises(BusTakenError, match=r" B is taken: this process has it open"):
        check_buses_are_free([free, taken])
    with pytest.raises(BusTakenError):
        take_bus(taken)
    lock.release()
    check_buses_are_free([free, taken])
