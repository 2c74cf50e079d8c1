"""Looks at what the loop knows, every cycle, and raises what is late, missing or too much."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from config.control import Supervision
from daemon.supervision.power import Phase, Power
from drivers.axis_scale import count_limits
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.node import NodeState
from safety.failsafe import Failsafe

# Whether an axis stays behind its target, seen from here.
#
# The gate lets no target run further ahead of an axis than the drive's own window, so a jammed
# axis would make the gate hold back for ever and the drive would never complain.


_SHARE_OF_WINDOW: Final = 0.8


class FollowingError:
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


NOT_REFERENCED: Final = "not_referenced"
_LOW_TO_FULL: Final = 0.1


@dataclass(slots=True)
class Watched:
    """What the watchdogs look at. The loop keeps it up to date."""

    tracking: bool = False
    """Whether the tracker is set up and follows its tools."""
    tip_age_s: float | None = None
    """Since the last believed measurement; None: there was none yet."""
    tip_quality: float = 0.0
    lease_held: bool = False
    lease_missing_s: float = 0.0
    setpoint_age_s: float | None = None
    """None: no set-points are being followed."""
    tensions_n: Sequence[tuple[str, float, float, float]] = ()
    """Of each tendon: its axis, its tension, and what it must stay between."""
    recorder_failed: str = ""
    recording_lost: str = ""
    """Why nothing is recorded, and will not be; empty: it is, or will be in a moment."""
    recordings_dropped: int = 0
    disk_free_mb: float | None = None


class Watchdogs:
    """Sets causes from `Watched` and from the drives themselves."""

    def __init__(
        self, failsafe: Failsafe, settings: Supervision, buses: Sequence[DriveBus], power: Power
    ) -> None:
        self._failsafe = failsafe
        self._set = failsafe.set
        self._settings = settings
        self._buses = buses
        self._power = power
        self._dropped_before = 0
        self._nodes = [
            (node, f"{node.subject} state") for bus in buses for node in bus.nodes.values()
        ]

    def check(
        self, watched: Watched, t_ns: int, energised: bool, moving: bool, homing: bool
    ) -> None:
        """energised: drives are, or are being, powered. moving: a reference is followed. homing:
        drives move by themselves."""
        self._check_tracker(watched, t_ns, energised)
        self._check_drives(t_ns)
        self._check_operator(watched, t_ns, energised, moving)
        self._check_recorder(watched, t_ns, energised)
        for axis, tension_n, lowest_n, highest_n in watched.tensions_n:
            slack = energised and not homing and tension_n < lowest_n
            over = tension_n > highest_n
            detail = f"{tension_n:.1f} N" if slack or over else ""
            self._set("tendon_slack", slack, t_ns, axis, detail)
            self._set("tendon_over_tension", over, t_ns, axis, detail)

    def check_gap(self, gap_s: float, t_ns: int, why: str) -> None:
        """The loop was away for `gap_s`."""
        settings = self._settings
        stalled = gap_s > settings.loop_fault_after_s
        late = gap_s > settings.loop_hold_after_s
        detail = f"{gap_s * 1e3:.0f} ms; {why}" if late else ""
        self._set("loop_stalled", stalled, t_ns, "loop", detail)
        self._set("loop_late", late, t_ns, "loop", detail)

    def _check_tracker(self, watched: Watched, t_ns: int, energised: bool) -> None:
        settings, age_s = self._settings, watched.tip_age_s
        self._set("tracker_not_ready", not watched.tracking, t_ns, "tip")
        # Of a tracker that is not set up yet, that is all there is to say.
        expected = watched.tracking or energised
        late = age_s is None or not age_s <= settings.tracker_hold_after_s
        gone = age_s is None or not age_s <= settings.tracker_fault_after_s
        poor = not watched.tip_quality >= settings.tracker_quality
        # Ages change with every cycle: a detail that does too would make every cycle an event.
        self._set("tracker_late", expected and late, t_ns, "tip")
        self._set("tracker_gone", energised and gone, t_ns, "tip")
        self._set("tracker_quality", expected and poor, t_ns, "tip")

    def _check_drives(self, t_ns: int) -> None:
        enabled = self._power.phase is Phase.ENABLED
        for bus in self._buses:
            self._set("bus_not_open", not bus.connected, t_ns, bus.name)
        watching = self._failsafe.watching
        for node, subject in self._nodes:
            not_ready = node.state is not NodeState.OPERATIONAL
            if not_ready or watching:
                self._set("node_not_ready", not_ready, t_ns, subject)
            for channel in node.channels:
                dropped = enabled and not channel.following
                if dropped or watching:
                    detail = channel.state.value if dropped else ""
                    self._set("drive_not_enabled", dropped, t_ns, channel.axis.name, detail)
                lost = not (not_ready or channel.referenced)
                if lost or watching:
                    self._set(NOT_REFERENCED, lost, t_ns, channel.axis.name)
        arming = self._power.phase is Phase.ENABLING
        late = arming and self._power.since_s(t_ns) > self._settings.arm_within_s
        self._set("arming_failed", late, t_ns, "drives", self._not_enabled() if late else "")

    def _check_operator(self, watched: Watched, t_ns: int, energised: bool, moving: bool) -> None:
        settings = self._settings
        lost = energised and not watched.lease_held
        abandoned = lost and watched.lease_missing_s > settings.lease_disarm_after_s
        self._set("lease_lost", lost, t_ns, "operator")
        self._set("lease_abandoned", abandoned, t_ns, "operator")
        age_s = watched.setpoint_age_s
        late = moving and age_s is not None and not age_s <= settings.setpoint_hold_after_s
        self._set("setpoint_late", late, t_ns, "operator")

    def _check_recorder(self, watched: Watched, t_ns: int, energised: bool) -> None:
        free_mb, least_mb = watched.disk_free_mb, self._settings.disk_free_mb
        low = free_mb is not None and free_mb < least_mb
        full = free_mb is not None and free_mb < least_mb * _LOW_TO_FULL
        detail = f"{free_mb:.0f} MB free" if low else ""
        self._set("disk_low", low, t_ns, "recorder", detail)
        self._set("disk_full", full, t_ns, "recorder", detail)
        failed = watched.recorder_failed
        self._set("recorder_failed", bool(failed), t_ns, "recorder", failed)
        lost = watched.recording_lost if self._settings.recording_required and energised else ""
        self._set("not_recorded", bool(lost), t_ns, "recorder", lost)
        more = watched.recordings_dropped > self._dropped_before
        self._dropped_before = watched.recordings_dropped
        self._set("recording_dropped", more, t_ns, "recorder")

    def _not_enabled(self) -> str:
        return ", ".join(
            f"{channel.axis.name} is {channel.state.value}"
            for bus in self._buses
            for channel in bus.channels
            if not channel.following
        )
