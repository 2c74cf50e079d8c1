"""The power state machine (CiA 402-2, 6): one table of states, one of transitions.

What a transition does to the motor is the axis' business.
"""

from enum import Enum, auto
from typing import Final


class State(Enum):
    """States, with the bits 0 to 3, 5 and 6 that they show in the statusword."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION = 0x0F
    FAULT = 0x08


class PowerCommand(Enum):
    """What the low bits of a controlword ask for."""

    DISABLE_VOLTAGE = auto()
    QUICK_STOP = auto()
    SHUTDOWN = auto()
    SWITCH_ON = auto()
    ENABLE_OPERATION = auto()


FAULT_RESET: Final = 1 << 7
HALT: Final = 1 << 8


def command_of(controlword: int) -> PowerCommand:
    """The command in a controlword. Quick stop is active low."""
    if not controlword & 0b0010:
        return PowerCommand.DISABLE_VOLTAGE
    if not controlword & 0b0100:
        return PowerCommand.QUICK_STOP
    if not controlword & 0b0001:
        return PowerCommand.SHUTDOWN
    if not controlword & 0b1000:
        return PowerCommand.SWITCH_ON
    return PowerCommand.ENABLE_OPERATION


# Transition number by state and command. 0, 1, 13 and 14 happen by themselves, 15 on the fault
# reset's edge. From READY, enabling takes 3 and then 4.
TRANSITIONS: Final = {
    (State.SWITCH_ON_DISABLED, PowerCommand.SHUTDOWN): 2,
    (State.READY, PowerCommand.SWITCH_ON): 3,
    (State.READY, PowerCommand.ENABLE_OPERATION): 3,
    (State.SWITCHED_ON, PowerCommand.ENABLE_OPERATION): 4,
    (State.OPERATION_ENABLED, PowerCommand.SWITCH_ON): 5,
    (State.SWITCHED_ON, PowerCommand.SHUTDOWN): 6,
    (State.READY, PowerCommand.DISABLE_VOLTAGE): 7,
    (State.READY, PowerCommand.QUICK_STOP): 7,
    (State.OPERATION_ENABLED, PowerCommand.SHUTDOWN): 8,
    (State.OPERATION_ENABLED, PowerCommand.DISABLE_VOLTAGE): 9,
    (State.SWITCHED_ON, PowerCommand.DISABLE_VOLTAGE): 10,
    (State.SWITCHED_ON, PowerCommand.QUICK_STOP): 10,
    (State.OPERATION_ENABLED, PowerCommand.QUICK_STOP): 11,
    (State.QUICK_STOP_ACTIVE, PowerCommand.DISABLE_VOLTAGE): 12,
    (State.QUICK_STOP_ACTIVE, PowerCommand.ENABLE_OPERATION): 16,
}

TARGET: Final = {
    2: State.READY,
    3: State.SWITCHED_ON,
    4: State.OPERATION_ENABLED,
    5: State.SWITCHED_ON,
    6: State.READY,
    7: State.SWITCH_ON_DISABLED,
    8: State.READY,
    9: State.SWITCH_ON_DISABLED,
    10: State.SWITCH_ON_DISABLED,
    11: State.QUICK_STOP_ACTIVE,
    12: State.SWITCH_ON_DISABLED,
    13: State.FAULT_REACTION,
    14: State.FAULT,
    15: State.SWITCH_ON_DISABLED,
    16: State.OPERATION_ENABLED,
}


class StopOption:
    """Option codes 0x605A to 0x605E: how to stop."""

    DISABLE: Final = 0
    SLOW_DOWN_RAMP: Final = 1
    QUICK_STOP_RAMP: Final = 2
    CURRENT_LIMIT: Final = 3
    STAY: Final = 4
    """Of 0x605A: this much more stays in quick stop active."""


class ConnectionLost:
    """0x6007: what to do when communication is lost."""

    NOTHING: Final = 0
    FAULT: Final = 1
    DISABLE_VOLTAGE: Final = 2
    QUICK_STOP: Final = 3


# What a drive of this make can do, of what its EDS gives a range for.
SUPPORTED_OPTIONS: Final = {
    0x6007: (0, 1, 2, 3),
    0x605A: (0, 1, 2, 3, 5, 6, 7),
    0x605B: (0, 1),
    0x605C: (0, 1),
    0x605D: (1, 2),
    0x605E: (0, 1, 2),
}
