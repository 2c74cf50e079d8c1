"""Everything that can be wrong with the robot, in one table: how bad it is, and what helps.

One home raises them, `daemon.supervision.checks`; `safety.failsafe` decides from this table what
follows.
"""

from collections.abc import Iterable
from enum import Enum, IntEnum, StrEnum, unique
from typing import Final, Self


class Severity(IntEnum):
    """What a cause does to the robot. The worst one wins."""

    NONE = 0
    WARNING = 1
    """Told, and nothing else."""
    NOT_READY = 2
    """No arming; a robot that is energised goes on."""
    HOLD = 3
    """Stand still, energised."""
    DISARM = 4
    """Stop, then power off. Arming again is possible at once."""
    FAULT = 5
    """Quick stop, then power off, until somebody clears it."""
    ESTOP = 6
    """The external chain is open: it has been observed that power is gone."""


class ClearRule(Enum):
    """What takes a cause away."""

    BY_ITSELF = "by itself"
    """Goes when the condition goes."""
    BY_RESUME = "by resuming"
    """Stays after the condition is gone until the operator resumes, or the power is off.

    For what is over in a moment, or would vanish just because the robot stands still.
    """
    DELIBERATELY = "by clearing"
    """Stays after the condition is gone until it is cleared, if it came while energised."""


