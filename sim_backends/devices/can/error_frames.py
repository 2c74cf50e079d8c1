"""What the kernel tells a program about its CAN controller: error frames (linux/can/error.h)."""

from typing import Final

from drivers.can.frame import ERROR_FLAG
from sim_backends.devices.can.port import ControllerState, Port

_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100
_COUNTERS: Final = 0x200

# Second byte of a controller error.
_TRANSMIT_WARNING: Final = 0x08
_TRANSMIT_PASSIVE: Final = 0x20
_RECEIVE_WARNING: Final = 0x04
_RECEIVE_PASSIVE: Final = 0x10
_ACTIVE: Final = 0x40


def error_frame(port: Port, was_off: bool) -> tuple[int, bytes]:
    """Identifier and data of the error frame that tells of the state `port` has just come to."""
    counters = bytes((min(port.transmit_errors, 255), min(port.receive_errors, 255)))
    if port.state is ControllerState.OFF:
        return ERROR_FLAG | _BUS_OFF, bytes(8)
    if was_off:
        return ERROR_FLAG | _RESTARTED, bytes(8)
    detail = _ACTIVE
    transmits = port.transmit_errors >= port.receive_errors
    if port.state is ControllerState.PASSIVE:
        detail = _TRANSMIT_PASSIVE if transmits else _RECEIVE_PASSIVE
    elif port.state is ControllerState.WARNING:
        detail = _TRANSMIT_WARNING if transmits else _RECEIVE_WARNING
    data = bytes((0, detail, 0, 0, 0, 0)) + counters
    return ERROR_FLAG | _CONTROLLER | _COUNTERS, data
