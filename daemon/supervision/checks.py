"""The one home of causes: every cause is raised, and withdrawn, by a line of this module.

What is seen comes in as plain facts: conditions of the drivers, what the service knows before each
cycle (`Watched`), and what the control step reports. Nothing here decides what follows from a
cause; `safety.causes` has that.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from config.control import Supervision
from daemon.supervision.condition_causes import CAUSE_OF_CONDITION, ONCE
from daemon.supervision.power import Power, PowerPhase
from drivers.axis_scale import count_limits
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.node import NodeState
from drivers.conditions import ConditionChange
from safety.causes import Cause
from safety.failsafe import Failsafe

# Whether an axis stays behind its target, seen from here.
#
# The gate lets no target run further ahead of an axis than the drive's own window, so a jammed
# axis would make the gate hold back for ever and the drive would never complain.


_SHARE_OF_WINDOW: Final = 0.8
"""Of the drive's window, to which the gate lets a target run ahead: below it, or it would never be
reached; and far above what a free axis stays behind. Chosen."""


class _FollowingError:
    """Watches all axes."""

    def __init__(self, channels: Sequence[AxisChannel]) -> None:
        self._channels = channels
        self._allowed = [_SHARE_OF_WINDOW * count_limits(c.axis).max_lag for c in channels]
        self._allowed_ns = [round(c.axis.following_error_time_s * 1e9) for c in channels]
        self._since_ns: list[int | None] = [None] * len(channels)

    def behind(self, targets: Sequence[int], t_ns: int) -> set[int]:
        """The places of axes that have been too far from their targets, in counts, for too long."""
        behind, since_ns = set(), self._since_ns
        for place, channel in enumerate(self._channels):
            far = abs(targets[place] - channel.position_counts) > self._allowed[place]
            if far and channel.following:
                began_ns = since_ns[place]
                if began_ns is None:
                    began_ns = since_ns[place] = t_ns
                if t_ns - began_ns > self._allowed_ns[place]:
                    behind.add(place)
            else:
                since_ns[place] = None
        return behind


_LED_BACK_MM: Final = 2.0
"""How much farther outside a tip may go that is led back: a lag's worth of the first motions, and
the tracker's noise. Chosen."""


class WorkspaceMonitor:
    """Lets no motion lead the tip out of the workspace, but back into it.

    What is outside when a motion begins, because a load or a hand has drawn it there, may go hardly
    farther; and once it has come nearer, not so far again.
    """

    def __init__(self) -> None:
        self._may_mm = 0.0
        """So far outside it may be."""

    def leaves(self, outside_mm: float, moving: bool) -> bool:
        """Whether the motion leads out, of a tip that is so far outside; negative: inside. Of no
        number nobody knows, so it does."""
        leaves = moving and not outside_mm <= self._may_mm
        here_mm = max(outside_mm + _LED_BACK_MM, 0.0)
        if moving:
            self._may_mm = min(self._may_mm, here_mm)
        else:
            self._may_mm = here_mm if outside_mm > 0.0 else 0.0
        return leaves


_LOW_TO_FULL: Final = 0.1
"""Of the room under which it is warned: a tenth of that is as good as none. Chosen."""


@dataclass(slots=True)
class Watched:
    """What the service knows, kept up to date by its monitors."""

    tracking: bool = False
    """Whether the tracker is set up and follows its tools."""
    tip_age_s: float | None = None
    """Since the last believed measurement; None: there was none yet."""
    tip_quality: float = 0.0
    body_failing: str = ""
    """What the package that an emulated body comes from does wrong; empty: nothing."""
    outside_mm: float = -math.inf
    """How far the tip is outside the workspace, where no reference may lead it; negative: how far
    it is from its walls."""
    targets: Sequence[int] = ()
    """Of each axis, in counts, in the order of the actuation vector; empty: not known yet."""
    cycles_missed: bool = False
    """Whether the loop often misses its time."""
    lease_held: bool = False
    lease_missing_s: float = 0.0
    setpoint_age_s: float | None = None
    """None: no set-points are being followed."""
    obstacles_late: str = ""
    """Whose streams of moving obstacles have stopped; empty: none."""
    tensions_n: Sequence[tuple[str, float, float, float]] = ()
    """Of each tendon: its axis, its tension, and what it must stay between."""
    minute_risk: str = ""
    """How much more was risked in the last minute than may be; empty: it was not."""
    path_risk: str = ""
    """How much more is risked on the rest of a planned path than may be; empty: it is not."""
    near_at_rest: str = ""
    """Where something is too near to a body that stands; empty: nowhere, or it is not known."""
    recorder_failed: str = ""
    recording_lost: str = ""
    """Why nothing is recorded, and will not be; empty: it is, or will be in a moment."""
    recordings_dropped: int = 0
    disk_free_mb: float | None = None


