"""The operating states, and everything that leads from one to another."""

from collections.abc import Mapping
from enum import Enum
from typing import Final

from safety.causes import Severity


class OperatingState(Enum):
    """What the robot is doing."""

    STANDBY = "standby"
    """Devices are read, nothing is energised; something is not ready."""
    READY = "ready"
    """Nothing is energised, and arming is possible."""
    ARMED = "armed"
    """Energised, standing where it was measured to be."""
    RUNNING = "running"
    """Energised, following a reference."""
    HOLD = "hold"
    """Energised, standing still because of something that may pass."""
    FAULT = "fault"
    """Stopped and powered off, until somebody clears it."""
    ESTOP = "estop"
    """The external chain is open."""
    HOMING = "homing"
    """Drives look for their zeros by themselves, and the others are off."""

    @property
    def energised(self) -> bool:
        """Whether drives are meant to be on."""
        return self in _FOLLOWS or self is OperatingState.HOMING

    @property
    def follows(self) -> bool:
        """Whether all drives are meant to be on, and to be where they are told to be."""
        return self in _FOLLOWS


_FOLLOWS: Final = (OperatingState.ARMED, OperatingState.RUNNING, OperatingState.HOLD)


class Request(Enum):
    """What somebody, or a part of the daemon, wants to happen."""

    ARM = "arm"
    """Enable the drives; the state changes when they report that they are (ARMED)."""
    ARMED = "armed"
    DISARM = "disarm"
    START = "start"
    FINISHED = "finished"
    """The reference has come to its end."""
    HOLD = "hold"
    RESUME = "resume"
    STOP = "stop"
    CLEAR = "clear"
    HOME = "home"
    HOMED = "homed"
    """Homing has come to its end, whichever."""


def next_state(
    state: OperatingState,
    request: Request | None,
    severity: Severity,
    blocked: bool,
    coming_to_rest: bool = False,
) -> OperatingState:
    """Where the robot goes from `state`; `state` itself where it stays.

    severity: of the worst reason there is now, after a request to clear or resume has had its
    effect on the reasons. blocked: some reason is NOT_READY or worse, and is not what the request
    takes out of the way. coming_to_rest: the drives were told to stop, and are not off yet: a fault
    counts as it would have a moment before, so that it does not matter which of a drive's messages
    came first.
    """
    if state is OperatingState.STANDBY and coming_to_rest and severity >= Severity.FAULT:
        return OperatingState.ESTOP if severity >= Severity.ESTOP else OperatingState.FAULT
    if state.energised:
        return _while_energised(state, request, severity)
    if state is OperatingState.ESTOP:
        return state if severity >= Severity.ESTOP else OperatingState.FAULT
    if state is OperatingState.FAULT:
        cleared = request is Request.CLEAR and severity < Severity.FAULT
        return OperatingState.STANDBY if cleared else state
    if blocked:
        return OperatingState.STANDBY
    if request is Request.HOME:
        return OperatingState.HOMING
    enabled = state is OperatingState.READY and request is Request.ARMED
    return OperatingState.ARMED if enabled else OperatingState.READY


def _while_energised(
    state: OperatingState, request: Request | None, severity: Severity
) -> OperatingState:
    if severity >= Severity.ESTOP:
        return OperatingState.ESTOP
    if severity >= Severity.FAULT:
        return OperatingState.FAULT
    if severity >= Severity.DISARM or request in (Request.STOP, Request.DISARM):
        return OperatingState.STANDBY
    if state is OperatingState.HOMING:  # nothing holds a drive that moves by itself
        ends = severity >= Severity.HOLD or request in (Request.HOLD, Request.HOMED)
        return OperatingState.STANDBY if ends else state
    if severity >= Severity.HOLD:  # what stands still already, armed, needs no holding
        return state if state is OperatingState.ARMED else OperatingState.HOLD
    if state is OperatingState.RUNNING:
        if request is Request.HOLD:
            return OperatingState.HOLD
        return OperatingState.ARMED if request is Request.FINISHED else state
    starts = request is Request.RESUME or (
        request is Request.START and state is OperatingState.ARMED
    )
    return OperatingState.RUNNING if starts else OperatingState.ARMED


_POSSIBLE_IN: Final[Mapping[Request, tuple[OperatingState, ...]]] = {
    Request.ARM: (OperatingState.READY,),
    Request.ARMED: (OperatingState.READY,),
    Request.START: (OperatingState.ARMED,),
    Request.FINISHED: (OperatingState.RUNNING,),
    Request.HOLD: (OperatingState.RUNNING, OperatingState.HOLD, OperatingState.HOMING),
    Request.RESUME: (OperatingState.ARMED, OperatingState.HOLD),
    Request.CLEAR: (OperatingState.FAULT, OperatingState.STANDBY, OperatingState.READY),
    Request.HOME: (OperatingState.STANDBY, OperatingState.READY),
    Request.HOMED: (OperatingState.HOMING,),
}

_INSTEAD: Final[Mapping[OperatingState, str]] = {
    OperatingState.STANDBY: "the drives are off, and something is not ready: see the reasons",
    OperatingState.READY: "the drives are off: arm first",
    OperatingState.ARMED: "the drives are on, and nothing moves",
    OperatingState.RUNNING: "the robot is moving: hold it or stop it first",
    OperatingState.HOLD: "the robot is being held: resume or stop",
    OperatingState.FAULT: "there was a fault: remove its cause, then clear",
    OperatingState.ESTOP: "the external chain is open: close it when it is safe, then clear",
    OperatingState.HOMING: "the drives look for their zeros: wait for them, or stop",
}


def refusal(state: OperatingState, request: Request, severity: Severity, blocked: bool) -> str:
    """Why a request is not possible now, in words; empty if it is. A stop is never refused."""
    if request in (Request.STOP, Request.DISARM):
        return ""
    if state not in _POSSIBLE_IN[request]:
        return _INSTEAD[state]
    if request in (Request.ARM, Request.ARMED, Request.HOME) and blocked:
        return "something is not ready: see the reasons"
    if request in (Request.START, Request.RESUME) and severity >= Severity.HOLD:
        return "something keeps the robot from moving: see the reasons"
    if request is Request.CLEAR and severity >= Severity.FAULT:
        return "a cause of the fault is still there: see the reasons"
    return ""
