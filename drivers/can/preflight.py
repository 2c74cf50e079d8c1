"""What Linux says of a CAN interface before it is opened."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.can.link import LinkError

_NETWORK_INTERFACES: Final = Path("/sys/class/net")
_ARPHRD_CAN: Final = "280"


@dataclass(frozen=True)
class InterfaceState:
    """An existing CAN interface."""

    up: bool
    tx_queue_frames: int


def check_interface(channel: str, root: Path = _NETWORK_INTERFACES) -> InterfaceState:
    """Look at a SocketCAN interface.

    Raises LinkError where there is none of that name, or it is not CAN, or it is not up.
    """
    place = root / channel
    if not place.is_dir():
        there = can_interfaces(root)
        raise LinkError(
            f"there is no interface {channel}",
            f"CAN interfaces here: {', '.join(there) or 'none'}; check the adapter and its driver",
        )
    if _read(place, "type") != _ARPHRD_CAN:
        raise LinkError(f"{channel} is not a CAN interface", "check the channel in the robot file")
    state = InterfaceState(
        _read(place, "operstate") != "down", int(_read(place, "tx_queue_len") or 0)
    )
    if not state.up:
        raise LinkError(
            f"{channel} is down",
            f"ip link set {channel} up type can bitrate 1000000 restart-ms 100",
        )
    return state


def can_interfaces(root: Path = _NETWORK_INTERFACES) -> list[str]:
    """The CAN interfaces that there are."""
    return sorted(entry.name for entry in root.iterdir() if _read(entry, "type") == _ARPHRD_CAN)


def _read(place: Path, name: str) -> str:
    try:
        return (place / name).read_text().strip()
    except OSError:
        return ""
