"""The kernel's error frames: what the CAN controller says about the bus."""

from collections.abc import Iterator
from typing import Final

from drivers.can.conditions import OFF, OVERFLOW, PASSIVE
from drivers.conditions import Condition

_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100

# Second byte of a controller error.
_RECEIVE_OVERFLOW: Final = 0x01
_TRANSMIT_OVERFLOW: Final = 0x02
_RECEIVE_PASSIVE: Final = 0x10
_TRANSMIT_PASSIVE: Final = 0x20
_ACTIVE: Final = 0x40


def conditions_of_error_frame(can_id: int, data: bytes) -> Iterator[tuple[Condition, bool, str]]:
    """What an error frame says: condition, whether it holds now, and details.

    An overflow is over as soon as it is told; the receiver counts it.
    """
    if can_id & _BUS_OFF:
        yield OFF, True, "error counter over 255"
    if can_id & _RESTARTED:
        yield OFF, False, "restarted"
        yield PASSIVE, False, "restarted"
    if can_id & _CONTROLLER and len(data) > 1:
        state = data[1]
        if state & (_RECEIVE_OVERFLOW | _TRANSMIT_OVERFLOW):
            yield OVERFLOW, True, "receive" if state & _RECEIVE_OVERFLOW else "transmit"
            yield OVERFLOW, False, ""
        if state & (_RECEIVE_PASSIVE | _TRANSMIT_PASSIVE):
            counters = f"counters {data[6]}/{data[7]}" if len(data) > 7 else "error-passive"
            yield PASSIVE, True, counters
        if state & _ACTIVE:
            yield PASSIVE, False, "error-active again"