class GateReport(NamedTuple):
    """What the gate did with one step; by default it let it through."""

    too_high: bool = False
    """Refused: its risk is above the threshold."""
    unavailable: bool = False
    """Refused: its risk is not known."""
    risk_detail: str = ""
    stuck: bool = False
    """The limits left practically nothing of it."""
    limits: str = ""
    """Which limits."""
    leaving: bool = False
    """Let through with a risk above the threshold: it leads away from what is there already."""
    kept_away: bool = False
    """Turned aside, with the tip far from its reference."""


NOTHING_REFUSED: Final = GateReport()


class Checks:
    """Raises causes from `Watched`, from the drives themselves, and from what it is told."""

    def __init__(
        self,
        failsafe: Failsafe,
        settings: Supervision,
        buses: Sequence[DriveBus],
        power: Power,
        react: Callable[[int], None],
    ) -> None:
        """react: has the robot's state follow at once from a cause that is over in a moment."""
        self.watched = Watched()
        self._failsafe = failsafe
        self._set = failsafe.set
        self._settings = settings
        self._buses = buses
        self._power = power
        self._react = react
        self._dropped_before = 0
        self._channels = in_order(buses)
        self._following_error = _FollowingError(self._channels)
        self._workspace = WorkspaceMonitor()
        self._nodes = [
            (node, f"{node.subject} state") for bus in buses for node in bus.nodes.values()
        ]

    # What the drivers say.

    def condition_changed(self, change: ConditionChange) -> None:
        """A driver says that something is wrong, or is no longer."""
        cause = CAUSE_OF_CONDITION[change.active.condition]
        # Several conditions may raise one cause about one subject: each is kept apart.
        subject = f"{change.active.subject} {change.active.condition.name}"
        detail = ": ".join(filter(None, (change.active.condition.text, change.active.detail)))
        self._set(cause, change.present, change.t_ns, subject, detail)
        if change.active.condition in ONCE:
            self._set(cause, False, change.t_ns, subject)

    # What is looked at in every bus cycle.

    def cycle(self, t_ns: int, energised: bool, moving: bool, homing: bool) -> None:
        """energised: drives are, or are being, powered. moving: a reference is followed. homing:
        drives move by themselves."""
        self._check_tracker(t_ns, energised)
        self._check_drives(t_ns)
        self._check_following(t_ns)
        self._check_operator(t_ns, energised, moving)
        self._check_recorder(t_ns, energised)
        self._check_tendons(t_ns, energised and not homing)
        watched = self.watched
        self._set(Cause.LOOP_SLOW, watched.cycles_missed, t_ns, "loop")
        outside = self._workspace.leaves(watched.outside_mm, moving)
        self._set(Cause.OUT_OF_WORKSPACE, outside, t_ns, "tip")
        near = watched.near_at_rest if energised and not (moving or homing) else ""
        for cause, words in (
            (Cause.NEAR_AT_REST, near),
            (Cause.MINUTE_RISK_TOO_HIGH, watched.minute_risk if energised else ""),
            (Cause.PATH_RISK_TOO_HIGH, watched.path_risk if energised else ""),
        ):
            self._set(cause, bool(words), t_ns, "gate", words)
        stopped = watched.obstacles_late
        self._set(Cause.OBSTACLES_LATE, bool(stopped), t_ns, "obstacles", stopped)

    def gap(self, gap_s: float, t_ns: int, why: str) -> None:
        """The loop was away for `gap_s`."""
        settings = self._settings
        stalled = gap_s > settings.loop_fault_after_s
        late = gap_s > settings.loop_hold_after_s
        detail = f"{gap_s * 1e3:.0f} ms; {why}" if late else ""
        self._set(Cause.LOOP_STALLED, stalled, t_ns, "loop", detail)
        self._set(Cause.LOOP_LATE, late, t_ns, "loop", detail)

    def _check_tracker(self, t_ns: int, energised: bool) -> None:
        settings, watched = self._settings, self.watched
        age_s = watched.tip_age_s
        self._set(Cause.TRACKER_NOT_READY, not watched.tracking, t_ns, "tip")
        # Of a tracker that is not set up yet, that is all there is to say.
        expected = watched.tracking or energised
        late = age_s is None or not age_s <= settings.tracker_hold_after_s
        gone = age_s is None or not age_s <= settings.tracker_fault_after_s
        poor = not watched.tip_quality >= settings.tracker_quality
        # Ages change with every cycle: a detail that does too would make every cycle an event.
        self._set(Cause.TRACKER_LATE, expected and late, t_ns, "tip")
        self._set(Cause.TRACKER_GONE, energised and gone, t_ns, "tip")
        self._set(Cause.TRACKER_QUALITY, expected and poor, t_ns, "tip")
        failing = watched.body_failing
        self._set(Cause.BODY_FAILED, bool(failing), t_ns, "body", failing)

    def _check_drives(self, t_ns: int) -> None:
        enabled = self._power.phase is PowerPhase.ENABLED
        for bus in self._buses:
            self._set(Cause.BUS_NOT_OPEN, not bus.connected, t_ns, bus.name)
        watching = self._failsafe.watching
        for node, subject in self._nodes:
            not_ready = node.state is not NodeState.OPERATIONAL
            if not_ready or watching:
                self._set(Cause.NODE_NOT_READY, not_ready, t_ns, subject)
            for channel in node.channels:
                dropped = enabled and not channel.following
                if dropped or watching:
                    detail = channel.state.value if dropped else ""
                    self._set(Cause.DRIVE_NOT_ENABLED, dropped, t_ns, channel.axis.name, detail)
                lost = not (not_ready or channel.referenced)
                if lost or watching:
                    self._set(Cause.NOT_REFERENCED, lost, t_ns, channel.axis.name)
        arming = self._power.phase is PowerPhase.ENABLING
        late = arming and self._power.since_s(t_ns) > self._settings.arm_within_s
        self._set(Cause.ARMING_FAILED, late, t_ns, "drives", self._not_enabled() if late else "")

    def _check_operator(self, t_ns: int, energised: bool, moving: bool) -> None:
        settings, watched = self._settings, self.watched
        lost = energised and not watched.lease_held
        abandoned = lost and watched.lease_missing_s > settings.lease_disarm_after_s
        self._set_lease(lost, abandoned, t_ns)
        age_s = watched.setpoint_age_s
        late = moving and age_s is not None and not age_s <= settings.setpoint_hold_after_s
        self._set(Cause.SETPOINT_LATE, late, t_ns, "operator")

    def _check_recorder(self, t_ns: int, energised: bool) -> None:
        watched = self.watched
        free_mb, least_mb = watched.disk_free_mb, self._settings.disk_free_mb
        low = free_mb is not None and free_mb < least_mb
        full = free_mb is not None and free_mb < least_mb * _LOW_TO_FULL
        detail = f"{free_mb:.0f} MB free" if low else ""
        self._set(Cause.DISK_LOW, low, t_ns, "recorder", detail)
        self._set(Cause.DISK_FULL, full, t_ns, "recorder", detail)
        failed = watched.recorder_failed
        self._set(Cause.RECORDER_FAILED, bool(failed), t_ns, "recorder", failed)
        lost = watched.recording_lost if self._settings.recording_required and energised else ""
        self._set(Cause.NOT_RECORDED, bool(lost), t_ns, "recorder", lost)
        more = watched.recordings_dropped > self._dropped_before
        self._dropped_before = watched.recordings_dropped
        self._set(Cause.RECORDING_DROPPED, more, t_ns, "recorder")

    def _check_following(self, t_ns: int) -> None:
        targets = self.watched.targets
        behind = self._following_error.behind(targets, t_ns) if targets else set()
        if not (behind or self._failsafe.watching):
            return
        for place, channel in enumerate(self._channels):
            detail = "it does not move" if place in behind else ""
            name = channel.axis.name
            self._set(Cause.DRIVE_FOLLOWING_ERROR, place in behind, t_ns, name, detail)

    def _check_tendons(self, t_ns: int, pulled: bool) -> None:
        """pulled: nobody but the loop moves them, and it keeps them tight."""
        for axis, tension_n, lowest_n, highest_n in self.watched.tensions_n:
            slack = pulled and tension_n < lowest_n
            over = tension_n > highest_n
            detail = f"{tension_n:.1f} N" if slack or over else ""
            self._set(Cause.TENDON_SLACK, slack, t_ns, axis, detail)
            self._set(Cause.TENDON_OVER_TENSION, over, t_ns, axis, detail)

    def _not_enabled(self) -> str:
        return ", ".join(
            f"{channel.axis.name} is {channel.state.value}"
            for bus in self._buses
            for channel in bus.channels
            if not channel.following
        )

    # What the control step reports.

    def body_not_as_modelled(self, present: bool, t_ns: int) -> None:
        """The measured tip is not where the model of the body has it."""
        self._set(Cause.BODY_NOT_AS_MODELLED, present, t_ns, "tip")

    def gate(self, t_ns: int, report: GateReport) -> None:
        """What the gate did with the present step."""
        detail = report.risk_detail
        self._set(Cause.RISK_TOO_HIGH, report.too_high, t_ns, "gate", detail)
        self._set(Cause.RISK_UNAVAILABLE, report.unavailable, t_ns, "gate", detail)
        self._set(Cause.GATE_REFUSED, report.stuck, t_ns, "gate", report.limits)
        self._set(Cause.GIVING_WAY, report.leaving, t_ns, "gate")
        self._set(Cause.KEPT_AWAY, report.kept_away, t_ns, "gate", detail)

    def controller_failed(self, t_ns: int, detail: str) -> None:
        """The controller gave no usable answer."""
        self._momentary(Cause.CONTROLLER_FAILED, t_ns, detail)

    def tracking_diverges(self, t_ns: int, detail: str) -> None:
        """The tip does not get to its reference, or goes away from it."""
        self._momentary(Cause.TRACKING_DIVERGES, t_ns, detail)

    def tip_jumped(self, t_ns: int, detail: str) -> None:
        """The tip is somewhere else than a frame before, and stays there."""
        self._momentary(Cause.TIP_JUMPED, t_ns, detail, "tip")

    # What operators and the service itself report.

    def operator_hold(self, t_ns: int) -> None:
        """The operator has asked for a hold."""
        self._momentary(Cause.OPERATOR_HOLD, t_ns, subject="operator")

    def lease_held(self, t_ns: int) -> None:
        """Somebody has the lease, from now on."""
        self._set_lease(False, False, t_ns)
        self._react(t_ns)

    def _set_lease(self, lost: bool, abandoned: bool, t_ns: int) -> None:
        self._set(Cause.LEASE_LOST, lost, t_ns, "operator")
        self._set(Cause.LEASE_ABANDONED, abandoned, t_ns, "operator")

    def internal_error(self, t_ns: int, detail: str) -> None:
        """Something that cannot happen has happened."""
        self._momentary(Cause.INTERNAL_ERROR, t_ns, detail)

    def real_time(self, t_ns: int, refused: Sequence[str]) -> None:
        """refused: which real-time rights the operating system does not give."""
        self._set(Cause.REAL_TIME_DEGRADED, bool(refused), t_ns, "loop", "; ".join(refused))

    def _momentary(self, cause: Cause, t_ns: int, detail: str = "", subject: str = "loop") -> None:
        """It is over as soon as it is there. What stays of it, the table says."""
        self._set(cause, True, t_ns, subject, detail)
        self._set(cause, False, t_ns, subject)
        self._react(t_ns)


def in_order(buses: Sequence[DriveBus]) -> list[AxisChannel]:
    """All axes, in the order of the actuation vector."""
    return sorted((channel for bus in buses for channel in bus.channels), key=lambda c: c.index)
