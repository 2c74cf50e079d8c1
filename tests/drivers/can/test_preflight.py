"""What Linux says of a CAN interface, and what to do when it says the wrong thing."""

from pathlib import Path

import pytest

from drivers.can.link import LinkError
from drivers.can.preflight import can_interfaces, check_interface


def interface(root: Path, name: str, kind: str = "280", state: str = "up", queue: int = 10) -> None:
    place = root / name
    place.mkdir()
    (place / "type").write_text(f"{kind}\n")
    (place / "operstate").write_text(f"{state}\n")
    (place / "tx_queue_len").write_text(f"{queue}\n")


def test_an_interface_that_is_up_tells_its_queue(tmp_path: Path) -> None:
    interface(tmp_path, "can0", queue=128)
    assert check_interface("can0", tmp_path).tx_queue_frames == 128


def test_a_missing_interface_is_named_with_those_that_are_there(tmp_path: Path) -> None:
    interface(tmp_path, "can1")
    interface(tmp_path, "eth0", kind="1")
    with pytest.raises(LinkError, match=r"there is no interface can0.*here: can1"):
        check_interface("can0", tmp_path)
    assert can_interfaces(tmp_path) == ["can1"]


def test_an_interface_that_is_down_or_no_can_is_refused_with_the_remedy(tmp_path: Path) -> None:
    interface(tmp_path, "can0", state="down")
    interface(tmp_path, "eth0", kind="1")
    with pytest.raises(LinkError, match="ip link set can0 up type can bitrate"):
        check_interface("can0", tmp_path)
    with pytest.raises(LinkError, match="eth0 is not a CAN interface"):
        check_interface("eth0", tmp_path)