class CauseRow(StrEnum):
    """A table of causes: each member is one row of it. A base without members."""

    severity: Severity
    debounce_s: float
    """So long the condition must hold; a condition that flaps adds its times up."""
    clears: ClearRule
    text: str
    remedy: str

    def __new__(
        cls,
        value: str,
        severity: Severity,
        debounce_s: float,
        clears: ClearRule,
        text: str,
        remedy: str,
    ) -> Self:
        """value: the name under which it is told, recorded and written in tables."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.severity, member.debounce_s, member.clears = severity, debounce_s, clears
        member.text, member.remedy = text, remedy
        return member


_W, _N, _H = Severity.WARNING, Severity.NOT_READY, Severity.HOLD
_D, _F, _E = Severity.DISARM, Severity.FAULT, Severity.ESTOP
_SELF, _RESUME, _CLEAR = ClearRule.BY_ITSELF, ClearRule.BY_RESUME, ClearRule.DELIBERATELY


# fmt: off
@unique
class Cause(CauseRow):
    """What can be wrong. A member is told by its value, everywhere."""

    TRACKER_WARNING = (
        "tracker_warning", _W, 0.5, _SELF,
        "the tracker measures, but not as it should",
        "see the detail; keep metal away and the sensors inside the measurement volume",
    )
    BUS_DEGRADED = (
        "bus_degraded", _W, 0.5, _SELF,
        "the CAN bus works, but with errors or too much traffic",
        "check plugs, cable length and both terminating resistors; see the detail",
    )
    DRIVE_WARNING = (
        "drive_warning", _W, 0.2, _SELF,
        "a drive warns",
        "look at its display or its manual before it becomes a fault",
    )
    DRIVE_LIMIT = (
        "drive_limit", _W, 0.2, _SELF,
        "a drive holds back because of one of its own limits",
        "compare travel, velocity and torque in the drive with the robot file",
    )
    LOOP_SLOW = (
        "loop_slow", _W, 1.0, _SELF,
        "the control loop often misses its time",
        "end other programs on this computer; see what the last late cycle was spent on",
    )
    GIVING_WAY = (
        "giving_way", _W, 0.2, _SELF,
        "something is nearer to the body than it may be, and steps are only let through since they"
        " lead away from it",
        "see in `/risk` or on the page where; stop what moves, or take it away: what comes faster"
        " than the body can go will touch it",
    )
    NEAR_AT_REST = (
        "near_at_rest", _W, 0.2, _SELF,
        "the body stands energised, and something touches it there, or may at any moment",
        "see the detail; stop what moves, or take it away, before the robot is started; disarm if"
        " somebody is pinched",
    )
    KEPT_AWAY = (
        "kept_away", _W, 2.0, _SELF,
        "what is near to the body keeps the tip from its reference",
        "see in `/risk` or on the page where; lead the reference elsewhere, plan a path, or hold,"
        " move what is in the way and load its new place",
    )
    REAL_TIME_DEGRADED = (
        "real_time_degraded", _W, 0.0, _SELF,
        "the operating system does not give the loop its real-time rights",
        "`tentacled doctor` names what is missing and how to grant it",
    )
    RECORDING_DROPPED = (
        "recording_dropped", _W, 0.0, _SELF,
        "the recorder cannot keep up: parts of the recording are missing",
        "record to a faster disk, or end other programs that write to it",
    )

    TRACKER_NOT_READY = (
        "tracker_not_ready", _N, 0.0, _SELF,
        "the tracker is not measuring",
        "see the detail; plug it in and switch it on",
    )
    NODE_NOT_READY = (
        "node_not_ready", _N, 0.0, _SELF,
        "a drive is not set up",
        "see the detail; check its power, its plug and its node number",
    )
    DRIVE_SETTINGS_CHANGED = (
        "drive_settings_changed", _N, 0.0, _SELF,
        "a drive's settings, its own safety reactions among them, are not what they were set to",
        "see which one and find out who writes to it; the drive is set up anew by itself when "
        "nobody else commands it; then arm again",
    )
    NOT_REFERENCED = (
        "not_referenced", _N, 0.0, _SELF,
        "an axis does not know where its zero is: its positions mean nothing",
        "make sure that it may move, then `tentacled home`",
    )
    BUS_NOT_OPEN = (
        "bus_not_open", _N, 0.0, _SELF,
        "the CAN interface is not open",
        "plug the adapter in and bring the interface up; see the detail",
    )
    RECORDER_FAILED = (
        "recorder_failed", _N, 0.0, _SELF,
        "the recorder does not run: nothing is recorded",
        "it is started again by itself; where that fails, see to what the detail says",
    )
    DISK_LOW = (
        "disk_low", _N, 0.0, _SELF,
        "little space is left where recordings go",
        "delete or move old recordings",
    )

    TRACKER_LATE = (
        "tracker_late", _H, 0.0, _SELF,
        "no believed measurement of the tip for too long",
        "look for metal or a cable in the way; resume when it is back",
    )
    TRACKER_QUALITY = (
        "tracker_quality", _H, 0.1, _SELF,
        "too many measurements of the tip are missing or not believed",
        "bring the sensors closer to the field generator and away from metal, then resume",
    )
    BUS_QUEUE_FULL = (
        "bus_queue_full", _H, 0.05, _SELF,
        "the CAN interface does not get its frames sent",
        "check plugs and terminating resistors; lengthen cycle_period_s or raise the bit rate",
    )
    DRIVE_EMERGENCY = (
        "drive_emergency", _H, 0.0, _RESUME,
        "a drive reports an error",
        "the code is named; its manual says more; then resume",
    )
    LOOP_LATE = (
        "loop_late", _H, 0.0, _SELF,
        "the control loop came much too late",
        "see what the time was spent on; end other programs, then resume",
    )
    LEASE_LOST = (
        "lease_lost", _H, 0.0, _SELF,
        "whoever controlled the robot no longer renews the lease",
        "connect again and take the lease, then resume",
    )
    SETPOINT_LATE = (
        "setpoint_late", _H, 0.0, _SELF,
        "no valid set-point for too long",
        "check the client and the network, then resume",
    )
    RISK_TOO_HIGH = (
        "risk_too_high", _H, 0.2, _RESUME,
        "going on would probably touch something",
        "follow another reference; or move what is in the way, load its new place, and resume",
    )
    MINUTE_RISK_TOO_HIGH = (
        "minute_risk_too_high", _H, 0.0, _RESUME,
        "the steps of the last minute together have probably enough touched something",
        "see whether something is touched; wait until the minute is over, then resume, or follow"
        " another reference",
    )
    PATH_RISK_TOO_HIGH = (
        "path_risk_too_high", _H, 0.0, _SELF,
        "what is left of the planned path would probably enough touch something",
        "take off what hangs at the tip, or plan another path from here and load it",
    )
    RISK_UNAVAILABLE = (
        "risk_unavailable", _H, 0.1, _RESUME,
        "the risk of collision is not known: its model is missing, late or outside what it knows",
        "see the detail; resume when the model answers in time",
    )
    BODY_NOT_AS_MODELLED = (
        "body_not_as_modelled", _H, 0.0, _SELF,
        "the tip is not where the model of the body has it, so the risk of collision is unknown",
        "look for what the body touches; take off what hangs at the tip, or train a model with it"
        " and declare it as risk.tip_load_g; then resume",
    )
    OBSTACLES_LATE = (
        "obstacles_late", _H, 0.0, _SELF,
        "a stream of moving obstacles has stopped: nobody knows where they are",
        "start what sends it, or have it end the stream, then resume; where it is gone for good, "
        "disarm and clear",
    )
    BODY_FAILED = (
        "body_failed", _H, 0.0, _RESUME,
        "the package that the emulated body comes from gave no body: it stays as it was",
        "see the detail, which names it; repair it or take another plant, then resume",
    )
    GATE_REFUSED = (
        "gate_refused", _H, 1.0, _RESUME,
        "the limits leave nothing of what the controller asks for",
        "see which limit; resume with a reference that the robot can reach",
    )
    CONTROLLER_FAILED = (
        "controller_failed", _H, 0.0, _RESUME,
        "the controller gave no usable answer",
        "see the detail; choose another controller or model, then resume",
    )
    TRACKING_DIVERGES = (
        "tracking_diverges", _H, 0.0, _RESUME,
        "the tip does not get to its reference, or goes away from it",
        "choose another controller, or learn a model first, then resume; look whether something "
        "holds the body",
    )
    TIP_JUMPED = (
        "tip_jumped", _H, 0.0, _RESUME,
        "the tip is suddenly somewhere else, and stays there: the body may have snapped",
        "look at the body; tubes snap back where they are drawn out or turned back; then resume",
    )
    OUT_OF_WORKSPACE = (
        "out_of_workspace", _H, 0.1, _RESUME,
        "the tip is going out of its workspace",
        "take off what pulls it, then resume: it is led back, and held again if it goes farther "
        "out; where it has to go there, widen the workspace in the robot file",
    )
    TENDON_SLACK = (
        "tendon_slack", _H, 0.2, _SELF,
        "a tendon has gone slack",
        "disarm: the drives hold their spools; put it back on its spool and wind it up by hand "
        "until it is tight, then arm, and start again",
    )
    NOT_RECORDED = (
        "not_recorded", _H, 0.0, _SELF,
        "the motion is not recorded: the recorder could not be started again, or has not been able"
        " to write for so long that parts are missing",
        "see to what the detail says; then resume, or, where that is refused, disarm and arm: that"
        " begins a new recording",
    )
    DISK_FULL = (
        "disk_full", _H, 0.0, _SELF,
        "no space is left where recordings go",
        "delete or move old recordings, then resume",
    )
    OPERATOR_HOLD = (
        "operator_hold", _H, 0.0, _RESUME,
        "the operator has asked for a hold",
        "resume, or stop",
    )

    TRACKER_GONE = (
        "tracker_gone", _D, 0.0, _SELF,
        "the tracker has been silent for so long that it will not come back soon",
        "check its power and its cable, then arm again",
    )
    LEASE_ABANDONED = (
        "lease_abandoned", _D, 0.0, _SELF,
        "the robot was energised and nobody was in control",
        "take the lease, then arm again",
    )
    ARMING_FAILED = (
        "arming_failed", _D, 0.0, _SELF,
        "the drives did not all come on in time",
        "see which one; look at its display, then arm again",
    )

    FOREIGN_MASTER = (
        "foreign_master", _F, 0.0, _CLEAR,
        "somebody else commands the drives on the bus",
        "end the other program, or take its adapter off the bus; then clear",
    )
    BUS_GONE = (
        "bus_gone", _F, 0.0, _CLEAR,
        "the CAN interface went away while the drives were on",
        "plug the adapter in again; it is reopened by itself; then clear",
    )
    BUS_OFF = (
        "bus_off", _F, 0.0, _CLEAR,
        "the CAN interface has taken itself off the bus after too many errors",
        "check cable, bit rate and terminating resistors, then clear",
    )
    DRIVE_FAULT = (
        "drive_fault", _F, 0.0, _CLEAR,
        "a drive has switched itself off",
        "the code is named; remove the cause, then clear",
    )
    DRIVE_FOLLOWING_ERROR = (
        "drive_following_error", _F, 0.0, _CLEAR,
        "an axis does not follow its target",
        "look for something that blocks it, check its load, then clear",
    )
    DRIVE_NOT_ENABLED = (
        "drive_not_enabled", _F, 0.0, _CLEAR,
        "a drive does not do what it is told",
        "look for an open enable input or brake, or a fault at its display, then clear",
    )
    NODE_LOST = (
        "node_lost", _F, 0.0, _CLEAR,
        "a drive is no longer heard",
        "check its power and its plug, then clear",
    )
    NODE_RESET = (
        "node_reset", _F, 0.0, _CLEAR,
        "a drive has started anew by itself",
        "check its supply for dips, then clear; it is set up again by itself",
    )
    LOOP_STALLED = (
        "loop_stalled", _F, 0.0, _CLEAR,
        "the control loop stood still for so long that the drives had to stop by themselves",
        "see what the time was spent on, then clear",
    )
    TENDON_OVER_TENSION = (
        "tendon_over_tension", _F, 0.05, _CLEAR,
        "a tendon is pulled harder than it may be",
        "release it by hand, look for what blocks the body, then clear",
    )
    INTERNAL_ERROR = (
        "internal_error", _F, 0.0, _CLEAR,
        "the daemon has met an error of its own",
        "keep the recording and report it with the detail; then clear",
    )

    DRIVE_NO_VOLTAGE = (
        "drive_no_voltage", _E, 0.0, _CLEAR,
        "the motor voltage is gone: the external chain is open, or the supply failed",
        "make sure that it is safe, close the chain or switch the supply on, then clear",
    )
# fmt: on

_BY_NAME: Final = {one.value: one for one in Cause}


def cause(name: str) -> Cause:
    """The cause of that name. Raises KeyError."""
    return _BY_NAME[name]


def causes_as_markdown(causes: Iterable[CauseRow] = Cause) -> str:
    """The table as people read it, worst first."""
    rows = [
        "| cause | severity | after | goes | what it means | what helps |",
        "|---|---|---|---|---|---|",
    ]
    for row in sorted(causes, key=lambda one: -one.severity):
        after = f"{row.debounce_s:g} s" if row.debounce_s else "at once"
        rows.append(
            f"| `{row.value}` | {row.severity.name} | {after} | {row.clears.value} "
            f"| {row.text} | {row.remedy} |"
        )
    return "\n".join(rows) + "\n"
