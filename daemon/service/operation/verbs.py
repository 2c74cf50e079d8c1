"""For every command: whether it would be let through now, and if not why, and what helps."""

from typing import Final, NamedTuple

from daemon.messages import COMMANDS, Acquire, Stop, Verb, verb
from daemon.supervision.supervisor import Supervisor
from safety.states import OperatingState, Request

_REQUESTS: Final = {
    "arm": Request.ARM,
    "home": Request.HOME,
    "start": Request.START,
    "teleoperate": Request.START,
    "hold": Request.HOLD,
    "resume": Request.RESUME,
    "clear": Request.CLEAR,
}
_NAMES: Final = tuple(verb(kind) for kind in COMMANDS)
_WITHOUT_LEASE: Final = frozenset((verb(Acquire), verb(Stop)))
_HELPS: Final = {
    OperatingState.STANDBY: "See to the reasons; then clear and arm",
    OperatingState.READY: "Arm first",
    OperatingState.ARMED: "Load and start",
    OperatingState.RUNNING: "Hold or stop first",
    OperatingState.HOLD: "Resume, or disarm",
    OperatingState.FAULT: "Remove the cause, then clear",
    OperatingState.ESTOP: "Close the external chain when it is safe, then clear",
    OperatingState.HOMING: "Wait for the drives, or stop",
}


_STANDS: Final = (OperatingState.READY, OperatingState.ARMED, OperatingState.HOLD)


class Prepared(NamedTuple):
    """What commands depend on besides the state."""

    loaded: bool
    """There is something for `start` to follow."""
    loaded_anew: bool
    """... and it is another than was held."""
    resumable: bool
    """There is something that was held."""
    preparing: bool
    """The robot is being armed or homed."""
    emulated: bool
    """Devices can be made to misbehave."""


_POSSIBLE: Final = {
    name: Verb(name=name, needs_lease=name not in _WITHOUT_LEASE, possible=True) for name in _NAMES
}


def verb_states(supervisor: Supervisor, prepared: Prepared) -> list[Verb]:
    """Every command, in the order of COMMANDS. Who asks is not considered, nor the lease."""
    told = []
    for name in _NAMES:
        why, helps = _why_not(name, supervisor, prepared)
        if not why:
            told.append(_POSSIBLE[name])
            continue
        needs_lease = name not in _WITHOUT_LEASE
        told.append(
            Verb(name=name, needs_lease=needs_lease, possible=False, why_not=why, helps=helps)
        )
    return told


def _why_not(name: str, supervisor: Supervisor, prepared: Prepared) -> tuple[str, str]:
    """Why, and what helps; empty where nothing stands in the way."""
    if name == "release" and supervisor.energised:
        return "the drives are energised", "Disarm first"
    if name in ("load", "surround") and supervisor.running:
        return "the robot is moving", "Hold or stop first"
    if name == "inject" and not prepared.emulated:
        return "faults are for emulated devices only", ""
    if name in ("arm", "home") and prepared.preparing:
        return "the robot is being armed or homed already", "Wait for it"
    if name == "plan" and supervisor.state not in _STANDS:
        return f"the robot is {supervisor.state.value}", "Plan while it is armed or held"
    request = _REQUESTS.get(name)
    if name == "start" and supervisor.state is OperatingState.HOLD and prepared.loaded_anew:
        request = Request.RESUME
    if request is None:
        return "", ""
    if why := supervisor.refusal(request):
        blocking = supervisor.blocking
        remedy = blocking[0].cause.remedy if blocking else _HELPS[supervisor.state]
        return why, remedy
    if name == "start" and not prepared.loaded:
        return "nothing is loaded", "Load a trajectory first"
    if name == "resume" and not prepared.resumable:
        return "nothing was held", "Load and start"
    if request is Request.RESUME and supervisor.still_holds:
        return "what stopped the motion still holds", supervisor.reasons[0].cause.remedy
    return "", ""
