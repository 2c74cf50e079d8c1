"""The power state machine of a CiA 402 drive, seen from the master.

The whole machine is two tables: what each statusword means, and which controlword leads on from
each state towards what is wanted. The next controlword is worked out anew from every statusword
that comes in; nothing waits.
"""

from enum import Enum
from typing import Final


class PowerState(Enum):
    """States of CiA 402, with the words that operators see."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"

    # Members are looked up in every cycle, and there is one of each: an enumeration's own hash is
    # that of the name, and slow.
    __hash__ = object.__hash__

    @property
    def energised(self) -> bool:
        """Whether the motor has torque."""
        return self in _ENERGISED

    @property
    def unpowered(self) -> bool:
        """Whether the drive says that its motor has none: of an unknown state nobody knows."""
        return not (self.energised or self is PowerState.UNKNOWN)


_ENERGISED: Final = {
    PowerState.OPERATION_ENABLED,
    PowerState.QUICK_STOP_ACTIVE,
    PowerState.FAULT_REACTION,
}

_STATE_OF_STATUSWORD: Final = (
    (0x4F, 0x00, PowerState.NOT_READY),
    (0x4F, 0x40, PowerState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, PowerState.READY_TO_SWITCH_ON),
    (0x6F, 0x23, PowerState.SWITCHED_ON),
    (0x6F, 0x27, PowerState.OPERATION_ENABLED),
    (0x6F, 0x07, PowerState.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, PowerState.FAULT_REACTION),
    (0x4F, 0x08, PowerState.FAULT),
)


def _look_up(low_bits: int) -> PowerState:
    for mask, value, state in _STATE_OF_STATUSWORD:
        if low_bits & mask == value:
            return state
    return PowerState.UNKNOWN


_STATES: Final = tuple(_look_up(low_bits) for low_bits in range(0x80))


def power_state(statusword: int) -> PowerState:
    """The state that a statusword (0x6041) tells."""
    return _STATES[statusword & 0x7F]


class StatuswordBit:
    """Further bits of the statusword."""

    VOLTAGE_ENABLED: Final = 1 << 4
    WARNING: Final = 1 << 7
    REMOTE: Final = 1 << 9
    TARGET_REACHED: Final = 1 << 10
    INTERNAL_LIMIT: Final = 1 << 11
    SETPOINT_ACKNOWLEDGED: Final = 1 << 12  # profile position
    HOMING_ATTAINED: Final = 1 << 12  # homing
    FOLLOWS_TARGET: Final = 1 << 12  # cyclic modes
    FOLLOWING_ERROR: Final = 1 << 13  # position modes
    HOMING_ERROR: Final = 1 << 13  # homing


class Control:
    """Controlwords (0x6040) without their mode bits, and the mode bits."""

    DISABLE_VOLTAGE: Final = 0x00
    QUICK_STOP: Final = 0x02
    SHUTDOWN: Final = 0x06
    SWITCH_ON: Final = 0x07
    ENABLE_OPERATION: Final = 0x0F
    FAULT_RESET: Final = 0x80
    NEW_SETPOINT: Final = 1 << 4  # profile position
    CHANGE_IMMEDIATELY: Final = 1 << 5  # profile position
    START_HOMING: Final = 1 << 4  # homing
    HALT: Final = 1 << 8


class PowerGoal(Enum):
    """What the master wants of a drive."""

    OFF = "off"
    """No voltage: switch on disabled."""
    STANDBY = "standby"
    """Ready to switch on."""
    ENABLED = "enabled"
    """Torque on, following targets."""
    QUICK_STOP = "quick stop"
    """Brake on the drive's own ramp; where it ends the drive's 0x605A says."""

    __hash__ = object.__hash__


_TOWARDS: Final = {
    PowerGoal.OFF: {},
    PowerGoal.STANDBY: {
        PowerState.SWITCH_ON_DISABLED: Control.SHUTDOWN,
        PowerState.READY_TO_SWITCH_ON: Control.SHUTDOWN,
        PowerState.SWITCHED_ON: Control.SHUTDOWN,
        PowerState.OPERATION_ENABLED: Control.SHUTDOWN,
    },
    PowerGoal.ENABLED: {
        PowerState.SWITCH_ON_DISABLED: Control.SHUTDOWN,
        PowerState.READY_TO_SWITCH_ON: Control.SWITCH_ON,
        PowerState.SWITCHED_ON: Control.ENABLE_OPERATION,
        PowerState.OPERATION_ENABLED: Control.ENABLE_OPERATION,
        PowerState.QUICK_STOP_ACTIVE: Control.ENABLE_OPERATION,
    },
    PowerGoal.QUICK_STOP: {
        PowerState.OPERATION_ENABLED: Control.QUICK_STOP,
        PowerState.QUICK_STOP_ACTIVE: Control.QUICK_STOP,
        PowerState.UNKNOWN: Control.QUICK_STOP,  # it may be moving
    },
}

_STAYS: Final = {
    PowerState.READY_TO_SWITCH_ON: Control.SHUTDOWN,
    PowerState.SWITCHED_ON: Control.SWITCH_ON,
    PowerState.QUICK_STOP_ACTIVE: Control.QUICK_STOP,
}

_REACHED: Final = {
    PowerGoal.OFF: {
        PowerState.SWITCH_ON_DISABLED,
        PowerState.NOT_READY,
        PowerState.FAULT,
    },
    PowerGoal.STANDBY: {PowerState.READY_TO_SWITCH_ON},
    PowerGoal.ENABLED: {PowerState.OPERATION_ENABLED},
    # A drive may pass through its quick stop faster than the master can see it.
    PowerGoal.QUICK_STOP: {
        PowerState.QUICK_STOP_ACTIVE,
        PowerState.SWITCH_ON_DISABLED,
        PowerState.READY_TO_SWITCH_ON,
        PowerState.SWITCHED_ON,
        PowerState.FAULT,
    },
}


def controlword_towards(goal: PowerGoal, state: PowerState) -> int:
    """The controlword that leads from `state` towards `goal`, or holds it there.

    Never resets a fault: that is deliberate, see `FaultReset`.
    """
    return _TOWARDS[goal].get(state, Control.DISABLE_VOLTAGE)


def controlword_to_stay(state: PowerState) -> int | None:
    """The controlword that changes nothing in `state`; None where there is none that is safe."""
    if state is PowerState.OPERATION_ENABLED:
        return None
    return _STAYS.get(state, Control.DISABLE_VOLTAGE)


def reached(goal: PowerGoal, state: PowerState) -> bool:
    """Whether a drive in `state` has done what `goal` asks."""
    return state in _REACHED[goal]


class FaultReset:
    """The rising edge that resets a fault.

    Synchronous outputs are applied at the next SYNC only, so the low and the high level each stay
    for two cycles.
    """

    _LEVELS: Final = (
        Control.DISABLE_VOLTAGE,
        Control.DISABLE_VOLTAGE,
        Control.FAULT_RESET,
        Control.FAULT_RESET,
        Control.DISABLE_VOLTAGE,
    )

    def __init__(self) -> None:
        self._next = len(self._LEVELS)
        self.running = False
        """Whether the edge still has levels to send."""

    def begin(self) -> None:
        """Start the edge with the next controlword."""
        self._next = 0
        self.running = True

    def controlword(self) -> int:
        """The next level of the edge."""
        level = self._LEVELS[self._next]
        self._next += 1
        self.running = self._next < len(self._LEVELS)
        return level
